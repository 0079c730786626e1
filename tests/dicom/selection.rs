//! Which files of a folder are a series, and which series is read.

use std::path::Path;

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use glam::DVec3;
use rhinoplan::io::dicom::{Folder, SeriesState, is_dicom};

use crate::builder::{Dir, IDENTITY, SERIES, SliceFile, expected, hus, read, stack};

const OTHER: &str = "1.2.826.0.1.3680043.8.498.2";

fn of_series(uid: &str, mut files: Vec<SliceFile>) -> Vec<SliceFile> {
    for file in &mut files {
        file.text(tags::SERIES_INSTANCE_UID, VR::UI, uid);
    }
    files
}

#[test]
fn two_series_are_listed_and_one_is_chosen() {
    let mut files = stack(3);
    files.extend(of_series(OTHER, stack(5)));
    let dir = Dir::of(&files);
    let message = dir.error();
    assert!(
        message.contains("holds 2 CT series; choose one"),
        "{message}"
    );
    for line in [
        format!("{SERIES}  4       CT            3  6×5        1×1.5×2"),
        format!("{OTHER}  4       CT            5  6×5        1×1.5×2"),
    ] {
        assert!(message.contains(&line), "{message}");
    }
    for (_, _, text) in IDENTITY {
        assert!(!message.contains(text), "{text}: {message}");
    }
    assert_eq!(
        hus(&read(dir.path(), Some(SERIES)).unwrap().volume),
        expected(3)
    );
    assert_eq!(
        hus(&read(dir.path(), Some(OTHER)).unwrap().volume),
        expected(5)
    );
    let message = read(dir.path(), Some("1.2.3")).unwrap_err().to_string();
    assert!(
        message.contains("no CT series with the UID 1.2.3"),
        "{message}"
    );
    assert!(message.contains(OTHER), "{message}");
}

#[test]
fn a_file_stands_for_its_series() {
    let mut files = stack(3);
    files.extend(of_series(OTHER, stack(5)));
    let dir = Dir::of(&files);
    let of_file = |name: &str| read(&dir.path().join(name), None);
    assert_eq!(hus(&of_file("0.dcm").unwrap().volume), expected(3));
    assert_eq!(hus(&of_file("7.dcm").unwrap().volume), expected(5));
    let message = read(&dir.path().join("0.dcm"), Some(OTHER))
        .unwrap_err()
        .to_string();
    assert!(
        message.contains(&format!("belongs to the series {SERIES}")),
        "{message}"
    );
    dir.write("note.txt", b"hello");
    let message = of_file("note.txt").unwrap_err().to_string();
    assert!(
        message.contains("not a slice of a CT series, but no DICOM file"),
        "{message}"
    );
    assert!(is_dicom(&dir.path().join("0.dcm")) && is_dicom(dir.path()));
    assert!(!is_dicom(&dir.path().join("note.txt")) && !is_dicom(Path::new("gone")));
}

