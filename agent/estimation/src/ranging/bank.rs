//! Iterated Kalman filters of one neighbour, one at each place where it may be, weighed by the ranges: what a window
//! cannot decide, the ranges after it do, and nothing of the past is forgotten.

mod hypothesis;

use super::pose::{Dimension, RelativePose, wrapped};
use super::sample::{LevelOdometry, RangeSample};
use super::trail::Past;
use super::window::{MODES_MAX, Modes};
use hypothesis::{Hypothesis, Moved};
use nalgebra::{Matrix4, Vector3, Vector4};

/// Most hypotheses.
pub const HYPOTHESES_MAX: usize = MODES_MAX;

/// An image that only noise speaks against has at least this part of the weight of what it is the image of.
const IMAGE_WEIGHT: f64 = 0.1;

/// How a bank works.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BankSettings {
    /// In the plane or in space.
    pub dimension: Dimension,
    /// The smallest standard deviation that a range is taken to have (m). Below, filters lock onto wrong places.
    pub sigma_floor_m: f64,
    /// How often a range is wrong altogether: not in line of sight.
    pub outlier_probability: f64,
    /// Over how many metres wrong ranges are spread.
    pub outlier_spread_m: f64,
    /// Hypotheses of less weight than this part of the heaviest's are dropped.
    pub negligible: f64,
    /// So many more ranges that no hypothesis explains than ranges that one does, and all are refuted.
    pub refuted_after: u32,
}

impl BankSettings {
    /// In the plane.
    pub const PLANAR: Self = Self {
        dimension: Dimension::Planar,
        sigma_floor_m: 0.05,
        outlier_probability: 0.02,
        outlier_spread_m: 10.0,
        negligible: 1e-6,
        refuted_after: 4,
    };
    /// In space with levelled attitudes.
    pub const SPATIAL: Self = Self {
        dimension: Dimension::Spatial,
        ..Self::PLANAR
    };
}

/// One place where the neighbour may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Place {
    /// Where.
    pub pose: RelativePose,
    /// Its probability.
    pub weight: f64,
    /// Covariance of position and yaw (x, y, z in m, yaw in rad).
    pub covariance: Matrix4<f64>,
    /// The greatest standard deviation of an angle: line of sight or yaw (rad).
    pub angle_sigma_rad: f64,
}

impl Place {
    /// Standard deviation of the position, of all axes together (m).
    #[must_use]
    pub fn position_sigma_m(&self) -> f64 {
        let variances = &self.covariance;
        (variances[(0, 0)] + variances[(1, 1)] + variances[(2, 2)]).sqrt()
    }

    /// The same place after both vehicles, own and neighbour, went from where their odometries had them to where those have
    /// them now. None across an interruption, and when numbers fail.
    #[must_use]
    pub fn carried(
        &self,
        then: [&LevelOdometry; 2],
        now: [&LevelOdometry; 2],
        dimension: Dimension,
    ) -> Option<Self> {
        if then.map(|one| one.segment) != now.map(|one| one.segment) {
            return None;
        }
        let to_steps = self.pose.axes().step_by_position();
        let mut steps = to_steps * self.covariance * to_steps.transpose();
        if dimension == Dimension::Planar {
            hypothesis::decouple(&mut steps);
        }
        let known = Hypothesis {
            pose: self.pose,
            covariance: steps,
            log_weight: 0.0,
        };
        let [own, neighbour] = [0, 1].map(|end| Past::of(then[end], now[end]));
        let moved = Moved::new(own, neighbour, dimension == Dimension::Planar);
        let (pose, steps) = known.predicted(&moved)?;
        Some(Self::of_steps(pose, self.weight, steps, dimension))
    }

    /// From a covariance of steps.
    fn of_steps(
        pose: RelativePose,
        weight: f64,
        mut steps: Matrix4<f64>,
        dimension: Dimension,
    ) -> Self {
        if dimension == Dimension::Planar {
            steps[(2, 2)] = 0.0;
        }
        let most = steps[(1, 1)].max(steps[(2, 2)]).max(steps[(3, 3)]);
        Self {
            pose,
            weight,
            covariance: pose.covariance_of(&steps),
            angle_sigma_rad: most.sqrt(),
        }
    }
}

