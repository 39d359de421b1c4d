//! Distance: the residual is measured less predicted, `deltahat - rho`. It never turns anything.

use nalgebra::{Vector3, Vector6};

use super::{End, Gradient, Jacobian, check_range, range_and_direction};
use crate::cooperative::refusal::Refusal;

/// The measured distance between the two origins, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Distance {
    metres: f64,
}

impl Distance {
    /// A checked measurement of `|t_j - t_i|`, metres.
    ///
    /// # Errors
    /// [`Refusal::NotFinite`], [`Refusal::NegativeDistance`] or [`Refusal::TooFar`].
    pub fn new(metres: f64) -> Result<Self, Refusal> {
        if !metres.is_finite() {
            return Err(Refusal::NotFinite {
                what: "the distance",
            });
        }
        if metres < 0.0 {
            return Err(Refusal::NegativeDistance { metres });
        }
        check_range(metres, "the distance")?;
        Ok(Self { metres })
    }

    /// The measured distance, metres.
    #[must_use]
    pub const fn metres(&self) -> f64 {
        self.metres
    }

    /// `deltahat - rho`, metres.
    #[must_use]
    pub fn residual(&self, from: &End, to: &End) -> f64 {
        self.metres - (to.translation - from.translation).norm()
    }

    /// `(deltahat - rho)^2`.
    #[must_use]
    pub fn cost(&self, from: &End, to: &End) -> f64 {
        self.residual(from, to).powi(2)
    }

    /// `delta_j = -2 (deltahat - rho) u = -delta_i`; zero where the ends coincide.
    #[must_use]
    pub fn gradient(&self, from: &End, to: &End) -> Gradient {
        let (residual, u) = self.linearised(from, to);
        let delta = -2.0 * residual * u;
        Gradient {
            from: Vector6::new(0.0, 0.0, 0.0, -delta.x, -delta.y, -delta.z),
            to: Vector6::new(0.0, 0.0, 0.0, delta.x, delta.y, delta.z),
        }
    }

    /// `J_dj = -u^T`, `J_di = u^T`.
    #[must_use]
    pub fn jacobian(&self, from: &End, to: &End) -> Jacobian<1> {
        let (_, u) = self.linearised(from, to);
        Jacobian {
            from: nalgebra::RowVector6::new(0.0, 0.0, 0.0, u.x, u.y, u.z),
            to: nalgebra::RowVector6::new(0.0, 0.0, 0.0, -u.x, -u.y, -u.z),
        }
    }

    /// The residual and `u`.
    pub(crate) fn linearised(&self, from: &End, to: &End) -> (f64, Vector3<f64>) {
        let (rho, u) = range_and_direction(&(to.translation - from.translation));
        (self.metres - rho, u)
    }
}
