//! The ways of locating that are compared: the published one, parts of it replaced one by one, and ours.

use serde::Serialize;
use skein_estimation::VehicleId;
use skein_estimation::mutual::filter::FilterSettings;
use skein_estimation::mutual::filter::bank::BankSettings;
use skein_estimation::mutual::identity::Identity;
use skein_estimation::mutual::registered::{Registered, Settings, Shown};
use skein_estimation::mutual::registration;
use skein_estimation::mutual::{FeatureSet, Located, Reduced};

/// Who estimates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// As published, its equations mended: P-MultiBeaReg3D, a particle filter for every neighbour, the best particle.
    Paper,
    /// Registration from pairs and triangles, a particle filter for every neighbour, the mean of its heaviest cluster.
    Particles,
    /// The same registration, a bank of Kalman filters for every neighbour.
    Bank,
    /// Identity that persists, and one filter over all neighbours.
    Identity,
}

/// All of them, in the order of the table.
pub const METHODS: [Method; 4] = [
    Method::Paper,
    Method::Particles,
    Method::Bank,
    Method::Identity,
];

/// A feature is said to be a neighbour when that is at least so likely.
const SURE: f64 = 0.8;

/// What one vehicle makes of the sets that it makes and hears.
pub trait Locator {
    /// Takes one of its own.
    fn own(&mut self, set: &FeatureSet);
    /// Takes one of a neighbour's.
    fn heard(&mut self, from: VehicleId, set: &FeatureSet);
    /// Where its neighbours are.
    fn located(&self) -> Vec<Located>;
    /// Which features of an own set, the newest, it is sure of, and who they are; none when it has not looked at them.
    fn identified(&self, newest: &FeatureSet) -> Option<Vec<(usize, VehicleId)>>;
    /// The likeliest places of a neighbour, likeliest first; none of a method that does not keep several.
    fn likeliest(&self, neighbour: VehicleId, count: usize) -> Vec<Reduced>;
}

impl Method {
    /// What it is called.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Particles => "particles",
            Self::Bank => "bank",
            Self::Identity => "identity",
        }
    }

    /// The method of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        METHODS.into_iter().find(|method| method.name() == name)
    }

    /// A vehicle that has seen and heard nothing yet. The seed is of its own randomness.
    #[must_use]
    pub fn locator(self, own: VehicleId, seed: u64) -> Box<dyn Locator> {
        let particles = Settings::paper();
        let settings = match self {
            Self::Identity => return Box::new(Identity::new(own)),
            Self::Paper => Settings {
                method: registration::Method::Published,
                shown: Shown::Best,
                ..particles
            },
            Self::Particles => particles,
            Self::Bank => Settings {
                filter: FilterSettings::Bank(BankSettings::QUADROTOR),
                ..particles
            },
        };
        Box::new(Registered::new(settings, seed))
    }
}

impl Locator for Identity {
    fn own(&mut self, set: &FeatureSet) {
        Self::own(self, set);
    }

    fn heard(&mut self, from: VehicleId, set: &FeatureSet) {
        let _ = Self::heard(self, from, set);
    }

    fn located(&self) -> Vec<Located> {
        Self::located(self)
    }

    fn identified(&self, _newest: &FeatureSet) -> Option<Vec<(usize, VehicleId)>> {
        let features = self.identities().iter();
        let sure = features.filter_map(|feature| Some((feature.feature, feature.confirmed?)));
        Some(sure.collect())
    }

    fn likeliest(&self, _neighbour: VehicleId, _count: usize) -> Vec<Reduced> {
        Vec::new()
    }
}

impl Locator for Registered {
    /// A registration is done as soon as it is asked for.
    fn own(&mut self, set: &FeatureSet) {
        Self::own(self, set);
        if let Some(work) = self.poll_job() {
            self.done(&work.run());
        }
    }

    fn heard(&mut self, from: VehicleId, set: &FeatureSet) {
        let _ = Self::heard(self, from, set);
    }

    fn located(&self) -> Vec<Located> {
        Self::located(self)
    }

    fn identified(&self, newest: &FeatureSet) -> Option<Vec<(usize, VehicleId)>> {
        let (taken, features) = self.identifications()?;
        if taken != newest.taken {
            return None;
        }
        let sure = features.iter().enumerate().filter_map(|(index, feature)| {
            let probable = feature.probabilities.iter();
            let mut sure = probable.filter(|(_, probability)| *probability >= SURE);
            sure.next().map(|(who, _)| (index, *who))
        });
        Some(sure.collect())
    }

    fn likeliest(&self, neighbour: VehicleId, count: usize) -> Vec<Reduced> {
        self.filter(neighbour)
            .map(|filter| filter.likeliest(count))
            .unwrap_or_default()
    }
}
