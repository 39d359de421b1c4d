//! Covariance that cumulative odometry gathers, in the odometry frame: purely additive, eleven numbers.
//!
//! With `C` the cumulative pose after an increment of covariance `Q = diag(qr I, qt I)` on its body side,
//! `Sigma <- Sigma + Ad(C) Q Ad(C)^T`. For isotropic `Q`, whatever its size from step to step, the sum is carried by
//! `a = sum qr`, `b = sum qr t`, `M = sum qr t t^T`, `c = sum qt`:
//! `Sigma_ww = a I`, `Sigma_vw = [b]x`, `Sigma_vv = tr(M) I - M + c I`.

use nalgebra::{Matrix3, Matrix6, Vector3};

use crate::so3;

/// The eleven numbers. The difference of two of them is the covariance of the motion between.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Growth {
    /// Sum of rotation variances (rad^2).
    pub rotation: f64,
    /// Sum of rotation variances times positions (rad^2 m).
    pub lever: Vector3<f64>,
    /// Sum of rotation variances times outer products of positions (rad^2 m^2); symmetric.
    pub lever_square: Matrix3<f64>,
    /// Sum of translation variances (m^2).
    pub translation: f64,
}

/// How far odometry may be off, as the root of the variances of all axes together.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Drift {
    /// In orientation, radians.
    pub rotation_rad: f64,
    /// In position, metres.
    pub translation_m: f64,
}

impl Drift {
    /// Of two vehicles against each other, when one drifts like the other.
    #[must_use]
    pub fn of_a_pair(self) -> Self {
        self.scaled(std::f64::consts::SQRT_2)
    }

    /// So many times as far.
    #[must_use]
    pub fn scaled(self, times: f64) -> Self {
        Self {
            rotation_rad: self.rotation_rad * times,
            translation_m: self.translation_m * times,
        }
    }
}

impl Growth {
    /// No motion, no covariance.
    pub fn zero() -> Self {
        Self {
            rotation: 0.0,
            lever: Vector3::zeros(),
            lever_square: Matrix3::zeros(),
            translation: 0.0,
        }
    }

    /// After one more increment that ends at `position` (m, odometry frame) with these standard deviations per axis.
    #[must_use]
    pub fn after(
        &self,
        position: &Vector3<f64>,
        rotation_sigma_rad: f64,
        translation_sigma_m: f64,
    ) -> Self {
        let variance = rotation_sigma_rad * rotation_sigma_rad;
        Self {
            rotation: self.rotation + variance,
            lever: self.lever + position * variance,
            lever_square: self.lever_square + position * position.transpose() * variance,
            translation: self.translation + translation_sigma_m * translation_sigma_m,
        }
    }

    /// Between two, at a fraction of the way.
    #[must_use]
    pub fn between(&self, later: &Self, fraction: f64) -> Self {
        let mix = |a: f64, b: f64| a + (b - a) * fraction;
        Self {
            rotation: mix(self.rotation, later.rotation),
            lever: self.lever + (later.lever - self.lever) * fraction,
            lever_square: self.lever_square + (later.lever_square - self.lever_square) * fraction,
            translation: mix(self.translation, later.translation),
        }
    }

    /// How far a body that is now at `position` (m, odometry frame) may have drifted since `earlier`.
    #[must_use]
    pub fn drift_since(&self, earlier: &Self, position: &Vector3<f64>) -> Drift {
        // Turned by w about t, a body at p moves by w x (p - t): of variance q I on w that is 2 q |p - t|^2 in all.
        let rotation = self.rotation - earlier.rotation;
        let lever = self.lever - earlier.lever;
        let square = self.lever_square.trace() - earlier.lever_square.trace();
        let turned =
            2.0 * (square - 2.0 * position.dot(&lever) + rotation * position.norm_squared());
        let moved = 3.0 * (self.translation - earlier.translation);
        Drift {
            rotation_rad: (3.0 * rotation).max(0.0).sqrt(),
            translation_m: (turned + moved).max(0.0).sqrt(),
        }
    }

    /// What was gathered since `earlier`: the covariance of the motion between.
    #[must_use]
    pub fn since(&self, earlier: &Self) -> Self {
        Self {
            rotation: self.rotation - earlier.rotation,
            lever: self.lever - earlier.lever,
            lever_square: self.lever_square - earlier.lever_square,
            translation: self.translation - earlier.translation,
        }
    }

