//! Relative localisation from distances and odometry alone (Cornejo & Nagpal): where is a neighbour of which all that is
//! measured is how far it is?
//!
//! Without coordination (Algorithm 1), in reading order: where a neighbour may be ([`RelativePose`]), what a few ranges
//! with the odometry of both say of it ([`window`]), what a long stream of them says ([`bank`]), the state machine of one
//! neighbour that a daemon feeds ([`Neighbour`]), and all pairs of a team at once ([`Team`]).
//!
//! With coordination: who moves and who stands still to be measured from ([`schedule`], Algorithm 3), and what a standing
//! and a moving robot make of their distances ([`trilateration`], Algorithm 2).
//!
//! Frames are *level*: a body's origin, z up, x along its heading. Either everything is in one plane, or attitudes are
//! known from gravity; what is unknown is the neighbour's position and its yaw relative to one's own.

pub mod bank;
pub mod neighbour;
pub mod pose;
pub mod sample;
pub mod schedule;
pub mod team;
mod trail;
pub mod trilateration;
pub mod window;

#[cfg(test)]
mod world;

pub use bank::Bank;
pub use neighbour::Neighbour;
pub use pose::{Dimension, RelativePose};
pub use sample::{LevelOdometry, RangeRefusal, RangeSample};
pub use team::Team;
pub use window::Window;
