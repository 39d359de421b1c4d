//! Where another vehicle may be, given where some already are: a mutual pair with one of them tells the direction and the
//! yaw, rays of the others and its own rays to the others tell how far.

use super::formation::{Formation, Stance};
use super::pairs::Pairs;
use super::scene::{Scene, angle2};
use super::triangle::meeting;
use crate::mutual::direction::wrapped;
use nalgebra::Vector3;

/// Most vehicles whose mutual pairs with the new one are tried, unless they lead nowhere.
const BASES_MAX: usize = 2;
/// They lead nowhere unless this share of all that could be seen is gained.
const CONVINCING_SHARE: f64 = 0.8;
/// Most distances along one ray that are tried: those at which most rays cross.
const DISTANCES_MAX: usize = 3;
/// What is placed from few sightings is not exactly there: variances count this often.
const WIDENED: f64 = 2.0;

/// A place for a vehicle.
#[derive(Clone, Copy)]
pub(super) struct Candidate {
    pub(super) stance: Stance,
    /// Of all sightings between it and those already placed (nats).
    pub(super) gain: f64,
}

/// A ray, turned into the formation's frame.
#[derive(Clone, Copy)]
struct Turned {
    unit: Vector3<f64>,
    variance: f64,
    /// What it gains when it points exactly at something (nats).
    peak: f64,
    /// By how much less per rad^2 that it points aside.
    slope: f64,
    /// The cosine of the angle at which nothing is gained.
    least_cosine: f64,
}

/// One vehicle that is placed already.
struct Located {
    vehicle: usize,
    position: Vector3<f64>,
    rays: Vec<Turned>,
    /// The rays that are nobody yet.
    unused: Vec<Turned>,
}

/// What is needed to place vehicles into one formation.
pub(super) struct Placing<'a> {
    scene: &'a Scene,
    pairs: &'a Pairs,
    formation: &'a Formation,
    located: Vec<Located>,
    /// How far apart vehicles are, on average.
    spacing: f64,
}

impl<'a> Placing<'a> {
    pub(super) fn new(scene: &'a Scene, pairs: &'a Pairs, formation: &'a Formation) -> Self {
        let located: Vec<Located> = formation
            .placed()
            .map(|(vehicle, stance)| {
                let turn = stance.frame_from_level();
                let rays: Vec<Turned> = scene.rays[vehicle]
                    .iter()
                    .map(|ray| Turned::new(ray, turn * ray.unit))
                    .collect();
                let unused = rays.iter().enumerate();
                let unused = unused.filter(|(index, _)| !formation.is_used(vehicle, *index));
                Located {
                    vehicle,
                    position: stance.position,
                    unused: unused.map(|(_, ray)| *ray).collect(),
                    rays,
                }
            })
            .collect();
        let from_first = located
            .iter()
            .skip(1)
            .map(|one| (one.position - located[0].position).norm());
        let spacing = from_first.sum::<f64>() / located.len().saturating_sub(1).max(1) as f64;
        Self {
            scene,
            pairs,
            formation,
            located,
            spacing: if spacing > 0.0 { spacing } else { 1.0 },
        }
    }

    /// The best places of a vehicle, best first, at most `count_max` that differ.
    pub(super) fn candidates(&self, vehicle: usize, count_max: usize) -> Vec<Candidate> {
        let mut found = Vec::new();
        let (first, rest) = self.located.split_at(self.located.len().min(BASES_MAX));
        for base in first {
            self.place_from(vehicle, base, &mut found);
        }
        // So much is gained where most of the located see it and are seen by it.
        let rays = &self.scene.rays[vehicle];
        let gain = rays.iter().map(|ray| ray.gain).sum::<f64>() / rays.len().max(1) as f64;
        let convincing = CONVINCING_SHARE * 2.0 * self.located.len() as f64 * (gain - 1.0);
        if !found.iter().any(|one| one.gain > convincing) {
            for base in rest {
                self.place_from(vehicle, base, &mut found);
            }
        }
        found.sort_by(|a, b| b.gain.total_cmp(&a.gain));
        let mut distinct: Vec<Candidate> = Vec::with_capacity(count_max);
        for one in found {
            if distinct.len() == count_max {
                break;
            }
            if !distinct.iter().any(|other| self.alike(&one, other)) {
                distinct.push(one);
            }
        }
        distinct
    }

    fn alike(&self, a: &Candidate, b: &Candidate) -> bool {
        let turned = wrapped(a.stance.yaw_rad - b.stance.yaw_rad);
        let width = (9.0 * self.scene.variance).clamp(1e-3, 0.3);
        if turned * turned > 2.0 * width {
            return false;
        }
        let from = self.located[0].position;
        let (to_a, to_b) = (a.stance.position - from, b.stance.position - from);
        let (far_a, far_b) = (to_a.norm(), to_b.norm());
        let stretched = (far_a / far_b).ln();
        angle2(to_a.dot(&to_b) / (far_a * far_b)) < width && stretched.abs() < 0.5
    }

