//! The program on a series: the same as on the same head in NIfTI, and nothing of the patient.

use std::collections::BTreeMap;
use std::io::Read;

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use glam::DVec3;
use rhinoplan::io::nifti;

use crate::builder::{IDENTITY, SERIES, SliceFile, rle, stack};
use crate::head::{DIMS, SPACING, nifti as head, plan};
use crate::process::Desk;

/// The head of the program's tests as slices.
fn slices() -> Vec<SliceFile> {
    let bytes = head();
    let samples: Vec<i16> = bytes[352..]
        .chunks_exact(2)
        .map(|pair| i16::from_le_bytes([pair[0], pair[1]]))
        .collect();
    let [nx, ny, _] = DIMS;
    let slice = |(z, plane): (usize, &[i16])| {
        let mut file = SliceFile::new([nx as u16, ny as u16], plane);
        file.at(DVec3::new(-48.0, -48.0, -36.0 + SPACING * z as f64))
            .text(tags::PIXEL_SPACING, VR::DS, "1.5\\1.5");
        file
    };
    samples
        .chunks_exact(nx * ny)
        .enumerate()
        .map(slice)
        .collect()
}

/// A desk with the head in the folder `Doe^Jane`.
fn desk(files: &[SliceFile]) -> Desk {
    let desk = Desk::new();
    for (index, file) in files.iter().enumerate() {
        // In no order.
        let name = (index * 7) % files.len();
        desk.write(&format!("Doe^Jane/IM{name:03}"), file.bytes());
    }
    desk
}

#[test]
fn a_run_on_slices_is_that_on_the_same_head_in_nifti() {
    let desk = desk(&slices());
    desk.write("ct.nii", head());
    desk.write("dicom.toml", plan("dicom", "Doe^Jane"));
    desk.write("nifti.toml", plan("nifti", "ct.nii"));
    let checked = desk.run(&["check", "dicom.toml"]).expect(0);
    assert!(
        checked.out.contains("64×64×48 voxels of 1.5×1.5×1.5 mm"),
        "{checked:?}"
    );
    desk.run(&["run", "dicom.toml", "nifti.toml"]).expect(0);
    let (ours, theirs) = (desk.results("out/dicom"), desk.results("out/nifti"));
    assert_eq!(
        ours.keys().collect::<Vec<_>>(),
        theirs.keys().collect::<Vec<_>>()
    );
    for (name, bytes) in &ours {
        let same = match name.as_str() {
            "run.json" | "table.md" => continue,
            gz if gz.ends_with(".nii.gz") && gz.contains("volume") => {
                let read = |plan: &str| {
                    let path = desk.path().join("out").join(plan).join(gz);
                    nifti::read(&path).unwrap().volume
                };
                read("dicom") == read("nifti")
            }
            _ if name.contains("displacement") => {
                inflate(bytes)[352..] == inflate(&theirs[name])[352..]
            }
            _ => bytes == &theirs[name],
        };
        assert!(same, "{name}");
    }
    let record = |plan: &str| desk.json(&format!("out/{plan}/run.json"));
    let (ours, theirs) = (record("dicom"), record("nifti"));
    assert_eq!(ours["candidates"], theirs["candidates"]);
    assert_eq!(ours["inputs"]["ct"]["source"], "dicom");
    assert_eq!(ours["inputs"]["ct"]["grid"], theirs["inputs"]["ct"]["grid"]);
    assert_eq!(ours["inputs"]["ct"]["stored_orientation"], "LPS");
}

fn inflate(bytes: &[u8]) -> Vec<u8> {
    let mut inflated = Vec::new();
    let mut packed = flate2::read::MultiGzDecoder::new(bytes);
    packed.read_to_end(&mut inflated).unwrap();
    inflated
}

#[test]
fn nothing_of_the_patient_reaches_an_output() {
    let desk = desk(&slices());
    desk.write("plan.toml", plan("private", "Doe^Jane"));
    let ran = desk.run(&["run", "plan.toml", "--json"]).expect(0);
    let mut outputs: BTreeMap<String, Vec<u8>> = desk.files("out");
    assert!(outputs.len() > 8);
    let packed: Vec<(String, Vec<u8>)> = outputs
        .iter()
        .filter(|(name, _)| name.ends_with(".gz"))
        .map(|(name, bytes)| (format!("inflated {name}"), inflate(bytes)))
        .collect();
    outputs.extend(packed);
    outputs.insert("stdout".to_owned(), ran.out.into_bytes());
    outputs.insert("stderr".to_owned(), ran.err.into_bytes());
    let sop = "1.2.826.0.1.3680043.8.498";
    let secrets = IDENTITY.iter().map(|(_, _, text)| *text);
    for secret in secrets.chain([SERIES, sop, "Doe", "Jane", "IM001"]) {
        for (name, bytes) in &outputs {
            let found = bytes
                .windows(secret.len())
                .any(|piece| piece == secret.as_bytes());
            assert!(!found, "{secret} in {name}");
        }
    }
    // `info` shows the UID, which is there to choose by, and no name.
    let info = desk.run(&["info", "Doe^Jane"]).expect(0).out;
    assert!(info.contains(SERIES));
    for (_, _, text) in IDENTITY {
        assert!(!info.contains(text), "{text}");
    }
}

