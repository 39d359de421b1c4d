//! P-MultiBeaReg3D as published (Cognetti et al., algorithm 1), with its triangle test mended: triangles are rated by how
//! often other rays meet, those with this vehicle found branches, and each branch grows by triangles that share a side.
//!
//! What is found is as it was measured: nothing is refined.

use super::belief::{Compared, Pose, agreement};
use super::formation::{Formation, NOBODY, Stance};
use super::pairs::Pairs;
use super::scene::{Scene, angle2};
use super::triangle::{Triangle, meeting, of_triple};
use super::{Cut, Job};
use crate::mutual::direction::wrapped;
use nalgebra::{Matrix4, Vector3};

/// Most triples of vehicles that are looked at, and triangles of them that are kept: those with the best rating.
const TRIPLES_MAX: usize = 1200;
const TRIANGLES_MAX: usize = 512;
/// Partial solutions of one step that are expanded.
const PARTIALS_MAX: usize = 32;
/// A rating below this share of the best is given up, of a triangle and of a partial solution.
const TRIANGLE_SHARE: f64 = 0.5;
const PARTIAL_SHARE: f64 = 0.8;
/// A metric so far below the best (nats) is given up.
const METRIC_NATS: f64 = 6.0;
/// Rays meet at a vehicle within three standard deviations, twice widened.
const POINTING_CHI2_MAX: f64 = 9.0 * 2.0;
/// A 2-intersection; a 3-intersection is worth three of them.
const PER_TWO: f64 = 1.0;
const PER_THREE: f64 = 3.0;

/// A branch: some vehicles, how they are seen, and the rating of that.
#[derive(Clone)]
struct Partial {
    formation: Formation,
    rating: f64,
}

/// All formations in which a branch ended.
pub(super) fn search(job: &Job, scene: &Scene, cut: &mut Cut) -> Vec<Formation> {
    let pairs = Pairs::new(scene, cut);
    // 1, 2: identify triangles, rate them by their intersections, keep those above a threshold.
    let triangles = rated(scene, &pairs, cut);
    // 3: a maximal subset of irreconcilable triangles with this vehicle.
    let mut partials: Vec<Partial> = Vec::new();
    for (rating, triangle) in triangles
        .iter()
        .filter(|(_, one)| one.vehicles.contains(&0))
    {
        let partial = Partial {
            formation: triangle.formation(scene),
            rating: *rating,
        };
        add_irreconcilable(&mut partials, partial);
    }
    // 4: those that agree with what is believed.
    prune(job, scene, &mut partials);
    let mut ended: Vec<Partial> = Vec::new();
    // Every step adds a vehicle or exchanges some for a better rating; steps and branches are bounded besides.
    for _ in 0..2 * scene.vehicles() {
        cut.branches += partials.len().saturating_sub(PARTIALS_MAX);
        partials.truncate(PARTIALS_MAX);
        let mut next: Vec<Partial> = Vec::new();
        for partial in partials {
            // 5, 6, 7: expand by every triangle that shares a side, and rate.
            let mut expanded: Vec<Partial> = Vec::new();
            for (_, triangle) in &triangles {
                if let Some(formation) = grown(&partial.formation, triangle) {
                    let rating = rating(&formation, &triangles, scene);
                    if rating > partial.rating {
                        expanded.push(Partial { formation, rating });
                    }
                }
            }
            if expanded.is_empty() {
                // 10: the branch ends.
                add_irreconcilable(&mut ended, partial);
                continue;
            }
            let best = expanded.iter().map(|one| one.rating).fold(0.0, f64::max);
            expanded.retain(|one| one.rating >= PARTIAL_SHARE * best);
            expanded.sort_by(|a, b| b.rating.total_cmp(&a.rating));
            // 8: of solutions that can be reconciled, the best rated goes on.
            let mut branches = Vec::new();
            for one in expanded {
                add_irreconcilable(&mut branches, one);
            }
            next.extend(branches);
        }
        next.sort_by(|a, b| b.rating.total_cmp(&a.rating));
        partials = Vec::new();
        for one in next {
            add_irreconcilable(&mut partials, one);
        }
        // 9: prune by an adaptive threshold.
        let best = partials
            .iter()
            .chain(&ended)
            .map(|one| one.rating)
            .fold(0.0, f64::max);
        partials.retain(|one| one.rating >= TRIANGLE_SHARE * best);
        prune(job, scene, &mut partials);
        if partials.is_empty() {
            break;
        }
    }
    ended.extend(partials);
    // The best are selected by the same criteria.
    let best = ended.iter().map(|one| one.rating).fold(0.0, f64::max);
    ended.retain(|one| one.rating >= PARTIAL_SHARE * best);
    ended.sort_by(|a, b| b.rating.total_cmp(&a.rating));
    prune(job, scene, &mut ended);
    ended
        .into_iter()
        .map(|one| as_measured(one.formation, scene))
        .collect()
}

