//! The paper's way as a whole (Cognetti et al., figure 2): registration of the newest scans of all, and one filter per
//! neighbour that makes a distance of it.
//!
//! ```text
//! own(set) ──┬─> every filter moves on
//! heard(set) ┘
//! poll_job() ─> Work, run anywhere ─> done(Done) ─> every filter is weighed by the answers about its neighbour
//! located(), identifications()
//! ```
//!
//! Registration takes long when it has nothing to start from, so it is a value that is handed out and taken back. While
//! one is out, the filters wait at the instant of its scans.

mod neighbour;

mod translated;

pub use neighbour::Shown;

use super::feature_set::FeatureSet;
use super::filter::mixture::{Mixture, Tempering};
use super::filter::{Estimate, FilterSettings, NeighbourFilter};
use super::located::Located;
use super::registration::{self, Job, Outcome, Sighting};
use super::unused::{Unused, is_understood};
use crate::time::{Span, Stamp};
use crate::vehicle_id::VehicleId;
use nalgebra::UnitVector3;
use neighbour::Neighbour;
use translated::{answers, sightings};

/// Neighbours that are known at once; sets of others are passed over, and counted.
pub const NEIGHBOURS_MAX: usize = 16;
/// A registration that is not back by then is given up.
pub const OUT_MAX: Span = Span::secs(1);
/// Sets whose stamp is further ahead of the own newest, or further behind, are refused.
const ASTRAY_MAX: Span = Span::secs(2);

/// What of a feature set is registered.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Seen {
    /// The features of the instant, as in the paper.
    Features,
    /// Confirmed tracks. They err less, but the next set's err as this one's: measure more seldom.
    Tracks,
}

/// How the paper's way works.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// The filter of every neighbour.
    pub filter: FilterSettings,
    /// How scans are registered.
    pub method: registration::Method,
    /// With which constants.
    pub registration: registration::Settings,
    /// How the answers are weighed.
    pub tempering: Tempering,
    /// What is registered.
    pub seen: Seen,
    /// Own sets per registration: filters move with every set and are measured more seldom, so that measurements are
    /// nearly independent (paper, section III-B).
    pub sets_per_measurement: u32,
    /// Which estimate is shown.
    pub shown: Shown,
    /// How much older than the own scan a neighbour's may be to be registered with it.
    pub scan_age_max: Span,
    /// A neighbour not heard for so long is silent: its filter stands still until it is heard again.
    pub silent_after: Span,
    /// A neighbour silent for so long is forgotten.
    pub forgotten_after: Span,
}

impl Settings {
    /// The paper's filter on raw features at 20 Hz, measured at 10; registration from pairs and triangles.
    #[must_use]
    pub fn paper() -> Self {
        Self {
            filter: FilterSettings::Particles(super::filter::particles::ParticleSettings::PAPER),
            method: registration::Method::SingleScan,
            // What only the beliefs explain is never contradicted by a search, and they lock into wrong places.
            registration: registration::Settings {
                search: registration::Search::Always,
                ..registration::Settings::default()
            },
            tempering: Tempering::CAUTIOUS,
            seen: Seen::Features,
            sets_per_measurement: 2,
            shown: Shown::Dominant,
            scan_age_max: Span::millis(120),
            silent_after: Span::millis(400),
            forgotten_after: Span::secs(20),
        }
    }
}

/// A registration to be run, anywhere and at any time.
#[derive(Clone, Debug, PartialEq)]
pub struct Work {
    number: u64,
    /// What is registered.
    pub job: Job,
}

/// A registration that has been run.
#[derive(Clone, Debug, PartialEq)]
pub struct Done {
    number: u64,
    outcome: Outcome,
}

impl Work {
    /// Its number: results are taken back by it.
    #[must_use]
    pub const fn number(&self) -> u64 {
        self.number
    }

    /// Runs it.
    #[must_use]
    pub fn run(&self) -> Done {
        Done {
            number: self.number,
            outcome: self.job.run(),
        }
    }
}

