//! The Skein daemon around the vehicle: clock, drivers, Zenoh, configuration, input log and command line.
//!
//! The straight path of a measurement, file by file: a [`driver`] sends a frame into the `inbox`; the `worker` hands it
//! to the [`skein_vehicle::Vehicle`] and puts what comes of it into the `outbox`, which publishes it. What other vehicles
//! send comes in through `reception`, perhaps loses its way in `faults`, and meets the frames in the same inbox.
//! [`agent`] starts all of it and stops it within a second.
//!
//! It never estimates anything: that is the vehicle's, which knows neither threads nor Zenoh.
#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod agent;
mod backlog;
mod changes;
pub mod checkpoint;
pub mod clock;
pub mod command;
pub mod config;
pub mod driver;
mod faults;
mod inbox;
mod life;
pub mod network;
mod operator;
mod outbox;
mod pending;
pub mod pose_graph;
mod process;
mod published;
mod queries;
mod queue;
mod reception;
pub mod record;
mod refusals;
mod session;
pub mod settings;
pub mod solve;
pub mod verify;
mod work;
mod worker;

pub use agent::{Agent, StartError};
pub use clock::Clock;
pub use driver::FrameSender;
pub use network::NetworkSettings;
pub use published::PublishedEstimate;
pub use settings::{DriverSettings, FaultSettings, Settings, TimedFrame, new_boot};
