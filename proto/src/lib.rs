//! The wire contract of Skein: what vehicles say to each other, under which keys, and in which bytes.
//!
//! Reading order: [`name`] and [`keys`] (who, where), [`envelope`] (what every packet opens with), then one file a
//! message: [`exchange`], [`record`], [`backlog`], [`features`], [`relay`], [`estimate`], [`frame`] in bytes; [`document`] and [`faults`] in JSON. What they
//! are made of: [`measured`], [`fixed`], [`anchor`], [`growth`]. [`codec`] turns bytes into checked values and back, and [`limits`] holds every bound.
//!
//! This crate knows raw integers and floats. It knows nothing of Zenoh, of mathematics or of our other crates.
#![cfg_attr(test, allow(clippy::unwrap_used))]

pub mod anchor;
pub mod backlog;
mod check;
pub mod codec;
pub mod document;
pub mod envelope;
pub mod estimate;
pub mod exchange;
pub mod faults;
pub mod features;
pub mod fixed;
pub mod frame;
pub mod growth;
pub mod keys;
mod le;
pub mod limits;
pub mod measured;
pub mod name;
pub mod record;
pub mod relay;
pub mod status;

/// Major version: a packet of another major version is refused. It is also the `@v1` chunk of every key.
pub const VERSION_MAJOR: u8 = 1;
/// Minor version: rises when a field is appended; a newer minor version may carry bytes that we do not know.
pub const VERSION_MINOR: u8 = 2;
