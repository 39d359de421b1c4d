//! The errors of a levelling filter and their covariance: a Kalman filter of twelve states about the attitude.
//!
//! Tilt `e` (about the gyro frame's x and y: `R = Exp(e) R^`), biases of rate and force (body), and how far the vehicle has
//! gone by its own reckoning, `v` and `p` (horizontal, gyro frame). With `f = R (a - ba)`:
//!
//! ```text
//! e' = -R bg        v' = (f_z e_y, -f_z e_x) - R ba        p' = v
//! ```
//!
//! What is measured is that a vehicle does not go away: `p = 0`, `v' = 0`, within what it roams and jolts. A tilt that is
//! wrong by `e` sends the reckoning away with `g e t^2 / 2`, and motion that comes back does not: so the tilt is found
//! under acceleration that lasts, and by an error's square in time, not by its first power as where the force's direction is
//! averaged.

use super::settings::Settings;
use nalgebra::{Matrix3, SMatrix, SVector, Vector2, Vector3};

const STATES: usize = 12;
const TILT: usize = 0;
const RATE_BIAS: usize = 2;
const FORCE_BIAS: usize = 5;
const VELOCITY: usize = 8;
const PLACE: usize = 10;

/// How long an error of scale turns one way (s): it makes a rate's error a noise of the density error^2 times twice this.
const SCALE_ERROR_S: f64 = 0.5;

/// Below this the variance of no state falls: rounding must not make a state certain.
const VARIANCE_MIN: f64 = 1e-20;

/// One number that is known of the errors: `row . errors = value`, within a variance.
struct Known {
    row: SVector<f64, STATES>,
    value: f64,
    variance: f64,
}

/// A correction to what is believed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Correction {
    pub(super) tilt_rad: Vector2<f64>,
    pub(super) rate_bias_rad_s: Vector3<f64>,
    pub(super) force_bias_m_s2: Vector3<f64>,
    pub(super) velocity_m_s: Vector2<f64>,
    pub(super) place_m: Vector2<f64>,
}

/// The covariance, and what was learnt of the errors since they were last taken out.
#[derive(Clone, Debug)]
pub(super) struct ErrorState {
    errors: SVector<f64, STATES>,
    covariance: SMatrix<f64, STATES, STATES>,
}

/// One interval of motion, as the covariance needs it.
pub(super) struct Interval {
    pub(super) elapsed_s: f64,
    /// `gyro_from_body`.
    pub(super) rotation: Matrix3<f64>,
    /// Mean force in the gyro frame (m/s^2).
    pub(super) force_m_s2: Vector3<f64>,
    /// Mean rate (rad/s).
    pub(super) rate_rad_s: Vector3<f64>,
}

impl ErrorState {
    pub(super) fn new(settings: &Settings) -> Self {
        let mut state = Self {
            errors: SVector::zeros(),
            covariance: SMatrix::zeros(),
        };
        state.forget_rate_bias(settings.rate.bias_sigma_rad_s);
        for axis in 0..3 {
            state.forget(FORCE_BIAS + axis, settings.force.bias_sigma_m_s2);
        }
        state.forget_tilt(settings);
        state
    }

    /// What an interval does to the errors.
    pub(super) fn advance(&mut self, settings: &Settings, interval: &Interval) {
        let dt = interval.elapsed_s;
        let rotation = &interval.rotation;
        let mut rates = SMatrix::<f64, STATES, STATES>::zeros();
        for row in 0..2 {
            for column in 0..3 {
                rates[(TILT + row, RATE_BIAS + column)] = -rotation[(row, column)];
                rates[(VELOCITY + row, FORCE_BIAS + column)] = -rotation[(row, column)];
            }
            rates[(PLACE + row, VELOCITY + row)] = 1.0;
        }
        rates[(VELOCITY, TILT + 1)] = interval.force_m_s2.z;
        rates[(VELOCITY + 1, TILT)] = -interval.force_m_s2.z;
        // exp(F dt), of which F^3 is zero but for the place by a bias, which is nothing in so short a time.
        let transition = SMatrix::identity() + rates * dt + rates * rates * (0.5 * dt * dt);
        self.covariance = transition * self.covariance * transition.transpose();
        // Rounding makes the two halves differ, and the difference grows.
        self.covariance = (self.covariance + self.covariance.transpose()) * 0.5;
        let turning = settings.rate.noise.powi(2)
            + (settings.rate.scale_error * interval.rate_rad_s.norm()).powi(2)
                * (2.0 * SCALE_ERROR_S);
        let noise = [
            (TILT, 2, turning),
            (RATE_BIAS, 3, settings.rate.bias_walk.powi(2)),
            (FORCE_BIAS, 3, settings.force.bias_walk.powi(2)),
            (VELOCITY, 2, settings.force.noise.powi(2)),
        ];
        for (first, count, density) in noise {
            for state in first..first + count {
                self.covariance[(state, state)] += density * dt;
            }
        }
    }

