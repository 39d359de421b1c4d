//! A straight line at constant speed, nose along it.

use crate::truth::{Pose, pose_from_euler};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// A start and a velocity.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// Where the motion starts, world frame, metres.
    pub start_m: [f64; 3],
    /// The velocity, world frame, metres per second.
    pub velocity_mps: [f64; 3],
    /// The heading, degrees counter-clockwise from east; along the velocity when not given.
    pub yaw_deg: Option<f64>,
}

impl Line {
    /// The truth pose at `t_s` seconds, not negative.
    pub(super) fn pose_at(&self, t_s: f64) -> Pose {
        let velocity = Vector3::from(self.velocity_mps);
        let yaw_rad = self
            .yaw_deg
            .map_or_else(|| velocity.y.atan2(velocity.x), f64::to_radians);
        pose_from_euler(
            Vector3::from(self.start_m) + velocity * t_s,
            yaw_rad,
            0.0,
            0.0,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nose_points_along_the_line_unless_told_otherwise() {
        let line: Line = toml::from_str("start_m = [1, 0, 0]\nvelocity_mps = [0, 2, 0]").unwrap();
        let pose = line.pose_at(1.5);
        assert!((pose.translation.vector - Vector3::new(1.0, 3.0, 0.0)).norm() < 1e-12);
        assert!((pose * Vector3::x() - pose * Vector3::zeros() - Vector3::y()).norm() < 1e-12);
        let sideways = Line {
            yaw_deg: Some(0.0),
            ..line
        };
        assert!(sideways.pose_at(1.5).rotation.angle() < 1e-12);
    }
}