#[test]
fn whatever_else_lies_in_the_folder_is_left_out_and_told_of() {
    let dir = Dir::of(&stack(4));
    let like = |change: &dyn Fn(&mut SliceFile)| {
        let mut file = of_series(OTHER, stack(1)).remove(0);
        change(&mut file);
        file.bytes()
    };
    let scout = like(&|file| {
        file.text(
            tags::IMAGE_TYPE,
            VR::CS,
            "ORIGINAL\\PRIMARY\\LOCALIZER\\CT_SOM5 TOP",
        )
        .oriented(DVec3::Y, DVec3::NEG_Z);
    });
    dir.write("scout", &scout);
    let class = |uid: &'static str| {
        like(&move |file| {
            file.text(tags::SOP_CLASS_UID, VR::UI, uid);
        })
    };
    dir.write("screen", &class(uids::SECONDARY_CAPTURE_IMAGE_STORAGE));
    dir.write("enhanced", &class(uids::ENHANCED_CT_IMAGE_STORAGE));
    dir.write("class", &class(uids::RAW_DATA_STORAGE));
    let modality = |word: &'static str| {
        like(&move |file| {
            file.text(tags::MODALITY, VR::CS, word);
        })
    };
    dir.write("mr", &modality("MR"));
    dir.write("none", &modality(""));
    let frames = like(&|file| {
        file.text(tags::NUMBER_OF_FRAMES, VR::IS, "20");
    });
    dir.write("frames", &frames);
    dir.write("DICOMDIR", &dicomdir());
    dir.write("notes.txt", b"hello");
    dir.write("empty", b"");
    dir.write("z.zip", &[0x50; 1000]);
    std::fs::create_dir(dir.path().join("inner")).unwrap();
    std::fs::write(dir.path().join("inner/slice"), &scout).unwrap();

    assert_eq!(hus(&dir.read().unwrap().volume), expected(4));
    let folder = Folder::scan(dir.path()).unwrap();
    let lines = folder.series();
    assert_eq!(lines[0].state, SeriesState::Usable);
    assert_eq!(lines[0].files, 4);
    let told: Vec<String> = lines
        .iter()
        .skip(1)
        .map(|line| {
            assert_eq!(
                (line.state, line.uid.as_str()),
                (SeriesState::Skipped, OTHER)
            );
            format!("{} {}", line.files, line.because.as_ref().unwrap())
        })
        .collect();
    for what in [
        "1 a localizer",
        "1 a secondary capture",
        "2 of several frames (Enhanced CT)",
        "1 no CT image",
        "1 of modality MR",
        "1 of modality unknown",
    ] {
        assert!(
            told.iter().any(|line| line.starts_with(what)),
            "{what}: {told:?}"
        );
    }
    assert_eq!(told.len(), 6, "{told:?}");
    let others: Vec<String> = folder
        .others()
        .iter()
        .map(|other| format!("{} {} {}", other.files, other.because, other.first))
        .collect();
    assert_eq!(
        others,
        [
            "1 a DICOMDIR DICOMDIR",
            "3 no DICOM file empty",
            "1 a folder within the folder, which is not searched inner",
        ]
    );
    assert!(folder.table().contains("left out: a localizer"));
}

fn dicomdir() -> Vec<u8> {
    let meta = dicom_object::FileMetaTableBuilder::new()
        .transfer_syntax(uids::EXPLICIT_VR_LITTLE_ENDIAN)
        .media_storage_sop_class_uid("1.2.840.10008.1.3.10")
        .media_storage_sop_instance_uid("1.2.3");
    let object = dicom_object::InMemDicomObject::new_empty()
        .with_meta(meta)
        .unwrap();
    let mut bytes = Vec::new();
    object.write_all(&mut bytes).unwrap();
    bytes
}

#[test]
fn a_folder_without_a_ct() {
    let dir = Dir::new();
    let message = dir.error();
    assert!(
        message.contains("holds no CT series: it is empty"),
        "{message}"
    );
    dir.write("a.txt", b"hello");
    dir.write("b.txt", b"hello");
    let mut mr = stack(1).remove(0);
    mr.text(tags::MODALITY, VR::CS, "MR");
    dir.write("c", &mr.bytes());
    let message = dir.error();
    assert!(
        message.contains("2 files are no DICOM file, one file is of modality MR, not CT"),
        "{message}"
    );
    let gone = Folder::scan(&dir.path().join("gone"))
        .unwrap_err()
        .to_string();
    assert!(gone.contains("cannot be read"), "{gone}");
}

#[test]
fn an_enhanced_ct_alone_is_refused_by_its_name() {
    let mut file = stack(1).remove(0);
    file.text(tags::SOP_CLASS_UID, VR::UI, uids::ENHANCED_CT_IMAGE_STORAGE);
    let message = Dir::of(&[file]).error();
    assert!(message.contains("Enhanced CT"), "{message}");
}

