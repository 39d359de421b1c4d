//! One extended Kalman filter of a bank, in modified polar coordinates: direction, logarithm of the distance, velocity over
//! the distance, yaw, and the bias of the difference of both accelerations.
//!
//! Directions are measured and tell direction and velocity over distance by themselves; only the accelerations tell the
//! distance. With coordinates that are cut the same way, what is not observed yet is not moved either.

use super::{BankSettings, Prior};
use crate::mutual::direction;
use crate::mutual::feature_set::Motion;
use crate::mutual::filter::mixture::{COMPONENTS_MAX, Component, Mixture, carried};
use crate::mutual::located::Reduced;
use nalgebra::{Matrix2, Matrix3, Rotation3, SMatrix, SVector, UnitVector3, Vector3};
use std::f64::consts::PI;

/// Numbers of the error: direction (along its tangents), logarithm of the distance, scaled velocity, yaw, bias.
const N: usize = 10;
const LOG_DISTANCE: usize = 2;
const VELOCITY: usize = 3;
const YAW: usize = 6;
const BIAS: usize = 7;
/// Where what is measured is in the error.
const MEASURED: [usize; 3] = [0, 1, YAW];

type Error = SVector<f64, N>;
type Covariance = SMatrix<f64, N, N>;

/// Answers farther off than this (rad) are not compared: the error is no longer a small one.
const FAR_RAD: f64 = 1.2;

/// One hypothesis and its weight.
#[derive(Clone, Debug)]
pub(super) struct Hypothesis {
    pub(super) weight: f64,
    direction: UnitVector3<f64>,
    log_distance: f64,
    /// Relative velocity over the distance (1/s).
    scaled_velocity: Vector3<f64>,
    yaw_rad: f64,
    /// What the difference of accelerations has too little, in this vehicle's level frame (m/s^2).
    bias_m_s2: Vector3<f64>,
    covariance: Covariance,
}

/// What a correction found.
pub(super) struct Corrected {
    /// Of the measurement, the floor with it.
    pub(super) likelihood: f64,
    /// Of each answer.
    pub(super) densities: [f64; COMPONENTS_MAX],
    /// Squared Mahalanobis distance of each answer.
    pub(super) distances2: [f64; COMPONENTS_MAX],
}

impl Hypothesis {
    pub(super) fn new(
        at: &Component,
        log_distance: f64,
        log_distance_sigma: f64,
        settings: &BankSettings,
        weight: f64,
    ) -> Self {
        let mut covariance = Covariance::zeros();
        for (row, &to_row) in MEASURED.iter().enumerate() {
            for (column, &to_column) in MEASURED.iter().enumerate() {
                covariance[(to_row, to_column)] = at.covariance[(row, column)];
            }
        }
        covariance[(LOG_DISTANCE, LOG_DISTANCE)] = log_distance_sigma.powi(2);
        let speed = settings.prior.speed_sigma_m_s * (-log_distance).exp();
        for axis in 0..3 {
            covariance[(VELOCITY + axis, VELOCITY + axis)] = speed * speed;
            covariance[(BIAS + axis, BIAS + axis)] = settings.acceleration_bias.sigma_m_s2.powi(2);
        }
        Self {
            weight,
            direction: at.direction,
            log_distance,
            scaled_velocity: Vector3::zeros(),
            yaw_rad: at.yaw_rad,
            bias_m_s2: Vector3::zeros(),
            covariance,
        }
    }

    /// Moves as both vehicles moved, and takes what that leaves open into the covariance.
    pub(super) fn predict(&mut self, own: &Motion, neighbour: &Motion, settings: &BankSettings) {
        let (after, jacobian) = self.moved(own, neighbour, settings.acceleration_bias.lasting_s);
        let elapsed = own.elapsed_s.max(0.0);
        let inverse_distance = (-after.log_distance).exp();
        let velocity2 = settings.noise.velocity_m_s_rs.powi(2) * elapsed;
        let scaled2 = velocity2 * inverse_distance * inverse_distance;
        let bias = &settings.acceleration_bias;
        let kept = (-elapsed / bias.lasting_s).exp();
        let mut covariance = jacobian * self.covariance * jacobian.transpose();
        for axis in 0..3 {
            covariance[(VELOCITY + axis, VELOCITY + axis)] += scaled2;
            covariance[(BIAS + axis, BIAS + axis)] += bias.sigma_m_s2.powi(2) * (1.0 - kept * kept);
        }
        // The velocity's noise is spread over the step: a third of it, times the step's square, is position's.
        let position2 = scaled2 * elapsed * elapsed / 3.0;
        for i in [0, 1, LOG_DISTANCE] {
            covariance[(i, i)] += position2;
        }
        covariance[(YAW, YAW)] += settings.noise.yaw_rad_rs.powi(2) * elapsed;
        *self = Self {
            covariance,
            ..after
        };
        self.keep_symmetric();
    }

