//! The search of ours: what the beliefs predict, if they explain the scan; else seeds from triangles and mutual pairs,
//! grown vehicle by vehicle, repaired where they do not fit, swapped for their equals, and refined as a whole.

mod explained;
mod growth;
mod repair;
mod swaps;

use super::formation::{Formation, Stance};
use super::pairs::Pairs;
use super::refinement::refine;
use super::scene::Scene;
use super::triangle::{Triangle, of_triple};
use super::{Cut, Job, Search};

/// Mutual pairs that are grown where triangles do not explain everything.
const PAIRS_MAX: usize = 256;
/// Formations that are grown at once from beliefs and triangles, and from pairs.
const SEEDS_WIDTH: usize = 24;
const PAIRS_WIDTH: usize = 96;
/// Triangles of one triple that are grown as they are rated like the best (nats), which symmetry makes them.
const SEEDS_ALIKE_MAX: usize = 96;
const SEED_ALIKE_NATS: f64 = 0.1;
/// First with little effort, then, if that does not explain everything, with more.
const EFFORTS: [Effort; 2] = [
    Effort {
        triangles: 1024,
        seeds: 32,
        width: SEEDS_WIDTH,
        patience: 3,
        repaired: 3,
    },
    Effort {
        triangles: 4096,
        seeds: 160,
        width: 64,
        patience: 6,
        repaired: 7,
    },
];
/// Distinct formations that are kept: the likeliest.
const FOUND_MAX: usize = 512;
/// Share of all vehicles that a vehicle that is where it is believed must see, and be seen by, at least.
const EXPLAINED_ONE_SHARE: f64 = 0.45;

/// All formations that were found.
pub(super) fn search(job: &Job, scene: &Scene, cut: &mut Cut) -> Vec<Formation> {
    let core = believed(job, scene)
        .map(|formation| without_unexplained(formation, scene))
        .filter(|core| core.placed().count() > 1);
    let only_unexplained = job.settings.search == Search::Unexplained;
    if let Some(core) = &core
        && only_unexplained
        && core.placed().count() == scene.vehicles()
    {
        let mut searching = Searching::new(job, scene, Pairs::none());
        searching.finish(core.clone());
        return searching.formations();
    }
    let mut searching = Searching::new(job, scene, Pairs::new(scene, cut));
    let is_seeded = core.is_some();
    if let Some(core) = core {
        searching.grow(vec![core], SEEDS_WIDTH, cut);
    }
    if !(is_seeded && only_unexplained) {
        for effort in EFFORTS {
            searching.seed_with_triangles(effort, cut);
            if searching.is_explained() {
                break;
            }
        }
        if !searching.is_explained() {
            searching.seed_with_pairs(cut);
        }
    }
    searching.formations()
}

/// The formation that the beliefs predict, with whom they are sure of.
fn believed(job: &Job, scene: &Scene) -> Option<Formation> {
    let mut formation = Formation::empty(scene);
    formation.stances[0] = Some(Stance::origin());
    let mut spreads = vec![(0.0, 0.0); scene.vehicles()];
    for (vehicle, spread) in spreads.iter_mut().enumerate().skip(1) {
        let belief = job.neighbours[vehicle - 1].belief.as_ref();
        if let Some((mean, position_variance, yaw_variance)) = belief.and_then(|one| one.sure()) {
            formation.stances[vehicle] = Some(Stance {
                position: mean.position_m,
                yaw_rad: mean.yaw_rad,
            });
            *spread = (position_variance, yaw_variance);
        }
    }
    if formation.placed().count() < 2 {
        return None;
    }
    formation.assign(scene, 1.0, |viewer, target, distance| {
        let positions = spreads[viewer].0 + spreads[target].0;
        (positions / (distance * distance) + spreads[viewer].1).min(0.1)
    });
    refine(&mut formation, scene, 3)?;
    Some(formation)
}

/// Takes those out whose sightings, or the sightings of whom, do not fit.
fn without_unexplained(mut formation: Formation, scene: &Scene) -> Formation {
    formation.assign(scene, 1.0, |_, _, _| 0.0);
    let placed: Vec<usize> = formation.placed().map(|(vehicle, _)| vehicle).collect();
    let expected = EXPLAINED_ONE_SHARE * (placed.len() - 1) as f64;
    let sees = |viewer: usize, target: usize| formation.ray_of(viewer, target).is_some();
    let unexplained: Vec<usize> = placed
        .iter()
        .copied()
        .filter(|one| {
            let looking = placed.iter().filter(|other| sees(*one, **other)).count();
            let looked_at = placed.iter().filter(|other| sees(**other, *one)).count();
            *one != 0 && (looking.min(looked_at) as f64) < expected
        })
        .collect();
    for vehicle in unexplained {
        formation.displace(vehicle);
    }
    formation
}

/// How much is grown.
#[derive(Clone, Copy)]
struct Effort {
    /// Triangles of each triple that are rated: those that close best.
    triangles: usize,
    /// Of these, triangles that are grown.
    seeds: usize,
    /// Formations that are grown at once.
    width: usize,
    /// Triples in a row that may find nothing better before no more are looked at.
    patience: usize,
    /// Of so many vehicles, two at a time are placed anew.
    repaired: usize,
}

