//! Real distances between robots, with their odometry, replayed: each robot follows each other from nothing, by distances
//! and both odometries, with what the daemon follows a neighbour with, and is scored against the truth.

use super::following::{Shares, Spread, Told, Truth};
use super::reckoning;
use crate::pyfg::{FactorGraph, Key, RangeEdge};
use crate::streams::{Purpose, Streams};
use crate::truth::{relative_position_m, wrapped_rad, yaw_rad};
use nalgebra::Vector3;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use serde::Serialize;
use skein_estimation::ranging::neighbour::NeighbourSettings;
use skein_estimation::ranging::{LevelOdometry, Neighbour, RangeSample};
use skein_estimation::time::{Span, Stamp};
use std::collections::BTreeMap;
use std::fmt::Write;

/// Converged is who is nearer than this, in position (m) and heading (rad), for so long (s).
const CONVERGED: (f64, f64, f64) = (0.5, 0.2, 5.0);

/// The recordings at hand state more noise of odometry than it has (1 cm and 5 mrad a step of 50 ms): this share of it is
/// believed. Over 1 to 5 s odometry is off by 0.2 to 0.4 of what it states, over a minute by 0.1.
const STATED_SHARE: f64 = 0.3;

/// Where truth and odometry turn so differently in a step (rad), motion capture took a robot for turned, and for so long
/// (s) before and after it is not believed.
const TORN: (f64, f64) = (0.3, 1.0);

/// What is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Request {
    /// Noise that is added to every step of odometry, in standard deviations that the recording states for it.
    pub added_sigmas: f64,
    /// Its seed.
    pub seed: u64,
}

/// How one robot followed another: one object of the JSON output.
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
    /// Distances that were refused, for want of odometry or by what follows.
    pub refused: usize,
    /// Distances that fitted no place.
    pub unexplained: u64,
    /// How often all places were given up.
    pub refuted: u64,
    /// After how long a place was told for the first time, counted from the first distance (s).
    pub told_s: Option<f64>,
    /// After how long what was told stayed within 0.5 m and 0.2 rad for 5 s, counted from the first distance (s).
    pub converged_s: Option<f64>,
    /// Position errors told afterwards (m).
    pub position_m: Spread,
    /// Heading errors told afterwards (rad).
    pub heading_rad: Spread,
    /// The greatest position error told at any time (m).
    pub worst_m: f64,
    /// Squared errors of position and heading over their covariance per dimension, told at any time.
    pub nees: Spread,
    /// What was told, of all distances.
    pub told: Shares,
}

/// A recording, and what follows of it before anybody is followed.
struct Recording<'a> {
    graph: &'a FactorGraph,
    reckoned: BTreeMap<Key, LevelOdometry>,
    /// When the truth of which robot was torn (s).
    torn: Vec<(char, f64)>,
}

/// Replays every ordered pair of robots that measured each other. None when the recording is not planar.
#[must_use]
pub fn replay(graph: &FactorGraph, request: Request) -> Option<Vec<PairResult>> {
    if graph.is_spatial {
        return None;
    }
    let recording = Recording {
        graph,
        reckoned: reckon(graph, request),
        torn: torn(graph),
    };
    let robots = graph.robots();
    let pairs = robots.iter().flat_map(|observer| {
        let others = robots.iter().filter(move |robot| *robot != observer);
        others.map(move |robot| (*observer, *robot))
    });
    let results =
        pairs.filter_map(|(observer, robot)| recording.pair(observer, robot, request.added_sigmas));
    Some(results.collect())
}

