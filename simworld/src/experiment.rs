//! The papers' experiments and the one that chooses the daemon's mode, many samples of each, with the spread beside every number.

pub mod attitude;
pub mod consistency;
pub mod cooperative;
pub mod modes;
pub mod mutual;
pub mod ranging;
pub mod registration;
pub mod solver_only;
