//! One neighbour of the paper's way: what it told last, and the filter that follows it.

use super::Settings;
use super::translated::sightings;
use crate::mutual::feature_set::{FeatureSet, Inertial};
use crate::mutual::filter::mixture::{Mixture, Responsibilities};
use crate::mutual::filter::{Estimate, NeighbourFilter};
use crate::mutual::located::{Located, Reduced, Status};
use crate::mutual::propagation::{inertial_at, propagated};
use crate::mutual::registration::{self, Belief, Pose};
use crate::mutual::unused::{Unused, is_flyable};
use crate::time::{Span, Stamp};
use crate::vehicle_id::VehicleId;
use nalgebra::Matrix4;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

/// Which of a filter's estimates is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// The likeliest particle, as in the paper.
    Best,
    /// The mean of all.
    Mean,
    /// The mean of the heaviest cluster.
    Dominant,
}

/// A neighbour is at one place when so much of the belief is ...
const CONVERGED_MASS: f64 = 0.8;
/// ... and the distance there is known to this part of itself.
const CONVERGED_DISTANCE_SIGMA: f64 = 0.3;
/// A belief so wide, or so divided, is handed to registration as samples.
const GAUSSIAN_DISTANCE_SIGMA: f64 = 0.35;
const GAUSSIAN_MASS: f64 = 0.9;
const SAMPLES: usize = 64;

/// One neighbour.
#[derive(Clone, Debug)]
pub(super) struct Neighbour {
    vehicle: VehicleId,
    newest: FeatureSet,
    before: Option<FeatureSet>,
    rng: ChaCha8Rng,
    followed: Option<Followed>,
    identity_probability: f64,
}

/// A filter, and how far both vehicles' integrals had got when it last moved.
#[derive(Clone, Debug)]
struct Followed {
    filter: NeighbourFilter,
    estimate: Estimate,
    own: Inertial,
    neighbour: Inertial,
}

impl Neighbour {
    pub(super) fn new(vehicle: VehicleId, set: &FeatureSet, seed: u64) -> Self {
        // A stream of its own: who else is there changes nothing for this one.
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream(vehicle.0);
        Self {
            vehicle,
            newest: set.clone(),
            before: None,
            rng,
            followed: None,
            identity_probability: 0.0,
        }
    }

    pub(super) const fn vehicle(&self) -> VehicleId {
        self.vehicle
    }

    /// When its newest set was taken.
    pub(super) const fn heard(&self) -> Stamp {
        self.newest.taken
    }

    pub(super) fn estimate(&self) -> Option<&Estimate> {
        self.followed.as_ref().map(|followed| &followed.estimate)
    }

    pub(super) fn filter(&self) -> Option<&NeighbourFilter> {
        self.followed.as_ref().map(|followed| &followed.filter)
    }

    /// Takes a set. After a restart its integrals say nothing of what is believed.
    ///
    /// # Errors
    /// [`Unused::TooOld`] and [`Unused::Implausible`].
    pub(super) fn hear(&mut self, set: &FeatureSet) -> Result<(), Unused> {
        if set.taken <= self.newest.taken {
            return Err(Unused::TooOld);
        }
        let restarted = set.inertial.elapsed_s < self.newest.inertial.elapsed_s;
        if !restarted && !is_flyable(&set.inertial.since(&self.newest.inertial)) {
            return Err(Unused::Implausible);
        }
        let before = std::mem::replace(&mut self.newest, set.clone());
        if restarted {
            self.before = None;
            self.followed = None;
        } else {
            self.before = Some(before);
        }
        Ok(())
    }

    /// Where its integrals are held to be at an instant; none when it has been silent for too long to say.
    fn inertial_at(&self, instant: Stamp, silent_after: Span) -> Option<Inertial> {
        ((instant - self.newest.taken).abs() <= silent_after)
            .then(|| inertial_at(instant, &self.newest, self.before.as_ref()))
    }

    /// The filter moves on to an own set, unless the neighbour is silent: then it catches up later.
    pub(super) fn move_on(&mut self, own: &FeatureSet, settings: &Settings) {
        let Some(inertial) = self.inertial_at(own.taken, settings.silent_after) else {
            return;
        };
        if let Some(followed) = &mut self.followed {
            let own_motion = own.inertial.since(&followed.own);
            if own_motion.elapsed_s <= 0.0 {
                return;
            }
            let motion = inertial.since(&followed.neighbour);
            followed.filter.predict(&own_motion, &motion, &mut self.rng);
            followed.estimate = followed.filter.estimate();
            (followed.own, followed.neighbour) = (own.inertial, inertial);
        }
    }

