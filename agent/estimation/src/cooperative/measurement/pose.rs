//! Relative pose. Two residuals are offered:
//!
//! - the paper's *product* form, orientation and position side by side (`residual`, `cost`, `gradient`, `jacobian`);
//! - the *twist* form, `Log(That^-1 T_i^-1 T_j)` in SE(3), rotation first (`twist_residual`, `twist_jacobian`). It is
//!   the one in which g2o files and GTSAM state a full 6x6 information matrix, and is used with such a matrix only.
//!
//! The two agree to first order in the rotation error but for the frame of the translation part: in the measured `to`
//! frame and with the opposite sign for the twist.

use nalgebra::{Matrix6, Vector6};

use super::{
    End, Gradient, Jacobian, Orientation, Position, check_range, check_rotation, check_vector,
};
use crate::cooperative::refusal::Refusal;
use crate::se3;
use crate::transform::{Sensor, Transform};

/// The measured pose of the `to` frame in the `from` frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    from_from_to: Transform<Sensor, Sensor>,
    orientation: Orientation,
    position: Position,
}

impl Pose {
    /// A checked measurement of `T_i^-1 T_j`.
    ///
    /// # Errors
    /// [`Refusal::NotFinite`], [`Refusal::NotUnit`] or [`Refusal::TooFar`].
    pub fn new(from_from_to: Transform<Sensor, Sensor>) -> Result<Self, Refusal> {
        let rotation = check_rotation(&from_from_to.rotation)?;
        check_vector(&from_from_to.translation, "the relative position")?;
        check_range(from_from_to.translation.norm(), "the relative position")?;
        Ok(Self {
            from_from_to: Transform::new(rotation, from_from_to.translation),
            orientation: Orientation::new(rotation)?,
            position: Position::new(from_from_to.translation)?,
        })
    }

    /// The measured transform.
    #[must_use]
    pub const fn relative(&self) -> Transform<Sensor, Sensor> {
        self.from_from_to
    }

    /// Its orientation part, as a measurement of that kind.
    #[must_use]
    pub const fn orientation(&self) -> &Orientation {
        &self.orientation
    }

    /// Its position part, as a measurement of that kind.
    #[must_use]
    pub const fn position(&self) -> &Position {
        &self.position
    }

    /// `(phi, that - v)`: rad, then metres.
    #[must_use]
    pub fn residual(&self, from: &End, to: &End) -> Vector6<f64> {
        let phi = self.orientation.residual(from, to);
        let rest = self.position.residual(from, to);
        Vector6::new(phi.x, phi.y, phi.z, rest.x, rest.y, rest.z)
    }

    /// `|phi|^2 + |that - v|^2`.
    #[must_use]
    pub fn cost(&self, from: &End, to: &End) -> f64 {
        self.orientation.cost(from, to) + self.position.cost(from, to)
    }

    /// The sum of the gradients of its two parts (paper eq. 7).
    #[must_use]
    pub fn gradient(&self, from: &End, to: &End) -> Gradient {
        let (turn, shift) = (
            self.orientation.gradient(from, to),
            self.position.gradient(from, to),
        );
        Gradient {
            from: turn.from + shift.from,
            to: turn.to + shift.to,
        }
    }

    /// The Jacobians of its two parts, one above the other.
    #[must_use]
    pub fn jacobian(&self, from: &End, to: &End) -> Jacobian<6> {
        let (turn, shift) = (
            self.orientation.jacobian(from, to),
            self.position.jacobian(from, to),
        );
        let mut jacobian = Jacobian::<6> {
            from: Matrix6::zeros(),
            to: Matrix6::zeros(),
        };
        jacobian.from.fixed_rows_mut::<3>(0).copy_from(&turn.from);
        jacobian.from.fixed_rows_mut::<3>(3).copy_from(&shift.from);
        jacobian.to.fixed_rows_mut::<3>(0).copy_from(&turn.to);
        jacobian.to.fixed_rows_mut::<3>(3).copy_from(&shift.to);
        jacobian
    }

    /// `Log(That^-1 T_i^-1 T_j)`: rotation (rad), then translation (m).
    #[must_use]
    pub fn twist_residual(&self, from: &End, to: &End) -> Vector6<f64> {
        se3::log(&(self.from_from_to.inverse() * (from.inverse() * *to)))
    }

    /// The derivative of [`Pose::twist_residual`]: `Jr^-1(r)` on the body twist of `to`, `-Jr^-1(r) Ad(T_j^-1 T_i)` on
    /// that of `from`; a body twist is `(w, R^T delta)`.
    #[must_use]
    pub fn twist_jacobian(&self, from: &End, to: &End) -> Jacobian<6> {
        let to_from_from = to.inverse() * *from;
        let residual = se3::log(&(self.from_from_to.inverse() * to_from_from.inverse()));
        let by_to_twist = se3::right_jacobian_inverse(&residual);
        let by_from_twist = -by_to_twist * se3::adjoint(&to_from_from);
        let in_world = |by_twist: Matrix6<f64>, end: &End| {
            let turned = by_twist.fixed_columns::<3>(3)
                * end.rotation.inverse().to_rotation_matrix().matrix();
            let mut jacobian = by_twist;
            jacobian.fixed_columns_mut::<3>(3).copy_from(&turned);
            jacobian
        };
        Jacobian {
            from: in_world(by_from_twist, from),
            to: in_world(by_to_twist, to),
        }
    }
}