/// All triangles with a rating above the threshold, the best first.
fn rated(scene: &Scene, pairs: &Pairs, cut: &mut Cut) -> Vec<(f64, Triangle)> {
    let vehicles = scene.vehicles();
    let mut rated = Vec::new();
    let mut triples = 0;
    for r in 0..vehicles {
        for s in r + 1..vehicles {
            for t in s + 1..vehicles {
                triples += 1;
                if triples > TRIPLES_MAX {
                    cut.triples += 1;
                    continue;
                }
                for triangle in of_triple(scene, pairs, [r, s, t], cut) {
                    let meet = triangle.intersections(scene);
                    let two = (meet.two - meet.three) as f64;
                    // A triangle is itself one more that is seen thrice.
                    let rating = PER_THREE * (1.0 + meet.three as f64) + PER_TWO * two;
                    rated.push((rating, triangle));
                }
            }
        }
    }
    let best = rated.iter().map(|(rating, _)| *rating).fold(0.0, f64::max);
    rated.retain(|(rating, _)| *rating >= TRIANGLE_SHARE * best);
    rated.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.chi2.total_cmp(&b.1.chi2)));
    cut.triangles += rated.len().saturating_sub(TRIANGLES_MAX);
    rated.truncate(TRIANGLES_MAX);
    rated
}

/// Adds it, unless it can be reconciled with one that is there: then both grow into the same.
fn add_irreconcilable(partials: &mut Vec<Partial>, one: Partial) {
    if partials
        .iter()
        .all(|other| is_irreconcilable(&other.formation, &one.formation))
    {
        partials.push(one);
    }
}

/// One vehicle is two sightings of another in the two, or one sighting is two vehicles.
fn is_irreconcilable(a: &Formation, b: &Formation) -> bool {
    a.seen.iter().zip(&b.seen).any(|(a, b)| {
        a.iter().enumerate().any(|(ray, target)| {
            *target != NOBODY
                && ((b[ray] != NOBODY && b[ray] != *target)
                    || b.iter()
                        .enumerate()
                        .any(|(other, same)| same == target && other != ray))
        })
    })
}

/// The formation with the triangle added, if they share a side. Vehicles that conflict with the triangle are taken out.
fn grown(formation: &Formation, triangle: &Triangle) -> Option<Formation> {
    if triangle.is_within(formation) {
        return None;
    }
    let corners = [(0, 1), (1, 2), (2, 0)];
    let (a, b) = corners.into_iter().find(|(a, b)| {
        let (first, second) = (triangle.vehicles[*a], triangle.vehicles[*b]);
        let mut sides = triangle.sides();
        let shared =
            |side: &(usize, usize, usize)| formation.seen[side.0][side.1] as usize == side.2;
        formation.stances[first].is_some()
            && formation.stances[second].is_some()
            && sides.all(|side| {
                let of_both =
                    [first, second].contains(&side.0) && [first, second].contains(&side.2);
                !of_both || shared(&side)
            })
    })?;
    let third = triangle.vehicles[3 - a - b];
    let mut grown = formation.clone();
    let conflicting: Vec<usize> = conflicts(formation, triangle);
    // The shared side itself must stay, and this vehicle is in every solution.
    if conflicting
        .iter()
        .any(|one| *one == triangle.vehicles[a] || *one == triangle.vehicles[b] || *one == 0)
    {
        return None;
    }
    for vehicle in conflicting {
        grown.displace(vehicle);
    }
    let joined = joined(&grown, triangle, [a, b])?;
    if grown.stances[third].is_none() {
        grown.stances[third] = Some(joined);
    }
    triangle.mark(&mut grown);
    Some(grown)
}

