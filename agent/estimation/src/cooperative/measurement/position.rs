//! Relative position, seen in the measuring frame: the residual is measured less predicted, `that - v`.

use nalgebra::{SMatrix, Vector3, Vector6};

use super::{End, Gradient, Jacobian, check_range, check_vector};
use crate::cooperative::refusal::Refusal;
use crate::so3;

/// The measured origin of the `to` frame in the `from` frame, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Position {
    in_from: Vector3<f64>,
}

impl Position {
    /// A checked measurement of `R_i^T (t_j - t_i)`, metres.
    ///
    /// # Errors
    /// [`Refusal::NotFinite`] or [`Refusal::TooFar`].
    pub fn new(in_from: Vector3<f64>) -> Result<Self, Refusal> {
        check_vector(&in_from, "the relative position")?;
        check_range(in_from.norm(), "the relative position")?;
        Ok(Self { in_from })
    }

    /// The measured vector, metres.
    #[must_use]
    pub const fn vector(&self) -> Vector3<f64> {
        self.in_from
    }

    /// `that - v`, metres.
    #[must_use]
    pub fn residual(&self, from: &End, to: &End) -> Vector3<f64> {
        self.in_from - from.rotation.inverse() * (to.translation - from.translation)
    }

    /// `|that - v|^2`.
    #[must_use]
    pub fn cost(&self, from: &End, to: &End) -> f64 {
        self.residual(from, to).norm_squared()
    }

    /// `w_i = 2 v x that`, `delta_j = -2 (R_i that - d) = -delta_i`.
    #[must_use]
    pub fn gradient(&self, from: &End, to: &End) -> Gradient {
        let d = to.translation - from.translation;
        let v = from.rotation.inverse() * d;
        let w = 2.0 * v.cross(&self.in_from);
        let delta = -2.0 * (from.rotation * self.in_from - d);
        Gradient {
            from: Vector6::new(w.x, w.y, w.z, -delta.x, -delta.y, -delta.z),
            to: Vector6::new(0.0, 0.0, 0.0, delta.x, delta.y, delta.z),
        }
    }

    /// `J_wi = -[v]x`, `J_di = R_i^T`, `J_dj = -R_i^T`.
    #[must_use]
    pub fn jacobian(&self, from: &End, to: &End) -> Jacobian<3> {
        let from_from_world = from.rotation.inverse().to_rotation_matrix().into_inner();
        let v = from_from_world * (to.translation - from.translation);
        let mut jacobian = Jacobian::<3> {
            from: SMatrix::zeros(),
            to: SMatrix::zeros(),
        };
        jacobian
            .from
            .fixed_columns_mut::<3>(0)
            .copy_from(&-so3::hat(&v));
        jacobian
            .from
            .fixed_columns_mut::<3>(3)
            .copy_from(&from_from_world);
        jacobian
            .to
            .fixed_columns_mut::<3>(3)
            .copy_from(&-from_from_world);
        jacobian
    }
}
