//! Whether an estimate is as good as it can be and as good as it says: error over the bound of a batch, and NEES.
//!
//! A [`cell`] makes a [`history`] of raw information and lets go wrong what does ([`mistakes`], [`odometer`]); [`hearing`]
//! says who hears what. The team estimator flies it ([`flight`]), so do the production vehicles in the older modes
//! ([`playback`]), and the [`bound`] is what a batch makes of the same with an oracle's help.

pub mod bound;
pub mod cell;
pub mod chi_square;
pub mod fixes;
pub mod flight;
pub mod hearing;
pub mod history;
pub mod mistakes;
pub mod odometer;
pub mod playback;
pub mod report;

use self::bound::Bound;
use self::cell::{Case, Cell};
use self::flight::{Flight, Heard};
use self::hearing::Hearing;
use self::history::History;
use self::playback::Playback;
use super::modes::{ratio_of_root_means, root_mean};
use super::solver_only::NotBare;
use crate::fleet::Fleet;
use crate::radio::Radio;
use crate::world::{World, nanos};
use nalgebra::Matrix6;
use rayon::prelude::*;
use serde::Serialize;
use skein_estimation::cooperative::team::{NoiseScales, Settings};
use skein_estimation::cooperative::{Mode, Refusal, Robust};
use skein_estimation::time::Span;
use skein_estimation::{Body, Transform, World as WorldFrame, se3};

/// Where the estimators of a flight differ, so many of them are flown at most, of vehicles at equal intervals...
const ESTIMATORS_MAX: usize = 5;
/// ...and so many that they follow no more vehicles than this altogether, but at least one.
const FOLLOWED_MAX: usize = 30;
/// Numbers of a pose.
const DEGREES_OF_FREEDOM: usize = 6;

/// Who estimates.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// Production vehicles in mode `paper`.
    Paper,
    /// Production vehicles in mode `star` as it is.
    Star,
    /// The team estimator with its default settings.
    Team,
    /// The batch: the bound itself.
    Batch,
}

/// What is asked for.
#[derive(Clone, Copy)]
pub struct Request<'a> {
    /// Samples a cell.
    pub samples: u64,
    /// Seed of all random streams. Every method flies the same samples.
    pub seed: u64,
    /// Rounds of every cell; each cell's own when not given.
    pub rounds: Option<usize>,
    /// A clock in seconds, for the time that a round takes.
    pub clock_s: &'a (dyn Fn() -> f64 + Sync),
}

/// The result of one cell: one object of the JSON output.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CellResult {
    /// Its name.
    pub cell: &'static str,
    /// How many vehicles.
    pub robots: usize,
    /// How many rounds.
    pub rounds: usize,
    /// How many samples.
    pub samples: u64,
    /// First seed.
    pub seed: u64,
    /// By method: of everybody but those who are scored apart.
    pub methods: Vec<MethodResult>,
    /// What the team estimator came to of those who are: of who lies; of the half of a team with fixes that meets the
    /// other.
    pub apart: Option<ApartResult>,
    /// Rounds that the team estimator could not solve, a flight and estimator.
    pub undetermined: f64,
    /// Quarantines that it began, a flight and estimator.
    pub quarantines: f64,
    /// Flights in which it put an honest vehicle into quarantine or took its odometry for a lie.
    pub honest_accused: u64,
    /// Milliseconds that a round takes it. Information: of whatever the machine did meanwhile.
    pub milliseconds: f64,
}

/// What one method came to.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct MethodResult {
    /// Which.
    pub method: Method,
    /// Root of the mean of |e|^2 over robots and samples at the last round, metres.
    pub rmse_m: f64,
    /// Its standard error, metres: robots of one flight are not independent, flights are.
    pub rmse_stderr_m: f64,
    /// Mean of |e|, which the paper's figures call bias, metres.
    pub mean_norm_m: f64,
    /// The root over that of the bound.
    pub ratio: f64,
    /// Its standard error: delta method, flight by flight.
    pub ratio_stderr: f64,
    /// How honest its covariance is, if it has one.
    pub nees: Option<Nees>,
}

