//! Identity that persists: anonymous bearings of five degrees made to say who is where.
//!
//! In each vehicle a [`Tracker`] follows what its camera sees. From the tracks that all vehicles tell, a hidden Markov
//! model per pair finds which track of the one is the other and how their headings differ; the yaws of three vehicles
//! close, and that is read out. A neighbour that is sure enough gets a bank of filters over its distance, then a place in
//! the joint filter of all neighbours, which takes the raw features of all and what the inertial sensors integrated.

use crate::mutual::direction::{difference, turned, wrapped};
use crate::mutual::feature_set::{Feature, FeatureSet, Motion, TrackNumber};
use crate::mutual::located::{Located, Status};
use crate::mutual::unused::Unused;
use crate::time::{Span, Stamp};
use crate::vehicle_id::VehicleId;

mod tracker;

mod talker;

mod pair_model;

mod closure;

mod yaw;

mod relative;

mod sight;

mod range_bank;

mod joint_filter;

mod initialising;

#[cfg(test)]
mod flight;

#[cfg(test)]
mod tests;

pub use tracker::Tracker;

use closure::{Readout, pair_index};
use initialising::Initialising;
use joint_filter::JointFilter;
use pair_model::PairModel;
use sight::{FEATURE_WIDENED, GATE, Sight};
use talker::{Taken, Talker};
use yaw::{likeliest_yaw, modes};

/// Neighbours that are known at once; sets of others are passed over.
pub const NEIGHBOURS_MAX: usize = 16;
/// How often the pair models take what has come.
const EPOCH: Span = Span::millis(250);
/// A neighbour not heard for so long is forgotten.
const FORGOTTEN_AFTER: Span = Span::secs(5);
/// Sets whose stamp is further ahead of the own newest, or further behind, are refused.
const AHEAD_MAX: Span = Span::secs(1);
const BEHIND_MAX: Span = Span::secs(2);
/// Features older than this say nothing any more (s).
const FEATURE_AGE_MAX_S: f64 = 0.5;
/// Longest step of the filters (s): after a longer pause of the own sets all is begun anew.
const STEP_MAX_S: f64 = 1.0;
/// Exponent of how much a track that is someone else's is not this one's.
const EXCLUSIVE: f64 = 0.15;
/// Least factor before that exponent.
const EXCLUSIVE_MIN: f64 = 0.03;
/// Chance of any identity for a feature that is of no confirmed track.
const CHANCE_UNTRACKED: f64 = 0.1;
/// Probability above which an identity and a yaw are taken for sure.
const SURE: f64 = 0.7;
/// Probability above which a feature is said to be a neighbour.
const CONFIRMED: f64 = 0.9;

/// What a feature of the own newest set is.
#[derive(Clone, Debug, PartialEq)]
pub struct Identification {
    /// Which feature of the set.
    pub feature: usize,
    /// For each neighbour the probability that it is this one; together at most one.
    pub probabilities: Vec<(VehicleId, f64)>,
    /// The neighbour it is taken to be.
    pub confirmed: Option<VehicleId>,
}

/// The pipeline of one vehicle. Deterministic; what it does per set is bounded by [`NEIGHBOURS_MAX`], the bounds of
/// [`FeatureSet`] and the lanes of the pair models.
#[derive(Clone, Debug)]
pub struct Identity {
    vehicle: VehicleId,
    /// This vehicle first, then neighbours in the order in which they appeared.
    talkers: Vec<Talker>,
    models: Vec<PairModel>,
    readouts: Vec<Readout>,
    initialising: Vec<Initialising>,
    joint: JointFilter,
    epoch: Option<Stamp>,
    identifications: Vec<Identification>,
}

impl Identity {
    /// Nothing was seen or heard yet.
    #[must_use]
    pub fn new(vehicle: VehicleId) -> Self {
        Self {
            vehicle,
            talkers: Vec::new(),
            models: Vec::new(),
            readouts: Vec::new(),
            initialising: Vec::new(),
            joint: JointFilter::new(),
            epoch: None,
            identifications: Vec::new(),
        }
    }