/// What something that this vehicle saw is.
#[derive(Clone, Debug, PartialEq)]
pub struct Identification {
    /// Where it was seen, in this vehicle's level frame of that instant.
    pub direction: UnitVector3<f64>,
    /// Standard deviation across the direction, per axis (rad).
    pub sigma_rad: f64,
    /// For each neighbour that it may be the probability that it is; together at most one.
    pub probabilities: Vec<(VehicleId, f64)>,
}

/// What was passed over to stay within bounds, since the beginning.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PassedOver {
    /// Sets of neighbours beyond [`NEIGHBOURS_MAX`].
    pub sets: u64,
    /// Registrations that were not back in time.
    pub registrations: u64,
}

/// The pipeline of one vehicle. Deterministic for its seed.
#[derive(Clone, Debug)]
pub struct Registered {
    settings: Settings,
    seed: u64,
    own: Option<FeatureSet>,
    /// In the order of their numbers.
    neighbours: Vec<Neighbour>,
    sets_until_measurement: u32,
    asked: u64,
    out: Option<Out>,
    identifications: Option<(Stamp, Vec<Identification>)>,
    passed_over: PassedOver,
}

/// The registration that is out.
#[derive(Clone, Debug)]
struct Out {
    number: u64,
    own: FeatureSet,
    sightings: Vec<Sighting>,
}

impl Registered {
    /// Nothing was seen or heard yet.
    #[must_use]
    pub const fn new(settings: Settings, seed: u64) -> Self {
        Self {
            settings,
            seed,
            own: None,
            neighbours: Vec::new(),
            sets_until_measurement: 0,
            asked: 0,
            out: None,
            identifications: None,
            passed_over: PassedOver {
                sets: 0,
                registrations: 0,
            },
        }
    }

    /// Takes a set of this vehicle's own: the filters move on to its instant. A set that is not newer than the one before
    /// changes nothing; after a restart of the own integrals everything begins anew.
    pub fn own(&mut self, set: &FeatureSet) {
        if let Some(own) = &self.own {
            if set.taken <= own.taken {
                return;
            }
            if set.inertial.elapsed_s < own.inertial.elapsed_s {
                self.neighbours.clear();
                self.out = None;
            }
        }
        self.own = Some(set.clone());
        let forgotten_after = self.settings.forgotten_after;
        self.neighbours
            .retain(|neighbour| set.taken - neighbour.heard() < forgotten_after);
        if let Some(out) = &self.out
            && set.taken - out.own.taken > OUT_MAX
        {
            self.out = None;
            self.passed_over.registrations += 1;
        }
        self.sets_until_measurement = self.sets_until_measurement.saturating_sub(1);
        if self.out.is_none() {
            self.move_on();
        }
    }

    /// Takes a set that a neighbour told, its stamp by this vehicle's clock. A lost set loses nothing, since motions are
    /// told as integrals.
    ///
    /// # Errors
    /// Why it was not taken: then nothing has changed.
    pub fn heard(&mut self, vehicle: VehicleId, set: &FeatureSet) -> Result<(), Unused> {
        let own = self.own.as_ref().ok_or(Unused::NothingOwn)?;
        if set.taken - own.taken > ASTRAY_MAX {
            return Err(Unused::TooNew);
        }
        if own.taken - set.taken > ASTRAY_MAX {
            return Err(Unused::TooOld);
        }
        if !is_understood(set) {
            return Err(Unused::Implausible);
        }
        match self
            .neighbours
            .binary_search_by_key(&vehicle, Neighbour::vehicle)
        {
            Ok(index) => self.neighbours[index].hear(set),
            Err(_) if self.neighbours.len() >= NEIGHBOURS_MAX => {
                self.passed_over.sets += 1;
                Err(Unused::Full)
            }
            Err(index) => {
                self.neighbours
                    .insert(index, Neighbour::new(vehicle, set, self.seed));
                Ok(())
            }
        }
    }