/// The vehicles whose sightings contradict the triangle's.
fn conflicts(formation: &Formation, triangle: &Triangle) -> Vec<usize> {
    let mut conflicting = Vec::new();
    for (viewer, ray, target) in triangle.sides() {
        let held = formation.seen[viewer][ray];
        if held != NOBODY && held as usize != target {
            conflicting.push(held as usize);
        }
        if formation
            .ray_of(viewer, target)
            .is_some_and(|other| other != ray)
        {
            conflicting.push(target);
        }
    }
    conflicting.sort_unstable();
    conflicting.dedup();
    conflicting
}

/// The third corner's stance in the formation's frame, by the change of coordinates that the shared side gives.
fn joined(formation: &Formation, triangle: &Triangle, [a, b]: [usize; 2]) -> Option<Stance> {
    let (first, second) = (
        formation.stances[triangle.vehicles[a]]?,
        formation.stances[triangle.vehicles[b]]?,
    );
    let (from, to, third) = (
        &triangle.stances[a],
        &triangle.stances[b],
        &triangle.stances[3 - a - b],
    );
    let scale = (second.position - first.position).norm() / (to.position - from.position).norm();
    // Both ends tell the turn; half of what they disagree by.
    let turn = wrapped(first.yaw_rad - from.yaw_rad);
    let apart = wrapped(second.yaw_rad - to.yaw_rad - turn);
    let frame_from_triangle = Stance {
        position: Vector3::zeros(),
        yaw_rad: turn + apart / 2.0,
    };
    let offset = frame_from_triangle.frame_from_level() * (third.position - from.position);
    let position = first.position + offset * scale;
    position.x.is_finite().then_some(Stance {
        position,
        yaw_rad: wrapped(third.yaw_rad + frame_from_triangle.yaw_rad),
    })
}

/// How often rays meet: n that meet in a point are n!/(n-3)!3! 3-intersections, in a vehicle as in a point that is none;
/// and a triangle that fits without adding anything is one more 4-intersection, four of them.
fn rating(formation: &Formation, triangles: &[(f64, Triangle)], scene: &Scene) -> f64 {
    let mut rating = 0.0;
    let placed: Vec<(usize, Stance)> = formation
        .placed()
        .map(|(vehicle, stance)| (vehicle, *stance))
        .collect();
    let turned: Vec<Vec<Vector3<f64>>> = placed
        .iter()
        .map(|(vehicle, stance)| {
            let turn = stance.frame_from_level();
            scene.rays[*vehicle]
                .iter()
                .map(|ray| turn * ray.unit)
                .collect()
        })
        .collect();
    let unused = |viewer: usize| {
        let vehicle = placed[viewer].0;
        (0..turned[viewer].len()).filter(move |ray| !formation.is_used(vehicle, *ray))
    };
    let points_at = |viewer: usize, ray: usize, point: &Vector3<f64>| {
        let offset = point - placed[viewer].1.position;
        let variance = scene.rays[placed[viewer].0][ray].variance;
        angle2(turned[viewer][ray].dot(&offset) / offset.norm().max(1e-9))
            < POINTING_CHI2_MAX * variance
    };
    for (vehicle, stance) in &placed {
        let pointing = (0..placed.len()).filter(|viewer| {
            formation.ray_of(placed[*viewer].0, *vehicle).is_some()
                || (placed[*viewer].0 != *vehicle
                    && unused(*viewer).any(|ray| points_at(*viewer, ray, &stance.position)))
        });
        // The vehicle itself stands there as well.
        rating += of_meeting(pointing.count() + 1);
    }
    for first in 0..placed.len() {
        for a in unused(first) {
            let mut best = 0;
            for second in first + 1..placed.len() {
                let offset = placed[second].1.position - placed[first].1.position;
                for b in unused(second) {
                    let variances = (scene.variance, scene.variance);
                    let (one, other) = (&turned[first][a], &turned[second][b]);
                    let Some(met) = meeting(&offset, one, other, variances.0, variances.1) else {
                        continue;
                    };
                    let point = placed[first].1.position + one * met.first;
                    let more = (second + 1..placed.len())
                        .filter(|third| unused(*third).any(|c| points_at(*third, c, &point)));
                    best = best.max(2 + more.count());
                }
            }
            rating += of_meeting(best);
        }
    }
    let fitting = triangles
        .iter()
        .filter(|(_, one)| one.is_within(formation))
        .count();
    rating + 4.0 * PER_THREE * fitting as f64
}

