//! A robot that does not know where it starts joins a located team by distances alone: when, and how far off it is then,
//! beside the same robot told its start. Production vehicles and codec, in virtual time.

use crate::evaluation::{covariance_of, planar_nees};
use crate::fleet::Fleet;
use crate::plot::{ErrorCurve, ErrorPoint, PlotError, error_curves};
use crate::scenario::{Scenario, Start};
use crate::statistics::mean_and_stderr;
use rayon::prelude::*;
use serde::Serialize;
use skein_proto::status::Status;
use std::fmt::Write;

/// Who joins: the last of the scenario `ranges`.
const JOINING: usize = 3;
/// What comes before is not scored (s).
const SCORED_FROM_S: f64 = 30.0;

/// How the joining robot knows where it starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Known {
    /// Not at all: by distances.
    ByDistances,
    /// It was told, as the others are.
    Told,
}

/// Both, in the order of the table.
pub const KNOWN: [Known; 2] = [Known::ByDistances, Known::Told];

impl Known {
    /// What the table calls it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ByDistances => "found by distances",
            Self::Told => "told",
        }
    }
}

/// How all flights went: one object of the JSON output. A flight is a draw.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JoiningResult {
    /// How it knew its start.
    pub known: Known,
    /// Flights.
    pub samples: u64,
    /// Seed of the scenario.
    pub seed: u64,
    /// Flights in which it had a pose at all.
    pub placed: usize,
    /// When it had one, in the middle flight (s).
    pub placed_median_s: Option<f64>,
    /// In the last one (s).
    pub placed_max_s: Option<f64>,
    /// RMSE of its position in the common frame from 30 s on (m).
    pub rmse_m: f64,
    /// Standard error of its square's mean, carried over to the root (m).
    pub rmse_stderr_m: f64,
    /// The same of the three others.
    pub others_rmse_m: f64,
    /// NEES of its pose from 30 s on, a degree of freedom.
    pub nees: f64,
    /// Its standard error.
    pub nees_stderr: f64,
    /// Mean of the position error and its standard deviation over the flights, from second to second.
    #[serde(skip)]
    pub over_time: Vec<ErrorPoint>,
}

/// One flight.
struct Flown {
    placed_s: Option<f64>,
    /// Mean squares (m^2), and NEES.
    square_m2: f64,
    others_m2: f64,
    nees: f64,
    /// At every full second (m); none without a pose.
    error_m: Vec<Option<f64>>,
}

/// Flies so many samples. `flown` is called after each, from any thread.
#[must_use]
pub fn run(known: Known, samples: u64, seed: u64, flown: impl Fn() + Sync) -> JoiningResult {
    let mut scenario = Scenario::built_in("ranges").expect("built in");
    scenario.seed = seed;
    if known == Known::Told {
        for vehicle in scenario.team.vehicles_mut() {
            vehicle.start = Start::Pose;
        }
    }
    let flights: Vec<Flown> = (0..samples)
        .into_par_iter()
        .map(|sample| {
            let flight = fly(&scenario, sample);
            flown();
            flight
        })
        .collect();
    let of = |value: fn(&Flown) -> f64| mean_and_stderr(flights.iter().map(value));
    let (square_m2, square_stderr_m2) = of(|flight| flight.square_m2);
    let (nees, nees_stderr) = of(|flight| flight.nees);
    let mut placed: Vec<f64> = flights
        .iter()
        .filter_map(|flight| flight.placed_s)
        .collect();
    placed.sort_by(f64::total_cmp);
    let seconds = flights.iter().map(|flight| flight.error_m.len()).min();
    JoiningResult {
        known,
        samples,
        seed,
        placed: placed.len(),
        placed_median_s: placed.get(placed.len() / 2).copied(),
        placed_max_s: placed.last().copied(),
        rmse_m: square_m2.sqrt(),
        rmse_stderr_m: square_stderr_m2 / (2.0 * square_m2.sqrt()),
        others_rmse_m: of(|flight| flight.others_m2).0.sqrt(),
        nees,
        nees_stderr,
        over_time: (0..seconds.unwrap_or(0))
            .filter_map(|second| at(&flights, second))
            .collect(),
    }
}

/// The error at one second over the flights; none while one of them has no pose.
fn at(flights: &[Flown], second: usize) -> Option<ErrorPoint> {
    let errors: Option<Vec<f64>> = flights
        .iter()
        .map(|flight| flight.error_m[second])
        .collect();
    let errors = errors?;
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let variance = errors
        .iter()
        .map(|error| (error - mean).powi(2))
        .sum::<f64>();
    Some(ErrorPoint {
        time_s: (second + 1) as f64,
        mean_norm_m: mean,
        std_m: (variance / errors.len() as f64).sqrt(),
    })
}

