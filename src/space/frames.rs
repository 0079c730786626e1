//! Positions and vectors, one type for each frame.

use glam::DVec3;
use serde::{Deserialize, Serialize};

macro_rules! frame_type {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $name(pub DVec3);

        impl $name {
            /// From its three components, in the frame's axis order.
            pub const fn new(x: f64, y: f64, z: f64) -> Self {
                Self(DVec3::new(x, y, z))
            }

            /// The three components, in the frame's axis order.
            pub const fn to_array(self) -> [f64; 3] {
                self.0.to_array()
            }
        }

        impl From<[f64; 3]> for $name {
            fn from(components: [f64; 3]) -> Self {
                Self(DVec3::from_array(components))
            }
        }
    };
}
pub(crate) use frame_type;

frame_type! {
    /// A position on the voxel lattice of a [`Grid`](super::Grid), in voxels. Axis order is LPS: x grows
    /// to the patient's left, y to posterior, z to superior. A voxel's centre is at its integer index.
    ContinuousIndex
}
frame_type! {
    /// A position in grid millimetres: index × spacing per axis, no origin and no rotation.
    GridPoint
}
frame_type! {
    /// A displacement in grid millimetres.
    GridVector
}
frame_type! {
    /// A position in the patient's frame, mm: x to the left, y to posterior, z to superior (DICOM PS3.3
    /// C.7.6.2, ITK).
    LpsPoint
}
frame_type! {
    /// A displacement in the patient's frame, mm.
    LpsVector
}

macro_rules! affine_space {
    ($point:ident, $vector:ident) => {
        impl std::ops::Sub for $point {
            type Output = $vector;
            fn sub(self, from: Self) -> $vector {
                $vector(self.0 - from.0)
            }
        }
        impl std::ops::Add<$vector> for $point {
            type Output = $point;
            fn add(self, by: $vector) -> $point {
                $point(self.0 + by.0)
            }
        }
    };
}

affine_space!(GridPoint, GridVector);
affine_space!(LpsPoint, LpsVector);
