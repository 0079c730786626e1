//! Files in and out: NIfTI-1, parallel gzip, and outputs that appear whole or not at all.

pub mod artifact;
pub mod digest;
pub mod gzip;
pub mod nifti;
pub mod staging;