    fn place_from(&self, vehicle: usize, base: &Located, found: &mut Vec<Candidate>) {
        let rays = &self.scene.rays[vehicle];
        let base_yaw = self.formation.stances[base.vehicle].map_or(0.0, |one| one.yaw_rad);
        let mut turned: Vec<Turned> = rays.iter().map(|ray| Turned::new(ray, ray.unit)).collect();
        let mut distances = Vec::new();
        for pair in self.pairs.of(base.vehicle, vehicle) {
            let (mine, theirs) = (pair.mine as usize, pair.theirs as usize);
            if self.formation.is_used(base.vehicle, mine) {
                continue;
            }
            let yaw_rad = base_yaw + pair.yaw_rad;
            let (sin, cos) = yaw_rad.sin_cos();
            for (turned, ray) in turned.iter_mut().zip(rays) {
                let unit = &ray.unit;
                turned.unit = Vector3::new(
                    cos * unit.x - sin * unit.y,
                    sin * unit.x + cos * unit.y,
                    unit.z,
                );
            }
            let along = (base.rays[mine].unit - turned[theirs].unit).normalize();
            if !along.x.is_finite() {
                continue;
            }
            self.distances(base, &along, &turned, theirs, &mut distances);
            let at = |distance: &f64| base.position + along * *distance;
            let best = distances
                .iter()
                .map(|distance| (self.gain(&at(distance), &turned), at(distance)))
                .max_by(|a, b| a.0.total_cmp(&b.0));
            if let Some((gain, position)) = best {
                let stance = Stance {
                    position,
                    yaw_rad: wrapped(yaw_rad),
                };
                found.push(Candidate { stance, gain });
            }
        }
    }

    /// Distances from the base at which a ray of another, or one of the vehicle's own towards another, crosses; how far
    /// vehicles are apart where none does.
    fn distances(
        &self,
        base: &Located,
        along: &Vector3<f64>,
        turned: &[Turned],
        theirs: usize,
        distances: &mut Vec<f64>,
    ) {
        distances.clear();
        let half = self.scene.variance / 2.0;
        for other in self
            .located
            .iter()
            .filter(|one| one.vehicle != base.vehicle)
        {
            let offset = other.position - base.position;
            let there = other.unused.iter().map(|ray| (ray.unit, ray.variance));
            let own = turned
                .iter()
                .enumerate()
                .filter(|(index, _)| *index != theirs);
            let back = own.map(|(_, ray)| (-ray.unit, ray.variance));
            for (unit, variance) in there.chain(back) {
                if let Some(met) = meeting(&offset, along, &unit, half, variance) {
                    distances.push(met.first);
                }
            }
        }
        if distances.is_empty() {
            distances.push(self.spacing);
            return;
        }
        distances.sort_unstable_by(f64::total_cmp);
        // Where most rays cross, as near to each other as the noise lets be told apart.
        let alike = 1.0 + 2.0 * self.scene.variance.sqrt();
        let mut groups = [(0_usize, 0.0_f64); DISTANCES_MAX];
        let mut start = 0;
        while start < distances.len() {
            let reach = distances[start] * alike;
            let end = start + distances[start..].partition_point(|one| *one <= reach);
            let group = (end - start, distances[(start + end - 1) / 2]);
            let least = groups.iter_mut().min_by_key(|one| one.0);
            if let Some(least) = least.filter(|least| least.0 < group.0) {
                *least = group;
            }
            start = end;
        }
        distances.clear();
        distances.extend(groups.iter().filter(|one| one.0 > 0).map(|one| one.1));
    }

    /// What the sightings between the vehicle, if it were there, and those already placed gain (nats).
    fn gain(&self, position: &Vector3<f64>, turned: &[Turned]) -> f64 {
        let mut gain = 0.0;
        for other in &self.located {
            let offset = position - other.position;
            let away = offset / offset.norm().max(1e-9);
            gain += best(&other.unused, &away) + best(turned, &-away);
        }
        gain
    }
}

/// What the ray that points there best gains; nothing when none does.
fn best(rays: &[Turned], direction: &Vector3<f64>) -> f64 {
    let mut best = 0.0_f64;
    for ray in rays {
        let cosine = ray.unit.dot(direction);
        if cosine > ray.least_cosine {
            best = best.max(ray.peak - ray.slope * angle2(cosine));
        }
    }
    best
}

impl Turned {
    fn new(ray: &super::scene::Ray, unit: Vector3<f64>) -> Self {
        let slope = 0.5 / (WIDENED * ray.variance);
        let farthest = (ray.gain.max(0.0) / slope).sqrt().min(1.5);
        Self {
            unit,
            variance: ray.variance,
            peak: ray.gain,
            slope,
            least_cosine: farthest.cos(),
        }
    }
}
