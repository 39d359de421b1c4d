//! Real distances between robots, with their odometry, replayed: each robot localises each other from nothing, by
//! distances and both odometries, and is scored against the truth.

use super::trilateration::error;
use crate::planar_swarm::PlanarPose;
use crate::pyfg::{FactorGraph, Key};
use crate::streams::{Purpose, Streams};
use crate::truth::{Pose, yaw_rad};
use nalgebra::{Rotation2, Vector2};
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;
use skein_estimation::ranging::trilateration::{Bank, Noise, PairMotion, Turtle};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Converged is who is nearer than this, in position (m) and heading (rad), for so long (s).
const CONVERGED: (f64, f64, f64) = (0.5, 0.2, 5.0);

/// The recordings at hand state far more noise of odometry than it has (1 cm a step of 50 ms, where 30 m end within
/// 18 cm): this share of it is believed.
const STATED_SHARE: f64 = 0.1;

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    /// Noise that is added to every step of odometry, in standard deviations that the recording states for it.
    pub added_sigmas: f64,
    /// Its seed.
    pub seed: u64,
}

/// How one robot localised another: one object of the JSON output.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PairResult {
    /// Who.
    pub observer: char,
    /// Whom.
    pub robot: char,
    /// Standard deviations of noise that were added to odometry.
    pub added_sigmas: f64,
    /// Distances.
    pub ranges: usize,
    /// Distances that were refused, or older than one before.
    pub refused: usize,
    /// After how long it stayed within 0.5 m and 0.2 rad for 5 s, counted from the first distance (s).
    pub converged_s: Option<f64>,
    /// Afterwards: root of the mean squared position error (m).
    pub position_rmse_m: f64,
    /// Afterwards: median position error (m).
    pub position_median_m: f64,
    /// Afterwards: root of the mean squared heading error (rad).
    pub heading_rmse_rad: f64,
    /// Afterwards: median heading error (rad).
    pub heading_median_rad: f64,
}

/// Where odometry has a robot, and what it states of its noise so far.
#[derive(Clone, Copy)]
struct Reckoned {
    position_m: Vector2<f64>,
    heading_rad: f64,
    translation_variance_m2: f64,
    rotation_variance_rad2: f64,
}

/// Replays every ordered pair of robots that measured each other. None when the recording is not planar.
#[must_use]
pub fn replay(graph: &FactorGraph, request: Request) -> Option<Vec<PairResult>> {
    if graph.is_spatial {
        return None;
    }
    let reckoned = reckon(graph, request);
    let robots = graph.robots();
    let pairs = robots.iter().flat_map(|observer| {
        let others = robots.iter().filter(move |robot| *robot != observer);
        others.map(move |robot| (*observer, *robot))
    });
    let results = pairs.filter_map(|(observer, robot)| {
        pair(graph, &reckoned, observer, robot, request.added_sigmas)
    });
    Some(results.collect())
}

/// Odometry from each robot's first pose on.
fn reckon(graph: &FactorGraph, request: Request) -> BTreeMap<Key, Reckoned> {
    let streams = Streams::new(request.seed, 0);
    let mut rngs: BTreeMap<char, ChaCha8Rng> = BTreeMap::new();
    let mut reckoned: BTreeMap<Key, Reckoned> = BTreeMap::new();
    for step in &graph.odometry {
        let robot = step.from.robot;
        let stream = || streams.vehicle(robot as usize, Purpose::Odometry);
        let rng = rngs.entry(robot).or_insert_with(stream);
        let mut gauss = |variance: f64| {
            let one: f64 = StandardNormal.sample(rng);
            request.added_sigmas * variance.sqrt() * one
        };
        let from = *reckoned.entry(step.from).or_insert(Reckoned {
            position_m: Vector2::zeros(),
            heading_rad: 0.0,
            translation_variance_m2: 0.0,
            rotation_variance_rad2: 0.0,
        });
        let off_m = Vector2::from_fn(|_, _| gauss(step.translation_variance_m2));
        let moved_m = step.motion.translation.vector.xy() + off_m;
        let turned_rad = yaw_rad(&step.motion) + gauss(step.rotation_variance_rad2);
        reckoned.insert(
            step.to,
            Reckoned {
                position_m: from.position_m + Rotation2::new(from.heading_rad) * moved_m,
                heading_rad: from.heading_rad + turned_rad,
                translation_variance_m2: from.translation_variance_m2
                    + step.translation_variance_m2,
                rotation_variance_rad2: from.rotation_variance_rad2 + step.rotation_variance_rad2,
            },
        );
    }
    reckoned
}

/// Time since the first distance (s), position error (m) and heading error (rad).
type Moment = (f64, f64, f64);