/// Odometry from each robot's first pose on.
fn reckon(graph: &FactorGraph, request: Request) -> BTreeMap<Key, LevelOdometry> {
    let streams = Streams::new(request.seed, 0);
    let mut rngs: BTreeMap<char, ChaCha8Rng> = BTreeMap::new();
    let mut reckoned: BTreeMap<Key, LevelOdometry> = BTreeMap::new();
    let believed = STATED_SHARE.hypot(request.added_sigmas);
    for step in &graph.odometry {
        let robot = step.from.robot;
        let stream = || streams.vehicle(robot as usize, Purpose::Odometry);
        let rng = rngs.entry(robot).or_insert_with(stream);
        let (sigma_m, sigma_rad) = (
            step.translation_variance_m2.sqrt(),
            step.rotation_variance_rad2.sqrt(),
        );
        let mut gauss = |sigma: f64| {
            let one: f64 = StandardNormal.sample(rng);
            request.added_sigmas * sigma * one
        };
        let off_m = Vector3::new(gauss(sigma_m), gauss(sigma_m), 0.0);
        let moved_m = step.motion.translation.vector + off_m;
        let turned_rad = yaw_rad(&step.motion) + gauss(sigma_rad);
        let from = *reckoned.entry(step.from).or_insert_with(reckoning::begun);
        let sigmas = (believed * sigma_rad, believed * sigma_m);
        reckoned.insert(
            step.to,
            reckoning::after(&from, &moved_m, turned_rad, sigmas),
        );
    }
    reckoned
}

/// When (s since the first distance), and what was told.
type Moment = (f64, Told);

impl Recording<'_> {
    fn pair(&self, observer: char, robot: char, added_sigmas: f64) -> Option<PairResult> {
        let mut follower = Neighbour::new(NeighbourSettings::PLANAR);
        let mut begun_s = None;
        let (mut ranges, mut refused) = (0, 0);
        let mut moments: Vec<Moment> = Vec::new();
        for range in &self.graph.ranges {
            let keys = match (range.from.robot, range.to.robot) {
                (from, to) if (from, to) == (observer, robot) => [range.from, range.to],
                (from, to) if (to, from) == (observer, robot) => [range.to, range.from],
                _ => continue,
            };
            ranges += 1;
            let taken = self
                .sample(range, keys)
                .is_some_and(|sample| follower.handle(&sample).is_ok());
            if !taken {
                refused += 1;
                continue;
            }
            let begun_s = *begun_s.get_or_insert(range.time_s);
            if let Some(truth) = self.truth(keys) {
                let told = Told::of(&follower.estimate(), &truth, follower.dimension());
                moments.push((range.time_s - begun_s, told));
            }
        }
        if ranges == 0 {
            return None;
        }
        let converged_s = converged(&moments);
        let offs = || {
            let told = moments.iter();
            told.filter_map(|(time_s, told)| Some((*time_s, told.off()?)))
        };
        let after =
            || offs().filter(|(time_s, _)| converged_s.is_some_and(|since| *time_s >= since));
        Some(PairResult {
            observer,
            robot,
            added_sigmas,
            ranges,
            refused,
            unexplained: follower.counters().unexplained,
            refuted: follower.counters().refuted,
            told_s: offs().next().map(|(time_s, _)| time_s),
            converged_s,
            position_m: Spread::of(after().map(|(_, off)| off.position_m)),
            heading_rad: Spread::of(after().map(|(_, off)| off.yaw_rad)),
            worst_m: offs().fold(0.0, |worst, (_, off)| off.position_m.max(worst)),
            nees: Spread::of(offs().map(|(_, off)| off.nees)),
            told: Shares::of(moments.iter().map(|(_, told)| told)),
        })
    }

    /// A distance with where both were by their odometry. None when one of them has none.
    fn sample(&self, range: &RangeEdge, [own, neighbour]: [Key; 2]) -> Option<RangeSample> {
        Some(RangeSample {
            taken: Stamp::default() + Span::from_secs_f64(range.time_s),
            range_m: range.range_m,
            sigma_m: range.variance_m2.sqrt(),
            own: *self.reckoned.get(&own)?,
            neighbour: *self.reckoned.get(&neighbour)?,
        })
    }

    fn truth(&self, keys: [Key; 2]) -> Option<Truth> {
        let sound = |key: &Key| {
            let vertex = self.graph.vertices.get(key)?;
            let mut torn = self.torn.iter();
            let is_torn = torn.any(|(robot, time_s)| {
                *robot == key.robot && (vertex.time_s - time_s).abs() <= TORN.1
            });
            (!is_torn).then_some(vertex)
        };
        let [Some(own), Some(neighbour)] = keys.map(|key| sound(&key)) else {
            return None;
        };
        Some(Truth {
            position_m: relative_position_m(&own.pose, &neighbour.pose),
            yaw_rad: yaw_rad(&neighbour.pose) - yaw_rad(&own.pose),
        })
    }
}

