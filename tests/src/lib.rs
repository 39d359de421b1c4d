//! What needs more than one crate of Skein is tested in `tests/`, one file a subject; [`stories`] is what they share, and
//! [`soak`] are the long flights of the program `skein-soak`.
//!
//! - `architecture`: who may depend on whom, asked of Cargo;
//! - `tidy`: house rules that no compiler checks, and documents that name only what is there;
//! - `fleet_stories`: what becomes of a fleet in virtual time when radios, clocks, sensors and processes fail;
//! - `faults`: every fault of section V, and how far off it leaves a team in mode `star`;
//! - `restarts`: vehicles that lose their pose and get it back;
//! - `impostors`, `hostile`: vehicles that are told lies and garbage;
//! - `soak`: flights with every fault on cost no more at the end than near the beginning;
//! - `deploy`: the unit file, the compose file and every example configuration fit the programs;
//! - `python_client`: a client in another language reads, decodes and drives, over real Zenoh.

pub mod soak;
pub mod stories;
