//! Virtual worlds for Skein: where vehicles really are, what they measure, what the radio does to their packets, and how
//! well they did. Nothing here reads a clock or a socket; everything is the same again for the same seed.
//!
//! A virtual flight passes through the modules in this order:
//!
//! ```text
//! scenario ─> trajectory ─> truth ─> sensor ─> (the vehicles) ─> radio ─> (the vehicles) ─> statistics, evaluation ─> plot
//!                                    streams
//! ```
//!
//! [`truth`], [`trajectory`], [`sensor`] and [`planar_swarm`] use none of the estimators' geometry: a sign error there must
//! meet a second opinion. [`mrclam`] and [`calibration`] put real robots in the place of the virtual ones, [`pyfg`] and
//! [`tiers`] real distances, [`broad`] and [`euroc`] real inertial sensors.

mod bounded;
pub mod scenario;
pub mod streams;

pub mod trajectory;
pub mod truth;

pub mod anonymous;
pub mod planar_swarm;
pub mod quadrotor;
pub mod radio;
pub mod sensor;
pub mod von_mises_fisher;

pub mod broad;
pub mod calibration;
pub mod datasets;
pub mod euroc;
pub mod inertial_recording;
pub mod mrclam;
pub mod pyfg;
pub mod tiers;

pub mod evaluation;
pub mod statistics;
pub mod tum;

pub mod plot;

pub mod experiment;
pub mod fleet;
pub mod mutual_scenario;
pub mod mutual_world;
pub mod recorded;
pub mod stage;
pub mod world;