    /// Takes a set of this vehicle's own: the filters advance to its instant. A set that is not newer than the one before
    /// changes nothing.
    pub fn own(&mut self, set: &FeatureSet) {
        let Some(own) = self.talkers.first_mut() else {
            self.talkers.extend(Talker::new(self.vehicle, set));
            return;
        };
        let before = own.taken;
        let Ok(taken) = own.hear(set) else { return };
        let dt_s = (set.taken - before).as_secs_f64();
        if taken == Taken::Restarted || dt_s > STEP_MAX_S {
            *self = Self::new(self.vehicle);
            self.talkers.extend(Talker::new(self.vehicle, set));
            return;
        }
        self.forget_the_silent(set.taken);
        let motions: Vec<Motion> = self
            .talkers
            .iter_mut()
            .map(|talker| talker.moved_until(set.taken))
            .collect();
        let unheard: Vec<_> = self
            .talkers
            .iter()
            .map(|talker| talker.unheard(set.taken, dt_s))
            .collect();
        self.joint.predict(dt_s, &motions, &unheard);
        for (at, neighbour) in self.initialising.iter_mut().enumerate() {
            neighbour.predict(dt_s, &motions[0], &motions[at + 1], unheard[at + 1]);
        }
        self.observe(set);
        let due = self.epoch.is_none_or(|epoch| set.taken - epoch >= EPOCH);
        if due {
            self.epoch = Some(set.taken);
            self.take_epoch(set.taken);
        }
    }

    /// Takes a set that a neighbour told, its stamp by this vehicle's clock.
    ///
    /// # Errors
    /// Why it was not: then nothing has changed.
    pub fn heard(&mut self, from: VehicleId, set: &FeatureSet) -> Result<(), Unused> {
        let own = self.talkers.first().ok_or(Unused::NothingOwn)?;
        if from == self.vehicle {
            return Err(Unused::Own);
        }
        if set.taken > own.taken + AHEAD_MAX {
            return Err(Unused::TooNew);
        }
        if set.taken < own.taken - BEHIND_MAX {
            return Err(Unused::TooOld);
        }
        let known = self
            .talkers
            .iter()
            .position(|talker| talker.vehicle == from);
        if let Some(index) = known {
            if self.talkers[index].hear(set)? == Taken::Newer {
                return Ok(());
            }
            self.forget(index);
        }
        if self.talkers.len() > NEIGHBOURS_MAX {
            return Err(Unused::Full);
        }
        let mut talker = Talker::new(from, set)?;
        let _ = talker.moved_until(own_instant(&self.talkers));
        self.talkers.push(talker);
        self.initialising.push(Initialising::new());
        for _ in 0..self.talkers.len() - 1 {
            self.models.push(PairModel::new());
        }
        self.readouts = closure::read(&self.models, self.talkers.len());
        Ok(())
    }

    /// Every neighbour that is heard, in the order in which they appeared.
    #[must_use]
    pub fn located(&self) -> Vec<Located> {
        (1..self.talkers.len())
            .map(|talker| self.locate(talker))
            .collect()
    }

    /// When the newest own set was taken.
    #[must_use]
    pub fn taken(&self) -> Option<Stamp> {
        self.talkers.first().map(|own| own.taken)
    }

    /// What each feature of the own newest set is.
    #[must_use]
    pub fn identities(&self) -> &[Identification] {
        &self.identifications
    }

    fn locate(&self, talker: usize) -> Located {
        let readout = &self.readouts[pair_index(0, talker)];
        let yaw = likeliest_yaw(readout);
        let identity_probability = readout.lanes[0].iter().copied().fold(0.0, f64::max);
        let joint = self.joint.state(talker);
        let doubted = self.initialising[talker - 1].doubted();
        let relative = joint.or_else(|| self.initialising[talker - 1].state());
        let status = match relative {
            Some(_) if joint.is_some() && yaw.probability >= SURE && !doubted => Status::Converged,
            Some(_) => Status::Ambiguous {
                modes: modes(readout),
            },
            None => Status::Unknown,
        };
        Located {
            vehicle: self.talkers[talker].vehicle,
            status,
            relative,
            covariance: self.joint.covariance(talker),
            identity_probability,
        }
    }

