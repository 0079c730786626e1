//! The program on a series: the same as on the same head in NIfTI, and nothing of the patient.

use std::collections::BTreeMap;
use std::io::Read;

use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use rhinoplan::io::nifti;

use crate::builder::{IDENTITY, SERIES, SliceFile, head_slices, rle, stack};
use crate::head::{DIMS, nifti as head, picture_plan, plan};
use crate::process::Desk;

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
    let desk = desk(&head_slices());
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
            // These name the plan, and the list holds their hashes.
            "run.json" | "table.md" | ".rhinoplan.files" | "plan.effective.toml" => continue,
            "compare.json" | "compare.md" => continue,
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

/// What a file holds once it is unpacked: of gzip and of the data in an NRRD file what is inflated, of a PNG its
/// pixels and each of its texts.
fn unpacked(name: &str, bytes: &[u8]) -> Vec<(String, Vec<u8>)> {
    let named = |what: &str, content: Vec<u8>| (format!("{what} of {name}"), content);
    if name.ends_with(".gz") {
        return vec![named("content", inflate(bytes))];
    }
    if name.ends_with(".nrrd") {
        let end = bytes.windows(2).position(|pair| pair == b"\n\n").unwrap();
        return vec![named("samples", inflate(&bytes[end + 2..]))];
    }
    if !name.ends_with(".png") {
        return Vec::new();
    }
    let (mut packed, mut parts) = (Vec::new(), Vec::new());
    let mut rest = &bytes[8..];
    while let Some((length, behind)) = rest.split_first_chunk::<4>() {
        let (kind, behind) = behind.split_at(4);
        let (data, behind) = behind.split_at(u32::from_be_bytes(*length) as usize);
        rest = &behind[4..];
        match kind {
            b"IDAT" => packed.extend(data),
            b"zTXt" | b"iTXt" | b"iCCP" => panic!("{name} may hold packed text"),
            other => parts.push(named(&String::from_utf8_lossy(other), data.to_vec())),
        }
    }
    let mut pixels = Vec::new();
    let mut zlib = flate2::read::ZlibDecoder::new(packed.as_slice());
    zlib.read_to_end(&mut pixels).unwrap();
    assert!(pixels.len() > packed.len());
    parts.push(named("pixels", pixels));
    parts
}

fn holds(bytes: &[u8], secret: &str) -> bool {
    // As text, and as the UTF-16 of some formats.
    let wide: Vec<u8> = secret.encode_utf16().flat_map(u16::to_le_bytes).collect();
    [secret.as_bytes(), &wide]
        .iter()
        .any(|secret| bytes.windows(secret.len()).any(|piece| piece == *secret))
}

#[test]
fn nothing_of_the_patient_reaches_an_output() {
    let files = head_slices();
    let desk = desk(&files);
    let all = "write = [\"views\", \"slices\", \"charts\", \"volume\", \"displacement\", \"inverse\", \"nrrd\", \
               \"mesh\", \"solids\"]";
    let text = picture_plan("private", "Doe^Jane")
        .replace("write = [\"views\", \"slices\", \"charts\"]", all);
    assert!(text.contains(all));
    desk.write("plan.toml", text);
    let ran = desk.run(&["run", "plan.toml", "--json"]).expect(0);
    let mut outputs: BTreeMap<String, Vec<u8>> = desk.files("out");
    for kind in [
        ".nii.gz", ".nrrd", ".png", ".svg", ".stl", ".ply", ".json", ".csv", ".md",
    ] {
        assert!(outputs.keys().any(|name| name.ends_with(kind)), "{kind}");
    }
    let parts: Vec<_> = outputs
        .iter()
        .flat_map(|(name, bytes)| unpacked(name, bytes))
        .collect();
    assert!(parts.len() > 40, "{}", parts.len());
    outputs.extend(parts);
    outputs.insert("stdout".to_owned(), ran.out.into_bytes());
    outputs.insert("stderr".to_owned(), ran.err.into_bytes());
    let sop = "1.2.826.0.1.3680043.8.498";
    let secrets = IDENTITY.iter().map(|(_, _, text)| *text);
    let input = files[0].bytes();
    for secret in secrets.chain([SERIES, sop, "Doe", "Jane"]) {
        assert!(
            holds(&input, secret),
            "{secret} is in no slice: nothing is tested"
        );
        for (name, bytes) in &outputs {
            assert!(!holds(bytes, secret), "{secret} in {name}");
        }
    }
    // Nor a name of a file.
    assert!(!outputs.values().any(|bytes| holds(bytes, "IM001")));
    // `info` shows the UID, which is there to choose by, and no name.
    let info = desk.run(&["info", "Doe^Jane"]).expect(0).out;
    assert!(info.contains(SERIES));
    for (_, _, text) in IDENTITY {
        assert!(!info.contains(text), "{text}");
    }
}

#[test]
fn info_of_a_folder() {
    let desk = desk(&head_slices());
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
    let mut files = head_slices();
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

    // The effective plan names neither the folder nor the series, and with both it runs to the same.
    let effective = desk.path().join("out/chosen/plan.effective.toml");
    let effective = std::fs::read_to_string(effective).unwrap();
    assert!(!effective.contains(SERIES) && !effective.contains("Doe"));
    desk.write("again.toml", effective.replace("\"ct\"", &chosen));
    desk.run(&["run", "again.toml", "--out", "again"]).expect(0);
    let (mut first, mut again) = (desk.results("out/chosen"), desk.results("again/chosen"));
    for files in [&mut first, &mut again] {
        assert!(files.remove("run.json").is_some());
    }
    assert!(first == again);

    desk.write("ct.nii", head());
    desk.write("plan.toml", text.replace("Doe^Jane", "ct.nii"));
    let ran = desk.run(&["check", "plan.toml"]).expect(3);
    assert!(
        ran.err
            .contains("`ct.series` (or `--series`) chooses nothing in it"),
        "{ran:?}"
    );
}

#[test]
fn a_series_is_pinned_whatever_its_files_are_called() {
    let desk = desk(&head_slices());
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
    let files: Vec<SliceFile> = head_slices()
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
