//! Round and round a centre, nose along the path, rising and falling a little: another motion than the one that the
//! methods were tried with first.

use super::course::Place;
use super::ramp::Smooth;
use crate::bounded::{finite, not_negative, positive};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::f64::consts::FRAC_PI_2;

/// A circle with a wave in height.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Round {
    /// Its centre: east, north, up, metres.
    pub centre_m: [f64; 3],
    /// Its radius, metres.
    #[serde(deserialize_with = "positive")]
    pub radius_m: f64,
    /// Angular rate, rad/s; negative turns right.
    #[serde(deserialize_with = "finite")]
    pub rate_rad_s: f64,
    /// Where on it the motion starts, radians counter-clockwise from east.
    #[serde(deserialize_with = "finite")]
    pub phase_rad: f64,
    /// How far it rises and falls, metres.
    #[serde(deserialize_with = "not_negative")]
    pub wave_m: f64,
}

/// Waves of height in one turn: not a whole number, so that no turn repeats the one before.
const WAVES: f64 = 1.37;

impl Round {
    pub(super) fn place_at(self, t_s: f64) -> Place {
        let started = Smooth::started(t_s);
        let sense = self.rate_rad_s.signum();
        let angle = self.phase_rad + self.rate_rad_s * started.value;
        let rate = self.rate_rad_s * started.rate_per_s;
        let rate2 = self.rate_rad_s * started.rate_per_s2;
        let (sin, cos) = angle.sin_cos();
        let (spoke, rim) = (Vector3::new(cos, sin, 0.0), Vector3::new(-sin, cos, 0.0));
        let (height_sin, height_cos) = (WAVES * (angle - self.phase_rad)).sin_cos();
        let (climb, climb2) = (WAVES * rate, WAVES * rate2);
        Place {
            position_m: Vector3::from(self.centre_m)
                + spoke * self.radius_m
                + Vector3::z() * (self.wave_m * height_sin),
            velocity_m_s: rim * (self.radius_m * rate)
                + Vector3::z() * (self.wave_m * climb * height_cos),
            acceleration_m_s2: (rim * rate2 - spoke * (rate * rate)) * self.radius_m
                + Vector3::z() * (self.wave_m * (climb2 * height_cos - climb * climb * height_sin)),
            heading_rad: angle + sense * FRAC_PI_2,
            heading_rate_rad_s: rate,
        }
    }
}
