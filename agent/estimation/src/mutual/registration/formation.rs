//! A formation: where some of the vehicles are, up to scale, and which sighting is whom.

use super::SIGHTINGS_MAX;
use super::scene::{Scene, angle2};
use crate::mutual::assignment::assign;
use nalgebra::{Rotation3, Vector3};

/// This sighting is nobody.
pub(super) const NOBODY: u8 = u8::MAX;

/// Where a vehicle is and where it heads, in the formation's frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stance {
    pub(super) position: Vector3<f64>,
    pub(super) yaw_rad: f64,
}

impl Stance {
    pub(super) fn origin() -> Self {
        Self {
            position: Vector3::zeros(),
            yaw_rad: 0.0,
        }
    }

    pub(super) fn frame_from_level(&self) -> Rotation3<f64> {
        Rotation3::from_axis_angle(&Vector3::z_axis(), self.yaw_rad)
    }
}

/// Where vehicles are and who is seen where.
#[derive(Clone)]
pub(super) struct Formation {
    /// By vehicle; none while it is not placed.
    pub(super) stances: Vec<Option<Stance>>,
    /// By vehicle and ray: the vehicle that is seen, or [`NOBODY`].
    pub(super) seen: Vec<[u8; SIGHTINGS_MAX]>,
}

impl Formation {
    /// Nobody is placed.
    pub(super) fn empty(scene: &Scene) -> Self {
        Self {
            stances: vec![None; scene.vehicles()],
            seen: vec![[NOBODY; SIGHTINGS_MAX]; scene.vehicles()],
        }
    }

    pub(super) fn placed(&self) -> impl Iterator<Item = (usize, &Stance)> {
        let stances = self.stances.iter().enumerate();
        stances.filter_map(|(vehicle, stance)| Some((vehicle, stance.as_ref()?)))
    }

    pub(super) fn is_used(&self, vehicle: usize, ray: usize) -> bool {
        self.seen[vehicle][ray] != NOBODY
    }

    /// The ray by which one vehicle sees another.
    pub(super) fn ray_of(&self, viewer: usize, target: usize) -> Option<usize> {
        self.seen[viewer]
            .iter()
            .position(|one| *one as usize == target)
    }

    /// The vehicle is taken out again.
    pub(super) fn displace(&mut self, vehicle: usize) {
        self.stances[vehicle] = None;
        self.seen[vehicle] = [NOBODY; SIGHTINGS_MAX];
        for seen in self.seen.iter_mut().flatten() {
            if *seen as usize == vehicle {
                *seen = NOBODY;
            }
        }
    }

    /// Decides anew who is seen where: of each vehicle's sightings and the placed vehicles, the likeliest one-to-one
    /// assignment. Variances are `widened` while the stances are not at their best yet; `spread` adds a variance (rad^2)
    /// of where the target is seen by the viewer.
    pub(super) fn assign(
        &mut self,
        scene: &Scene,
        widened: f64,
        spread: impl Fn(usize, usize, f64) -> f64,
    ) {
        let placed: Vec<(usize, Stance)> = self
            .placed()
            .map(|(vehicle, stance)| (vehicle, *stance))
            .collect();
        let mut gains = Vec::new();
        let mut targets = Vec::new();
        for (viewer, stance) in &placed {
            let rays = &scene.rays[*viewer];
            let level_from_frame = stance.frame_from_level().inverse();
            targets.clear();
            for (target, other) in placed.iter().filter(|(target, _)| target != viewer) {
                let offset = level_from_frame * (other.position - stance.position);
                let distance = offset.norm();
                if distance > 0.0 && distance.is_finite() {
                    let added = spread(*viewer, *target, distance);
                    targets.push((*target, offset / distance, added));
                }
            }
            gains.clear();
            for ray in rays {
                for (_, unit, added) in &targets {
                    let variance = ray.variance * widened + added;
                    let spread_nats = (variance / ray.variance).ln();
                    gains
                        .push(ray.gain - spread_nats - 0.5 * angle2(ray.unit.dot(unit)) / variance);
                }
            }
            self.seen[*viewer] = [NOBODY; SIGHTINGS_MAX];
            let columns = targets.len();
            for (ray, column) in likeliest(&gains, rays.len(), columns) {
                self.seen[*viewer][ray] = targets[column].0 as u8;
            }
        }
    }

    /// The gain of all assigned sightings over clutter and misses (nats), less what placing the vehicles costs.
    pub(super) fn log_likelihood(&self, scene: &Scene) -> f64 {
        let contributions = self.contributions(scene);
        let placed = self.placed().count().saturating_sub(1);
        contributions.iter().sum::<f64>() / 2.0 - scene.placing_nats * placed as f64
    }