    /// Gives the filters every feature that has not been used.
    fn observe(&mut self, set: &FeatureSet) {
        let now = set.taken;
        let count = self.talkers.len();
        for observer in 0..count {
            let back_rad = -self.talkers[observer].yaw_rad();
            for waiting in self.talkers[observer].waiting() {
                let age_s = (now - waiting.taken).as_secs_f64();
                if age_s.abs() > FEATURE_AGE_MAX_S {
                    continue;
                }
                let sights: Vec<Sight> = waiting
                    .features
                    .iter()
                    .map(|feature| Sight {
                        direction: turned(&feature.direction, back_rad),
                        variance_rad2: feature.sigma_rad * feature.sigma_rad,
                        chances: self
                            .chances(observer, self.talkers[observer].lane_of(feature.track)),
                        strays: self.strays(observer, feature, &waiting.features),
                    })
                    .collect();
                initialising::observe(
                    &mut self.initialising,
                    &self.talkers[observer],
                    observer,
                    age_s,
                    &sights,
                );
                let held = self.joint.observe(observer, age_s, &sights);
                if observer == 0 {
                    self.identify(&sights, &held);
                }
            }
        }
        self.joint.settle();
    }

    /// For each talker the probability that an observer's lane is it.
    fn chances(&self, observer: usize, lane: Option<usize>) -> Vec<f64> {
        let chance = |target: usize| match lane {
            _ if target == observer => 0.0,
            None => CHANCE_UNTRACKED,
            Some(lane) => self.chance(observer, target, lane),
        };
        (0..self.talkers.len()).map(chance).collect()
    }

    /// Tracks that none of the image's features went into, near one of them.
    fn strays(
        &self,
        observer: usize,
        feature: &Feature,
        image: &[Feature],
    ) -> Vec<(f64, Vec<f64>)> {
        let talker = &self.talkers[observer];
        let went_without =
            |track: TrackNumber| image.iter().all(|other| other.track != Some(track));
        let tracks = talker.tracks().iter();
        tracks
            .filter(|(track, ..)| went_without(*track))
            .filter_map(|(track, direction, variance_rad2)| {
                let away2 = difference(direction, &feature.direction).norm_squared();
                let distance =
                    away2 / (variance_rad2 + FEATURE_WIDENED * feature.sigma_rad.powi(2));
                (distance < GATE).then(|| {
                    (
                        distance,
                        self.chances(observer, talker.lane_of(Some(*track))),
                    )
                })
            })
            .collect()
    }

    fn chance(&self, observer: usize, target: usize, lane: usize) -> f64 {
        let (first, second) = (observer.min(target), observer.max(target));
        let lanes = &self.readouts[pair_index(first, second)].lanes;
        lanes[usize::from(observer > target)]
            .get(lane)
            .copied()
            .unwrap_or(0.0)
    }

    fn identify(&mut self, sights: &[Sight], held: &[Option<(usize, f64)>]) {
        self.identifications.clear();
        for (feature, (sight, held)) in sights.iter().zip(held).enumerate() {
            let probability = |talker: usize| match held {
                Some((target, probability)) if *target == talker => *probability,
                Some((_, probability)) => (1.0 - probability) * sight.chances[talker],
                None => 0.0,
            };
            let probabilities: Vec<_> = (1..self.talkers.len())
                .map(|talker| (self.talkers[talker].vehicle, probability(talker)))
                .collect();
            let confirmed = probabilities
                .iter()
                .find(|(_, probability)| *probability > CONFIRMED)
                .map(|(who, _)| *who);
            self.identifications.push(Identification {
                feature,
                probabilities,
                confirmed,
            });
        }
    }

