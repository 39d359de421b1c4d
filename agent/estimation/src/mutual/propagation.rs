//! How a neighbour's relative state moves with both vehicles' motion (Cognetti et al., eq. 18-22, corrected).
//!
//! In this vehicle's level frame, with `v` the relative velocity as an observer that does not turn sees it, `a` proper
//! accelerations and `R(psi)` a turn about the vertical:
//!
//! `p' = v - psi_i' e3 x p`, `v' = R(psi) a_j - a_i - psi_i' e3 x v`, `psi' = psi_j' - psi_i'`.
//!
//! The paper prints `p' = v` and the other sign in front of the last term of `v'`; gravity cancels because both
//! accelerations are proper. Seen from a frame that stands still over a step, the terms with `e3` vanish, so a step is
//! *exact* in the two [`Motion`]s, however long it is: what is integrated numerically is each vehicle's own motion only.

use super::feature_set::{FeatureSet, Inertial, Motion};
use super::located::Reduced;
use crate::time::Stamp;
use nalgebra::{Rotation3, Vector3};

/// The state after both have moved, for equally long.
#[must_use]
pub fn propagated(state: &Reduced, own: &Motion, neighbour: &Motion) -> Reduced {
    let elapsed_s = own.elapsed_s;
    let before_from_neighbour = about_vertical(state.yaw_rad);
    let after_from_before = about_vertical(-own.yaw_rad);
    Reduced {
        position_m: after_from_before
            * (state.position_m
                + state.velocity_m_s * elapsed_s
                + before_from_neighbour * neighbour.position_m
                - own.position_m),
        velocity_m_s: after_from_before
            * (state.velocity_m_s + before_from_neighbour * neighbour.velocity_m_s
                - own.velocity_m_s),
        yaw_rad: state.yaw_rad + neighbour.yaw_rad - own.yaw_rad,
    }
}

/// What moves a vehicle at one instant, in its level frame of that instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drive {
    /// Acceleration (m/s^2). Gravity may be left in if it is left in for both vehicles: it cancels.
    pub acceleration_m_s2: Vector3<f64>,
    /// Yaw rate (rad/s).
    pub yaw_rate_rad_s: f64,
}

/// The motion from one sample to the next by Tustin's rule: in between, the drive is the mean of both. Exact for a drive
/// that is constant in the turning level frame, else of second order.
#[must_use]
pub fn motion_between(from: &Drive, to: &Drive, elapsed_s: f64) -> Motion {
    let acceleration_m_s2 = (from.acceleration_m_s2 + to.acceleration_m_s2) / 2.0;
    let yaw_rad = (from.yaw_rate_rad_s + to.yaw_rate_rad_s) / 2.0 * elapsed_s;
    Motion {
        elapsed_s,
        yaw_rad,
        velocity_m_s: turned_by(once_integrated(yaw_rad), &acceleration_m_s2) * elapsed_s,
        position_m: turned_by(twice_integrated(yaw_rad), &acceleration_m_s2)
            * (elapsed_s * elapsed_s),
    }
}

/// The integrals after a further motion; inverse of [`Inertial::since`].
#[must_use]
pub fn advanced(inertial: &Inertial, motion: &Motion) -> Inertial {
    let gyro_from_level = about_vertical(inertial.yaw_rad);
    Inertial {
        elapsed_s: inertial.elapsed_s + motion.elapsed_s,
        yaw_rad: inertial.yaw_rad + motion.yaw_rad,
        velocity_m_s: inertial.velocity_m_s + gyro_from_level * motion.velocity_m_s,
        position_m: inertial.position_m
            + inertial.velocity_m_s * motion.elapsed_s
            + gyro_from_level * motion.position_m,
    }
}

/// A vehicle's integrals at an instant near its two newest sets, as if it went on accelerating and turning as it did from
/// the one to the other.
///
/// What is guessed wrong is put right by the next set, since the integrals are cumulative: the guess is the end of one step
/// and the beginning of the next.
#[must_use]
pub fn inertial_at(instant: Stamp, newest: &FeatureSet, before: Option<&FeatureSet>) -> Inertial {
    let ahead_s = (instant - newest.taken).as_secs_f64();
    let (yaw_rate_rad_s, acceleration_m_s2) = before
        .map(|before| {
            let elapsed_s = newest.inertial.elapsed_s - before.inertial.elapsed_s;
            (
                (newest.inertial.yaw_rad - before.inertial.yaw_rad) / elapsed_s,
                (newest.inertial.velocity_m_s - before.inertial.velocity_m_s) / elapsed_s,
            )
        })
        .filter(|(rate, acceleration)| {
            rate.is_finite() && acceleration.iter().all(|a| a.is_finite())
        })
        .unwrap_or((0.0, Vector3::zeros()));
    let inertial = &newest.inertial;
    Inertial {
        elapsed_s: inertial.elapsed_s + ahead_s,
        yaw_rad: inertial.yaw_rad + yaw_rate_rad_s * ahead_s,
        velocity_m_s: inertial.velocity_m_s + acceleration_m_s2 * ahead_s,
        position_m: inertial.position_m
            + inertial.velocity_m_s * ahead_s
            + acceleration_m_s2 * (ahead_s * ahead_s / 2.0),
    }
}

fn about_vertical(yaw_rad: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad)
}

/// Below this angle the closed forms lose more digits than their series leave out.
const SERIES_BELOW_RAD: f64 = 1e-2;

/// The integral over s in 0..1 of `R(yaw s)`, as (cosine part, sine part, what the vertical is multiplied by).
fn once_integrated(yaw: f64) -> (f64, f64, f64) {
    let y2 = yaw * yaw;
    if yaw.abs() < SERIES_BELOW_RAD {
        (
            1.0 - y2 / 6.0 + y2 * y2 / 120.0,
            yaw * (0.5 - y2 / 24.0 + y2 * y2 / 720.0),
            1.0,
        )
    } else {
        (yaw.sin() / yaw, (1.0 - yaw.cos()) / yaw, 1.0)
    }
}

/// The integral over s in 0..1 of `(1 - s) R(yaw s)`, likewise.
fn twice_integrated(yaw: f64) -> (f64, f64, f64) {
    let y2 = yaw * yaw;
    if yaw.abs() < SERIES_BELOW_RAD {
        (
            0.5 - y2 / 24.0 + y2 * y2 / 720.0,
            yaw * (1.0 / 6.0 - y2 / 120.0 + y2 * y2 / 5040.0),
            0.5,
        )
    } else {
        ((1.0 - yaw.cos()) / y2, (yaw - yaw.sin()) / y2, 0.5)
    }
}

fn turned_by((cosine, sine, vertical): (f64, f64, f64), vector: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(
        cosine * vector.x - sine * vector.y,
        sine * vector.x + cosine * vector.y,
        vertical * vector.z,
    )
}

#[cfg(test)]
pub(in crate::mutual) mod weaving;

#[cfg(test)]
mod tests;
