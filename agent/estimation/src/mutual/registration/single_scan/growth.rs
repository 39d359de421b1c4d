//! Growth: formations grow vehicle by vehicle, side by side, and those that are far less likely than others are given up.

use super::super::Cut;
use super::super::formation::Formation;
use super::super::placing::Placing;
use super::super::refinement::refine;
use super::Searching;

/// Formations that are grown at once as they are about as likely as the best, which symmetry makes them.
const ALIKE_MAX: usize = 384;
const ALIKE_NATS: f64 = 2.0;
/// Places of one vehicle that are told apart.
const PLACES_MAX: usize = 6;
/// Places that are so much worse than the best (nats) are not tried.
const PLACE_NATS: f64 = 10.0;
/// Formations that are so much worse (nats) than another of as many vehicles are given up.
const PRUNE_NATS: f64 = 12.0;
/// A place that gains so many times what placing costs leaves no doubt that the vehicle has a place.
const CONVINCING: f64 = 2.0;

/// A formation that grows.
#[derive(Clone)]
struct Partial {
    formation: Formation,
    score: f64,
    /// Vehicles that have no place in it, a bit each.
    skipped: u32,
}

impl Searching<'_> {
    /// Grows all seeds by a vehicle at a time, to all places where that may be; of all that have as many vehicles the
    /// `width` likeliest go on, if they are not far less likely than the best.
    pub(super) fn grow(&mut self, seeds: Vec<Formation>, width: usize, cut: &mut Cut) {
        let mut beam: Vec<Partial> = Vec::new();
        for seed in seeds {
            self.add(&mut beam, seed, 0, cut);
        }
        let order = self.by_sightings();
        for _ in 0..self.scene.vehicles() {
            self.thin(&mut beam);
            let mut grown = Vec::new();
            let mut proposals = Vec::new();
            let mut is_growing = false;
            for (parent, partial) in beam.iter().enumerate() {
                let next = order.iter().copied().find(|one| {
                    partial.formation.stances[*one].is_none() && partial.skipped & (1 << one) == 0
                });
                let Some(vehicle) = next else {
                    grown.push(partial.clone());
                    continue;
                };
                is_growing = true;
                let placing = Placing::new(self.scene, &self.pairs, &partial.formation);
                let places = placing.candidates(vehicle, PLACES_MAX);
                let best = places.first().map_or(0.0, |place| place.gain);
                for place in &places {
                    if place.gain > self.scene.placing_nats && place.gain > best - PLACE_NATS {
                        let score = partial.score + place.gain - self.scene.placing_nats;
                        let count = partial.formation.placed().count() + 1;
                        if score < self.best_by_count[count] - PRUNE_NATS {
                            continue;
                        }
                        proposals.push((score, parent, vehicle, place.stance));
                    }
                }
                if best < CONVINCING * self.scene.placing_nats {
                    grown.push(Partial {
                        skipped: partial.skipped | 1 << vehicle,
                        ..partial.clone()
                    });
                }
            }
            proposals.sort_by(|a, b| b.0.total_cmp(&a.0));
            let best = proposals.first().map_or(0.0, |best| best.0);
            let within = |nats: f64| proposals.partition_point(|one| one.0 >= best - nats);
            let alike = within(ALIKE_NATS);
            cut.branches += alike.saturating_sub(ALIKE_MAX);
            let count = within(PRUNE_NATS).min(width).max(alike.min(ALIKE_MAX));
            for (_, parent, vehicle, stance) in proposals.into_iter().take(count) {
                let mut branch = beam[parent].formation.clone();
                branch.stances[vehicle] = Some(stance);
                self.add(&mut grown, branch, beam[parent].skipped, cut);
            }
            beam = grown;
            if !is_growing {
                break;
            }
        }
        self.thin(&mut beam);
        for partial in beam {
            self.finish(partial.formation);
        }
    }

    /// Adds a formation to the beam once its stances are improved.
    fn add(
        &mut self,
        beam: &mut Vec<Partial>,
        mut formation: Formation,
        skipped: u32,
        cut: &mut Cut,
    ) {
        if self.branches == self.job.settings.branches_max {
            cut.branches += 1;
            return;
        }
        self.branches += 1;
        formation.assign(self.scene, 2.0, |_, _, _| 0.0);
        if refine(&mut formation, self.scene, 1).is_some() {
            let score = formation.log_likelihood(self.scene);
            beam.push(Partial {
                formation,
                score,
                skipped,
            });
        }
    }

    /// Keeps what is about as likely as the best of as many vehicles, and each but once.
    fn thin(&mut self, beam: &mut Vec<Partial>) {
        beam.sort_by(|a, b| b.score.total_cmp(&a.score));
        let Some(best) = beam.first().map(|one| one.score) else {
            return;
        };
        let count = beam
            .iter()
            .map(|one| one.formation.placed().count())
            .max()
            .unwrap_or(0);
        self.best_by_count[count] = self.best_by_count[count].max(best);
        let least = self.best_by_count[count] - PRUNE_NATS;
        beam.retain(|one| one.score >= least);
        let mut kept: Vec<Partial> = Vec::new();
        for partial in beam.drain(..) {
            let is_known = kept.iter().any(|one| {
                one.skipped == partial.skipped && one.formation.seen == partial.formation.seen
            });
            if !is_known {
                kept.push(partial);
            }
        }
        *beam = kept;
    }

    /// The vehicles, those with most sightings first.
    fn by_sightings(&self) -> Vec<usize> {
        let mut order: Vec<usize> = (0..self.scene.vehicles()).collect();
        order.sort_by_key(|one| std::cmp::Reverse(self.scene.rays[*one].len()));
        order
    }
}