    fn take_epoch(&mut self, now: Stamp) {
        let count = self.talkers.len();
        let exclusive: Vec<Vec<Vec<f64>>> = (0..count)
            .map(|observer| self.exclusive(observer))
            .collect();
        let fresh: Vec<bool> = self
            .talkers
            .iter_mut()
            .map(|talker| talker.refresh_lanes(now))
            .collect();
        let carried: Vec<Vec<Vec<f64>>> = exclusive
            .iter()
            .zip(&self.talkers)
            .map(|(of_targets, talker)| {
                of_targets
                    .iter()
                    .map(|factors| talker.carried_over(factors, 1.0))
                    .collect()
            })
            .collect();
        for second in 1..count {
            for first in 0..second {
                let sides = [
                    carried[first][second].as_slice(),
                    carried[second][first].as_slice(),
                ];
                self.models[pair_index(first, second)].step(
                    &self.talkers[first].side(),
                    &self.talkers[second].side(),
                    sides,
                    fresh[first] && fresh[second],
                );
            }
        }
        self.readouts = closure::read(&self.models, count);
        for talker in 1..count {
            self.initialise(talker);
        }
    }

    /// For each target and lane of an observer, how well the lane is not someone else already.
    fn exclusive(&self, observer: usize) -> Vec<Vec<f64>> {
        let lanes = self.talkers[observer].lane_directions().len();
        let count = self.talkers.len();
        let mut all = vec![1.0; lanes];
        let factor = |target: usize, lane: usize| {
            (1.0 - self.chance(observer, target, lane))
                .max(EXCLUSIVE_MIN)
                .powf(EXCLUSIVE)
        };
        for target in (0..count).filter(|target| *target != observer) {
            for (lane, product) in all.iter_mut().enumerate() {
                *product *= factor(target, lane);
            }
        }
        (0..count)
            .map(|target| {
                if target == observer {
                    return Vec::new();
                }
                all.iter()
                    .enumerate()
                    .map(|(lane, product)| product / factor(target, lane))
                    .collect()
            })
            .collect()
    }

    /// One epoch of a neighbour on its way into the joint filter, and the joint filter's supervision.
    fn initialise(&mut self, talker: usize) {
        let readout = &self.readouts[pair_index(0, talker)];
        let yaw = likeliest_yaw(readout);
        // The models know the yaw between gyro frames; the filters that between level frames.
        let level_yaw_rad =
            wrapped(yaw.yaw_rad - self.talkers[0].yaw_rad() + self.talkers[talker].yaw_rad());
        let best = readout.lanes[0]
            .iter()
            .copied()
            .enumerate()
            .reduce(|best, next| if next.1 > best.1 { next } else { best });
        let direction = best.map(|(lane, chance)| {
            let direction = &self.talkers[0].lane_directions()[lane];
            (turned(direction, -self.talkers[0].yaw_rad()), chance)
        });
        let joint = self.joint.state(talker);
        let verdict = self.initialising[talker - 1].epoch(&initialising::Evidence {
            yaw_rad: level_yaw_rad,
            yaw_probability: yaw.probability,
            direction,
            joint,
        });
        match verdict {
            initialising::Verdict::Keep => {}
            initialising::Verdict::Insert(state) => self.joint.insert(talker, state),
            initialising::Verdict::Remove => self.joint.remove(talker),
        }
    }

    fn forget_the_silent(&mut self, now: Stamp) {
        for index in (1..self.talkers.len()).rev() {
            if now - self.talkers[index].taken > FORGOTTEN_AFTER {
                self.forget(index);
            }
        }
    }

    fn forget(&mut self, index: usize) {
        let count = self.talkers.len();
        let mut models = Vec::with_capacity(self.models.len());
        for second in 1..count {
            for first in 0..second {
                if first != index && second != index {
                    models.push(std::mem::replace(
                        &mut self.models[pair_index(first, second)],
                        PairModel::new(),
                    ));
                }
            }
        }
        self.models = models;
        self.talkers.remove(index);
        self.initialising.remove(index - 1);
        self.joint.forget(index);
        self.readouts = closure::read(&self.models, self.talkers.len());
    }
}

fn own_instant(talkers: &[Talker]) -> Stamp {
    talkers[0].taken
}