/// What became of a range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Explained {
    /// Some hypothesis explains it.
    Yes,
    /// None does: it was not in line of sight, or odometry is wrong.
    No,
}

/// A bank of filters of one neighbour.
#[derive(Clone, Copy, Debug)]
pub struct Bank {
    settings: BankSettings,
    /// Heaviest first, never empty.
    hypotheses: [Option<Hypothesis>; HYPOTHESES_MAX],
    /// Where both were at the last range.
    last: RangeSample,
    unexplained: u32,
}

impl Bank {
    /// From the minima of a window of which `newest` is the newest sample. None of none.
    #[must_use]
    pub fn started(settings: BankSettings, modes: &Modes, newest: &RangeSample) -> Option<Self> {
        let mut bank = Self {
            settings,
            hypotheses: [None; HYPOTHESES_MAX],
            last: *newest,
            unexplained: 0,
        };
        let mut count = 0;
        for mode in modes.as_slice() {
            let Some(mut covariance) = mode.covariance_of_steps() else {
                continue;
            };
            if settings.dimension == Dimension::Planar {
                hypothesis::decouple(&mut covariance);
            }
            bank.hypotheses[count] = Some(Hypothesis {
                pose: mode.pose,
                covariance,
                log_weight: mode.weight.max(f64::MIN_POSITIVE).ln(),
            });
            count += 1;
        }
        bank.prune();
        (count > 0).then_some(bank)
    }

    /// Takes a range that goes on from the last: its odometry is of the same segments. It is the caller's to have
    /// [checked](RangeSample::check) it.
    pub fn update(&mut self, sample: &RangeSample) -> Explained {
        let settings = self.settings;
        let moved = self.moved_to(&sample.own, &sample.neighbour);
        let variance = sample.variance_m2(settings.sigma_floor_m);
        let wrong = (settings.outlier_probability / settings.outlier_spread_m).ln();
        let right = (1.0 - settings.outlier_probability).ln();
        let mut explained = Explained::No;
        for slot in &mut self.hypotheses {
            let Some(hypothesis) = slot else { continue };
            let updated = hypothesis.updated(&moved, sample.range_m, variance);
            let fitting = updated.filter(|updated| right + updated.log_likelihood > wrong);
            let (pose, covariance, log_likelihood) = if let Some(updated) = fitting {
                explained = Explained::Yes;
                let both = right + updated.log_likelihood;
                let sum = both + (wrong - both).exp().ln_1p();
                (updated.pose, updated.covariance, sum)
            } else if let Some((pose, covariance)) = hypothesis.predicted(&moved) {
                (pose, covariance, wrong)
            } else {
                *slot = None;
                continue;
            };
            *hypothesis = Hypothesis {
                pose,
                covariance,
                log_weight: hypothesis.log_weight + log_likelihood,
            };
        }
        self.last = *sample;
        self.unexplained = match explained {
            Explained::Yes => self.unexplained.saturating_sub(1),
            Explained::No => self.unexplained + 1,
        };
        self.prune();
        explained
    }

    /// Keeps the image of the likeliest place below or above: where neither end has climbed, ranges say nothing against
    /// it, and what odometry's noise seems to say adds up round by round.
    pub fn keep_below(&mut self) {
        let Some(best) = self.hypotheses[0] else {
            return;
        };
        let image = Hypothesis {
            log_weight: best.log_weight + IMAGE_WEIGHT.ln(),
            ..best.below()
        };
        if image.is_same(&best) {
            return;
        }
        let mut known = self.hypotheses.iter_mut().flatten();
        if let Some(same) = known.find(|one| one.is_same(&image)) {
            same.log_weight = same.log_weight.max(image.log_weight);
        } else {
            // Heaviest first: the last place is empty, or the lightest's.
            self.hypotheses[HYPOTHESES_MAX - 1] = Some(image);
        }
        self.prune();
    }

