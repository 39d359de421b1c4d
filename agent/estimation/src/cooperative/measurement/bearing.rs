//! Bearing: the direction in which the other is seen. Two residuals are offered:
//!
//! - the paper's, `tau rho - v`, metres (eq. 6), which weighs an angle by the present distance;
//! - *on the sphere*, `tau - v / rho`, about radians, for a bearing with a stated angular noise.

use nalgebra::{Matrix3, Vector3, Vector6};

use super::{End, Gradient, Jacobian, UNIT_TOLERANCE, check_vector, range_and_direction};
use crate::cooperative::refusal::Refusal;
use crate::so3;

/// The measured unit vector towards the `to` origin, in the `from` frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bearing {
    in_from: Vector3<f64>,
}

impl Bearing {
    /// A checked measurement of `R_i^T u`; made exactly unit.
    ///
    /// # Errors
    /// [`Refusal::NotFinite`] or [`Refusal::NotUnit`].
    pub fn new(in_from: Vector3<f64>) -> Result<Self, Refusal> {
        check_vector(&in_from, "the bearing")?;
        let norm = in_from.norm();
        if (norm - 1.0).abs() <= UNIT_TOLERANCE {
            Ok(Self {
                in_from: in_from / norm,
            })
        } else {
            Err(Refusal::NotUnit {
                what: "the bearing",
                norm,
            })
        }
    }

    /// The measured unit vector.
    #[must_use]
    pub const fn direction(&self) -> Vector3<f64> {
        self.in_from
    }

    /// `tau rho - v`, metres.
    #[must_use]
    pub fn residual(&self, from: &End, to: &End) -> Vector3<f64> {
        let v = from.rotation.inverse() * (to.translation - from.translation);
        self.in_from * v.norm() - v
    }

    /// `|tau rho - v|^2`.
    #[must_use]
    pub fn cost(&self, from: &End, to: &End) -> f64 {
        self.residual(from, to).norm_squared()
    }

    /// `w_i = 2 rho v x tau`, `delta_j = 2 [2d - rho R_i tau - (tau.v) u] = -delta_i`.
    #[must_use]
    pub fn gradient(&self, from: &End, to: &End) -> Gradient {
        let d = to.translation - from.translation;
        let (rho, u) = range_and_direction(&d);
        let v = from.rotation.inverse() * d;
        let w = 2.0 * rho * v.cross(&self.in_from);
        let delta =
            2.0 * (2.0 * d - rho * (from.rotation * self.in_from) - self.in_from.dot(&v) * u);
        Gradient {
            from: Vector6::new(w.x, w.y, w.z, -delta.x, -delta.y, -delta.z),
            to: Vector6::new(0.0, 0.0, 0.0, delta.x, delta.y, delta.z),
        }
    }

    /// `J_wi = -[v]x`, `J_dj = tau u^T - R_i^T = -J_di`.
    #[must_use]
    pub fn jacobian(&self, from: &End, to: &End) -> Jacobian<3> {
        let (_, by_rotation, by_translation) = self.linearised(from, to);
        join(&by_rotation, &by_translation)
    }

    /// `tau - v / rho`; zero where the ends coincide and no direction exists.
    #[must_use]
    pub fn residual_on_sphere(&self, from: &End, to: &End) -> Vector3<f64> {
        let (rho, u) = range_and_direction(&(to.translation - from.translation));
        if rho < super::COINCIDENT_BELOW_M {
            Vector3::zeros()
        } else {
            self.in_from - from.rotation.inverse() * u
        }
    }

    /// `J_wi = -[v/rho]x`, `J_dj = -R_i^T (I - u u^T) / rho = -J_di`.
    #[must_use]
    pub fn jacobian_on_sphere(&self, from: &End, to: &End) -> Jacobian<3> {
        let (_, by_rotation, by_translation) = self.linearised_on_sphere(from, to);
        join(&by_rotation, &by_translation)
    }

    /// The residual, its derivative in `w_i`, and that in `delta_i`, which is minus that in `delta_j`.
    pub(crate) fn linearised(
        &self,
        from: &End,
        to: &End,
    ) -> (Vector3<f64>, Matrix3<f64>, Matrix3<f64>) {
        let d = to.translation - from.translation;
        let (rho, u) = range_and_direction(&d);
        let from_from_world = from.rotation.inverse().to_rotation_matrix().into_inner();
        let v = from_from_world * d;
        (
            self.in_from * rho - v,
            -so3::hat(&v),
            from_from_world - self.in_from * u.transpose(),
        )
    }

    /// As [`Bearing::linearised`], for the residual on the sphere; all zero where the ends coincide.
    pub(crate) fn linearised_on_sphere(
        &self,
        from: &End,
        to: &End,
    ) -> (Vector3<f64>, Matrix3<f64>, Matrix3<f64>) {
        let (rho, u) = range_and_direction(&(to.translation - from.translation));
        if rho < super::COINCIDENT_BELOW_M {
            return (Vector3::zeros(), Matrix3::zeros(), Matrix3::zeros());
        }
        let from_from_world = from.rotation.inverse().to_rotation_matrix().into_inner();
        let seen = from_from_world * u;
        (
            self.in_from - seen,
            -so3::hat(&seen),
            (from_from_world - seen * u.transpose()) / rho,
        )
    }
}

fn join(by_rotation: &Matrix3<f64>, by_translation: &Matrix3<f64>) -> Jacobian<3> {
    let mut jacobian = Jacobian::<3> {
        from: nalgebra::SMatrix::zeros(),
        to: nalgebra::SMatrix::zeros(),
    };
    jacobian
        .from
        .fixed_columns_mut::<3>(0)
        .copy_from(by_rotation);
    jacobian
        .from
        .fixed_columns_mut::<3>(3)
        .copy_from(by_translation);
    jacobian
        .to
        .fixed_columns_mut::<3>(3)
        .copy_from(&-by_translation);
    jacobian
}