    /// What it told, for registration with scans of an instant; none when its own is too old or too new.
    pub(super) fn told(
        &mut self,
        instant: Stamp,
        settings: &Settings,
    ) -> Option<registration::Neighbour> {
        if (instant - self.newest.taken).abs() > settings.scan_age_max {
            return None;
        }
        // Its scan is turned as it has turned since.
        let inertial = self.inertial_at(instant, settings.silent_after)?;
        Some(registration::Neighbour {
            vehicle: self.vehicle,
            sightings: sightings(&self.newest, settings.seen, -inertial.yaw_rad),
            belief: self.followed.as_ref().map(Followed::belief),
        })
    }

    /// Weighs what is believed by a registration of the scans of the instant to which the filter has moved; a first one
    /// begins a belief.
    pub(super) fn measure(
        &mut self,
        measured: &Mixture,
        settings: &Settings,
        own: &FeatureSet,
    ) -> Responsibilities {
        let said = match &mut self.followed {
            Some(followed) => {
                let said = followed.filter.update(measured, &mut self.rng);
                followed.estimate = followed.filter.estimate();
                said
            }
            None => {
                let Some(neighbour) = self.inertial_at(own.taken, settings.silent_after) else {
                    return Responsibilities::default();
                };
                let mut filter = NeighbourFilter::born(&settings.filter, measured, &mut self.rng);
                self.followed = Some(Followed {
                    estimate: filter.estimate(),
                    filter,
                    own: own.inertial,
                    neighbour,
                });
                Responsibilities::default()
            }
        };
        let probabilities = said.own_features.iter().map(|of| of.1);
        self.identity_probability = probabilities.fold(0.0, f64::max);
        said
    }

    pub(super) fn located(&self, own: &FeatureSet, settings: &Settings) -> Located {
        let Some(followed) = &self.followed else {
            return Located {
                vehicle: self.vehicle,
                status: Status::Unknown,
                relative: None,
                covariance: None,
                identity_probability: 0.0,
            };
        };
        let estimate = &followed.estimate;
        let is_sure = estimate.dominant_mass >= CONVERGED_MASS
            && estimate.relative_distance_sigma() < CONVERGED_DISTANCE_SIGMA;
        let shown = match settings.shown {
            Shown::Best => estimate.best,
            Shown::Mean => estimate.mean,
            Shown::Dominant => estimate.dominant,
        };
        let inertial = self.inertial_at(own.taken, settings.silent_after);
        let moved = |inertial: Inertial| {
            let own = own.inertial.since(&followed.own);
            propagated(&shown, &own, &inertial.since(&followed.neighbour))
        };
        // Motions that no vehicle makes can take a filter where no number is.
        let relative = inertial.map(moved).filter(|relative| {
            relative.position_m.iter().all(|x| x.is_finite()) && relative.yaw_rad.is_finite()
        });
        Located {
            vehicle: self.vehicle,
            status: match relative {
                None => Status::Unknown,
                Some(_) if is_sure => Status::Converged,
                Some(_) => Status::Ambiguous {
                    modes: estimate.modes,
                },
            },
            relative,
            // That of the dominant cluster was never shown to be the error's: filters of one neighbour each take the same
            // sightings for independent.
            covariance: None,
            identity_probability: self.identity_probability,
        }
    }
}

impl Followed {
    fn belief(&self) -> Belief {
        let pose = |state: &Reduced| Pose {
            position_m: state.position_m,
            yaw_rad: state.yaw_rad,
        };
        let estimate = &self.estimate;
        if estimate.dominant_mass < GAUSSIAN_MASS
            || estimate.relative_distance_sigma() > GAUSSIAN_DISTANCE_SIGMA
        {
            return Belief::Samples(self.filter.sampled(SAMPLES).iter().map(pose).collect());
        }
        const OF: [usize; 4] = [0, 1, 2, 6];
        Belief::Gaussian {
            mean: pose(&estimate.dominant),
            covariance: Matrix4::from_fn(|row, column| estimate.covariance[(OF[row], OF[column])]),
        }
    }
}
