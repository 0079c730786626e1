//! Meshes, solids and the inverse displacement: what a run writes of them.

use std::collections::{BTreeMap, HashMap};
use std::process::Command;

use serde_json::Value;

use crate::head::{CANDIDATES, nifti, plan, plan_head, put_sform};
use crate::process::{Desk, names};

/// Two candidates with everything that is made of surfaces and maps.
fn everything(name: &str, ct: &str, more: &str) -> String {
    let outputs = "[\"volume\", \"displacement\"]";
    assert!(CANDIDATES.contains(outputs));
    let all = "[\"volume\", \"displacement\", \"mesh\", \"solids\", \"inverse\"]";
    plan_head(name, ct) + &CANDIDATES.replace(outputs, all) + more
}

fn record(desk: &Desk, plan: &str) -> Value {
    let path = desk.path().join(format!("out/{plan}/run.json"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn f32_at(bytes: &[u8], at: usize) -> f32 {
    f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

/// Triangles, and volume in mm³ by the divergence theorem, of an STL file whose equal corners are one point: every edge
/// is walked once in each direction, or this fails.
fn closed_stl(bytes: &[u8]) -> (usize, f64) {
    let count = u32::from_le_bytes(bytes[80..84].try_into().unwrap()) as usize;
    assert_eq!(bytes.len(), 84 + 50 * count);
    let mut edges: HashMap<[[u32; 3]; 2], i32> = HashMap::new();
    let mut volume = 0.0;
    for triangle in bytes[84..].chunks_exact(50) {
        let corners = [12, 24, 36].map(|at| [0, 4, 8].map(|axis| f32_at(triangle, at + axis)));
        let [a, b, c] = corners.map(|corner| glam::DVec3::from_array(corner.map(f64::from)));
        volume += a.dot(b.cross(c)) / 6.0;
        let bits = corners.map(|corner| corner.map(f32::to_bits));
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let walked = edges.entry([bits[from], bits[to]]).or_default();
            *walked += 1;
            assert_eq!(*walked, 1, "an edge is walked twice the same way");
        }
    }
    for [from, to] in edges.keys() {
        assert!(edges.contains_key(&[*to, *from]), "an edge is open");
    }
    (count, volume)
}

#[test]
fn files_and_record_agree_and_meshes_are_closed() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    let segment = "[segment]\nbone_hu = 45\n";
    desk.write("plan.toml", everything("all", "ct.nii", segment));
    desk.run(&["run", "plan.toml"]).expect(0);
    let files: BTreeMap<String, Vec<u8>> = desk.files("out/all");
    for name in [
        "preoperative/skin.stl",
        "preoperative/bone.stl",
        "both/01-move/skin.stl",
        "both/01-move/bone.stl",
        "both/01-move/skin.ply",
        "both/01-move/augmentation.stl",
        "both/01-move/resection.stl",
        "both/01-move/displacement-inverse.nii.gz",
        "both/02-reduce/resection.stl",
        "up/01-rotate/skin.stl",
    ] {
        assert!(files.contains_key(name), "{name} in {:?}", names(&files));
    }
    assert!(!files.contains_key("preoperative/skin.ply"));
    let record = record(&desk, "all");
    let table = String::from_utf8_lossy(&files["table.md"]);
    let stages = record["candidates"][0]["stages"].as_array().unwrap();
    let folders = ["preoperative", "both/01-move", "both/02-reduce"];
    for (stage, folder) in stages.iter().zip(folders) {
        for object in ["skin", "bone"] {
            let mesh = &stage["meshes"][object];
            let (triangles, volume) = closed_stl(&files[&format!("{folder}/{object}.stl")]);
            assert_eq!(mesh["triangles"], triangles);
            let recorded = mesh["volume_mm3"].as_f64().unwrap();
            assert!(
                (volume / recorded - 1.0).abs() < 1e-5,
                "{volume}, {recorded}"
            );
            assert!(
                mesh["topology"]
                    .as_object()
                    .unwrap()
                    .values()
                    .all(|n| n == 0)
            );
        }
    }
    for (stage, folder) in stages.iter().zip(folders).skip(1) {
        for kind in ["augmentation", "resection"] {
            let solid = &stage["solids"][kind];
            let number = |of: &str| solid[of].as_f64().unwrap();
            let (held, between) = (number("volume_mm3"), number("between_mm3"));
            assert!(between > 0.97 * held, "{folder} {kind}: {solid}");
            let shown = if solid["bodies"] == 0 {
                format!("none ({between:.1})")
            } else {
                format!("{held:.1} ({between:.1})")
            };
            assert!(table.contains(&shown), "{shown} is not in: {table}");
            let file = files.get(&format!("{folder}/{kind}.stl"));
            assert_eq!(solid["bodies"] == 0, file.is_none(), "{folder} {kind}");
            if let Some(file) = file {
                let (triangles, volume) = closed_stl(file);
                assert_eq!(solid["triangles"], triangles);
                assert!((volume / solid["volume_mm3"].as_f64().unwrap() - 1.0).abs() < 1e-3);
            }
        }
        let inverse = &stage["inverse"];
        assert_eq!(inverse["not_converged"], 0);
        assert!(inverse["displacement_max_mm"].as_f64().unwrap() > 1.0);
    }
    // The tip goes to posterior: more is taken away than added.
    let volume = |kind: &str| stages[2]["solids"][kind]["volume_mm3"].as_f64().unwrap();
    assert!(volume("resection") > 100.0 && volume("resection") > volume("augmentation"));
    let change = &stages[2]["meshes"]["change"];
    assert!(change["inward_max_mm"].as_f64().unwrap() < -1.5);
    assert_eq!(change["unknown"], 0);
}

#[test]
fn a_number_of_triangles_is_kept_to() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    let more = "[mesh]\ntriangles = 2000\n";
    desk.write("plan.toml", everything("few", "ct.nii", more));
    desk.run(&["run", "plan.toml"]).expect(0);
    let files = desk.files("out/few");
    let (triangles, _) = closed_stl(&files["both/02-reduce/skin.stl"]);
    assert!((1500..=2000).contains(&triangles), "{triangles}");
    let record = record(&desk, "few");
    assert_eq!(record["plan"]["mesh"]["triangles"], 2000);
    let skin = &record["candidates"][0]["stages"][2]["meshes"]["skin"];
    let change = skin["decimation_volume_change"].as_f64().unwrap();
    assert!(change != 0.0 && change.abs() < 5e-3, "{change}");
    // There is no bone in this head: no file, and nothing in the record.
    assert!(!files.contains_key("preoperative/bone.stl"));
    assert!(record["candidates"][0]["stages"][0]["meshes"]["bone"].is_null());
}

#[test]
fn threads_do_not_matter_and_a_plan_without_meshes_has_none() {
    let desk = Desk::new();
    desk.write("ct.nii", nifti());
    desk.write("plan.toml", everything("same", "ct.nii", ""));
    desk.write("plain.toml", plan("plain", "ct.nii"));
    for threads in ["1", "3"] {
        let args = [
            "run",
            "plan.toml",
            "plain.toml",
            "--threads",
            threads,
            "--out",
            threads,
        ];
        desk.run(&args).expect(0);
    }
    let [mut one, mut three] = ["1", "3"].map(|out| desk.files(out));
    for files in [&mut one, &mut three] {
        files.retain(|name, _| !name.ends_with("timings.json"));
        assert!(
            !files
                .keys()
                .any(|name| name.contains("plain") && name.ends_with(".stl"))
        );
        assert!(files.keys().filter(|name| name.ends_with(".stl")).count() > 5);
    }
    assert!(one == three);
}

/// What an ITK program does with our files: it warps the CT through the displacement to our volume, and finds our meshes
/// and the inverse where they belong.
const CHECK: &str = "
import sys
try:
    import SimpleITK as sitk, numpy as np
except ImportError:
    print('no SimpleITK'); sys.exit(0)
ct = sitk.ReadImage(sys.argv[1], sitk.sitkFloat64)
out = sys.argv[2]
volume = sitk.GetArrayFromImage(sitk.ReadImage(out + '/volume.nii.gz', sitk.sitkFloat64))
read = lambda name: sitk.ReadImage(out + '/' + name, sitk.sitkVectorFloat64)
field, inverse = read('displacement.nii.gz'), read('displacement-inverse.nii.gz')
moved = np.linalg.norm(sitk.GetArrayFromImage(field), axis=-1)
forward = sitk.DisplacementFieldTransform(sitk.Image(field))
warped = sitk.Resample(ct, ct, forward, sitk.sitkLinear, -3000.0)
error = np.abs(sitk.GetArrayFromImage(warped) - volume)
inner = (slice(3, -3),) * 3
share = np.mean(error[inner] <= 1.0)
moving = moved[inner] > 0.1
share_moving = np.mean(error[inner][moving] <= 1.0)
# From a preoperative voxel to the stage and back: what is left, mm.
back = sitk.DisplacementFieldTransform(sitk.Image(inverse))
left = 0.0
size = ct.GetSize()
for k in range(4, size[2] - 4, 3):
    for j in range(4, size[1] - 4, 3):
        for i in range(4, size[0] - 4, 3):
            p = np.array(ct.TransformIndexToPhysicalPoint((i, j, k)))
            q = np.array(forward.TransformPoint(back.TransformPoint(p)))
            left = max(left, np.linalg.norm(p - q))
# The skin's vertices, in mm of the patient, are where the volume after the stage reaches the threshold.
stl = np.fromfile(out + '/skin.stl', offset=84, dtype=np.dtype([('n', '<f4', 3), ('at', '<f4', (3, 3)), ('_', '<u2')]))
after = sitk.ReadImage(out + '/volume.nii.gz', sitk.sitkFloat64)
on_skin = []
for p in stl['at'].reshape(-1, 3)[::17].astype(float).tolist():
    index = np.array(after.TransformPhysicalPointToContinuousIndex(p))
    if (index > 1).all() and (index < np.array(size) - 2).all():
        on_skin.append(abs(after.EvaluateAtPhysicalPoint(p) + 500.0) < 250.0)
print('moving', int(moving.sum()), 'share', share, 'share_moving', share_moving, 'left', left, 'on skin', len(on_skin), np.mean(on_skin))
assert len(on_skin) > 500 and np.mean(on_skin) > 0.95
assert moving.sum() > 2000
assert share >= 0.999 and share_moving >= 0.999
assert left < 0.25
";

/// Optional: where a Python with SimpleITK is at hand (`PYTHON` names another than `python3`).
#[test]
fn simple_itk_agrees_on_oblique_and_flipped_grids() {
    let say = |text: &str| {
        use std::io::Write;
        writeln!(std::io::stderr(), "{text}").unwrap();
    };
    let python = std::env::var("PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let s = 1.5_f32;
    // 12° about z and then 7° about x, as it is and with the first and last axes stored backwards.
    let (c1, s1) = (0.978_147_6 * s, 0.207_911_7 * s);
    let (c2, s2) = (0.992_546_2_f32, 0.121_869_3_f32);
    let lps = [
        [c1, -s1, 0.0],
        [s1 * c2, c1 * c2, -s2 * s],
        [s1 * s2, c1 * s2, c2 * s],
    ];
    let origin = [-48.0, -52.0, -36.0];
    let ras = |row: usize, lps: f32| if row < 2 { -lps } else { lps };
    let straight: [[f32; 4]; 3] = std::array::from_fn(|row| {
        let [x, y, z] = lps[row].map(|cosine| ras(row, cosine));
        [x, y, z, ras(row, origin[row])]
    });
    let dims = crate::head::DIMS;
    let flipped: [[f32; 4]; 3] = std::array::from_fn(|row| {
        let [x, y, z, at] = straight[row];
        let last = [dims[0] - 1, dims[2] - 1].map(|n| n as f32);
        [-x, y, -z, at + x * last[0] + z * last[1]]
    });
    for (name, affine, flip) in [("oblique", straight, false), ("flipped", flipped, true)] {
        let desk = Desk::new();
        let mut bytes = nifti();
        put_sform(&mut bytes, affine);
        if flip {
            flip_x_and_z(&mut bytes[352..], dims);
        }
        desk.write("ct.nii", bytes);
        desk.write("plan.toml", everything(name, "ct.nii", ""));
        desk.run(&["run", "plan.toml"]).expect(0);
        let script = desk.write("check.py", CHECK);
        let out = desk.path().join(format!("out/{name}/both/02-reduce"));
        let ct = desk.path().join("ct.nii");
        let ran = Command::new(&python).arg(script).arg(ct).arg(out).output();
        let Ok(ran) = ran else {
            say(&format!(
                "skipped: there is no {python} to run SimpleITK with"
            ));
            return;
        };
        let printed = String::from_utf8_lossy(&ran.stdout);
        if printed.contains("no SimpleITK") {
            say(&format!("skipped: {python} has no SimpleITK"));
            return;
        }
        say(&format!("{name}: {}", printed.trim()));
        let errors = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.success(), "{name}: {printed}{errors}");
    }
}

/// Stores 16-bit voxels in the opposite order along the first and last axes.
fn flip_x_and_z(voxels: &mut [u8], [nx, ny, nz]: [usize; 3]) {
    let before = voxels.to_vec();
    for z in 0..nz {
        for y in 0..ny {
            for x in 0..nx {
                let place = |x: usize, z: usize| 2 * ((z * ny + y) * nx + x);
                let (from, to) = (place(nx - 1 - x, nz - 1 - z), place(x, z));
                voxels[to..to + 2].copy_from_slice(&before[from..from + 2]);
            }
        }
    }
}