#[test]
fn stacks_that_differ_under_one_uid() {
    let turned = |files: &mut Vec<SliceFile>| {
        for (k, file) in files.iter_mut().enumerate() {
            file.oriented(DVec3::Y, DVec3::NEG_Z)
                .at(DVec3::new(-2.0 * k as f64, 0.0, 0.0));
        }
    };
    let stretched = |files: &mut Vec<SliceFile>| {
        for file in files {
            file.text(tags::PIXEL_SPACING, VR::DS, "1.5\\1.01");
        }
    };
    type Change<'a> = &'a dyn Fn(&mut Vec<SliceFile>);
    let changes: [Change<'_>; 2] = [&turned, &stretched];
    for change in changes {
        let mut files = stack(4);
        let mut others = stack(3);
        change(&mut others);
        files.extend(others);
        let dir = Dir::of(&files);
        let message = dir.error();
        assert!(message.contains("under one UID are 2 stacks"), "{message}");
        assert_eq!(
            hus(&read(&dir.path().join("1.dcm"), None).unwrap().volume),
            expected(4)
        );
    }
}

#[test]
fn a_scout_view_that_does_not_say_so_is_left_out() {
    let mut files = stack(4);
    let mut scout = stack(1).remove(0);
    scout.oriented(DVec3::Y, DVec3::NEG_Z);
    files.push(scout);
    let dir = Dir::of(&files);
    assert_eq!(hus(&dir.read().unwrap().volume), expected(4));
    assert!(
        Folder::scan(dir.path())
            .unwrap()
            .table()
            .contains("left out: a single slice")
    );
}

#[test]
fn orientations_that_differ_in_their_last_digits_are_one() {
    let mut files = stack(4);
    files[1].oriented(
        DVec3::new(1.0, 0.00001, 0.0),
        DVec3::new(-0.00001, 1.0, 0.0),
    );
    assert_eq!(hus(&Dir::of(&files).read().unwrap().volume), expected(4));
}

#[test]
fn a_damaged_slice_is_an_error_and_that_of_another_series_is_not() {
    let mut files = stack(4);
    files[2].remove(tags::PIXEL_SPACING);
    let message = Dir::of(&files).error();
    assert!(
        message.contains("file `2.dcm` has no PixelSpacing (0028,0030)"),
        "{message}"
    );
    files[2] = of_series(OTHER, vec![files[2].clone()]).remove(0);
    files[2].at(DVec3::ZERO);
    files.extend(stack(4).drain(2..3));
    let dir = Dir::of(&files);
    assert_eq!(
        hus(&read(dir.path(), Some(SERIES)).unwrap().volume),
        expected(4)
    );
    let message = read(dir.path(), Some(OTHER)).unwrap_err().to_string();
    assert!(message.contains("PixelSpacing"), "{message}");
    // Without a choice it might be the one that is meant.
    let message = dir.error();
    assert!(message.contains("holds 2 CT series"), "{message}");
    assert!(
        message.contains("unusable: file `2.dcm` has no PixelSpacing"),
        "{message}"
    );
    // Of a file that cannot be read at all nobody knows where it belongs.
    let bytes = stack(1).remove(0).bytes();
    dir.write("cut", &bytes[..300]);
    let message = read(dir.path(), Some(SERIES)).unwrap_err().to_string();
    assert!(
        message.contains("file `cut` ends inside its header"),
        "{message}"
    );
}

#[test]
#[cfg(unix)]
fn pipes_sockets_and_dangling_links_do_not_block() {
    use std::os::unix::fs::symlink;
    let dir = Dir::of(&stack(3));
    let pipe = dir.path().join("pipe");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    assert!(made.unwrap().success());
    let _socket = std::os::unix::net::UnixListener::bind(dir.path().join("socket")).unwrap();
    symlink("gone", dir.path().join("link")).unwrap();
    symlink("loop", dir.path().join("loop")).unwrap();
    // A link to a slice elsewhere is a slice.
    let elsewhere = Dir::new();
    let last = elsewhere.write("fourth", &stack(4).remove(3).bytes());
    symlink(last, dir.path().join("fourth")).unwrap();
    let folder = Folder::scan(dir.path()).unwrap();
    let others = folder.others();
    let told = |what: &str| {
        others
            .iter()
            .find(|other| other.because.contains(what))
            .unwrap()
    };
    assert_eq!(told("pipe").files, 2);
    assert_eq!(told("leads nowhere").files, 2);
    assert_eq!(hus(&dir.read().unwrap().volume), expected(4));
}