struct Searching<'a> {
    job: &'a Job,
    scene: &'a Scene,
    pairs: Pairs,
    found: Vec<(Formation, f64)>,
    /// The best likelihood of all formations of as many vehicles, finished or not.
    best_by_count: Vec<f64>,
    branches: usize,
    /// How many of the found have been looked at for swaps.
    swapped: usize,
}

impl<'a> Searching<'a> {
    fn new(job: &'a Job, scene: &'a Scene, pairs: Pairs) -> Self {
        Self {
            job,
            scene,
            pairs,
            found: Vec::new(),
            best_by_count: vec![f64::NEG_INFINITY; scene.vehicles() + 1],
            branches: 0,
            swapped: 0,
        }
    }

    fn formations(self) -> Vec<Formation> {
        self.found
            .into_iter()
            .map(|(formation, _)| formation)
            .collect()
    }

    fn best(&self) -> Option<&Formation> {
        let best = self.found.iter().max_by(|a, b| a.1.total_cmp(&b.1));
        best.map(|(formation, _)| formation)
    }

    /// Looks for triangles triple by triple and grows those with the best rating, until one solution explains everything or
    /// several triples in a row found nothing better.
    fn seed_with_triangles(&mut self, effort: Effort, cut: &mut Cut) {
        let triples = triples(self.scene);
        let mut patience = effort.patience;
        for (order, triple) in triples.iter().enumerate() {
            if order == self.job.settings.triples_max {
                cut.triples += triples.len() - order;
                break;
            }
            let before = self.best_score();
            let triangles = of_triple(self.scene, &self.pairs, *triple, cut);
            let mut rated: Vec<(f64, &Triangle)> = triangles
                .iter()
                .take(effort.triangles)
                .map(|one| (one.intersections(self.scene).nats - 0.5 * one.chi2, one))
                .collect();
            rated.sort_by(|a, b| b.0.total_cmp(&a.0));
            let best = rated.first().map_or(0.0, |best| best.0);
            let alike = rated.partition_point(|one| one.0 > best - SEED_ALIKE_NATS);
            let count = effort.seeds.max(alike.min(SEEDS_ALIKE_MAX));
            let unknown = rated
                .iter()
                .filter(|(_, one)| !self.is_known(one))
                .take(count);
            let seeds = unknown.map(|(_, one)| one.formation(self.scene));
            self.grow(seeds.collect(), effort.width, cut);
            self.swap(cut);
            self.repair(effort, cut);
            self.swap(cut);
            patience = if self.best_score() > before + 1.0 {
                effort.patience
            } else {
                patience - 1
            };
            if self.is_explained() || patience == 0 {
                break;
            }
        }
    }

    fn best_score(&self) -> f64 {
        self.found
            .iter()
            .map(|(_, score)| *score)
            .fold(f64::NEG_INFINITY, f64::max)
    }

    fn is_known(&self, triangle: &Triangle) -> bool {
        self.found.iter().any(|(one, _)| triangle.is_within(one))
    }

    fn seed_with_pairs(&mut self, cut: &mut Cut) {
        let scene = self.scene;
        let vehicles = scene.vehicles();
        let mut seeds = Vec::new();
        for first in 0..vehicles {
            for second in first + 1..vehicles {
                for pair in self.pairs.of(first, second) {
                    seeds.push((first, second, *pair));
                }
            }
        }
        // This vehicle's own pairs first, then those that agree best.
        seeds.sort_by(|a, b| {
            (a.0.min(1).cmp(&b.0.min(1))).then(a.2.zenith_chi2.total_cmp(&b.2.zenith_chi2))
        });
        cut.branches += seeds.len().saturating_sub(PAIRS_MAX);
        seeds.truncate(PAIRS_MAX);
        let seeds = seeds.into_iter().map(|(first, second, pair)| {
            let mut formation = Formation::empty(scene);
            formation.stances[first] = Some(Stance::origin());
            formation.stances[second] = Some(Stance {
                position: scene.rays[first][pair.mine as usize].unit,
                yaw_rad: pair.yaw_rad,
            });
            formation.seen[first][pair.mine as usize] = second as u8;
            formation.seen[second][pair.theirs as usize] = first as u8;
            formation
        });
        self.grow(seeds.collect(), PAIRS_WIDTH, cut);
        self.swap(cut);
    }
}

/// The triples of vehicles: those with this vehicle first, and of these those with most sightings.
fn triples(scene: &Scene) -> Vec<[usize; 3]> {
    let vehicles = scene.vehicles();
    let mut triples = Vec::new();
    for r in 0..vehicles {
        for s in r + 1..vehicles {
            for t in s + 1..vehicles {
                let fewest = [r, s, t].map(|one| scene.rays[one].len()).into_iter().min();
                triples.push((r.min(1), std::cmp::Reverse(fewest), [r, s, t]));
            }
        }
    }
    triples.sort_unstable();
    triples.into_iter().map(|(.., triple)| triple).collect()
}
