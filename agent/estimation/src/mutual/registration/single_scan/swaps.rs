//! Swaps: two vehicles at each other's places. The others see the same, so only what the two themselves see decides; that
//! is told quickly for all pairs. Symmetric formations have all their solutions found so, and wrong ones are mended.

use super::super::Cut;
use super::super::formation::{Formation, Stance};
use super::super::scene::{Ray, Scene, angle2};
use super::Searching;
use crate::mutual::direction::wrapped;
use nalgebra::Vector3;

/// Stances of the two are not refined when they are told: swaps that seem worse by so much (nats, beyond what survives)
/// are tried.
const SWAP_NATS: f64 = 4.0;
/// Variances count this often until then.
const WIDENED: f64 = 1.5;
/// Vehicles that a sighting is taken for, in turn, to tell the yaw.
const REFERENCES: usize = 2;

impl Searching<'_> {
    /// Tries all swaps in all formations found since the last time, and in those that this finds.
    pub(super) fn swap(&mut self, cut: &mut Cut) {
        while self.swapped < self.found.len() {
            let (formation, score) = self.found[self.swapped].clone();
            self.swapped += 1;
            if score < self.best_score() - self.job.settings.survival_nats - SWAP_NATS {
                continue;
            }
            for other in swaps(
                &formation,
                self.scene,
                self.job.settings.survival_nats + SWAP_NATS,
            ) {
                if self
                    .found
                    .iter()
                    .any(|(known, _)| known.agrees(&other, self.scene))
                {
                    continue;
                }
                if self.branches == self.job.settings.branches_max {
                    cut.branches += 1;
                    continue;
                }
                self.branches += 1;
                self.finish(other);
            }
        }
    }
}

/// The formations with two vehicles swapped that lose at most so much (nats).
fn swaps(formation: &Formation, scene: &Scene, loss_max: f64) -> Vec<Formation> {
    let placed: Vec<(usize, Stance)> = formation
        .placed()
        .map(|(vehicle, stance)| (vehicle, *stance))
        .collect();
    // What each vehicle would see at each place.
    let looks: Vec<Vec<(f64, f64)>> = placed
        .iter()
        .map(|(vehicle, _)| {
            let rays = &scene.rays[*vehicle];
            (0..placed.len())
                .map(|place| look(rays, &placed, place))
                .collect()
        })
        .collect();
    let mut swapped = Vec::new();
    for u in 0..placed.len() {
        for v in u + 1..placed.len() {
            let loss = looks[u][u].0 + looks[v][v].0 - looks[u][v].0 - looks[v][u].0;
            if loss > loss_max {
                continue;
            }
            let mut other = formation.clone();
            for (vehicle, place) in [(u, v), (v, u)] {
                other.stances[placed[vehicle].0] = Some(Stance {
                    position: placed[place].1.position,
                    yaw_rad: looks[vehicle][place].1,
                });
            }
            swapped.push(other);
        }
    }
    swapped
}

/// The most that these rays gain at a place (nats), and the yaw at which they do.
fn look(rays: &[Ray], placed: &[(usize, Stance)], place: usize) -> (f64, f64) {
    let from = placed[place].1.position;
    let others = placed
        .iter()
        .enumerate()
        .filter(|(other, _)| *other != place);
    let directions: Vec<Vector3<f64>> = others
        .filter_map(|(_, (_, stance))| (stance.position - from).try_normalize(1e-9))
        .collect();
    let mut best = (0.0, 0.0);
    for reference in directions.iter().take(REFERENCES) {
        for ray in rays {
            let zenith = reference.z.clamp(-1.0, 1.0).acos();
            if (zenith - ray.zenith_rad).powi(2) > 2.0 * ray.gain.max(0.0) * WIDENED * ray.variance
            {
                continue;
            }
            let yaw_rad = wrapped(reference.y.atan2(reference.x) - ray.azimuth_rad);
            let (sin, cos) = yaw_rad.sin_cos();
            let seen = directions.iter().map(|one| {
                // Into the level frame of the vehicle.
                let level =
                    Vector3::new(cos * one.x + sin * one.y, cos * one.y - sin * one.x, one.z);
                let gains = rays.iter().map(|ray| {
                    ray.gain - 0.5 * angle2(ray.unit.dot(&level)) / (WIDENED * ray.variance)
                });
                gains.fold(0.0, f64::max)
            });
            let gain = seen.sum::<f64>();
            if gain > best.0 {
                best = (gain, yaw_rad);
            }
        }
    }
    best
}
