//! A bank of Kalman filters of one neighbour, one for each of several distances at each place it may be, weighed as
//! particles are. As each carries a covariance, a few do what thousands of particles do.

mod hypothesis;

use super::clusters::{self, Points};
use super::mixture::{COMPONENTS_MAX, Component, Mixture, Responsibilities};
use super::particles::choose;
use super::{Estimate, MotionNoise, Prior};
use crate::mutual::direction;
use crate::mutual::feature_set::Motion;
use crate::mutual::located::Reduced;
use hypothesis::Hypothesis;
use nalgebra::{SMatrix, SVector};

/// Distances that are tried at each place.
pub const DISTANCES: usize = 7;
/// Most hypotheses that are kept; of more, the likeliest.
pub const HYPOTHESES_MAX: usize = DISTANCES * 9;

/// How a bank works.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BankSettings {
    /// What is known at first.
    pub prior: Prior,
    /// How far the motions may be wrong, in passing.
    pub noise: MotionNoise,
    /// How far they may be wrong for long.
    pub acceleration_bias: AccelerationBias,
    /// Which part of the weight is put where an answer is that no hypothesis explains:
    /// [`INJECTED_WEIGHT`](super::INJECTED_WEIGHT).
    pub injected_weight: f64,
    /// An answer at least half as likely as the likeliest is unexplained while less than this part of the weight is near.
    pub unexplained_below: f64,
}

/// The error of the difference of both accelerations, as a Markov process: what levelling by a slightly wrong attitude
/// leaves of gravity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AccelerationBias {
    /// Standard deviation, per axis (m/s^2).
    pub sigma_m_s2: f64,
    /// How long it lasts (s).
    pub lasting_s: f64,
}

impl BankSettings {
    /// For quadrotors as the paper's.
    pub const QUADROTOR: Self = Self {
        prior: Prior::ARENA,
        noise: MotionNoise::QUADROTOR,
        acceleration_bias: AccelerationBias {
            sigma_m_s2: 0.1,
            lasting_s: 30.0,
        },
        injected_weight: super::INJECTED_WEIGHT,
        unexplained_below: 0.02,
    };
}

/// Within this Mahalanobis distance, squared, a hypothesis explains an answer.
const EXPLAINED: f64 = 16.3;
/// Hypotheses of less weight than this part of the heaviest's are dropped. Injected ones have to live until the answer
/// after the one that brought them.
const NEGLIGIBLE: f64 = 1e-2 * super::INJECTED_WEIGHT;

/// A bank of filters of one neighbour.
#[derive(Clone, Debug)]
pub struct Bank {
    settings: BankSettings,
    /// Weights of a sum of one, heaviest first after an update; never empty.
    hypotheses: Vec<Hypothesis>,
}

impl Bank {
    /// Hypotheses at all distances around the answers of a first measurement.
    #[must_use]
    pub fn born(settings: BankSettings, first: &Mixture) -> Self {
        let mut born = Self {
            settings,
            hypotheses: Vec::with_capacity(HYPOTHESES_MAX + COMPONENTS_MAX * DISTANCES),
        };
        for component in first.components() {
            born.put(component, component.weight);
        }
        born.prune();
        born
    }

    /// Puts hypotheses of such weight together at an answer.
    fn put(&mut self, at: &Component, weight: f64) {
        let prior = &self.settings.prior;
        let ratio = (prior.distance_max_m / prior.distance_min_m).ln() / DISTANCES as f64;
        for i in 0..DISTANCES {
            let log_distance = prior.distance_min_m.ln() + (i as f64 + 0.5) * ratio;
            self.hypotheses.push(Hypothesis::new(
                at,
                log_distance,
                0.5 * ratio,
                &self.settings,
                weight / DISTANCES as f64,
            ));
        }
    }

    /// Moves every hypothesis as both vehicles moved.
    pub fn predict(&mut self, own: &Motion, neighbour: &Motion) {
        for hypothesis in &mut self.hypotheses {
            hypothesis.predict(own, neighbour, &self.settings);
        }
    }

    /// Corrects every hypothesis by the answers it may be meant by, and weighs it by how likely it made them.
    pub fn update(&mut self, measured: &Mixture) -> Responsibilities {
        let components = measured.components();
        let mut responsible = [0.0; COMPONENTS_MAX];
        let mut explained = [0.0; COMPONENTS_MAX];
        for hypothesis in &mut self.hypotheses {
            let before = hypothesis.weight;
            let corrected = hypothesis.correct(measured);
            hypothesis.weight = before * corrected.likelihood;
            for k in 0..components.len() {
                responsible[k] += before * corrected.densities[k];
                if corrected.distances2[k] < EXPLAINED && hypothesis.is_sound(&self.settings.prior)
                {
                    explained[k] += before;
                }
            }
        }
        let sum: f64 = self.hypotheses.iter().map(|h| h.weight).sum();
        self.prune();
        for (k, component) in components.iter().enumerate() {
            if component.weight >= 0.5 * components[0].weight
                && explained[k] < self.settings.unexplained_below
            {
                self.put(component, self.settings.injected_weight);
            }
        }
        self.prune();
        for responsible in &mut responsible {
            *responsible /= if sum > 0.0 { sum } else { 1.0 };
        }
        measured.by_feature(&responsible[..components.len()])
    }

