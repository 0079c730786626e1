//! Half the size and back (paper section III; method section 5).

pub mod gaussian;
pub mod half;
