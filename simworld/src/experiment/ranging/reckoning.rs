//! Cumulative odometry of a level robot, from what its sensors say of each step.

use nalgebra::{Rotation3, Vector3};
use skein_estimation::odometry::Growth;
use skein_estimation::ranging::LevelOdometry;

/// Before the first step.
pub(super) fn begun() -> LevelOdometry {
    LevelOdometry {
        segment: 0,
        position_m: Vector3::zeros(),
        yaw_rad: 0.0,
        growth: Growth::zero(),
    }
}

/// After a step: the robot moved by so much in its level frame of before, then turned, each known to a standard deviation
/// (rad, m).
pub(super) fn after(
    odometry: &LevelOdometry,
    moved_m: &Vector3<f64>,
    turned_rad: f64,
    (rotation_sigma_rad, translation_sigma_m): (f64, f64),
) -> LevelOdometry {
    let heading = Rotation3::from_axis_angle(&Vector3::z_axis(), odometry.yaw_rad);
    let position_m = odometry.position_m + heading * moved_m;
    LevelOdometry {
        segment: odometry.segment,
        position_m,
        yaw_rad: odometry.yaw_rad + turned_rad,
        growth: odometry
            .growth
            .after(&position_m, rotation_sigma_rad, translation_sigma_m),
    }
}
