//! Formations robot by robot: where each may be as seen from those already placed, the best few of all combinations.

use super::formation::{Descent, Poses};
use super::{FORMATIONS_MAX, Team};
use crate::ranging::pose::{RelativePose, turned, wrapped};
use crate::ranging::trail::Past;
use crate::ranging::window::{Starts, WINDOW_MIN, Window, WindowSettings};
use nalgebra::Vector3;

/// Candidates that are refined for every formation that is kept.
const REFINED_PER_KEPT: usize = 2;

/// The formations that the ranges lead to, best first.
pub(super) fn formations(team: &Team, settings: &WindowSettings) -> Vec<Poses> {
    let count = team.now.len();
    let modes = pair_modes(team, settings);
    let mut origin = vec![None; count];
    if let Some(own) = origin.first_mut() {
        *own = Some(RelativePose::new(Vector3::zeros(), 0.0));
    }
    let mut kept: Vec<Poses> = vec![origin];
    let mut descent = Descent::new(team, settings);
    let mut placed = vec![0];
    while let Some(next) = most_heard(team, &placed) {
        let candidates = seen(&kept, &placed, next, &modes);
        let best = best(candidates, &mut descent);
        if !best.is_empty() {
            kept = best;
        }
        placed.push(next);
    }
    // Of two that are far from where the other's ranges alone put them no formation has begun well: everyone is tried once
    // more from all the others. Without a third there is nothing new to see.
    if placed.len() > 2 {
        for again in placed.iter().skip(1).copied() {
            let others: Vec<usize> = placed.iter().copied().filter(|one| *one != again).collect();
            let mut candidates = seen(&kept, &others, again, &modes);
            candidates.append(&mut kept);
            kept = best(candidates, &mut descent);
        }
    }
    kept
}

/// The formations with one robot where any of the others sees it.
fn seen(
    formations: &[Poses],
    others: &[usize],
    robot: usize,
    modes: &[Vec<Vec<RelativePose>>],
) -> Vec<Poses> {
    let mut candidates = Vec::new();
    for formation in formations {
        for from in others {
            let Some(start) = formation[*from] else {
                continue;
            };
            for mode in &modes[*from][robot] {
                let mut candidate = formation.clone();
                candidate[robot] = Some(composed(&start, mode));
                candidates.push(candidate);
            }
        }
    }
    candidates
}

/// The best few of them that differ, refined, best first.
fn best(candidates: Vec<Poses>, descent: &mut Descent<'_>) -> Vec<Poses> {
    let cost = |candidate: Poses| (descent.cost(&candidate), candidate);
    let mut candidates: Vec<(f64, Poses)> = candidates.into_iter().map(cost).collect();
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
    candidates.truncate(REFINED_PER_KEPT * FORMATIONS_MAX);
    for (cost, candidate) in &mut candidates {
        *cost = descent.refine(candidate);
    }
    candidates.retain(|one| one.0.is_finite());
    candidates.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut distinct: Vec<Poses> = Vec::new();
    for (_, candidate) in candidates {
        if distinct.len() < FORMATIONS_MAX && !distinct.iter().any(|one| is_same(one, &candidate)) {
            distinct.push(candidate);
        }
    }
    distinct
}

/// By pair, in both directions, where the second may be now as the first sees it.
fn pair_modes(team: &Team, settings: &WindowSettings) -> Vec<Vec<Vec<RelativePose>>> {
    let count = team.now.len();
    let mut modes = vec![vec![Vec::new(); count]; count];
    let pairs = (1..count).flat_map(|high| (0..high).map(move |low| (low, high)));
    for (low, high) in pairs {
        let mut window = Window::new();
        for sample in team.pair(low, high) {
            // All were checked when they were taken.
            let _ = window.push(sample);
        }
        let Some(newest) = window.newest().copied() else {
            continue;
        };
        let own = Past::of(&newest.own, &team.now[low]);
        let neighbour = Past::of(&newest.neighbour, &team.now[high]);
        for mode in window.solve(settings, Starts::Exhaustive, None).as_slice() {
            let now = own.carried(&neighbour, &mode.pose);
            modes[low][high].push(now);
            modes[high][low].push(now.inverse());
        }
    }
    modes
}

/// Of the robots not yet placed, the one with most ranges to those that are.
fn most_heard(team: &Team, placed: &[usize]) -> Option<usize> {
    let heard = |robot: usize| -> usize {
        let pairs = placed
            .iter()
            .map(|other| team.pair(robot.min(*other), robot.max(*other)));
        pairs
            .filter(|pair| pair.len() >= WINDOW_MIN)
            .map(<[_]>::len)
            .sum()
    };
    let others = (0..team.now.len()).filter(|robot| !placed.contains(robot));
    others
        .filter(|robot| heard(*robot) > 0)
        .max_by_key(|robot| (heard(*robot), usize::MAX - robot))
}

/// A pose seen from one that is seen itself.
fn composed(first: &RelativePose, second: &RelativePose) -> RelativePose {
    RelativePose::new(
        first.position_m + turned(&second.position_m, first.yaw_rad),
        first.yaw_rad + second.yaw_rad,
    )
}

/// Whether every robot is at the same place in both (to 0.2 m and 0.05 rad).
pub(super) fn is_same(a: &Poses, b: &Poses) -> bool {
    a.iter().zip(b).all(|(a, b)| match (a, b) {
        (Some(a), Some(b)) => is_same_place(a, b),
        (None, None) => true,
        _ => false,
    })
}

/// Whether two places are one.
pub(super) fn is_same_place(a: &RelativePose, b: &RelativePose) -> bool {
    (a.position_m - b.position_m).norm() < 0.2 && wrapped(a.yaw_rad - b.yaw_rad).abs() < 0.05
}
