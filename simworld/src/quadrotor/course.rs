//! Where a quadrotor is to be, and where it looks: a formula of time with its derivatives, without attitude.

use super::{Legs, Round, Weave};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// A point of a course. World frame: x east, y north, z up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Metres.
    pub position_m: Vector3<f64>,
    /// m/s.
    pub velocity_m_s: Vector3<f64>,
    /// m/s^2.
    pub acceleration_m_s2: Vector3<f64>,
    /// Radians counter-clockwise from east, not wrapped.
    pub heading_rad: f64,
    /// rad/s.
    pub heading_rate_rad_s: f64,
}

/// A course that a quadrotor can fly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Course {
    /// To and fro along each axis, each with its own frequency: the motion of the experiments with four and eight.
    Weave(Weave),
    /// Round and round, nose along the path.
    Round(Round),
    /// From point to point, resting at each.
    Legs(Legs),
}

impl Course {
    /// Where it leads at `t_s` seconds since the start.
    #[must_use]
    pub fn place_at(&self, t_s: f64) -> Place {
        match self {
            Self::Weave(course) => course.place_at(t_s),
            Self::Round(course) => course.place_at(t_s),
            Self::Legs(course) => course.place_at(t_s),
        }
    }
}
