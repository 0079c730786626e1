//! What of a volume is tissue.

pub mod threshold;