    /// Where the motions take it, and the derivative of the error after by the error before.
    fn moved(&self, own: &Motion, neighbour: &Motion, bias_lasting_s: f64) -> (Self, Covariance) {
        let elapsed = own.elapsed_s.max(0.0);
        let inverse_distance = (-self.log_distance).exp();
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -own.yaw_rad);
        let before_from_neighbour = Rotation3::from_axis_angle(&Vector3::z_axis(), self.yaw_rad);
        let (neighbour_p, neighbour_v) = (
            before_from_neighbour * neighbour.position_m,
            before_from_neighbour * neighbour.velocity_m_s,
        );
        let half2 = elapsed * elapsed / 2.0;
        let gained_p = neighbour_p - own.position_m + self.bias_m_s2 * half2;
        let gained_v = neighbour_v - own.velocity_m_s + self.bias_m_s2 * elapsed;
        // Position and velocity after, over the distance before.
        let position = self.direction.into_inner()
            + self.scaled_velocity * elapsed
            + gained_p * inverse_distance;
        let velocity = self.scaled_velocity + gained_v * inverse_distance;
        let growth = position.norm().max(1e-6);
        let kept = (-elapsed / bias_lasting_s).exp();
        let after = Self {
            weight: self.weight,
            direction: UnitVector3::new_normalize(turn * position),
            log_distance: self.log_distance + growth.ln(),
            scaled_velocity: turn * velocity / growth,
            yaw_rad: direction::wrapped(self.yaw_rad + neighbour.yaw_rad - own.yaw_rad),
            bias_m_s2: self.bias_m_s2 * kept,
            covariance: self.covariance,
        };