/// When the truth of which robot was torn (s).
fn torn(graph: &FactorGraph) -> Vec<(char, f64)> {
    let torn = graph.odometry.iter().filter_map(|step| {
        let [from, to] = [step.from, step.to].map(|key| graph.vertices.get(&key));
        let (from, to) = (from?, to?);
        let truth_rad = yaw_rad(&to.pose) - yaw_rad(&from.pose);
        let off_rad = wrapped_rad(truth_rad - yaw_rad(&step.motion));
        (off_rad.abs() > TORN.0).then_some((step.to.robot, to.time_s))
    });
    torn.collect()
}

/// When it begins (s) that everything told is good, for long enough.
fn converged(moments: &[Moment]) -> Option<f64> {
    let (near_m, near_rad, long_s) = CONVERGED;
    let mut first_s = None;
    for (time_s, told) in moments {
        let Some(off) = told.off() else { continue };
        if off.position_m > near_m || off.yaw_rad > near_rad {
            first_s = None;
            continue;
        }
        let since_s = *first_s.get_or_insert(*time_s);
        if time_s - since_s >= long_s {
            return Some(since_s);
        }
    }
    None
}

/// The results as people read them.
#[must_use]
pub fn table(results: &[PairResult]) -> String {
    let mut text = String::from(
        "        added  distances    after s:       afterwards, RMSE (median)          ever: NEES       told, % of distances: a\n\
         pair    noise  (refused)    told  close  position m     heading rad      worst m  mean (median)  place  imprecise  several  none  given up\n",
    );
    let seconds =
        |time_s: Option<f64>| time_s.map_or_else(|| "never".to_owned(), |s| format!("{s:.1}"));
    for one in results {
        let share = |share: f64| format!("{:.1}", 100.0 * share);
        let _ = writeln!(
            text,
            "{} of {} {:>5.1}x {:>7} ({}) {:>6} {:>6}  {:.3} ({:.3})  {:.3} ({:.3}) {:>9.2} {:>7.2} ({:.2}) {:>8} {:>9} {:>8} {:>6} {:>5}",
            one.robot,
            one.observer,
            one.added_sigmas,
            one.ranges,
            one.refused,
            seconds(one.told_s),
            seconds(one.converged_s),
            one.position_m.rms,
            one.position_m.median,
            one.heading_rad.rms,
            one.heading_rad.median,
            one.worst_m,
            one.nees.mean,
            one.nees.median,
            share(one.told.place),
            share(one.told.imprecise),
            share(one.told.ambiguous),
            share(one.told.nothing),
            one.refuted,
        );
    }
    text
}

/// One row a pair.
#[must_use]
pub fn csv(results: &[PairResult]) -> String {
    let mut text = String::from(
        "observer,robot,added_sigmas,ranges,refused,unexplained,refuted,told_s,converged_s,position_rmse_m,\
         position_median_m,heading_rmse_rad,heading_median_rad,worst_m,nees_mean,nees_median,place,imprecise,ambiguous,\
         nothing\n",
    );
    let seconds = |time_s: Option<f64>| time_s.map_or_else(String::new, |s| s.to_string());
    for one in results {
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{},{}",
            one.observer,
            one.robot,
            one.added_sigmas,
            one.ranges,
            one.refused,
            one.unexplained,
            one.refuted,
            seconds(one.told_s),
            seconds(one.converged_s),
            one.position_m.rms,
            one.position_m.median,
            one.heading_rad.rms,
            one.heading_rad.median,
            one.worst_m,
            one.nees.mean,
            one.nees.median,
            one.told.place,
            one.told.imprecise,
            one.told.ambiguous,
            one.told.nothing,
        );
    }
    text
}

#[cfg(test)]
mod tests;