fn pair(
    graph: &FactorGraph,
    reckoned: &BTreeMap<Key, Reckoned>,
    observer: char,
    robot: char,
    added_sigmas: f64,
) -> Option<PairResult> {
    let mut bank: Option<(Bank, [Key; 2])> = None;
    let mut begun_s = 0.0;
    let (mut ranges, mut refused) = (0, 0);
    let mut moments: Vec<Moment> = Vec::new();
    for range in &graph.ranges {
        let keys = match (range.from.robot, range.to.robot) {
            (from, to) if (from, to) == (observer, robot) => [range.from, range.to],
            (from, to) if (to, from) == (observer, robot) => [range.to, range.from],
            _ => continue,
        };
        ranges += 1;
        let now = keys.map(|key| reckoned.get(&key));
        let [Some(own), Some(theirs)] = now else {
            refused += 1;
            continue;
        };
        let Some((filter, before)) = &mut bank else {
            let noise = noise(0.0, 0.0, range.variance_m2);
            begun_s = range.time_s;
            bank = Bank::new(range.range_m, &noise)
                .ok()
                .map(|bank| (bank, keys));
            continue;
        };
        let then = before.map(|key| reckoned[&key]);
        if keys[0] < before[0] || keys[1] < before[1] {
            refused += 1;
            continue;
        }
        let motion = PairMotion {
            own: between(&then[0], own),
            theirs: between(&then[1], theirs),
        };
        // One noise for both: the mean of theirs.
        let grown =
            |of: fn(&Reckoned) -> f64| 0.5 * (of(own) - of(&then[0]) + of(theirs) - of(&then[1]));
        let by = STATED_SHARE.powi(2) + added_sigmas.powi(2);
        let noise = noise(
            by * grown(|one| one.translation_variance_m2),
            by * grown(|one| one.rotation_variance_rad2),
            range.variance_m2,
        );
        if filter.update(&motion, Some(range.range_m), &noise).is_err() {
            refused += 1;
            continue;
        }
        *before = keys;
        let truth = keys.map(|key| graph.vertices.get(&key));
        if let (Some(mode), [Some(own), Some(theirs)]) = (filter.estimate(), truth) {
            let truth = planar(&theirs.pose).seen_from(&planar(&own.pose));
            let (off_m, off_rad) = error(&mode.at, &truth);
            moments.push((range.time_s - begun_s, off_m, off_rad));
        }
    }
    if ranges == 0 {
        return None;
    }
    let converged = converged(&moments);
    let after = &moments[converged.unwrap_or(moments.len())..];
    let position = spread(after.iter().map(|moment| moment.1));
    let heading = spread(after.iter().map(|moment| moment.2));
    Some(PairResult {
        observer,
        robot,
        added_sigmas,
        ranges,
        refused,
        converged_s: converged.map(|index| moments[index].0),
        position_rmse_m: position.0,
        position_median_m: position.1,
        heading_rmse_rad: heading.0,
        heading_median_rad: heading.1,
    })
}

/// The first moment of those that are good for long enough.
fn converged(moments: &[Moment]) -> Option<usize> {
    let (near_m, near_rad, long_s) = CONVERGED;
    let mut first = None;
    for (index, (time_s, off_m, off_rad)) in moments.iter().enumerate() {
        if *off_m > near_m || *off_rad > near_rad {
            first = None;
            continue;
        }
        let since = *first.get_or_insert(index);
        if time_s - moments[since].0 >= long_s {
            return Some(since);
        }
    }
    None
}

fn noise(translation_m2: f64, rotation_rad2: f64, range_m2: f64) -> Noise {
    Noise {
        range_sigma_m: range_m2.max(0.0).sqrt(),
        translation_sigma_m: translation_m2.max(0.0).sqrt(),
        rotation_sigma_rad: rotation_rad2.max(0.0).sqrt(),
    }
}

fn between(before: &Reckoned, now: &Reckoned) -> Turtle {
    Turtle {
        translation_m: Rotation2::new(-before.heading_rad) * (now.position_m - before.position_m),
        rotation_rad: now.heading_rad - before.heading_rad,
    }
}

fn planar(pose: &Pose) -> PlanarPose {
    PlanarPose {
        position_m: pose.translation.vector.xy(),
        heading_rad: yaw_rad(pose),
    }
}

/// Root of the mean square, and median; NaN of nothing.
fn spread(errors: impl Iterator<Item = f64>) -> (f64, f64) {
    let mut all: Vec<f64> = errors.collect();
    all.sort_by(f64::total_cmp);
    let squares = all.iter().map(|one| one.powi(2)).sum::<f64>() / all.len() as f64;
    let median = all.get(all.len() / 2).copied().unwrap_or(f64::NAN);
    (squares.sqrt(), median)
}

/// The results as people read them.
#[must_use]
pub fn table(results: &[PairResult]) -> String {
    let mut text = String::from(
        "pair   added noise  distances (refused)  converged after s   position m RMSE, median   heading rad RMSE, median\n",
    );
    for one in results {
        let converged = one.converged_s;
        let _ = writeln!(
            text,
            "{} of {} {:>10.1}x {:>9} ({:>4}) {:>20} {:>14.3} {:>9.3} {:>15.3} {:>9.3}",
            one.robot,
            one.observer,
            one.added_sigmas,
            one.ranges,
            one.refused,
            converged.map_or_else(|| "never".to_owned(), |s| format!("{s:.1}")),
            one.position_rmse_m,
            one.position_median_m,
            one.heading_rmse_rad,
            one.heading_median_rad,
        );
    }
    text
}

/// One row a pair.
#[must_use]
pub fn csv(results: &[PairResult]) -> String {
    let mut text = String::from(
        "observer,robot,added_sigmas,ranges,refused,converged_s,position_rmse_m,position_median_m,heading_rmse_rad,\
         heading_median_rad\n",
    );
    for one in results {
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{}",
            one.observer,
            one.robot,
            one.added_sigmas,
            one.ranges,
            one.refused,
            one.converged_s.map_or_else(String::new, |s| s.to_string()),
            one.position_rmse_m,
            one.position_median_m,
            one.heading_rmse_rad,
            one.heading_median_rad,
        );
    }
    text
}

#[cfg(test)]
mod tests;
