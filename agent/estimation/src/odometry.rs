//! Odometry as everybody keeps it: cumulative, never reset, with the covariance that it gathers.
//!
//! [`track`] holds a stretch of it and answers for any instant within; [`growth`] adds up its covariance.

pub mod growth;
pub mod track;

pub use growth::{Drift, Growth};
pub use track::{Gap, OdometryPoint, Track};
