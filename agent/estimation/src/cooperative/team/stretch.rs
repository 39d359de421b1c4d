//! What odometry says between two poses of one vehicle: a factor of the window.

use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector4, Vector6};

use super::settings::{BIASED_STRETCH_MAX, ODOMETRY_VARIANCE_MAX, Settings, UNKNOWN_START};
use crate::odometry::OdometryPoint;
use crate::{Body, Odometry, Transform, World, se3, so3};

/// Bias states of one vehicle: three of the gyroscope (rad/s, added to what it says), one of the odometer's scale (added
/// to one).
pub(super) const BIASES: usize = 4;
/// By how much cumulative variances may seem to shrink, rad^2 or m^2.
const ROUNDING: f64 = 1e-12;
pub(super) type BiasJacobian = SMatrix<f64, 6, BIASES>;

/// A linearised factor, whitened: `r + J (xi_2 - xi_1) + B db`, all of unit variance. Its first three rows are what
/// rotation noise explains, the last three what is left to translation noise.
pub(super) struct Linear {
    pub(super) residual: Vector6<f64>,
    pub(super) twist: Matrix6<f64>,
    pub(super) bias: BiasJacobian,
}

/// The stretch between two points of one odometry, of which the earlier is first.
pub(super) struct Stretch<'a> {
    pub(super) earlier: &'a OdometryPoint,
    pub(super) later: &'a OdometryPoint,
}

