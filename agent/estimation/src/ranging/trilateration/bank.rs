//! A mixture of Gaussians over where a neighbour is and how it is turned, fed with the distance and both odometries of
//! each round. The first distance starts it with every bearing and orientation; what the distances then contradict is
//! dropped, and as soon as [`MODES_MAX`] modes hold nearly all the weight, no more live on. Each is an iterated extended
//! Kalman filter that passes over distances which it takes for outliers, at a price.

use super::pair_motion::{self, Noise, PairMotion, Refusal};
use super::{Relative, ahead, wrapped};
use nalgebra::{Matrix2, Matrix3, Rotation2, RowVector3, Vector2, Vector3};
use std::f64::consts::TAU;

/// Modes that live on once they hold nearly all the weight.
pub const MODES_MAX: usize = 8;

/// Modes of the start: bearings times orientations.
pub const START_MODES: usize = START_ANGLES * START_ANGLES;

const START_ANGLES: usize = 24;

/// What the modes beyond [`MODES_MAX`] may hold of the weight to be dropped.
const REST: f64 = 1e-4;

/// What both must have driven for the likeliest mode to be worth telling (m).
const TRAVEL_MIN_M: f64 = 0.1;

/// The least standard deviation of a distance (m): mixtures of a sharper one lose the right mode between the others.
const RANGE_SIGMA_MIN_M: f64 = 0.05;

/// Steps of an update.
const ITERATIONS: usize = 5;

/// Modes with less than this share of the likeliest one's weight are dropped (natural logarithm).
const NEGLIGIBLE: f64 = -14.0;

/// Logarithm of the density of a distance that is an outlier: 2 % of all, spread over 10 m.
const OUTLIER: f64 = -6.2;

/// Two modes within so many standard deviations are one.
const SAME_NIS: f64 = 0.5;

/// One hypothesis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Its mean.
    pub at: Relative,
    /// Of x, y (m) and orientation (rad).
    pub covariance: Matrix3<f64>,
    /// Natural logarithm of its weight, not normalised.
    pub log_weight: f64,
}

/// The modes of one neighbour.
#[derive(Clone, Debug)]
pub struct Bank {
    modes: Vec<Mode>,
    /// What both have driven (m).
    own_travel_m: f64,
    their_travel_m: f64,
}

impl Bank {
    /// All bearings and orientations at a first distance (m).
    ///
    /// # Errors
    /// When the distance is not finite, negative or absurd.
    pub fn new(range_m: f64, noise: &Noise) -> Result<Self, Refusal> {
        pair_motion::check_range(range_m)?;
        let sigma_m = range_sigma_m(noise);
        // Neighbouring modes overlap at 0.7 standard deviations: their sum is flat.
        let step_rad = TAU / START_ANGLES as f64;
        let angle_sigma_rad = 0.7 * step_rad;
        let modes = (0..START_MODES).map(|index| {
            let bearing_rad = step_rad * (index / START_ANGLES) as f64;
            let orientation_rad = step_rad * (index % START_ANGLES) as f64;
            let across_m = angle_sigma_rad * range_m;
            let frame = Rotation2::new(bearing_rad);
            let polar = Matrix2::new(sigma_m.powi(2), 0.0, 0.0, across_m.powi(2));
            let mut covariance = Matrix3::zeros();
            let planar = frame.matrix() * polar * frame.matrix().transpose();
            covariance.fixed_view_mut::<2, 2>(0, 0).copy_from(&planar);
            covariance[(2, 2)] = angle_sigma_rad.powi(2);
            Mode {
                at: Relative {
                    position_m: range_m * ahead(bearing_rad),
                    orientation_rad: wrapped(orientation_rad),
                },
                covariance,
                log_weight: 0.0,
            }
        });
        Ok(Self {
            modes: modes.collect(),
            own_travel_m: 0.0,
            their_travel_m: 0.0,
        })
    }

    /// Takes in a round: how both have moved, and the distance at its end (m) if it was measured.
    ///
    /// # Errors
    /// With the reason when a number is not finite or absurd; then nothing has changed.
    pub fn update(
        &mut self,
        motion: &PairMotion,
        range_m: Option<f64>,
        noise: &Noise,
    ) -> Result<(), Refusal> {
        motion.check()?;
        if let Some(range_m) = range_m {
            pair_motion::check_range(range_m)?;
        }
        for mode in &mut self.modes {
            mode.predict(motion, noise);
            if let Some(range_m) = range_m {
                mode.correct(range_m, range_sigma_m(noise));
            }
        }
        self.own_travel_m += motion.own.translation_m.norm();
        self.their_travel_m += motion.theirs.translation_m.norm();
        self.prune();
        Ok(())
    }

    /// The modes, the likeliest first once a round has been taken in.
    #[must_use]
    pub fn modes(&self) -> &[Mode] {
        &self.modes
    }

    /// The likeliest mode, once both have moved: before, any is as likely as another.
    #[must_use]
    pub fn estimate(&self) -> Option<&Mode> {
        let has_begun = self.own_travel_m.min(self.their_travel_m) >= TRAVEL_MIN_M;
        self.modes.first().filter(|_| has_begun)
    }

    /// The weight of the likeliest mode among all, from 0 to 1.
    #[must_use]
    pub fn certainty(&self) -> f64 {
        let Some(best) = self.modes.first() else {
            return 0.0;
        };
        let weights = self.modes.iter();
        let all: f64 = weights
            .map(|one| (one.log_weight - best.log_weight).exp())
            .sum();
        1.0 / all
    }

