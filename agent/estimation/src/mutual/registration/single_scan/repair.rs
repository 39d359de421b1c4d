//! Repair: whoever does not fit into an almost right formation is placed anew.

use super::super::Cut;
use super::super::formation::Formation;
use super::super::placing::Placing;
use super::super::refinement::refine;
use super::{Effort, FOUND_MAX, Searching};

/// Repairs in a row, and how many formations are grown at once for one.
const REPAIRS_MAX: usize = 3;
const REPAIR_WIDTH: usize = 16;
/// Vehicles for which this much less speaks than for half of all are placed anew.
const POOR_SHARE: f64 = 0.75;

impl Searching<'_> {
    /// By vehicle: how much less it gains by what it sees than it could (nats). Who stands at another's place is seen as
    /// well as that one, but sees little that fits.
    fn shortfalls(&self, formation: &Formation) -> Vec<f64> {
        let vehicles = self.scene.vehicles();
        let gains = formation.looking(self.scene);
        let rays = self.scene.rays.iter().zip(gains);
        rays.map(|(rays, gain)| {
            let mean = rays.iter().map(|ray| ray.gain).sum::<f64>() / rays.len().max(1) as f64;
            rays.len().min(vehicles - 1) as f64 * (mean - 1.0) - gain
        })
        .collect()
    }

    /// Takes those out of the best formation who see least of what they should, some at a time, and places them anew in
    /// all ways that may be: vehicles that stand at each other's places are found so.
    pub(super) fn repair(&mut self, effort: Effort, cut: &mut Cut) {
        for _ in 0..REPAIRS_MAX {
            let before = self.best_score();
            let Some(best) = self.best().filter(|_| !self.is_explained()).cloned() else {
                return;
            };
            let shortfalls = self.shortfalls(&best);
            let mut worst: Vec<usize> = (0..shortfalls.len()).collect();
            worst.sort_by(|a, b| shortfalls[*b].total_cmp(&shortfalls[*a]));
            let count = effort.repaired.min(worst.len());
            let pairs = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
            let mut sets: Vec<Vec<usize>> = pairs.map(|(a, b)| vec![worst[a], worst[b]]).collect();
            sets.extend((3..=4).map(|count| worst.iter().copied().take(count).collect()));
            for set in sets {
                let mut core = best.clone();
                for vehicle in set {
                    core.displace(vehicle);
                }
                if core.placed().count() > 1 {
                    self.grow(vec![core], REPAIR_WIDTH, cut);
                }
            }
            if self.best_score() < before + 1.0 {
                return;
            }
        }
    }

    /// Places anew whoever has no place, and those that little speaks for, now that the others are where they are.
    fn place_better(&self, formation: &mut Formation) {
        let scene = self.scene;
        let contributions = formation.contributions(scene);
        let mut sorted = contributions.clone();
        sorted.sort_by(f64::total_cmp);
        let poor = POOR_SHARE * sorted[sorted.len() / 2];
        let mut missing: Vec<usize> = (1..scene.vehicles())
            .filter(|one| formation.stances[*one].is_none() || contributions[*one] < poor)
            .collect();
        if missing.is_empty() || missing.len() + 1 >= scene.vehicles() {
            return;
        }
        let mut other = formation.clone();
        for vehicle in &missing {
            other.displace(*vehicle);
        }
        while !missing.is_empty() {
            let placing = Placing::new(scene, &self.pairs, &other);
            let places = missing.iter().enumerate().filter_map(|(index, vehicle)| {
                Some((index, *placing.candidates(*vehicle, 1).first()?))
            });
            let Some((index, place)) = places.max_by(|a, b| a.1.gain.total_cmp(&b.1.gain)) else {
                break;
            };
            let vehicle = missing.swap_remove(index);
            other.stances[vehicle] = Some(place.stance);
            other.assign(scene, 1.5, |_, _, _| 0.0);
            if refine(&mut other, scene, 2).is_none() {
                return;
            }
        }
        other.assign(scene, 1.0, |_, _, _| 0.0);
        if refine(&mut other, scene, 3).is_some()
            && other.log_likelihood(scene) > formation.log_likelihood(scene)
        {
            *formation = other;
        }
    }

    /// Refines to the end, drops whom nothing speaks for, and keeps the formation unless it is known.
    pub(super) fn finish(&mut self, mut formation: Formation) {
        let scene = self.scene;
        for widened in [1.5, 1.0, 1.0] {
            formation.assign(scene, widened, |_, _, _| 0.0);
            if refine(&mut formation, scene, 3).is_none() {
                return;
            }
        }
        self.place_better(&mut formation);
        let contributions = formation.contributions(scene);
        let idle: Vec<usize> = formation
            .placed()
            .map(|(vehicle, _)| vehicle)
            .filter(|vehicle| *vehicle > 0 && contributions[*vehicle] < scene.placing_nats)
            .collect();
        for vehicle in idle {
            formation.displace(vehicle);
        }
        if formation.stances[0].is_none()
            || formation.placed().count() < 2
            || !formation.is_finite()
        {
            return;
        }
        let score = formation.log_likelihood(scene);
        let known = self
            .found
            .iter()
            .position(|(other, _)| other.agrees(&formation, scene));
        let worst = || {
            let scores = self.found.iter().enumerate();
            scores
                .min_by(|a, b| a.1.1.total_cmp(&b.1.1))
                .map(|(index, _)| index)
        };
        let is_full = self.found.len() >= FOUND_MAX;
        match known.or_else(|| worst().filter(|_| is_full)) {
            None => self.found.push((formation, score)),
            Some(index) if score > self.found[index].1 => self.found[index] = (formation, score),
            Some(_) => {}
        }
    }
}