    /// The vehicle is still where it was: its reckoned place is zero but for how it roams, of this density (m^2/Hz).
    pub(super) fn does_not_go_away(
        &mut self,
        density: f64,
        interval: &Interval,
        place_m: &Vector2<f64>,
    ) {
        let variance = density / interval.elapsed_s;
        for axis in 0..2 {
            let mut row = SVector::zeros();
            row[PLACE + axis] = 1.0;
            self.learn(&Known {
                row,
                value: -place_m[axis],
                variance,
            });
        }
    }

    /// The vehicle does not accelerate, within `jolting` (m/s^2 per root Hz).
    pub(super) fn does_not_accelerate(&mut self, jolting: f64, interval: &Interval) {
        let force = &interval.force_m_s2;
        let variance = jolting.powi(2) / interval.elapsed_s;
        for axis in 0..2 {
            let mut row = SVector::zeros();
            if axis == 0 {
                row[TILT + 1] = force.z;
            } else {
                row[TILT] = -force.z;
            }
            for column in 0..3 {
                row[FORCE_BIAS + column] = -interval.rotation[(axis, column)];
            }
            self.learn(&Known {
                row,
                value: -force[axis],
                variance,
            });
        }
    }

    /// The vehicle does not turn: what its gyro says beyond the known bias is bias.
    pub(super) fn does_not_turn(&mut self, excess_rad_s: &Vector3<f64>, variance: f64) {
        for axis in 0..3 {
            let mut row = SVector::zeros();
            row[RATE_BIAS + axis] = 1.0;
            self.learn(&Known {
                row,
                value: excess_rad_s[axis],
                variance,
            });
        }
    }

    /// Whether so large a bias of the rate, beyond the known one, can be, within `sigmas`.
    pub(super) fn may_be_biased_by(
        &self,
        excess_rad_s: &Vector3<f64>,
        variance: f64,
        sigmas: f64,
    ) -> bool {
        (0..3).all(|axis| {
            let state = RATE_BIAS + axis;
            let off = excess_rad_s[axis] - self.errors[state];
            off * off <= sigmas * sigmas * (self.covariance[(state, state)] + variance)
        })
    }

    /// The errors as far as they are known; from now on they are held to be taken out.
    pub(super) fn take(&mut self) -> Correction {
        let errors = std::mem::replace(&mut self.errors, SVector::zeros());
        Correction {
            tilt_rad: errors.fixed_rows::<2>(TILT).into_owned(),
            rate_bias_rad_s: errors.fixed_rows::<3>(RATE_BIAS).into_owned(),
            force_bias_m_s2: errors.fixed_rows::<3>(FORCE_BIAS).into_owned(),
            velocity_m_s: errors.fixed_rows::<2>(VELOCITY).into_owned(),
            place_m: errors.fixed_rows::<2>(PLACE).into_owned(),
        }
    }

    /// Variance of the tilt, the mean of its two axes (rad^2).
    pub(super) fn tilt_variance_rad2(&self) -> f64 {
        0.5 * (self.covariance[(TILT, TILT)] + self.covariance[(TILT + 1, TILT + 1)])
    }

    /// The rate's bias may be anything of this standard deviation (rad/s).
    pub(super) fn forget_rate_bias(&mut self, sigma_rad_s: f64) {
        for axis in 0..3 {
            self.forget(RATE_BIAS + axis, sigma_rad_s);
        }
    }

    /// The tilt is that of a first reading; the biases stay known.
    pub(super) fn forget_tilt(&mut self, settings: &Settings) {
        for axis in 0..2 {
            self.forget(TILT + axis, settings.first_tilt_sigma_rad);
            self.forget(VELOCITY + axis, settings.first_speed_m_s);
            self.forget(PLACE + axis, 0.0);
        }
    }

    fn forget(&mut self, state: usize, sigma: f64) {
        self.errors[state] = 0.0;
        self.covariance.row_mut(state).fill(0.0);
        self.covariance.column_mut(state).fill(0.0);
        self.covariance[(state, state)] = sigma * sigma;
    }

    fn learn(&mut self, known: &Known) {
        let across = self.covariance * known.row;
        let spread = known.row.dot(&across) + known.variance;
        let innovation = known.value - known.row.dot(&self.errors);
        self.errors += across * (innovation / spread);
        self.covariance -= across * across.transpose() / spread;
        for state in 0..STATES {
            let variance = &mut self.covariance[(state, state)];
            *variance = variance.max(VARIANCE_MIN);
        }
    }
}
