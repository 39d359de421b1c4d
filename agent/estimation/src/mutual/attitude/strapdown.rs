//! What an inertial sensor says between two of its samples: turn, change of velocity and of position, exact where rate and
//! force are constant in the body and of second order in the step otherwise (Tustin's rule).

use crate::so3;
use nalgebra::{UnitQuaternion, Vector3};

/// A reading: turn rate (rad/s) and proper acceleration (m/s^2) in the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Reading {
    pub(super) rate_rad_s: Vector3<f64>,
    pub(super) force_m_s2: Vector3<f64>,
}

/// What happened between two readings, in the body frame of the first; gravity is still in it.
pub(super) struct Between {
    /// `earlier_from_later`.
    pub(super) turn: UnitQuaternion<f64>,
    /// Integral of the force (m/s).
    pub(super) velocity_m_s: Vector3<f64>,
    /// Integral of that (m).
    pub(super) position_m: Vector3<f64>,
}

impl Between {
    pub(super) fn of(earlier: &Reading, later: &Reading, elapsed_s: f64) -> Self {
        // The second term is what the two rates turn about each other (coning, for a rate that changes linearly).
        let turn = (earlier.rate_rad_s + later.rate_rad_s) * (0.5 * elapsed_s)
            + earlier.rate_rad_s.cross(&later.rate_rad_s) * (elapsed_s * elapsed_s / 12.0);
        let force = (earlier.force_m_s2 + later.force_m_s2) * 0.5;
        Self {
            turn: so3::exp(&turn),
            velocity_m_s: so3::left_jacobian(&turn) * force * elapsed_s,
            position_m: integrated_twice(&turn, &force) * (elapsed_s * elapsed_s),
        }
    }
}

/// `(I/2 + b [w]x + c [w]x^2) a`, the double integral of `exp([w]x s) a` for s from 0 to 1.
fn integrated_twice(w: &Vector3<f64>, a: &Vector3<f64>) -> Vector3<f64> {
    let s = w.norm_squared();
    // b = (x - sin x)/x^3, c = (x^2/2 + cos x - 1)/x^4 with x = |w|; the closed forms lose all digits near zero.
    let (b, c) = if s < 0.04 {
        (
            1.0 / 6.0 - s / 120.0 * (1.0 - s / 42.0 * (1.0 - s / 72.0)),
            1.0 / 24.0 - s / 720.0 * (1.0 - s / 56.0 * (1.0 - s / 90.0)),
        )
    } else {
        let x = s.sqrt();
        ((x - x.sin()) / (s * x), (0.5 * s + x.cos() - 1.0) / (s * s))
    };
    let once = w.cross(a);
    a * 0.5 + once * b + w.cross(&once) * c
}