impl Stretch<'_> {
    /// Both ends in odometry axes about the later end, where levers are short.
    fn ends(&self) -> (Transform<Odometry, Body>, Transform<Odometry, Body>) {
        let origin = self.later.odometry_from_body.translation;
        let about = |pose: &Transform<Odometry, Body>| {
            Transform::new(pose.rotation, pose.translation - origin)
        };
        (
            about(&self.earlier.odometry_from_body),
            about(&self.later.odometry_from_body),
        )
    }

    fn seconds(&self) -> f64 {
        (self.later.taken - self.earlier.taken).as_secs_f64()
    }

    /// Whether a bias is followed along the stretch, or taken for noise.
    fn is_followed(&self) -> bool {
        self.later.taken - self.earlier.taken <= BIASED_STRETCH_MAX
    }

    /// Where the later end is, by the earlier one and the biases.
    pub(super) fn predict(
        &self,
        world_from_earlier: &Transform<World, Body>,
        biases: &Vector4<f64>,
    ) -> Transform<World, Body> {
        let (earlier, later) = self.ends();
        let bent = se3::exp(&(self.bias_jacobian() * biases));
        *world_from_earlier * earlier.inverse() * bent * later
    }

    /// How biases move the later end against the earlier, as a twist in the frame of [`Stretch::ends`]: the integral of
    /// `Ad(C) [I; 0]` for the gyroscope, which the path of constant twist approximates (Simpson), and the way itself for
    /// the scale, which telescopes.
    fn bias_jacobian(&self) -> BiasJacobian {
        let mut jacobian = BiasJacobian::zeros();
        if !self.is_followed() {
            return jacobian;
        }
        let (earlier, later) = self.ends();
        let middle = se3::interpolate(&earlier, &later, 0.5);
        let seconds = self.seconds();
        for (pose, share) in [(&earlier, 1.0), (&middle, 4.0), (&later, 1.0)] {
            let rotation =
                pose.rotation.to_rotation_matrix().into_inner() * (share * seconds / 6.0);
            let mut turned = jacobian.fixed_view_mut::<3, 3>(0, 0);
            turned += rotation;
            let mut moved = jacobian.fixed_view_mut::<3, 3>(3, 0);
            moved += so3::hat(&pose.translation) * rotation;
        }
        jacobian
            .fixed_view_mut::<3, 1>(3, 3)
            .copy_from(&(later.translation - earlier.translation));
        jacobian
    }

    /// Whether what is said of its noise is a covariance at all.
    pub(super) fn is_sound(&self, settings: &Settings, period_s: f64) -> bool {
        let growth = self.later.growth.since(&self.earlier.growth);
        let origin = &self.later.odometry_from_body.translation;
        let stated = growth.about(origin).covariance();
        // Not the other way round: what is not a number is no covariance either.
        growth.rotation.min(growth.translation) >= -ROUNDING
            && stated
                .iter()
                .all(|number| number.abs() <= ODOMETRY_VARIANCE_MAX)
            && self
                .stated_covariance((1.0, 1.0), settings, period_s)
                .cholesky()
                .is_some()
    }

    /// The covariance in the frame of [`Stretch::ends`], its angles and its lengths no wider than those of an unknown
    /// start.
    fn covariance(&self, factors: (f64, f64), settings: &Settings, period_s: f64) -> Matrix6<f64> {
        let mut covariance = self.stated_covariance(factors, settings, period_s);
        for (from, most) in [(0, UNKNOWN_START.0), (3, UNKNOWN_START.1)] {
            let variances = (from..from + 3).map(|axis| covariance[(axis, axis)]);
            let sigma = variances.fold(0.0, f64::max).sqrt();
            if sigma > most {
                covariance.rows_mut(from, 3).scale_mut(most / sigma);
                covariance.columns_mut(from, 3).scale_mut(most / sigma);
            }
        }
        covariance
    }

    /// As stated, its rotation and translation noise taken `factors` times; the floor is added once a round of
    /// `period_s`.
    fn stated_covariance(
        &self,
        factors: (f64, f64),
        settings: &Settings,
        period_s: f64,
    ) -> Matrix6<f64> {
        let origin = &self.later.odometry_from_body.translation;
        let mut growth = self.later.growth.since(&self.earlier.growth).about(origin);
        let (rotation, translation) = factors;
        growth = growth.scaled(rotation * rotation, translation * translation);
        let rounds = (self.seconds() / period_s).max(1.0);
        let (floor_rad, floor_m) = settings.odometry_floor;
        growth.rotation += rounds * floor_rad * floor_rad;
        growth.translation += rounds * floor_m * floor_m;
        let mut covariance = growth.covariance();
        if !self.is_followed() {
            let seconds = self.seconds();
            let (earlier, _) = self.ends();
            let way_m = earlier.translation.norm();
            let turned = settings.bias.gyro.room * seconds;
            let moved = (settings.bias.scale.room + turned) * way_m;
            for axis in 0..3 {
                covariance[(axis, axis)] += turned * turned;
                covariance[(axis + 3, axis + 3)] += moved * moved;
            }
        }
        covariance
    }

    /// How uncertain the stretch leaves the orientation, radians per axis.
    pub(super) fn rotation_sigma_rad(&self, settings: &Settings) -> f64 {
        let turned = self.later.growth.rotation - self.earlier.growth.rotation;
        let bias = settings.bias.gyro.room * self.seconds();
        (turned.max(0.0) + bias * bias).sqrt()
    }

    /// The lower factor of the covariance.
    fn spread(
        &self,
        factors: (f64, f64),
        settings: &Settings,
        period_s: f64,
    ) -> Option<Matrix6<f64>> {
        let covariance = self.covariance(factors, settings, period_s);
        if let Some(factored) = covariance.cholesky() {
            return Some(factored.unpack());
        }
        // Rounding at the end of a long odometry, or levers that no path explains, which translation noise hid until it
        // was scaled down: without their cross terms, and as wide as they are in their widest direction.
        let mut wide = Matrix6::zeros();
        for from in [0, 3] {
            let half: Matrix3<f64> = covariance.fixed_view::<3, 3>(from, from).into();
            let widest = half.trace().max(2.0 * half.amax());
            for axis in from..from + 3 {
                wide[(axis, axis)] = widest;
            }
        }
        wide.cholesky().map(|factored| factored.unpack())
    }

    /// Linearises at two poses and the biases. None when there is no noise at all.
    ///
    /// `eta = Log(C_1 T_1^-1 T_2 C_2^-1) - B b`, `d eta = Jl^-1(eta) Ad(C_1 T_1^-1) (xi_2 - xi_1)`.
    pub(super) fn linearise(
        &self,
        world_from_earlier: &Transform<World, Body>,
        world_from_later: &Transform<World, Body>,
        biases: &Vector4<f64>,
        factors: (f64, f64),
        settings: &Settings,
        period_s: f64,
    ) -> Option<Linear> {
        let (earlier, later) = self.ends();
        let odometry_from_world = earlier * world_from_earlier.inverse();
        let eta = se3::log(&(odometry_from_world * *world_from_later * later.inverse()));
        let bias = self.bias_jacobian();
        let lower = self.spread(factors, settings, period_s)?;
        let whiten = |right: Matrix6<f64>| lower.solve_lower_triangular(&right);
        let residual = lower.solve_lower_triangular(&(eta - bias * biases))?;
        let twist = whiten(se3::left_jacobian_inverse(&eta) * se3::adjoint(&odometry_from_world))?;
        let bias = lower.solve_lower_triangular(&(-bias))?;
        Some(Linear {
            residual,
            twist,
            bias,
        })
    }
}

/// `Ad` of a pure translation.
pub(super) fn adjoint_of_shift(shift: &Vector3<f64>) -> Matrix6<f64> {
    let mut adjoint = Matrix6::identity();
    let cross: Matrix3<f64> = so3::hat(shift);
    adjoint.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross);
    adjoint
}
