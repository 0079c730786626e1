//! Rhinoplasty planning on head CT: plan files, 3-D feature-based volume morphing and measurements.
//!
//! Implements *Computer-Aided Prototype System for Nose Surgery* (T.-Y. Lee, C.-H. Lin, H.-Y. Lin, IEEE
//! Transactions on Information Technology in Biomedicine 5(4), 2001).

pub mod cli;
pub mod compare;
pub mod exec;
pub mod feature;
pub mod golden;
pub mod io;
pub mod measure;
pub mod mesh;
pub mod morph;
pub mod phantom;
pub mod picture;
pub mod plan;
pub mod render;
pub mod report;
pub mod resample;
pub mod segment;
pub mod simd;
pub mod space;
pub mod surface;
mod text;
pub mod volume;
