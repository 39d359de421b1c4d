//! Registration: what single scans of several vehicles, none of which says who is who, tell of where all are, up to scale.
//! A [`Job`] is a value with all it needs inside, so that a worker thread can [`Job::run`] it; the [`Outcome`] has *every*
//! solution that survives, as symmetric formations have several.
//!
//! ```text
//! Job ─> scene ─> pairs ─> triangles ─┬─> single_scan: seeds, expansion, refinement ─┬─> belief metric ─> Outcome
//!                                     └─> published: ratings, branches (as the paper) ┘
//! ```

mod belief;
mod formation;
mod pairs;
mod placing;
mod published;
mod refinement;
mod scene;
mod single_scan;
mod solution;
mod triangle;

#[cfg(test)]
mod tests;

pub use belief::{Belief, Pose};
pub use solution::{Cut, Outcome, Placed, Solution};

use crate::mutual::Feature;
use crate::vehicle_id::VehicleId;
use nalgebra::UnitVector3;

/// Most neighbours in one job.
pub const NEIGHBOURS_MAX: usize = 31;
/// Most sightings of one vehicle.
pub const SIGHTINGS_MAX: usize = 32;

/// Something that a vehicle sees, in its level frame: a raw feature or a track, but without identity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sighting {
    /// Where.
    pub direction: UnitVector3<f64>,
    /// Standard deviation across the direction, per axis (rad).
    pub sigma_rad: f64,
}

/// What a neighbour told, and what is believed of it.
#[derive(Clone, Debug, PartialEq)]
pub struct Neighbour {
    /// Who.
    pub vehicle: VehicleId,
    /// What it sees, in its level frame.
    pub sightings: Vec<Sighting>,
    /// Where it is believed to be, if anything is; in this vehicle's level frame, at the time of the scan.
    pub belief: Option<Belief>,
}

/// How to register.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Method {
    /// Ours: seeds from triangles and mutual pairs, expansion, and refinement of all poses at once.
    SingleScan,
    /// P-MultiBeaReg3D (Cognetti et al., algorithm 1), its triangle test mended.
    Published,
}

/// When a [`Method::SingleScan`] searches beyond what the beliefs predict.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Search {
    /// Always: ambiguities are found though the beliefs are sure.
    Always,
    /// Only for neighbours that the beliefs leave unexplained.
    Unexplained,
}

/// Constants of registration. They say what a scan is like; none depends on a scenario.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Settings {
    /// When to search.
    pub search: Search,
    /// Probability that a vehicle sees another.
    pub detection_probability: f64,
    /// Sightings of one vehicle that are no talking vehicle, on average.
    pub clutter: f64,
    /// Probability that a belief is wrong altogether, so that it cannot rule out what the sightings say.
    pub belief_wrong_probability: f64,
    /// A solution survives while it is at most this much less likely than the best (nats).
    pub survival_nats: f64,
    /// Most solutions in an outcome.
    pub solutions_max: usize,
    /// Most triples of vehicles whose triangles are looked for.
    pub triples_max: usize,
    /// Most partial solutions that are refined.
    pub branches_max: usize,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            search: Search::Unexplained,
            detection_probability: 0.85,
            clutter: 1.0,
            belief_wrong_probability: 0.05,
            survival_nats: 6.0,
            solutions_max: 128,
            triples_max: 24,
            branches_max: 4096,
        }
    }
}

/// Everything that one registration needs.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// What this vehicle sees.
    pub own: Vec<Sighting>,
    /// What the others told. Those beyond [`NEIGHBOURS_MAX`] and sightings beyond [`SIGHTINGS_MAX`] are cut, and counted.
    pub neighbours: Vec<Neighbour>,
    /// How.
    pub method: Method,
    /// With which constants.
    pub settings: Settings,
}

impl Job {
    /// Finds all solutions. Pure: the same job has the same outcome. Its work is bounded by the settings, whatever the
    /// sightings are; sightings that are not finite are passed over.
    #[must_use]
    pub fn run(&self) -> Outcome {
        let mut cut = Cut::default();
        let scene = scene::Scene::new(self, &mut cut);
        let formations = match self.method {
            Method::SingleScan => single_scan::search(self, &scene, &mut cut),
            Method::Published => published::search(self, &scene, &mut cut),
        };
        solution::outcome(self, &scene, formations, cut)
    }
}

impl From<&Feature> for Sighting {
    fn from(feature: &Feature) -> Self {
        Self {
            direction: feature.direction,
            sigma_rad: feature.sigma_rad,
        }
    }
}
