//! Whether a formation explains a scan, so that no other needs to be looked for.

use super::super::formation::{Formation, NOBODY};
use super::super::refinement::cost;
use super::Searching;
use std::f64::consts::PI;

/// Half a chi-square of two degrees of freedom is one on average; beyond this a scan is not explained.
const COST_PER_SIGHTING_MAX: f64 = 1.15;
/// An explanation is believed if it is by this much (nats) less likely by chance than there are assignments.
const CHANCE_NATS: f64 = 20.0;

impl Searching<'_> {
    /// Some solution leaves next to nothing unexplained.
    pub(super) fn is_explained(&self) -> bool {
        let Some(best) = self.best() else {
            return false;
        };
        let deficits = self.deficits(best);
        let vehicles = self.scene.vehicles();
        let allowed = 1 + vehicles * (vehicles - 1) / 50;
        let seen = best
            .seen
            .iter()
            .flatten()
            .filter(|one| **one != NOBODY)
            .count() as f64;
        let redundant = 2.0 * seen - 4.0 * vehicles as f64 + 5.0;
        // Every number that fits though nothing was solved for it is that unlikely by chance; the more assignments there
        // are, the more chances.
        let nats = -0.5 * (2.0 * PI * self.scene.variance).ln() * redundant;
        nats >= self.log_assignments() + CHANCE_NATS
            && cost(best, self.scene) <= COST_PER_SIGHTING_MAX * seen
            && deficits.iter().sum::<usize>() <= allowed
            && deficits.iter().all(|one| *one <= 1)
    }

    /// The logarithm of how many ways there are to see all the others.
    fn log_assignments(&self) -> f64 {
        let others = self.scene.vehicles() - 1;
        let rays = self.scene.rays.iter().map(Vec::len);
        let ways = rays.map(|rays| {
            let (more, fewer) = (rays.max(others), rays.min(others));
            let factors = more - fewer..more;
            factors
                .map(|factor| ((factor + 1) as f64).ln())
                .sum::<f64>()
        });
        ways.sum()
    }

    /// By vehicle: how many of the others it could see, by the number of its sightings, and does not.
    fn deficits(&self, formation: &Formation) -> Vec<usize> {
        let vehicles = self.scene.vehicles();
        let rays = self.scene.rays.iter().enumerate();
        rays.map(|(vehicle, rays)| {
            let seen = (0..rays.len())
                .filter(|ray| formation.is_used(vehicle, *ray))
                .count();
            rays.len().min(vehicles - 1) - seen
        })
        .collect()
    }
}
