//! Relative orientation: the residual is the rotation vector from the measured to the predicted orientation,
//! `phi = Log(Rhat^T R_i^T R_j)`.

use nalgebra::{SMatrix, UnitQuaternion, Vector3, Vector6};

use super::{End, Gradient, Jacobian, check_rotation, rotation_between};
use crate::cooperative::refusal::Refusal;
use crate::so3;

/// The measured rotation from the `to` frame to the `from` frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Orientation {
    from_from_to: UnitQuaternion<f64>,
}

impl Orientation {
    /// A checked measurement of `R_i^T R_j`.
    ///
    /// # Errors
    /// [`Refusal::NotFinite`] or [`Refusal::NotUnit`].
    pub fn new(from_from_to: UnitQuaternion<f64>) -> Result<Self, Refusal> {
        Ok(Self {
            from_from_to: check_rotation(&from_from_to)?,
        })
    }

    /// The measured rotation.
    #[must_use]
    pub const fn rotation(&self) -> UnitQuaternion<f64> {
        self.from_from_to
    }

    /// `phi`, rad, length at most pi.
    #[must_use]
    pub fn residual(&self, from: &End, to: &End) -> Vector3<f64> {
        rotation_between(&self.from_from_to, &(from.rotation.inverse() * to.rotation))
    }

    /// `|phi|^2`: the squared Riemannian distance of paper eq. 5.
    #[must_use]
    pub fn cost(&self, from: &End, to: &End) -> f64 {
        self.residual(from, to).norm_squared()
    }

    /// `w_i = -2 R_i^T R_j phi`, `w_j = 2 phi`.
    #[must_use]
    pub fn gradient(&self, from: &End, to: &End) -> Gradient {
        let phi = self.residual(from, to);
        let w_from = from.rotation.inverse() * (to.rotation * phi) * -2.0;
        let w_to = 2.0 * phi;
        Gradient {
            from: Vector6::new(w_from.x, w_from.y, w_from.z, 0.0, 0.0, 0.0),
            to: Vector6::new(w_to.x, w_to.y, w_to.z, 0.0, 0.0, 0.0),
        }
    }

    /// `J_wj = Jr^-1(phi)`, `J_wi = -Jr^-1(phi) R_j^T R_i`.
    #[must_use]
    pub fn jacobian(&self, from: &End, to: &End) -> Jacobian<3> {
        let to_from_from = to.rotation.inverse() * from.rotation;
        let phi = so3::log(&(self.from_from_to.inverse() * to_from_from.inverse()));
        let by_to = so3::right_jacobian_inverse(&phi);
        let by_from = -by_to * to_from_from.to_rotation_matrix().into_inner();
        let mut jacobian = Jacobian::<3> {
            from: SMatrix::zeros(),
            to: SMatrix::zeros(),
        };
        jacobian.from.fixed_columns_mut::<3>(0).copy_from(&by_from);
        jacobian.to.fixed_columns_mut::<3>(0).copy_from(&by_to);
        jacobian
    }
}
