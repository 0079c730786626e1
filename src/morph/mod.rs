//! The map from a planned nose back to the patient's, and volumes warped through it.
//!
//! Source: paper section III and Fig. 4, after Beier and Neely 1992 (doi 10.1145/133994.134003), in three
//! dimensions; piecewise-linear evaluation after Lerios, Garfinkle and Levoy 1995
//! (doi 10.1145/218380.218502).
//!
//! - [`pair`]: what one pair of feature lines does to a point, an affine map.
//! - [`stage`]: one stage's map in its short form, the hot loop; [`mod@reference`]: the general sum over any
//!   number of lines, which the short form is tested against.
//! - [`chain`]: several stages composed, on a lattice of voxels.
//! - [`field`]: source positions for tiles of voxels, exactly or on an octree.
//! - [`warp`]: a volume sampled through a field; [`displacement`]: a field as LPS vectors.
//! - [`inverse`]: the way back, from the preoperative CT to a stage.
//! - [`audit`]: is the map folded, how far does it move tissue, how far is adaptive from exact.
//!
//! Everything here works on [`Points`]: positions in voxels of one [`Lattice`], target positions going
//! in, source positions coming out.

pub mod audit;
mod bounds;
pub mod chain;
pub mod displacement;
mod exact;
pub mod field;
pub mod halfscale;
pub mod inverse;
mod octree;
pub mod pair;
mod points;
pub mod reference;
pub mod stage;
mod still;
mod tile;
pub mod warp;

#[cfg(test)]
mod tests;

pub use chain::{Chain, Lattice};
pub use field::{Evaluation, Field};
pub use points::{LANES, Points};
pub use tile::TILE;

/// Added to every distance before it is inverted (paper equation 3; method section 3). In the units of
/// the model: voxels for `lee2001`, mm for `local`.
pub const EPSILON: f64 = 1e-3;