/// What the team estimator came to of vehicles that are scored apart.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ApartResult {
    /// Root of the mean of |e|^2, metres.
    pub rmse_m: f64,
    /// The root over that of the bound.
    pub ratio: f64,
    /// Its standard error.
    pub ratio_stderr: f64,
    /// The farthest that one of them moved in a round from when it met the others, beside its odometry and in the standard
    /// deviations of its position before: the mean over flights, and the largest.
    pub moved_sigmas: Option<(f64, f64)>,
}

/// Normalised squared errors of a vehicle's own pose in exponential coordinates, per degree of freedom; one estimator a
/// flight, so that they are independent.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Nees {
    /// Mean at the last round.
    pub mean: f64,
    /// Median at the last round.
    pub median: f64,
    /// 2.5 % quantile of the mean of so many.
    pub low: f64,
    /// 97.5 % quantile.
    pub high: f64,
    /// Share of the rounds from 1 on in which the mean is between the two.
    pub inside: f64,
    /// The mean, round by round from 1 on. Empty for the batch, which has the last only.
    pub over_time: Vec<f64>,
}

/// Why a cell could not be flown.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Failed {
    /// Its world needs vehicles.
    #[error(transparent)]
    NotBare(#[from] NotBare),
    /// Its history holds what is no measurement.
    #[error("the batch refused: {0}")]
    Refused(#[from] Refusal),
}

/// One flight in numbers: of each vehicle that was scored, how far off it was.
#[derive(Clone, Debug, Default)]
struct Scored {
    paper_m: Vec<f64>,
    star_m: Vec<f64>,
    team_m: Vec<f64>,
    bound_m: Vec<f64>,
    /// Errors of the team estimator and of the bound of those who are scored apart.
    apart_m: (Vec<f64>, Vec<f64>),
    /// How far those moved when they met the others, standard deviations.
    moved_sigmas: Option<f64>,
    nees: Vec<f64>,
    bound_nees: Option<f64>,
    undetermined: f64,
    quarantines: f64,
    is_honest_accused: bool,
    seconds: f64,
}

/// Flies every sample of a cell. `flown` is called after each, from any thread.
///
/// # Errors
/// [`Failed`], of a cell that cannot be flown.
pub fn run(
    cell: &Cell,
    request: &Request<'_>,
    flown: impl Fn() + Sync,
) -> Result<CellResult, Failed> {
    let cell = Cell {
        rounds: request.rounds.unwrap_or(cell.rounds),
        ..*cell
    };
    let flights: Result<Vec<Scored>, Failed> = (0..request.samples)
        .into_par_iter()
        .map(|sample| {
            let scored = fly(&cell, request, sample);
            flown();
            scored
        })
        .collect();
    let flights = flights?;
    let of_method = |method: Method, errors: fn(&Scored) -> &Vec<f64>, nees: Option<Nees>| {
        let squares: Vec<f64> = flights
            .iter()
            .map(|flight| square(errors(flight)))
            .collect();
        let bounds: Vec<f64> = flights
            .iter()
            .map(|flight| square(&flight.bound_m))
            .collect();
        let (rmse_m, rmse_stderr_m) = root_mean(&squares);
        let (ratio, ratio_stderr) = ratio_of_root_means(&squares, &bounds);
        let all = flights.iter().flat_map(errors);
        MethodResult {
            method,
            rmse_m,
            rmse_stderr_m,
            mean_norm_m: mean(all.copied()),
            ratio,
            ratio_stderr,
            nees,
        }
    };
    let mut methods = Vec::new();
    // The older modes take no absolute fixes from these stages.
    if flights.iter().all(|flight| !flight.paper_m.is_empty()) {
        methods.push(of_method(Method::Paper, |flight| &flight.paper_m, None));
        methods.push(of_method(Method::Star, |flight| &flight.star_m, None));
    }
    let over_time = nees_over_time(&flights, cell.rounds);
    methods.push(of_method(Method::Team, |flight| &flight.team_m, over_time));
    let at_the_end: Option<Vec<f64>> = flights.iter().map(|flight| flight.bound_nees).collect();
    let at_the_end = at_the_end.map(|last| Nees::at_the_end(last, Vec::new()));
    methods.push(of_method(
        Method::Batch,
        |flight| &flight.bound_m,
        at_the_end,
    ));
    let per_flight = |of: fn(&Scored) -> f64| mean(flights.iter().map(of));
    Ok(CellResult {
        cell: cell.name,
        robots: cell.robots,
        rounds: cell.rounds,
        samples: request.samples,
        seed: request.seed,
        methods,
        apart: scored_apart(&flights),
        undetermined: per_flight(|flight| flight.undetermined),
        quarantines: per_flight(|flight| flight.quarantines),
        honest_accused: flights
            .iter()
            .filter(|flight| flight.is_honest_accused)
            .count() as u64,
        milliseconds: 1e3 * per_flight(|flight| flight.seconds) / cell.rounds as f64,
    })
}

impl CellResult {
    /// What a method came to, if it flew.
    #[must_use]
    pub fn method(&self, method: Method) -> Option<&MethodResult> {
        self.methods.iter().find(|result| result.method == method)
    }
}

impl Nees {
    /// From everybody's at the last round, and the means before.
    fn at_the_end(mut last: Vec<f64>, over_time: Vec<f64>) -> Self {
        last.sort_by(f64::total_cmp);
        let (low, high) = chi_square::bounds_95(DEGREES_OF_FREEDOM, last.len());
        let is_inside = |mean: &&f64| (low..=high).contains(*mean);
        Self {
            mean: mean(last.iter().copied()),
            median: f64::midpoint(last[(last.len() - 1) / 2], last[last.len() / 2]),
            low,
            high,
            inside: over_time.iter().filter(is_inside).count() as f64
                / over_time.len().max(1) as f64,
            over_time,
        }
    }
}

/// Of those who are scored apart in every flight.
fn scored_apart(flights: &[Scored]) -> Option<ApartResult> {
    let of = |errors: fn(&Scored) -> &Vec<f64>| -> Vec<f64> {
        flights
            .iter()
            .map(|flight| square(errors(flight)))
            .collect()
    };
    if flights.iter().any(|flight| flight.apart_m.0.is_empty()) {
        return None;
    }
    let (squares, bounds) = (
        of(|flight| &flight.apart_m.0),
        of(|flight| &flight.apart_m.1),
    );
    let (ratio, ratio_stderr) = ratio_of_root_means(&squares, &bounds);
    let moved: Option<Vec<f64>> = flights.iter().map(|flight| flight.moved_sigmas).collect();
    Some(ApartResult {
        rmse_m: root_mean(&squares).0,
        ratio,
        ratio_stderr,
        moved_sigmas: moved.map(|moved| {
            let largest = moved.iter().copied().fold(0.0, f64::max);
            (mean(moved.into_iter()), largest)
        }),
    })
}

/// The mean of the squares.
fn square(errors: &[f64]) -> f64 {
    mean(errors.iter().map(|error| error * error))
}

/// The means round by round; rounds that one flight could not solve are left to the others.
fn nees_over_time(flights: &[Scored], rounds: usize) -> Option<Nees> {
    let of_round = |k: usize| -> Vec<f64> {
        let all = flights.iter().map(|flight| flight.nees[k]);
        all.filter(|nees| nees.is_finite()).collect()
    };
    let means = (1..=rounds)
        .map(|k| mean(of_round(k).into_iter()))
        .collect();
    let last = of_round(rounds);
    (!last.is_empty()).then(|| Nees::at_the_end(last, means))
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

fn fly(cell: &Cell, request: &Request<'_>, sample: u64) -> Result<Scored, Failed> {
    let case = cell.case(request.seed, sample)?;
    let scenario = cell.scenario(request.seed);
    let (team, last) = (cell.robots, case.told.last());
    let hearing = Hearing::new(&cell.air, team, last, &scenario.streams(sample));
    let mut scored = Scored::default();
    let is_shared = cell.air.is_perfect();
    let estimators: Vec<usize> = if is_shared {
        vec![sample as usize % team]
    } else {
        let count = (FOLLOWED_MAX / team).clamp(1, ESTIMATORS_MAX).min(team);
        // Others in every flight. The first is the one whose NEES is taken.
        let nth = |nth: usize| (nth * team / count + sample as usize) % team;
        (0..count).map(nth).collect()
    };
    let period = Span::from_nanos(nanos(scenario.period_s));
    let everything = |own: usize| Heard::new(&case.told, &hearing, own);
    let mut shared_bound = None;
    for (nth, &own) in estimators.iter().enumerate() {
        let heard = everything(own);
        let begun_s = (request.clock_s)();
        let flight = flight::fly(&case.told, &heard, Settings::DEFAULT, period, |_| true);
        scored.seconds += ((request.clock_s)() - begun_s) / estimators.len() as f64;
        if shared_bound.is_none() || !cell.air.is_perfect() {
            shared_bound = Some(bound_of(&case, &heard, &flight, period)?);
        }
        let bound = shared_bound.as_ref().expect("made above");
        let whom = if is_shared { 0..team } else { own..own + 1 };
        for vehicle in whom {
            let truth = case.told.true_pose(last, vehicle).translation;
            let (_, pose) = flight.rounds[last].team[vehicle];
            let error_m = (pose.translation - truth).norm();
            let bound_m = (bound.team[vehicle].translation - truth).norm();
            let (team, best) = if cell.is_scored_apart(vehicle) {
                (&mut scored.apart_m.0, &mut scored.apart_m.1)
            } else {
                (&mut scored.team_m, &mut scored.bound_m)
            };
            team.push(error_m);
            best.push(bound_m);
        }
        if cell.air.apart_rounds > 0 && cell.is_scored_apart(own) {
            let moved = moved_sigmas(&case.told, &flight, own, cell.air.apart_rounds);
            scored.moved_sigmas = Some(scored.moved_sigmas.unwrap_or(0.0).max(moved));
        }
        if nth == 0 {
            scored.nees = own_nees(&case.told, &flight, own);
            scored.bound_nees = bound.covariance.map(|covariance| {
                nees(
                    &bound.team[own],
                    &covariance,
                    &case.told.true_pose(last, own),
                )
            });
        }
        let statistics = flight.statistics;
        scored.undetermined += statistics.undetermined as f64 / estimators.len() as f64;
        scored.quarantines += statistics.quarantines as f64 / estimators.len() as f64;
        let mut accused = flight.accused.iter();
        scored.is_honest_accused |= accused.any(|vehicle| cell.is_honest(*vehicle));
    }
    let has_fixes = case.told.rounds.iter().any(|round| !round.fixes.is_empty());
    if !has_fixes {
        let produced = |mode| {
            produced(cell, request.seed, sample, &case.told, mode)
                .into_iter()
                .enumerate()
                .filter(|(vehicle, _)| is_shared || estimators.contains(vehicle))
                .filter(|(vehicle, _)| !cell.is_scored_apart(*vehicle))
                .map(|(_, error_m)| error_m)
                .collect()
        };
        scored.paper_m = produced(Mode::Paper);
        scored.star_m = produced(Mode::Star(Robust::DEFAULT));
    }
    Ok(scored)
}

/// The bound, started from a flight that was told what the bound is.
fn bound_of(case: &Case, heard: &Heard, flight: &Flight, period: Span) -> Result<Bound, Refusal> {
    let uses_everybody = case.known.team() <= Settings::DEFAULT.nearest + 1;
    if case.is_clean && uses_everybody {
        return bound::of(&case.known, heard, flight);
    }
    let settings = Settings {
        nearest: case.known.team(),
        ..Settings::DEFAULT
    };
    let oracle = flight::fly(&case.known, heard, settings, period, |sighting| {
        !sighting.is_wrong
    });
    bound::of(&case.known, heard, &oracle)
}

/// Of the own pose after each round; not a number where the round could not be solved.
fn own_nees(history: &History, flight: &Flight, own: usize) -> Vec<f64> {
    let rounds = flight.rounds.iter().enumerate();
    rounds
        .map(|(k, estimates)| {
            estimates.own.map_or(f64::NAN, |estimate| {
                let truth = history.true_pose(k, own);
                nees(&estimate.world_from_body, &estimate.covariance, &truth)
            })
        })
        .collect()
}

/// The farthest that the own position moved in one round from round `from` on, beside what odometry said, in its standard
/// deviations before.
fn moved_sigmas(history: &History, flight: &Flight, own: usize, from: usize) -> f64 {
    let rounds = flight
        .rounds
        .windows(2)
        .enumerate()
        .skip(from.saturating_sub(1));
    let moved = rounds.filter_map(|(before, estimates)| {
        let (earlier, later) = (estimates[0].own?, estimates[1].own?);
        let expected = earlier.world_from_body * history.step(own, before, before + 1);
        let covariance = earlier.carried_to(&later.point, &NoiseScales::default())?;
        let moved = se3::log(&(expected.inverse() * later.world_from_body));
        let (moved, covariance) = (
            moved.fixed_rows::<3>(3),
            covariance.fixed_view::<3, 3>(3, 3),
        );
        let inverse = covariance.into_owned().try_inverse()?;
        Some((moved.transpose() * inverse * moved)[(0, 0)].sqrt())
    });
    moved.fold(0.0, f64::max)
}

/// `e^T P^-1 e / 6`, `e = Log(estimate^-1 truth)`.
fn nees(
    estimate: &Transform<WorldFrame, Body>,
    covariance: &Matrix6<f64>,
    truth: &Transform<WorldFrame, Body>,
) -> f64 {
    let error = se3::log(&(estimate.inverse() * *truth));
    covariance.cholesky().map_or(f64::NAN, |covariance| {
        error.dot(&covariance.solve(&error)) / DEGREES_OF_FREEDOM as f64
    })
}

/// How far off production vehicles are at the end, metres.
fn produced(cell: &Cell, seed: u64, sample: u64, history: &History, mode: Mode) -> Vec<f64> {
    let scenario = cell.scenario(seed);
    let world = World::new(&scenario, sample);
    let radio = Radio::new(&scenario.radio, world.streams());
    let stage = Playback::new(world, history.clone());
    let mut fleet = Fleet::on(stage, radio, |_, config| skein_vehicle::Config {
        mode,
        repeats: cell.air.repeats,
        ..config
    });
    // Just before the next round, so that what can be heard of the last one by then has been heard.
    let (end_ns, period_ns) = (nanos(scenario.duration_s), nanos(scenario.period_s));
    fleet.run_until(end_ns + period_ns);
    (0..fleet.len())
        .map(|vehicle| fleet.position_error_m(vehicle))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request() -> Request<'static> {
        Request {
            samples: 3,
            seed: 1,
            rounds: Some(20),
            clock_s: &|| 0.0,
        }
    }

    #[test]
    fn a_short_study_is_the_same_every_time_and_nobody_is_better_than_the_bound_is_itself() {
        for name in ["pose-3", "loss-30-repeats"] {
            let cell = Cell::named(name).unwrap();
            let result = run(&cell, &request(), || ()).unwrap();
            assert_eq!(result, run(&cell, &request(), || ()).unwrap());
            let methods: Vec<Method> = result.methods.iter().map(|of| of.method).collect();
            let all = [Method::Paper, Method::Star, Method::Team, Method::Batch];
            assert_eq!(methods, all);
            let batch = result.method(Method::Batch).unwrap();
            assert_eq!((batch.ratio, batch.ratio_stderr), (1.0, 0.0));
            assert_eq!(batch.nees.is_some(), name == "pose-3", "only without loss");
            let team = result.method(Method::Team).unwrap();
            assert_eq!(team.nees.as_ref().unwrap().over_time.len(), 20);
            // As near to the bound as 20 rounds let it be, where the paper's way is far from it.
            let paper = result.method(Method::Paper).unwrap();
            assert!(team.ratio < 1.5 && paper.ratio > team.ratio, "{result:?}");
            assert_eq!((result.undetermined, result.honest_accused), (0.0, 0));
        }
    }

    #[test]
    fn a_vehicle_that_is_off_by_its_standard_deviations_has_a_nees_of_one() {
        let covariance =
            Matrix6::from_diagonal(&nalgebra::Vector6::new(1e-4, 1e-4, 1e-4, 1e-2, 1e-2, 1e-2));
        let twist = nalgebra::Vector6::new(0.01, -0.01, 0.01, 0.1, 0.1, -0.1);
        let truth = Transform::<WorldFrame, Body>::identity();
        let off = truth * se3::exp::<Body, Body>(&-twist);
        assert!((nees(&off, &covariance, &truth) - 1.0).abs() < 1e-9);
    }
}