/// What so many rays that meet are worth.
fn of_meeting(rays: usize) -> f64 {
    match rays {
        0 | 1 => 0.0,
        2 => PER_TWO,
        _ => PER_THREE * (rays * (rays - 1) * (rays - 2) / 6) as f64,
    }
}

/// Gives those up whose metric is far below the best.
fn prune(job: &Job, scene: &Scene, partials: &mut Vec<Partial>) {
    if job.neighbours.iter().all(|one| one.belief.is_none()) {
        return;
    }
    let wrong = job.settings.belief_wrong_probability.clamp(1e-6, 1.0);
    let metrics: Vec<f64> = partials
        .iter()
        .map(|partial| {
            let formation = as_measured(partial.formation.clone(), scene);
            let compared: Vec<Compared<'_>> = formation
                .placed()
                .filter(|(vehicle, _)| *vehicle > 0)
                .map(|(vehicle, stance)| Compared {
                    belief: job.neighbours[vehicle - 1].belief.as_ref(),
                    place: Pose {
                        position_m: stance.position,
                        yaw_rad: stance.yaw_rad,
                    },
                    covariance: raw_covariance(&formation, scene, vehicle),
                })
                .collect();
            // Partial solutions have different vehicles: the mean is comparable.
            agreement(&compared, wrong).log_metric / compared.len().max(1) as f64
        })
        .collect();
    let best = metrics.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mut kept = metrics.iter().map(|metric| *metric >= best - METRIC_NATS);
    partials.retain(|_| kept.next().unwrap_or(false));
}

/// Every neighbour that this vehicle sees lies exactly where it is seen, and heads as the mutual sightings say.
fn as_measured(mut formation: Formation, scene: &Scene) -> Formation {
    formation.normalise();
    for vehicle in 1..scene.vehicles() {
        let (Some(stance), Some(mine)) = (formation.stances[vehicle], formation.ray_of(0, vehicle))
        else {
            continue;
        };
        let seen = &scene.rays[0][mine];
        let mut measured = stance;
        measured.position = seen.unit * stance.position.norm();
        if let Some(theirs) = formation.ray_of(vehicle, 0) {
            let back = &scene.rays[vehicle][theirs];
            if seen.azimuth_variance + back.azimuth_variance < 0.6 {
                measured.yaw_rad =
                    wrapped(seen.azimuth_rad - back.azimuth_rad + std::f64::consts::PI);
            }
        }
        formation.stances[vehicle] = Some(measured);
    }
    formation
}

/// Covariance of a neighbour's position and yaw as single sightings have it; the distance is known to a third.
pub(super) fn raw_covariance(formation: &Formation, scene: &Scene, vehicle: usize) -> Matrix4<f64> {
    let position = formation.stances[vehicle].map_or(Vector3::x(), |stance| stance.position);
    let distance2 = position.norm_squared();
    let along = position.normalize();
    let across = nalgebra::Matrix3::identity() - along * along.transpose();
    let place = (across * scene.variance + along * along.transpose() * 0.1) * distance2;
    let mut covariance = Matrix4::zeros();
    covariance.fixed_view_mut::<3, 3>(0, 0).copy_from(&place);
    let level = along.xy().norm_squared().max(0.05);
    covariance[(3, 3)] = 2.0 * scene.variance / level;
    covariance
}