    /// By vehicle: the gain of the sightings that it makes and of those of it (nats). Each sighting counts for both ends.
    pub(super) fn contributions(&self, scene: &Scene) -> Vec<f64> {
        let mut contributions = vec![0.0; scene.vehicles()];
        self.each_gain(scene, |viewer, target, gain| {
            contributions[viewer] += gain;
            contributions[target] += gain;
        });
        contributions
    }

    /// By vehicle: the gain of the sightings that it makes (nats).
    pub(super) fn looking(&self, scene: &Scene) -> Vec<f64> {
        let mut looking = vec![0.0; scene.vehicles()];
        self.each_gain(scene, |viewer, _, gain| looking[viewer] += gain);
        looking
    }

    /// Viewer, target and gain (nats) of every sighting that is somebody.
    fn each_gain(&self, scene: &Scene, mut each: impl FnMut(usize, usize, f64)) {
        for (viewer, stance) in self.placed() {
            let level_from_frame = stance.frame_from_level().inverse();
            for (index, ray) in scene.rays[viewer].iter().enumerate() {
                let target = self.seen[viewer][index] as usize;
                let Some(Some(other)) = self.stances.get(target) else {
                    continue;
                };
                let offset = level_from_frame * (other.position - stance.position);
                let cosine = ray.unit.dot(&offset) / offset.norm().max(1e-12);
                each(
                    viewer,
                    target,
                    ray.gain - 0.5 * angle2(cosine) / ray.variance,
                );
            }
        }
    }

    /// Two formations are the same when they have the same sightings of the same vehicles, as seen from this vehicle and
    /// by the others of it.
    pub(super) fn agrees(&self, other: &Self, scene: &Scene) -> bool {
        let (Some(mine), Some(theirs)) = (self.stances[0], other.stances[0]) else {
            return false;
        };
        (1..self.stances.len()).all(|vehicle| {
            match (self.stances[vehicle], other.stances[vehicle]) {
                (None, None) => true,
                (Some(a), Some(b)) => near(scene, [mine, a], [theirs, b]),
                _ => false,
            }
        })
    }

    /// Turns, shifts and scales everything so that this vehicle is the origin and the mean distance from it is one.
    pub(super) fn normalise(&mut self) {
        let Some(own) = self.stances[0] else { return };
        let level_from_frame = own.frame_from_level().inverse();
        let mut total = 0.0;
        let mut count = 0;
        for stance in self.stances.iter_mut().flatten() {
            stance.position = level_from_frame * (stance.position - own.position);
            stance.yaw_rad = crate::mutual::direction::wrapped(stance.yaw_rad - own.yaw_rad);
            total += stance.position.norm();
            count += 1;
        }
        let scale = f64::from(count - 1) / total;
        if scale.is_finite() {
            for stance in self.stances.iter_mut().flatten() {
                stance.position *= scale;
            }
        }
    }

    pub(super) fn is_finite(&self) -> bool {
        self.placed().all(|(_, stance)| {
            stance.yaw_rad.is_finite() && stance.position.iter().all(|one| one.is_finite())
        })
    }
}

/// Whether a neighbour has the same direction and yaw relative to the own stance in two formations, within what noise
/// does.
fn near(scene: &Scene, [own_a, a]: [Stance; 2], [own_b, b]: [Stance; 2]) -> bool {
    let width = (9.0 * scene.variance).min(0.3);
    let seen = |own: &Stance, stance: &Stance| {
        own.frame_from_level().inverse() * (stance.position - own.position).normalize()
    };
    let apart = angle2(seen(&own_a, &a).dot(&seen(&own_b, &b)));
    let turned = crate::mutual::direction::wrapped(
        (a.yaw_rad - own_a.yaw_rad) - (b.yaw_rad - own_b.yaw_rad),
    );
    apart < width && turned * turned < 2.0 * width
}

/// The likeliest one-to-one assignment of rays to columns by the table of their gains.
fn likeliest(gains: &[f64], rays: usize, columns: usize) -> Vec<(usize, usize)> {
    let mut chosen = Vec::with_capacity(rays.min(columns));
    let mut taken = 0_u64;
    let mut contested = false;
    for ray in 0..rays {
        let row = &gains[ray * columns..(ray + 1) * columns];
        let best = row.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
        let Some((column, gain)) = best.filter(|(_, gain)| **gain > 0.0) else {
            continue;
        };
        debug_assert!(gain.is_finite());
        contested |= taken & (1 << column) != 0;
        taken |= 1 << column;
        chosen.push((ray, column));
    }
    if !contested {
        return chosen;
    }
    let cost = |ray: usize, column: usize| {
        let gain = gains[ray * columns + column];
        if gain > 0.0 { -gain } else { f64::INFINITY }
    };
    let assigned = assign(rays, columns, 0.0, cost).into_iter().enumerate();
    assigned
        .filter_map(|(ray, column)| Some((ray, column?)))
        .collect()
}