    /// Merges what has become the same, drops what is negligible, and makes the weights' sum one.
    fn prune(&mut self) {
        for hypothesis in &mut self.hypotheses {
            if !hypothesis.is_sound(&self.settings.prior) {
                hypothesis.weight = 0.0;
            }
        }
        self.hypotheses
            .sort_by(|a, b| b.weight.total_cmp(&a.weight));
        for i in 1..self.hypotheses.len() {
            let (heavier, rest) = self.hypotheses.split_at_mut(i);
            let lighter = &mut rest[0];
            if let Some(same) = heavier
                .iter_mut()
                .find(|heavy| heavy.weight > 0.0 && heavy.is_same(lighter))
            {
                same.weight += lighter.weight;
                lighter.weight = 0.0;
            }
        }
        let heaviest = self.hypotheses.iter().map(|h| h.weight).fold(0.0, f64::max);
        let mut first = true;
        // One is kept, whatever it weighs.
        self.hypotheses
            .retain(|h| std::mem::take(&mut first) || h.weight > NEGLIGIBLE * heaviest);
        self.hypotheses
            .sort_by(|a, b| b.weight.total_cmp(&a.weight));
        self.hypotheses.truncate(HYPOTHESES_MAX);
        let sum: f64 = self.hypotheses.iter().map(|h| h.weight).sum();
        let even = 1.0 / self.hypotheses.len() as f64;
        for hypothesis in &mut self.hypotheses {
            hypothesis.weight = if sum > f64::MIN_POSITIVE {
                hypothesis.weight / sum
            } else {
                even
            };
        }
    }

    /// Heaviest hypothesis, mean and dominant cluster.
    #[must_use]
    pub fn estimate(&self) -> Estimate {
        let mut rows = [[0.0; HYPOTHESES_MAX]; 6];
        let n = self.hypotheses.len();
        for (i, hypothesis) in self.hypotheses.iter().enumerate() {
            let (direction, yaw_rad) = hypothesis.place();
            let (sin, cos) = yaw_rad.sin_cos();
            for (row, number) in rows.iter_mut().zip([
                direction.x,
                direction.y,
                direction.z,
                cos,
                sin,
                hypothesis.weight,
            ]) {
                row[i] = number;
            }
        }
        let [x, y, z, cos, sin, weight] = rows.each_ref().map(|row| &row[..n]);
        let points = Points {
            direction: [x, y, z],
            cos_yaw: cos,
            sin_yaw: sin,
            weight,
        };
        let mut labels = [clusters::NOWHERE; HYPOTHESES_MAX];
        let found = clusters::find(&points, &mut labels[..n]);
        let (label, mass) = found.dominant().unwrap_or((clusters::NOWHERE, 1.0));
        let (dominant, covariance) = self.moments(|i| labels[i] == label);
        Estimate {
            best: self.hypotheses[0].relative(),
            mean: self.moments(|_| true).0,
            dominant,
            covariance,
            dominant_mass: mass.min(1.0),
            modes: found.count().max(1),
        }
    }

    /// Mean and covariance of some of the hypotheses, each with the covariance of its own.
    fn moments(&self, of: impl Fn(usize) -> bool) -> (Reduced, SMatrix<f64, 7, 7>) {
        let some = || {
            self.hypotheses
                .iter()
                .enumerate()
                .filter(|(i, _)| of(*i))
                .map(|(_, hypothesis)| hypothesis)
        };
        // Yaws are averaged as angles around that of the heaviest.
        let Some(reference) = some().next().map(Hypothesis::relative) else {
            return (
                self.hypotheses[0].relative(),
                self.hypotheses[0].covariance_of_relative(),
            );
        };
        let state = |hypothesis: &Hypothesis| {
            let relative = hypothesis.relative();
            let mut state = SVector::<f64, 7>::zeros();
            state.fixed_rows_mut::<3>(0).copy_from(&relative.position_m);
            state
                .fixed_rows_mut::<3>(3)
                .copy_from(&relative.velocity_m_s);
            state[6] = direction::wrapped(relative.yaw_rad - reference.yaw_rad);
            state
        };
        let mass: f64 = some().map(|h| h.weight).sum();
        let mean = some().map(|h| state(h) * h.weight).sum::<SVector<f64, 7>>() / mass;
        let covariance = some()
            .map(|h| {
                let error = state(h) - mean;
                (h.covariance_of_relative() + error * error.transpose()) * (h.weight / mass)
            })
            .sum();
        let mean = Reduced {
            position_m: mean.fixed_rows::<3>(0).into_owned(),
            velocity_m_s: mean.fixed_rows::<3>(3).into_owned(),
            yaw_rad: direction::wrapped(reference.yaw_rad + mean[6]),
        };
        (mean, covariance)
    }

    /// Places drawn from the hypotheses in proportion to their weights: all equally likely.
    #[must_use]
    pub fn sampled(&self, count: usize) -> Vec<Reduced> {
        let weight: Vec<f64> = self.hypotheses.iter().map(|h| h.weight).collect();
        let mut chosen = vec![0; count];
        choose(&weight, &mut chosen, 0.5);
        chosen
            .into_iter()
            .map(|i| self.hypotheses[i].relative())
            .collect()
    }

    /// The heaviest hypotheses' places, heaviest first, at most `count`.
    #[must_use]
    pub fn likeliest(&self, count: usize) -> Vec<Reduced> {
        let mut order: Vec<_> = self.hypotheses.iter().collect();
        order.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        order
            .into_iter()
            .take(count)
            .map(Hypothesis::relative)
            .collect()
    }
}

#[cfg(test)]
mod tests;