fn fly(scenario: &Scenario, sample: u64) -> Flown {
    /// Looks a second: each round is seen.
    const LOOKS: i64 = 10;
    let mut fleet = Fleet::new(scenario, sample);
    let mut flown = Flown {
        placed_s: None,
        square_m2: 0.0,
        others_m2: 0.0,
        nees: 0.0,
        error_m: Vec::new(),
    };
    let (mut scored, mut others, mut weighed) = (0_u32, 0_u32, 0_u32);
    for look in 1..=(scenario.duration_s * LOOKS as f64) as i64 {
        fleet.run_until(look * 1_000_000_000 / LOOKS);
        let now_s = look as f64 / LOOKS as f64;
        let poses = fleet.scored(JOINING);
        let tracks = fleet
            .estimate(JOINING)
            .is_some_and(|estimate| estimate.status == Status::Tracking);
        if flown.placed_s.is_none() && poses.is_some() && tracks {
            flown.placed_s = Some(now_s);
        }
        let error_m = poses.map(|(truth, estimate)| {
            (truth.translation.vector - estimate.translation.vector).norm()
        });
        if look % LOOKS == 0 {
            flown.error_m.push(error_m);
        }
        if now_s <= SCORED_FROM_S {
            continue;
        }
        if let (Some((truth, pose)), Some(error_m)) = (poses, error_m) {
            flown.square_m2 += error_m * error_m;
            scored += 1;
            let covariance = fleet
                .estimate(JOINING)
                .and_then(|told| told.covariance.as_ref());
            let nees = covariance
                .and_then(covariance_of)
                .and_then(|covariance| planar_nees(&pose, &covariance, &truth));
            if let Some(nees) = nees {
                flown.nees += nees;
                weighed += 1;
            }
        }
        for other in (0..fleet.len()).filter(|other| *other != JOINING) {
            flown.others_m2 += fleet.position_error_m(other).powi(2);
            others += 1;
        }
    }
    flown.square_m2 /= f64::from(scored);
    flown.others_m2 /= f64::from(others);
    flown.nees /= f64::from(weighed);
    flown
}

/// The table of the terminal.
#[must_use]
pub fn table(results: &[JoiningResult]) -> String {
    let mut text = String::from(
        "the fourth robot's start  placed   after s (median, last)   RMSE from 30 s, m   of the others, m   NEES\n",
    );
    let seconds = |s: Option<f64>| s.map_or_else(|| "-".to_owned(), |s| format!("{s:.1}"));
    for result in results {
        let _ = writeln!(
            text,
            "{:<22} {:>6} of {:<4} {:>12} {:>8} {:>14.3} +- {:.3} {:>16.3} {:>9.2} +- {:.2}",
            result.known.name(),
            result.placed,
            result.samples,
            seconds(result.placed_median_s),
            seconds(result.placed_max_s),
            result.rmse_m,
            result.rmse_stderr_m,
            result.others_rmse_m,
            result.nees,
            result.nees_stderr,
        );
    }
    text
}

/// One line a way to know the start.
#[must_use]
pub fn csv(results: &[JoiningResult]) -> String {
    let mut text = String::from(
        "known,samples,seed,placed,placed_median_s,placed_max_s,rmse_m,rmse_stderr_m,others_rmse_m,nees,nees_stderr\n",
    );
    let number = |number: Option<f64>| number.map_or_else(String::new, |number| number.to_string());
    for result in results {
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{}",
            result.known.name(),
            result.samples,
            result.seed,
            result.placed,
            number(result.placed_median_s),
            number(result.placed_max_s),
            result.rmse_m,
            result.rmse_stderr_m,
            result.others_rmse_m,
            result.nees,
            result.nees_stderr,
        );
    }
    text
}

/// Error against time, from the second on in which all flights have a pose.
///
/// # Errors
/// When there is nothing to draw.
pub fn figure(results: &[JoiningResult]) -> Result<String, PlotError> {
    let curve = |result: &JoiningResult| ErrorCurve {
        label: format!("start {}", result.known.name()),
        points: result.over_time.clone(),
    };
    let curves: Vec<ErrorCurve> = results.iter().map(curve).collect();
    error_curves(
        "A robot that joins three others by distances alone",
        &curves,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_is_told_its_start_has_a_pose_at_once_and_whoever_finds_it_soon() {
        let [found, told] = KNOWN.map(|known| run(known, 3, 1, || {}));
        assert!(
            told.placed == 3 && told.placed_max_s < Some(1.0),
            "{told:?}"
        );
        assert!(found.placed == 3, "{found:?}");
        let median_s = found.placed_median_s.unwrap();
        assert!((3.0..12.0).contains(&median_s), "{median_s} s");
        assert!(
            found.rmse_m < 1.2 && told.rmse_m < 0.6,
            "{found:?} {told:?}"
        );
        assert!((0.3..3.0).contains(&told.nees), "{told:?}");
        assert_eq!(table(std::slice::from_ref(&found)).lines().count(), 2);
        assert!(figure(&[found, told]).unwrap().contains("start told"));
    }
}
