//! Files in and out: NIfTI-1, NRRD, DICOM series, 3D Slicer's landmarks, parallel gzip, and outputs that appear
//! whole or not at all.

pub mod artifact;
mod axes;
pub mod dicom;
pub mod digest;
pub mod gzip;
pub mod landmarks;
pub mod nifti;
pub mod nrrd;
pub mod staging;
pub mod written;

pub use axes::StoredAxes;

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    /// What a folder holds, sorted.
    pub(super) fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }
}