    /// Whether the ranges have refuted all hypotheses.
    #[must_use]
    pub const fn is_refuted(&self) -> bool {
        self.unexplained >= self.settings.refuted_after || self.hypotheses[0].is_none()
    }

    /// The places, likeliest first, at the last range.
    pub fn places(&self) -> impl Iterator<Item = Place> + Clone + '_ {
        self.hypotheses
            .iter()
            .flatten()
            .map(|one| self.place(one, one.pose, &one.covariance))
    }

    /// The places, likeliest first, where the two have got to by their odometry since.
    pub fn places_at<'a>(
        &'a self,
        own: &LevelOdometry,
        neighbour: &LevelOdometry,
    ) -> impl Iterator<Item = Place> + Clone + 'a {
        let moved = self.moved_to(own, neighbour);
        self.hypotheses.iter().flatten().filter_map(move |one| {
            let (pose, covariance) = one.predicted(&moved)?;
            Some(self.place(one, pose, &covariance))
        })
    }

    fn place(&self, of: &Hypothesis, pose: RelativePose, steps: &Matrix4<f64>) -> Place {
        Place::of_steps(pose, of.log_weight.exp(), *steps, self.settings.dimension)
    }

    fn moved_to(&self, own: &LevelOdometry, neighbour: &LevelOdometry) -> Moved {
        Moved::new(
            Past::of(&self.last.own, own),
            Past::of(&self.last.neighbour, neighbour),
            self.settings.dimension == Dimension::Planar,
        )
    }

    /// Merges what has become the same, drops what is negligible, and makes the weights' sum one.
    fn prune(&mut self) {
        let log_weight = |one: &Option<Hypothesis>| one.map_or(f64::NEG_INFINITY, |h| h.log_weight);
        self.hypotheses
            .sort_by(|a, b| log_weight(b).total_cmp(&log_weight(a)));
        let heaviest = log_weight(&self.hypotheses[0]);
        for i in 1..HYPOTHESES_MAX {
            let (heavier, rest) = self.hypotheses.split_at_mut(i);
            let Some(lighter) = rest[0] else { break };
            if lighter.log_weight < heaviest + self.settings.negligible.ln() {
                rest[0] = None;
            } else if let Some(same) = heavier
                .iter_mut()
                .flatten()
                .find(|one| one.is_same(&lighter))
            {
                same.log_weight += (lighter.log_weight - same.log_weight).exp().ln_1p();
                rest[0] = None;
            }
        }
        self.hypotheses
            .sort_by(|a, b| log_weight(b).total_cmp(&log_weight(a)));
        let heaviest = log_weight(&self.hypotheses[0]);
        let present = self.hypotheses.iter().flatten();
        let sum: f64 = present.map(|one| (one.log_weight - heaviest).exp()).sum();
        for one in self.hypotheses.iter_mut().flatten() {
            one.log_weight -= heaviest + sum.ln();
        }
    }
}

/// Mean and covariance of all places together (x, y, z in m, yaw in rad, around the likeliest's). None of no place.
#[must_use]
pub fn moments(
    places: impl Iterator<Item = Place> + Clone,
) -> Option<(RelativePose, Matrix4<f64>)> {
    let reference = places.clone().next()?.pose;
    let mass: f64 = places.clone().map(|place| place.weight).sum();
    let off = |place: &Place| {
        let position = place.pose.position_m - reference.position_m;
        let yaw = wrapped(place.pose.yaw_rad - reference.yaw_rad);
        Vector4::new(position.x, position.y, position.z, yaw)
    };
    let mean = places
        .clone()
        .map(|place| off(&place) * (place.weight / mass))
        .sum::<Vector4<f64>>();
    let covariance = places
        .map(|place| {
            let error = off(&place) - mean;
            (place.covariance + error * error.transpose()) * (place.weight / mass)
        })
        .sum();
    let position = reference.position_m + Vector3::new(mean.x, mean.y, mean.z);
    let pose = RelativePose::new(position, reference.yaw_rad + mean.w);
    Some((pose, covariance))
}

#[cfg(test)]
mod tests;