    /// A registration to be run, when it is time for one and none is out.
    pub fn poll_job(&mut self) -> Option<Work> {
        if self.out.is_some() || self.sets_until_measurement > 0 {
            return None;
        }
        // Those that were silent until now have to catch up.
        self.move_on();
        let own = self.own.as_ref()?;
        let told: Vec<registration::Neighbour> = self
            .neighbours
            .iter_mut()
            .filter_map(|neighbour| neighbour.told(own.taken, &self.settings))
            .collect();
        if told.is_empty() {
            return None;
        }
        self.sets_until_measurement = self.settings.sets_per_measurement.max(1);
        self.asked += 1;
        let sightings = sightings(own, self.settings.seen, -own.inertial.yaw_rad);
        self.out = Some(Out {
            number: self.asked,
            own: own.clone(),
            sightings: sightings.clone(),
        });
        Some(Work {
            number: self.asked,
            job: Job {
                own: sightings,
                neighbours: told,
                method: self.settings.method,
                settings: self.settings.registration,
            },
        })
    }

    /// Takes a registration back. One that was given up changes nothing.
    pub fn done(&mut self, done: &Done) {
        let Some(out) = self.out.take_if(|out| out.number == done.number) else {
            return;
        };
        let mut identifications: Vec<Identification> = out
            .sightings
            .iter()
            .map(|sighting| Identification {
                direction: sighting.direction,
                sigma_rad: sighting.sigma_rad,
                probabilities: Vec::new(),
            })
            .collect();
        for neighbour in &mut self.neighbours {
            let (answers, elsewhere) = answers(&done.outcome, neighbour.vehicle());
            let measured = Mixture::new(&answers, &elsewhere, &self.settings.tempering);
            let Some(measured) = measured else { continue };
            let said = neighbour.measure(&measured, &self.settings, &out.own);
            for (feature, probability) in said.own_features {
                if let Some(identification) = identifications.get_mut(feature) {
                    let of = (neighbour.vehicle(), probability);
                    identification.probabilities.push(of);
                }
            }
        }
        for identification in &mut identifications {
            // The filters do not know of each other; two that claim the same share it.
            let sum: f64 = identification.probabilities.iter().map(|of| of.1).sum();
            for of in &mut identification.probabilities {
                of.1 /= sum.max(1.0);
            }
        }
        self.identifications = Some((out.own.taken, identifications));
        self.move_on();
    }

    /// Every filter moves on to the own newest set.
    fn move_on(&mut self) {
        let Some(own) = &self.own else { return };
        for neighbour in &mut self.neighbours {
            neighbour.move_on(own, &self.settings);
        }
    }

    /// Every neighbour that is heard or was lately, in the order of their numbers, at the instant of the own newest set.
    #[must_use]
    pub fn located(&self) -> Vec<Located> {
        let locate = |own| {
            let of_neighbour = move |neighbour: &Neighbour| neighbour.located(own, &self.settings);
            self.neighbours.iter().map(of_neighbour).collect()
        };
        self.own.as_ref().map(locate).unwrap_or_default()
    }

    /// What the features, or tracks, of the set are that was registered last, and when that was taken.
    #[must_use]
    pub fn identifications(&self) -> Option<(Stamp, &[Identification])> {
        let (taken, identifications) = self.identifications.as_ref()?;
        Some((*taken, identifications))
    }

    /// All that a neighbour's filter makes of its place, at the instant to which the filter has moved.
    #[must_use]
    pub fn estimate(&self, vehicle: VehicleId) -> Option<&Estimate> {
        self.neighbour(vehicle)?.estimate()
    }

    /// A neighbour's filter.
    #[must_use]
    pub fn filter(&self, vehicle: VehicleId) -> Option<&NeighbourFilter> {
        self.neighbour(vehicle)?.filter()
    }

    /// What was passed over.
    #[must_use]
    pub const fn passed_over(&self) -> PassedOver {
        self.passed_over
    }

    fn neighbour(&self, vehicle: VehicleId) -> Option<&Neighbour> {
        let known = self
            .neighbours
            .binary_search_by_key(&vehicle, Neighbour::vehicle);
        known.ok().map(|index| &self.neighbours[index])
    }
}

#[cfg(test)]
mod tests;