    fn prune(&mut self) {
        // A mode that has lost its numbers is none.
        self.modes.retain(|one| one.log_weight.is_finite());
        self.modes
            .sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
        let best = self.modes.first().map_or(0.0, |one| one.log_weight);
        let mut kept: Vec<Mode> = Vec::new();
        for mut mode in self.modes.drain(..) {
            mode.log_weight -= best;
            if mode.log_weight < NEGLIGIBLE {
                break;
            }
            if let Some(same) = kept.iter_mut().find(|one| one.is_near(&mode)) {
                same.log_weight = (same.log_weight.exp() + mode.log_weight.exp()).ln();
            } else {
                kept.push(mode);
            }
        }
        kept.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
        let weight = |modes: &[Mode]| -> f64 { modes.iter().map(|one| one.log_weight.exp()).sum() };
        if kept.len() > MODES_MAX && weight(&kept[MODES_MAX..]) < REST * weight(&kept) {
            kept.truncate(MODES_MAX);
        }
        self.modes = kept;
    }
}

impl Mode {
    fn predict(&mut self, motion: &PairMotion, noise: &Noise) {
        let turned = Rotation2::new(-motion.own.rotation_rad);
        let before = self.at;
        self.at = motion.carried(&before);
        // d R(phi) t = R(phi) (-t_y, t_x) dphi
        let t = motion.theirs.translation_m;
        let by_orientation =
            turned * (Rotation2::new(before.orientation_rad) * Vector2::new(-t.y, t.x));
        let mut f = Matrix3::identity();
        f.fixed_view_mut::<2, 2>(0, 0).copy_from(turned.matrix());
        f.fixed_view_mut::<2, 1>(0, 2).copy_from(&by_orientation);
        self.covariance = f * self.covariance * f.transpose();
        let translation = noise.translation_sigma_m.powi(2);
        let rotation = noise.rotation_sigma_rad.powi(2);
        for one in [&motion.own, &motion.theirs] {
            if !one.is_still() {
                // A rotation of isotropic noise is the same noise.
                self.covariance[(0, 0)] += translation;
                self.covariance[(1, 1)] += translation;
            }
        }
        if !motion.own.is_still() {
            // p' = R(-w) (..): d p' = (p'_y, -p'_x) dw, d phi' = -dw.
            let p = self.at.position_m;
            let g = Vector3::new(p.y, -p.x, -1.0);
            self.covariance += rotation * g * g.transpose();
        }
        if !motion.theirs.is_still() {
            self.covariance[(2, 2)] += rotation;
        }
    }

    /// An iterated update with a distance: Gauss-Newton on prior and measurement.
    fn correct(&mut self, range_m: f64, sigma_m: f64) {
        let variance = sigma_m.powi(2);
        let prior = Vector3::new(
            self.at.position_m.x,
            self.at.position_m.y,
            self.at.orientation_rad,
        );
        let mut x = prior;
        let mut h = RowVector3::zeros();
        let mut predicted_m = 0.0;
        let mut gain = Vector3::zeros();
        for _ in 0..ITERATIONS {
            predicted_m = x.x.hypot(x.y);
            if predicted_m < 1e-6 {
                break;
            }
            h = RowVector3::new(x.x / predicted_m, x.y / predicted_m, 0.0);
            // S = H P H^T + R, K = P H^T / S
            let s = (h * self.covariance * h.transpose())[0] + variance;
            gain = self.covariance * h.transpose() / s;
            let innovation = range_m - predicted_m - (h * (prior - x))[0];
            x = prior + gain * innovation;
        }
        // The weight: Laplace's approximation of the marginal likelihood at the mode.
        let s = (h * self.covariance * h.transpose())[0] + variance;
        let misfit = (range_m - predicted_m).powi(2) / variance;
        let moved = x - prior;
        let prior_misfit = self
            .covariance
            .cholesky()
            .map_or(f64::NAN, |cholesky| moved.dot(&cholesky.solve(&moved)));
        let log_density = -0.5 * (misfit + prior_misfit + s.ln() + TAU.ln());
        if log_density < OUTLIER {
            self.log_weight += OUTLIER;
            return;
        }
        self.log_weight += log_density;
        // Joseph's form stays symmetric and positive.
        let reduced = Matrix3::identity() - gain * h;
        self.covariance =
            reduced * self.covariance * reduced.transpose() + variance * gain * gain.transpose();
        self.at = Relative {
            position_m: Vector2::new(x.x, x.y),
            orientation_rad: wrapped(x.z),
        };
    }

    fn is_near(&self, other: &Self) -> bool {
        let apart_m = other.at.position_m - self.at.position_m;
        let turned_rad = wrapped(other.at.orientation_rad - self.at.orientation_rad);
        let apart = Vector3::new(apart_m.x, apart_m.y, turned_rad);
        let nis = self
            .covariance
            .cholesky()
            .map_or(f64::INFINITY, |cholesky| apart.dot(&cholesky.solve(&apart)));
        nis < SAME_NIS
    }
}

fn range_sigma_m(noise: &Noise) -> f64 {
    // What is not a number is not greater.
    noise.range_sigma_m.max(RANGE_SIGMA_MIN_M)
}

#[cfg(test)]
mod tests;
