//! Standing in the air. A sway, when asked, moves the vehicle on a figure of eight about its place.

use crate::bounded::positive;
use crate::truth::{Pose, pose_from_euler};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;

/// A place to stand, and how far to sway about it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hover {
    /// The place, world frame, metres.
    pub position_m: [f64; 3],
    /// The heading, degrees counter-clockwise from east.
    #[serde(default)]
    pub yaw_deg: f64,
    /// The sway's amplitude along each world axis, metres.
    #[serde(default)]
    pub sway_m: [f64; 3],
    /// The sway's period, seconds.
    #[serde(default = "ten_seconds", deserialize_with = "positive")]
    pub sway_period_s: f64,
}

fn ten_seconds() -> f64 {
    10.0
}

impl Hover {
    /// The truth pose at `t_s` seconds, not negative.
    pub(super) fn pose_at(&self, t_s: f64) -> Pose {
        let turns = t_s / self.sway_period_s;
        // East once, north twice and up three times a period: three axes that are never in step, all 0 at the start.
        let wave = Vector3::new(
            (TAU * turns).sin(),
            (2.0 * TAU * turns).sin(),
            (3.0 * TAU * turns).sin(),
        );
        let sway_m = Vector3::from(self.sway_m).component_mul(&wave);
        pose_from_euler(
            Vector3::from(self.position_m) + sway_m,
            self.yaw_deg.to_radians(),
            0.0,
            0.0,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_sway_the_vehicle_stands_still() {
        let hover: Hover = toml::from_str("position_m = [1, 2, 3]\nyaw_deg = 90").unwrap();
        assert_eq!(hover.pose_at(0.0), hover.pose_at(3.3));
        assert!((hover.pose_at(0.0) * Vector3::x() - Vector3::y()).norm() < 1e-12);
    }

    #[test]
    fn a_sway_reaches_its_amplitude_a_quarter_period_on() {
        let hover: Hover =
            toml::from_str("position_m = [0, 0, 5]\nsway_m = [0.4, 0, 0]\nsway_period_s = 8")
                .unwrap();
        assert!(
            (hover.pose_at(2.0).translation.vector - Vector3::new(0.4, 0.0, 5.0)).norm() < 1e-12
        );
    }
}
