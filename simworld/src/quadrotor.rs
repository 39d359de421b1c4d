//! How a quadrotor moves: where it is at every instant, the attitude that its thrust needs for that, and what turns it.
//!
//! World frame: x east, y north, z up. Body frame: x forward, y left, z up. A course is a formula of time, so position,
//! velocity and acceleration are exact, and attitude and angular rate belong to them.

mod course;
mod imu;
mod legs;
mod ramp;
mod round;
mod weave;

pub use course::{Course, Place};
pub use imu::{Imu, ImuSample, ImuSettings, Stated};
pub(crate) use legs::Arena;
pub use legs::Legs;
pub use round::Round;
pub use weave::{Weave, WeaveOf};

use crate::truth::{Pose, pose_from_euler};
use nalgebra::Vector3;

/// Standard gravity (m/s^2).
pub const GRAVITY_M_S2: f64 = 9.80665;

/// What the air takes: deceleration for each m/s of speed (1/s).
const DRAG_PER_S: f64 = 0.25;

/// Half of the step over which the attitude is differentiated (s). The error grows with its square and is below
/// 1e-6 rad/s for these courses.
const HALF_STEP_S: f64 = 1e-4;

/// What is true of a quadrotor at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// `world_from_body`, metres.
    pub pose: Pose,
    /// World frame, m/s.
    pub velocity_m_s: Vector3<f64>,
    /// World frame, m/s^2.
    pub acceleration_m_s2: Vector3<f64>,
    /// Heading, radians counter-clockwise from east, not wrapped.
    pub heading_rad: f64,
    /// Its rate, rad/s.
    pub heading_rate_rad_s: f64,
    /// Roll of `Rz(heading) Ry(pitch) Rx(roll)`, radians.
    pub roll_rad: f64,
    /// Pitch of the same, radians; positive lowers the nose.
    pub pitch_rad: f64,
    /// Body frame, rad/s.
    pub angular_rate_rad_s: Vector3<f64>,
}

impl Motion {
    /// What is true at `t_s` seconds since the start of the motion.
    #[must_use]
    pub fn at(course: &Course, t_s: f64) -> Self {
        let place = course.place_at(t_s);
        let (roll_rad, pitch_rad) = tilt_rad(&place);
        let before = attitude(&course.place_at(t_s - HALF_STEP_S));
        let after = attitude(&course.place_at(t_s + HALF_STEP_S));
        // R' = R [w]x, so the turn from before to after is exp(2 h w) in the body's own axes.
        let turn = before.rotation.inverse() * after.rotation;
        Self {
            pose: attitude(&place),
            velocity_m_s: place.velocity_m_s,
            acceleration_m_s2: place.acceleration_m_s2,
            heading_rad: place.heading_rad,
            heading_rate_rad_s: place.heading_rate_rad_s,
            roll_rad,
            pitch_rad,
            angular_rate_rad_s: turn.scaled_axis() / (2.0 * HALF_STEP_S),
        }
    }

    /// What an ideal accelerometer feels: all that is not gravity, body frame, m/s^2. At rest it points up.
    #[must_use]
    pub fn specific_force_m_s2(&self) -> Vector3<f64> {
        let felt = self.acceleration_m_s2 + Vector3::z() * GRAVITY_M_S2;
        self.pose.rotation.inverse() * felt
    }
}

/// `world_from_body` at a place of a course.
pub(crate) fn attitude(place: &Place) -> Pose {
    let (roll_rad, pitch_rad) = tilt_rad(place);
    pose_from_euler(place.position_m, place.heading_rad, pitch_rad, roll_rad)
}

/// Roll and pitch by differential flatness: the body's z axis is where the thrust points, which has to accelerate the
/// body, carry it and overcome the air.
fn tilt_rad(place: &Place) -> (f64, f64) {
    let thrust =
        place.acceleration_m_s2 + Vector3::z() * GRAVITY_M_S2 + place.velocity_m_s * DRAG_PER_S;
    let up = thrust.normalize();
    // Seen from a frame that has the heading and is level, that axis is (cos roll sin pitch, -sin roll, cos roll cos pitch).
    let (sin, cos) = place.heading_rad.sin_cos();
    let ahead = cos * up.x + sin * up.y;
    let left = cos * up.y - sin * up.x;
    (-left.asin(), ahead.atan2(up.z))
}

#[cfg(test)]
mod tests;