#[test]
fn info_of_a_folder() {
    let desk = desk(&slices());
    desk.write("Doe^Jane/notes.txt", "hello");
    let out = desk.run(&["info", "Doe^Jane"]).expect(0).out;
    let (start, digest) = out.rsplit_once("SHA-256      ").unwrap();
    assert_eq!(digest.trim().len(), 64);
    assert_eq!(
        start,
        "  series                       number  modality  files  size       spacing (mm)\n  \
         1.2.826.0.1.3680043.8.498.1  4       CT           48  64×64      1.5×1.5×1.5\n  \
         not in a series: `notes.txt`: no DICOM file\n\
         size         64 × 64 × 48 voxels (left, posterior, superior)\n\
         spacing      1.5 × 1.5 × 1.5 mm\n\
         extent       96.0 × 96.0 × 72.0 mm\n\
         stored as    LPS, i16 (slope 1, intercept 0)\n\
         position     from 48 slices; first voxel at -48.000, -48.000, -36.000 mm (LPS)\n\
         obliquity    0.00°\n\
         range        -1000 to 50 HU\n"
    );
    let document = desk
        .run(&["info", "Doe^Jane/IM000", "--json"])
        .expect(0)
        .document();
    assert_eq!(document["ct"]["source"], "dicom");
    assert_eq!(document["ct"]["sha256"], digest.trim());
    assert_eq!(document["series"][0]["uid"], SERIES);
    assert_eq!(document["series"][0]["files"], 48);
    assert_eq!(document["series"][0]["state"], "usable");
    assert_eq!(document["other_files"][0]["first"], "notes.txt");
}

#[test]
fn several_series_are_chosen_among_by_info_and_by_plans() {
    let mut files = slices();
    let other = "1.2.826.0.1.3680043.8.498.2";
    files.extend(stack(3).into_iter().map(|mut file| {
        file.text(tags::SERIES_INSTANCE_UID, VR::UI, other);
        file
    }));
    let desk = desk(&files);
    let listed = desk.run(&["info", "Doe^Jane"]).expect(0);
    assert!(
        listed.out.contains(SERIES) && listed.out.contains(other),
        "{listed:?}"
    );
    assert!(listed.err.contains("--series UID"), "{listed:?}");
    let shown = desk.run(&["info", "Doe^Jane", "--series", other]).expect(0);
    assert!(
        shown.out.contains("size         6 × 5 × 3 voxels"),
        "{shown:?}"
    );
    let wrong = desk.run(&["info", "Doe^Jane", "--series", "1.2"]).expect(3);
    assert!(
        wrong.err.contains("no CT series with the UID 1.2"),
        "{wrong:?}"
    );

    desk.write("plan.toml", plan("open", "Doe^Jane"));
    for command in [&["check"][..], &["run"], &["run", "--dry-run"]] {
        let ran = desk.run(&[command, &["plan.toml"]].concat()).expect(3);
        assert!(ran.err.contains("holds 2 CT series"), "{ran:?}");
    }
    let chosen = format!("\"Doe^Jane\"\nseries = \"{SERIES}\"");
    let text = plan("chosen", "Doe^Jane").replace("\"Doe^Jane\"", &chosen);
    desk.write("plan.toml", &text);
    desk.run(&["run", "plan.toml"]).expect(0);
    let record = std::fs::read_to_string(desk.path().join("out/chosen/run.json")).unwrap();
    assert!(!record.contains(SERIES));

    desk.write("ct.nii", head());
    desk.write("plan.toml", text.replace("Doe^Jane", "ct.nii"));
    let ran = desk.run(&["check", "plan.toml"]).expect(3);
    assert!(
        ran.err.contains("`ct.series` chooses nothing in it"),
        "{ran:?}"
    );
}

#[test]
fn a_series_is_pinned_whatever_its_files_are_called() {
    let desk = desk(&slices());
    let document = desk
        .run(&["info", "Doe^Jane", "--json"])
        .expect(0)
        .document();
    let right = document["ct"]["sha256"].as_str().unwrap().to_owned();
    let pinned = |pin: &str| {
        let ct = format!("\"Doe^Jane\"\nsha256 = \"{pin}\"");
        desk.write(
            "plan.toml",
            plan("pinned", "Doe^Jane").replace("\"Doe^Jane\"", &ct),
        );
    };
    pinned(&right);
    let rename = |from: &str, to: &str| {
        let folder = desk.path().join("Doe^Jane");
        std::fs::rename(folder.join(from), folder.join(to)).unwrap();
    };
    rename("IM000", "zzz");
    desk.run(&["run", "plan.toml"]).expect(0);
    pinned(&"0".repeat(64));
    let ran = desk.run(&["run", "plan.toml"]).expect(3);
    assert!(ran.err.contains(&right), "{ran:?}");
}

#[test]
fn check_reads_no_pixels() {
    let files: Vec<SliceFile> = slices()
        .into_iter()
        .map(|mut file| {
            let plane = vec![0_i16; DIMS[0] * DIMS[1]];
            let image = rle(&plane[..100]);
            file.fragments(uids::RLE_LOSSLESS, &[&image]);
            file
        })
        .collect();
    let desk = desk(&files);
    desk.write("plan.toml", plan("damaged", "Doe^Jane"));
    assert_eq!(desk.run(&["check", "plan.toml"]).expect(0).err, "");
    let ran = desk.run(&["run", "plan.toml"]).expect(3);
    assert!(
        ran.err.contains("cannot be decoded (RLE Lossless"),
        "{ran:?}"
    );
    assert!(!ran.err.contains("panicked"), "{ran:?}");
    assert!(!desk.path().join("out").exists());
}
