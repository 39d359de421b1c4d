//! The whole daemon minus sockets: what one vehicle does with what it is given, as a state machine.
//!
//! The straight path of a measurement, file by file:
//!
//! 1. [`input`]: a driver's frame or a packet arrives with its time at [`Vehicle::handle`] ([`vehicle`]).
//! 2. `sensors` and `hearing` decode it, check who it is from and count what they refuse.
//! 3. `dead_reckoning` adds odometry up; `rounds` keeps measurements until their round and brings them into the body
//!    frame of its instant; `speaking` tells the neighbours.
//! 4. When everybody has answered, or the round's time is up, `local_star` puts the round together for
//!    `skein_estimation::cooperative`, or in mode `team` `smoothing` what everybody told of itself; the solution becomes
//!    the new correction of the odometry.
//!    Camera frames and inertial readings take another way: `mutual` levels them, tells everybody and locates who is in
//!    sight. Distances to whoever is not in the common frame go to `ranging`.
//! 5. `reporting` writes the estimate and the health; [`Vehicle::poll`] hands everything out ([`output`]).
//!
//! The drain rule: after every `handle`, call `poll` until it returns [`Output::WakeAt`]; call `handle` again with the
//! next input, or with [`Input::Wake`] at that instant.
//!
//! ```
//! # use skein_vehicle::{Input, Output, Vehicle};
//! # fn send(_: Output) {}
//! # fn drain(vehicle: &mut Vehicle, now: skein_estimation::time::Stamp, input: Input) {
//! vehicle.handle(now, input);
//! let wake_at = loop {
//!     match vehicle.poll() {
//!         Output::WakeAt(instant) => break instant,
//!         output => send(output),
//!     }
//! };
//! # let _ = wake_at;
//! # }
//! ```
//!
//! This crate knows nothing of Zenoh, tokio, files or clocks: time is an argument, and the same inputs at the same
//! times give the same outputs, bit by bit.

pub mod checkpoint;
pub mod config;
pub mod input;
pub mod output;
pub mod told_pose;
pub mod vehicle;
pub mod work;

mod anchor;
mod asking;
mod backlog;
mod clock;
mod counters;
mod dead_reckoning;
mod duplicates;
mod gathering;
mod heard_rounds;
mod hearing;
mod local_star;
mod mutual;
mod neighbours;
mod placing;
mod ranging;
mod refused;
mod relaying;
mod reporting;
mod rounds;
mod scheduling;
mod sensors;
mod sequence;
mod smoothing;
mod solving;
mod speaking;
mod translate;
mod trust;

pub use checkpoint::{Checkpoint, CheckpointError};
pub use config::{Config, MutualConfig, MutualWay, RangingConfig, SensorConfig, Start};
pub use input::{Input, PacketKey};
pub use output::Output;
pub use told_pose::ToldPose;
pub use vehicle::Vehicle;
pub use work::{Done, Work};