        let mut of_position = SMatrix::<f64, 3, N>::zeros();
        let mut of_velocity = SMatrix::<f64, 3, N>::zeros();
        let [across, up] = direction::tangents(&self.direction);
        of_position.set_column(0, &across);
        of_position.set_column(1, &up);
        of_position.set_column(LOG_DISTANCE, &(-gained_p * inverse_distance));
        of_velocity.set_column(LOG_DISTANCE, &(-gained_v * inverse_distance));
        let vertical = Vector3::z();
        of_position.set_column(YAW, &(vertical.cross(&neighbour_p) * inverse_distance));
        of_velocity.set_column(YAW, &(vertical.cross(&neighbour_v) * inverse_distance));
        for axis in 0..3 {
            of_position[(axis, VELOCITY + axis)] = elapsed;
            of_velocity[(axis, VELOCITY + axis)] = 1.0;
            of_position[(axis, BIAS + axis)] = half2 * inverse_distance;
            of_velocity[(axis, BIAS + axis)] = elapsed * inverse_distance;
        }
        let of_position = turn * of_position / growth;
        let of_velocity = turn * of_velocity / growth;
        let of_growth = after.direction.transpose() * of_position;
        let mut jacobian = Covariance::identity() * 0.0;
        for (row, tangent) in direction::tangents(&after.direction).iter().enumerate() {
            jacobian.set_row(row, &(tangent.transpose() * of_position));
        }
        jacobian.set_row(LOG_DISTANCE, &of_growth);
        jacobian[(LOG_DISTANCE, LOG_DISTANCE)] += 1.0;
        let of_scaled = of_velocity - after.scaled_velocity * of_growth;
        jacobian.fixed_rows_mut::<3>(VELOCITY).copy_from(&of_scaled);
        jacobian[(YAW, YAW)] = 1.0;
        for axis in 0..3 {
            jacobian[(BIAS + axis, BIAS + axis)] = kept;
        }
        (after, jacobian)
    }

    /// Corrects by every answer as far as it is likely to be meant, and tells how likely the whole measurement was.
    pub(super) fn correct(&mut self, measured: &Mixture) -> Corrected {
        let mut corrected = Corrected {
            likelihood: measured.floor_density(),
            densities: [0.0; COMPONENTS_MAX],
            distances2: [f64::INFINITY; COMPONENTS_MAX],
        };
        let mut step = Error::zeros();
        let mut spread = Covariance::zeros();
        let measured_covariance = SMatrix::<f64, 3, 3>::from_fn(|row, column| {
            self.covariance[(MEASURED[row], MEASURED[column])]
        });
        let across =
            SMatrix::<f64, N, 3>::from_fn(|row, column| self.covariance[(row, MEASURED[column])]);
        for (k, component) in measured.components().iter().enumerate() {
            let off = direction::difference(&self.direction, &component.direction);
            let yaw_off = direction::wrapped(component.yaw_rad - self.yaw_rad);
            if off.norm() > FAR_RAD || yaw_off.abs() > FAR_RAD {
                continue;
            }
            let innovation = Vector3::new(off.x, off.y, yaw_off);
            let carry = carried(&component.direction, &self.direction);
            let carry = with_yaw(&carry);
            // S = H P H^T + R
            let s = measured_covariance + carry * component.covariance * carry.transpose();
            let Some(cholesky) = s.cholesky() else {
                continue;
            };
            let distance2 = innovation.dot(&cholesky.solve(&innovation));
            let height = 1.0 / ((2.0 * PI).powi(3) * cholesky.determinant()).sqrt();
            let density = measured.probability(k) * height * (-0.5 * distance2).exp();
            corrected.distances2[k] = distance2;
            corrected.densities[k] = density;
            corrected.likelihood += density;
            let gain = across * cholesky.inverse();
            let move_by = gain * innovation;
            step += move_by * density;
            spread += (move_by * move_by.transpose() - gain * across.transpose()) * density;
        }
        let likelihood = corrected.likelihood;
        if likelihood > f64::MIN_POSITIVE {
            step /= likelihood;
            self.covariance += spread / likelihood - step * step.transpose();
            self.step(&step);
            self.keep_symmetric();
        }
        corrected
    }

    /// Moves the state by an error, and the covariance's directions with it.
    fn step(&mut self, by: &Error) {
        let before = self.direction;
        self.direction = direction::moved(&before, &by.fixed_rows::<2>(0).into_owned());
        let carry = carried(&before, &self.direction);
        let rows = carry * self.covariance.fixed_rows::<2>(0);
        self.covariance.fixed_rows_mut::<2>(0).copy_from(&rows);
        let columns = self.covariance.fixed_columns::<2>(0) * carry.transpose();
        self.covariance
            .fixed_columns_mut::<2>(0)
            .copy_from(&columns);
        self.log_distance += by[LOG_DISTANCE];
        self.scaled_velocity += by.fixed_rows::<3>(VELOCITY);
        self.yaw_rad = direction::wrapped(self.yaw_rad + by[YAW]);
        self.bias_m_s2 += by.fixed_rows::<3>(BIAS);
    }

    fn keep_symmetric(&mut self) {
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
    }

    /// Everything is a number, no variance is negative, and the distance is one that vehicles have.
    pub(super) fn is_sound(&self, prior: &Prior) -> bool {
        let nearest = prior.distance_min_m.ln() - BEYOND_PRIOR;
        let farthest = prior.distance_max_m.ln() + BEYOND_PRIOR;
        self.weight.is_finite()
            && self.direction.iter().all(|x| x.is_finite())
            && self.scaled_velocity.iter().all(|x| x.is_finite())
            && self.covariance.iter().all(|x| x.is_finite())
            && self.covariance.diagonal().min() >= 0.0
            && self.yaw_rad.is_finite()
            && (nearest..farthest).contains(&self.log_distance)
    }

    /// Two that tell the same within a fraction of what they are uncertain by.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        let mut off = Error::zeros();
        off.fixed_rows_mut::<2>(0)
            .copy_from(&direction::difference(&self.direction, &other.direction));
        off[LOG_DISTANCE] = other.log_distance - self.log_distance;
        off.fixed_rows_mut::<3>(VELOCITY)
            .copy_from(&(other.scaled_velocity - self.scaled_velocity));
        off[YAW] = direction::wrapped(other.yaw_rad - self.yaw_rad);
        (0..BIAS).all(|i| off[i] * off[i] < SAME_WITHIN2 * self.covariance[(i, i)])
    }

    pub(super) const fn place(&self) -> (UnitVector3<f64>, f64) {
        (self.direction, self.yaw_rad)
    }

    /// The state in Cartesian coordinates.
    pub(super) fn relative(&self) -> Reduced {
        let distance = self.log_distance.exp();
        Reduced {
            position_m: self.direction.into_inner() * distance,
            velocity_m_s: self.scaled_velocity * distance,
            yaw_rad: self.yaw_rad,
        }
    }

    /// Covariance of position, velocity and yaw.
    pub(super) fn covariance_of_relative(&self) -> SMatrix<f64, 7, 7> {
        let distance = self.log_distance.exp();
        let [across, up] = direction::tangents(&self.direction);
        let mut jacobian = SMatrix::<f64, 7, N>::zeros();
        for axis in 0..3 {
            jacobian[(axis, 0)] = across[axis] * distance;
            jacobian[(axis, 1)] = up[axis] * distance;
            jacobian[(axis, LOG_DISTANCE)] = self.direction[axis] * distance;
            jacobian[(3 + axis, LOG_DISTANCE)] = self.scaled_velocity[axis] * distance;
            jacobian[(3 + axis, VELOCITY + axis)] = distance;
        }
        jacobian[(6, YAW)] = 1.0;
        jacobian * self.covariance * jacobian.transpose()
    }
}

/// How far beyond the prior a distance may get, as a logarithm: three times.
const BEYOND_PRIOR: f64 = 1.1;

/// A quarter of a standard deviation, squared.
const SAME_WITHIN2: f64 = 0.0625;

fn with_yaw(carry: &Matrix2<f64>) -> Matrix3<f64> {
    let mut with_yaw = Matrix3::identity();
    with_yaw.fixed_view_mut::<2, 2>(0, 0).copy_from(carry);
    with_yaw
}

#[cfg(test)]
mod tests;
