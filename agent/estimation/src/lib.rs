//! Skein's estimation: the mathematics of locating vehicles by each other, as pure functions and state machines.
//!
//! No clock, no file, no network and no global randomness: what a function needs is an argument.

pub mod time;

pub mod so3;

pub mod se3;

pub mod transform;

pub mod odometry;

pub mod vehicle_id;

pub mod cooperative;

pub mod mutual;

pub mod ranging;

#[cfg(test)]
mod lie_laws;

pub use time::{Span, Stamp};
pub use transform::{Body, Odometry, Sensor, Transform, TransformError, World};
pub use vehicle_id::VehicleId;
