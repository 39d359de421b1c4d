//! The papers' experiments, many samples of each, with the spread beside every number.

pub mod cooperative;
pub mod solver_only;