    /// The same in axes of the odometry frame with their origin at `origin` (m, odometry frame).
    #[must_use]
    pub fn about(&self, origin: &Vector3<f64>) -> Self {
        let crossed = origin * self.lever.transpose();
        Self {
            lever: self.lever - origin * self.rotation,
            lever_square: self.lever_square - crossed - crossed.transpose()
                + origin * origin.transpose() * self.rotation,
            ..*self
        }
    }

    /// The variances of rotation and of translation increments so many times as large.
    #[must_use]
    pub fn scaled(&self, rotation: f64, translation: f64) -> Self {
        Self {
            rotation: self.rotation * rotation,
            lever: self.lever * rotation,
            lever_square: self.lever_square * rotation,
            translation: self.translation * translation,
        }
    }

    /// The 6 x 6 covariance of a world-side twist (rotation first) in the odometry frame.
    #[must_use]
    pub fn covariance(&self) -> Matrix6<f64> {
        let mut covariance = Matrix6::zeros();
        let cross = so3::hat(&self.lever);
        let spread = Matrix3::identity() * (self.lever_square.trace() + self.translation)
            - self.lever_square;
        covariance
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(Matrix3::identity() * self.rotation));
        covariance.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross);
        covariance
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&cross.transpose());
        covariance.fixed_view_mut::<3, 3>(3, 3).copy_from(&spread);
        covariance
    }

    /// `a, b, upper triangle of M row by row, c`: as it crosses the network.
    #[must_use]
    pub fn to_numbers(&self) -> [f64; 11] {
        let (b, m) = (&self.lever, &self.lever_square);
        [
            self.rotation,
            b.x,
            b.y,
            b.z,
            m[(0, 0)],
            m[(0, 1)],
            m[(0, 2)],
            m[(1, 1)],
            m[(1, 2)],
            m[(2, 2)],
            self.translation,
        ]
    }

    /// The inverse of [`Growth::to_numbers`].
    #[must_use]
    pub const fn from_numbers(numbers: &[f64; 11]) -> Self {
        let [rotation, x, y, z, xx, xy, xz, yy, yz, zz, translation] = *numbers;
        Self {
            rotation,
            lever: Vector3::new(x, y, z),
            lever_square: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
            translation,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Body, Odometry, Transform};

    #[test]
    fn what_crosses_the_network_comes_out_as_it_went_in() {
        let growth = Growth::zero()
            .after(&Vector3::new(1.0, -2.0, 3.0), 0.1, 0.2)
            .after(&Vector3::new(0.5, 4.0, -1.0), 0.3, 0.1);
        assert_eq!(Growth::from_numbers(&growth.to_numbers()), growth);
    }

    #[test]
    fn eleven_numbers_say_what_the_sum_of_adjoints_says() {
        let step = Transform::<Body, Body>::from_rotation_vector([0.1, -0.2, 0.3, 1.0, 0.2, -0.1])
            .unwrap();
        let mut pose = Transform::<Odometry, Body>::identity();
        let (mut growth, mut reference) = (Growth::zero(), Matrix6::zeros());
        for sigma in [(0.02, 0.001), (0.05, 0.3), (0.01, 0.2)] {
            pose = pose * step;
            growth = growth.after(&pose.translation, sigma.0, sigma.1);
            let rotation = pose.rotation.to_rotation_matrix().into_inner();
            let mut adjoint = Matrix6::zeros();
            adjoint.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
            adjoint.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
            adjoint
                .fixed_view_mut::<3, 3>(3, 0)
                .copy_from(&(so3::hat(&pose.translation) * rotation));
            let (qr, qt): (f64, f64) = (sigma.0 * sigma.0, sigma.1 * sigma.1);
            let noise = Matrix6::from_diagonal(&nalgebra::Vector6::new(qr, qr, qr, qt, qt, qt));
            reference += adjoint * noise * adjoint.transpose();
        }
        assert!((growth.covariance() - reference).norm() < 1e-12);

        let origin = pose.translation;
        let mut shift = Matrix6::identity();
        shift
            .fixed_view_mut::<3, 3>(3, 0)
            .copy_from(&so3::hat(&-origin));
        let about = growth.about(&origin).covariance();
        assert!((about - shift * reference * shift.transpose()).norm() < 1e-12);
        let doubled = growth.scaled(4.0, 4.0).since(&growth).covariance();
        assert!((doubled - reference * 3.0).norm() < 1e-12);
    }
}
