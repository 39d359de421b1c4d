//! Two planar robots on straight parallel lines, as in the paper's experiment (figure 6 of Knuth & Barooah). The
//! spacing and speed are ours: the paper gives neither.

use crate::truth::{Pose, pose_from_euler};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use std::num::NonZeroU32;

/// One lane: robot 1 on the right, each further robot one spacing to its left.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parallel {
    /// Which robot, from 1.
    pub robot: NonZeroU32,
    /// The distance between lanes, metres.
    #[serde(default = "two")]
    pub spacing_m: f64,
    /// How far each robot starts ahead of the one on its right, metres, so that no camera looks exactly sideways.
    #[serde(default = "one")]
    pub lead_m: f64,
    /// The speed, metres per second.
    #[serde(default = "quarter")]
    pub speed_mps: f64,
    /// The direction of all lanes, degrees counter-clockwise from east.
    #[serde(default)]
    pub yaw_deg: f64,
}

fn two() -> f64 {
    2.0
}

fn one() -> f64 {
    1.0
}

fn quarter() -> f64 {
    0.25
}

impl Parallel {
    /// The lane of this robot with every other setting at its default.
    #[must_use]
    pub fn of_robot(robot: NonZeroU32) -> Self {
        Self {
            robot,
            spacing_m: two(),
            lead_m: one(),
            speed_mps: quarter(),
            yaw_deg: 0.0,
        }
    }

    /// The truth pose at `t_s` seconds, not negative.
    pub(super) fn pose_at(&self, t_s: f64) -> Pose {
        let lane = f64::from(self.robot.get() - 1);
        let along_m = lane * self.lead_m + self.speed_mps * t_s;
        let course = pose_from_euler(Vector3::zeros(), self.yaw_deg.to_radians(), 0.0, 0.0);
        course
            * pose_from_euler(
                Vector3::new(along_m, lane * self.spacing_m, 0.0),
                0.0,
                0.0,
                0.0,
            )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::relative_position_m;

    #[test]
    fn the_second_robot_stays_ahead_and_to_the_left_of_the_first() {
        let lane = |number| Parallel {
            yaw_deg: 35.0,
            ..Parallel::of_robot(NonZeroU32::new(number).unwrap())
        };
        for t_s in [0.0, 4.0, 11.0] {
            let seen = relative_position_m(&lane(1).pose_at(t_s), &lane(2).pose_at(t_s));
            assert!(
                (seen - Vector3::new(1.0, 2.0, 0.0)).norm() < 1e-12,
                "{seen}"
            );
        }
    }

    #[test]
    fn a_lane_runs_in_its_direction_nose_ahead() {
        let north = Parallel {
            yaw_deg: 90.0,
            ..Parallel::of_robot(NonZeroU32::new(1).unwrap())
        };
        let pose = north.pose_at(4.0);
        assert!((pose.translation.vector - Vector3::new(0.0, 1.0, 0.0)).norm() < 1e-12);
        assert!((pose.rotation * Vector3::x() - Vector3::y()).norm() < 1e-12);
    }
}
