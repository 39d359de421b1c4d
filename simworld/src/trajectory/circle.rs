//! A level circle at constant speed, nose along the path.

use crate::bounded::positive;
use crate::truth::{Pose, pose_from_euler};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, TAU};

/// A centre, a radius and a period.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Circle {
    /// The centre, world frame, metres.
    pub centre_m: [f64; 3],
    /// The radius, metres.
    pub radius_m: f64,
    /// The time of one turn, seconds.
    #[serde(deserialize_with = "positive")]
    pub period_s: f64,
    /// Where on the circle the motion starts, degrees counter-clockwise from east.
    #[serde(default)]
    pub phase_deg: f64,
    /// Whether the vehicle turns right instead of left.
    #[serde(default)]
    pub clockwise: bool,
}

impl Circle {
    /// The truth pose at `t_s` seconds, not negative.
    pub(super) fn pose_at(&self, t_s: f64) -> Pose {
        let sense = if self.clockwise { -1.0 } else { 1.0 };
        let azimuth_rad = self.phase_deg.to_radians() + sense * TAU * t_s / self.period_s;
        let spoke = Vector3::new(azimuth_rad.cos(), azimuth_rad.sin(), 0.0);
        let position_m = Vector3::from(self.centre_m) + spoke * self.radius_m;
        pose_from_euler(position_m, azimuth_rad + sense * FRAC_PI_2, 0.0, 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nose_follows_the_path_in_both_senses() {
        for clockwise in [false, true] {
            let circle = Circle {
                centre_m: [1.0, 2.0, 3.0],
                radius_m: 4.0,
                period_s: 12.0,
                phase_deg: 20.0,
                clockwise,
            };
            let (now, next) = (circle.pose_at(5.0), circle.pose_at(5.001));
            let velocity = (next.translation.vector - now.translation.vector) / 0.001;
            assert!((velocity.norm() - TAU * 4.0 / 12.0).abs() < 1e-6);
            assert!((now.rotation.inverse() * velocity.normalize() - Vector3::x()).norm() < 1e-3);
        }
    }

    #[test]
    fn a_quarter_turn_to_the_left_from_east_is_north() {
        let circle = Circle {
            centre_m: [0.0; 3],
            radius_m: 2.0,
            period_s: 8.0,
            phase_deg: 0.0,
            clockwise: false,
        };
        assert!(
            (circle.pose_at(2.0).translation.vector - Vector3::new(0.0, 2.0, 0.0)).norm() < 1e-12
        );
    }
}
