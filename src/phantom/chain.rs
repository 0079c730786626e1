//! Parts joined one after the other, and which of them a small place can do without.

use super::primitives::{Point, Scalar, union, without};
use super::shape::Part;

/// How a part changes what stands before it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Join {
    Union,
    Without,
}

/// A part, how it joins, and the width in mm over which the joint is rounded.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Step(pub Join, pub Part, pub f64);

/// Parts in the order in which they are joined.
pub(super) struct Chain<const N: usize>(pub [Step; N]);

/// Which steps of a chain are taken: bit n for step n.
pub(super) type Steps = u32;

/// The field before the first part, mm: far outside everything.
const EMPTY: f64 = 1e6;

impl<const N: usize> Chain<N> {
    /// All steps.
    pub const fn whole(&self) -> Steps {
        (1 << N) - 1
    }

    /// The body's field at `point`, of the steps given.
    pub fn field<S: Scalar>(&self, steps: Steps, point: Point<S>) -> S {
        let mut body = S::constant(EMPTY);
        for (place, Step(join, part, width)) in self.0.iter().enumerate() {
            if steps & (1 << place) != 0 {
                let part = part.field(point);
                body = match join {
                    Join::Union => union(body, part, *width),
                    Join::Without => without(body, part, *width),
                };
            }
        }
        body
    }

    /// The field at `point`, and those of `steps` that alone give the same field as all of `steps`, to
    /// the last bit, wherever no field differs by more than `slack` mm from what it is at `point`.
    ///
    /// A part that cannot come within its rounding of the body is left out, and a part that takes all
    /// leaves out those before it (after Duff 1992).
    pub fn near(&self, steps: Steps, point: Point<f64>, slack: f64) -> (f64, Steps) {
        let mut body = EMPTY;
        let mut needed = 0;
        for (place, Step(join, part, width)) in self.0.iter().enumerate() {
            let bit = 1 << place;
            if steps & bit == 0 {
                continue;
            }
            let part = part.field(point);
            let apart = width + 2.0 * slack;
            match join {
                Join::Union => {
                    if part - body < apart {
                        if body - part > apart {
                            needed = 0;
                        }
                        needed |= bit;
                    }
                    body = union(body, part, *width);
                }
                Join::Without => {
                    if -part - body > -apart {
                        needed |= bit;
                    }
                    body = without(body, part, *width);
                }
            }
        }
        (body, needed)
    }
}
