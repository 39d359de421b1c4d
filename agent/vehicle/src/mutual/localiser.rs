//! The estimator behind mutual localisation: one of the two ways, by one interface.

use skein_estimation::VehicleId;
use skein_estimation::mutual::registered::Settings;
use skein_estimation::mutual::{Done, FeatureSet, Identity, Located, Registered, Unused, Work};
use skein_estimation::time::Stamp;

use crate::config::MutualWay;

/// Who is who and where.
#[derive(Clone, Debug)]
pub(super) enum Localiser {
    Persistent(Box<Identity>),
    Published(Box<Registered>),
}

/// Who the features of one own set are.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Identified {
    /// When the set was taken.
    pub(super) taken: Stamp,
    /// By the feature's place in the set: the probability of each neighbour that it may be.
    pub(super) features: Vec<(usize, Vec<(VehicleId, f64)>)>,
}

impl Localiser {
    pub(super) fn new(me: VehicleId, seed: u64, way: MutualWay) -> Self {
        match way {
            MutualWay::Persistent => Self::Persistent(Box::new(Identity::new(me))),
            MutualWay::Published => {
                Self::Published(Box::new(Registered::new(Settings::paper(), seed)))
            }
        }
    }

    pub(super) const fn way(&self) -> MutualWay {
        match self {
            Self::Persistent(_) => MutualWay::Persistent,
            Self::Published(_) => MutualWay::Published,
        }
    }

    /// Takes a set of this vehicle's own.
    pub(super) fn own(&mut self, set: &FeatureSet) {
        match self {
            Self::Persistent(identity) => identity.own(set),
            Self::Published(registered) => registered.own(set),
        }
    }

    /// Takes what a neighbour told.
    pub(super) fn heard(&mut self, from: VehicleId, set: &FeatureSet) -> Result<(), Unused> {
        match self {
            Self::Persistent(identity) => identity.heard(from, set),
            Self::Published(registered) => registered.heard(from, set),
        }
    }

    /// The computation that is due: a registration.
    pub(super) fn begin_work(&mut self) -> Option<Work> {
        match self {
            Self::Persistent(_) => None,
            Self::Published(registered) => registered.poll_job(),
        }
    }

    /// Takes back what came of it.
    pub(super) fn finish_work(&mut self, done: &Done) {
        if let Self::Published(registered) = self {
            registered.done(done);
        }
    }

    /// Every neighbour that is known.
    pub(super) fn located(&self) -> Vec<Located> {
        match self {
            Self::Persistent(identity) => identity.located(),
            Self::Published(registered) => registered.located(),
        }
    }

    /// Who the features are of the own set that was identified last.
    pub(super) fn identified(&self) -> Option<Identified> {
        match self {
            Self::Persistent(identity) => {
                let taken = identity.taken()?;
                let of = identity.identities().iter();
                let features = of
                    .map(|of| (of.feature, of.probabilities.clone()))
                    .collect();
                Some(Identified { taken, features })
            }
            Self::Published(registered) => {
                let (taken, of) = registered.identifications()?;
                let of = of.iter().enumerate();
                let features = of
                    .map(|(feature, of)| (feature, of.probabilities.clone()))
                    .collect();
                Some(Identified { taken, features })
            }
        }
    }
}
