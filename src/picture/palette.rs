//! Colours for things that are told apart by name.

use super::svg::Colour;

/// Eight colours that are told apart with any colour blindness: M. Okabe and K. Ito, *Color Universal Design*
/// (2008), black first and the pale yellow last.
const OKABE_ITO: [Colour; 8] = [
    [0, 0, 0],
    [230, 159, 0],
    [86, 180, 233],
    [0, 158, 115],
    [213, 94, 0],
    [0, 114, 178],
    [204, 121, 167],
    [240, 228, 66],
];

/// The colour of the n-th of several things, and how often all colours were used before it: what is drawn the
/// second time round needs another look.
pub(super) fn colour(n: usize) -> (Colour, usize) {
    let index = n % OKABE_ITO.len();
    (
        OKABE_ITO.get(index).copied().unwrap_or_default(),
        n / OKABE_ITO.len(),
    )
}
