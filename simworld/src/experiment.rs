//! The papers' experiments and the one that chooses the daemon's mode, many samples of each, with the spread beside every number.

pub mod consistency;
pub mod cooperative;
pub mod modes;
pub mod solver_only;
