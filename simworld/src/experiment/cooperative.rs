//! Section V and figure 6 of Knuth & Barooah: how well robot 1 knows where it is, by team size and by kind of
//! measurement.

use crate::experiment::solver_only::{self, NotBare};
use crate::fleet::Fleet;
use crate::plot::{self, ErrorCurve, ErrorPoint, Path, PathKind, PlotError};
use crate::scenario::Scenario;
use crate::sensor::{Kind, KindChange};
use crate::stage::Stage;
use crate::statistics::{ErrorSummary, PoseError};
use crate::world::{World, nanos};
use rayon::prelude::*;
use serde::Serialize;
use skein_estimation::cooperative::{Mode, Optimiser};
use std::fmt::Write;

/// How often the kind changes in the cells that mix kinds.
const CHANGE_EVERY_S: f64 = 4.0;
const KINDS: [Kind; 5] = [
    Kind::Pose,
    Kind::Orientation,
    Kind::Position,
    Kind::Bearing,
    Kind::Distance,
];

/// What measures in a cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CellKind {
    /// Nobody measures anybody: odometry alone.
    None,
    /// One kind throughout.
    One(Kind),
    /// All five in turn.
    Changing,
}

/// One cell of the table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Cell {
    /// How many robots.
    pub robots: usize,
    /// What they measure.
    pub kind: CellKind,
}

/// What flies the samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Engine {
    /// The production vehicle and codec in virtual time.
    Vehicle,
    /// The bare algorithm.
    SolverOnly,
}

/// What is asked for.
#[derive(Clone, Debug)]
pub struct Request {
    /// Samples a cell.
    pub samples: u64,
    /// First seed of all random streams.
    pub seed: u64,
    /// What flies them.
    pub engine: Engine,
    /// How rounds are solved.
    pub optimiser: Optimiser,
}

/// The result of one cell: one object of the JSON output.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CellResult {
    /// How many robots.
    pub robots: usize,
    /// `none`, one of the five kinds, or `changing`.
    pub kind: String,
    /// The mode of the cooperative pipeline.
    pub mode: String,
    /// How many samples.
    pub samples: u64,
    /// Mean of |e| of robot 1 at the end, in metres: the paper's "bias".
    pub mean_error_m: f64,
    /// Its standard error.
    pub stderr_m: f64,
    /// Square root of the trace of the covariance of e.
    pub std_m: f64,
    /// Its standard error.
    pub std_stderr_m: f64,
    /// Square root of the mean of |e|^2.
    pub rmse_m: f64,
    /// Length of the mean of e.
    pub mean_vector_m: f64,
    /// Mean orientation error, in radians.
    pub orientation_rad: f64,
    /// Its standard error.
    pub orientation_stderr_rad: f64,
    /// The same over time, for the curves.
    #[serde(skip)]
    pub curve: Vec<(f64, ErrorSummary)>,
}

/// The cells of figures 3 and 4, and the kinds in turn.
#[must_use]
pub fn cells() -> Vec<Cell> {
    let teams = (2..=5).map(|robots| Cell {
        robots,
        kind: CellKind::One(Kind::Pose),
    });
    let kinds = KINDS[1..].iter().map(|kind| Cell {
        robots: 5,
        kind: CellKind::One(*kind),
    });
    let alone = Cell {
        robots: 1,
        kind: CellKind::None,
    };
    let changing = Cell {
        robots: 5,
        kind: CellKind::Changing,
    };
    std::iter::once(alone)
        .chain(teams)
        .chain(kinds)
        .chain([changing])
        .collect()
}

impl Cell {
    /// The scenario of a cell.
    #[must_use]
    pub fn scenario(self, seed: u64) -> Scenario {
        let mut scenario = Scenario::built_in("section-v").expect("built in");
        scenario.seed = seed;
        scenario.team.truncate(self.robots);
        match self.kind {
            CellKind::None => {}
            CellKind::One(kind) => scenario.sensor.kind = kind,
            CellKind::Changing => {
                let turns = (scenario.duration_s / CHANGE_EVERY_S).ceil() as usize;
                scenario.sensor.changes = (1..turns)
                    .map(|turn| KindChange {
                        from_s: turn as f64 * CHANGE_EVERY_S,
                        kind: KINDS[turn % KINDS.len()],
                    })
                    .collect();
            }
        }
        scenario
    }

    /// What its results are filed under.
    #[must_use]
    pub fn kind_name(self) -> String {
        match self.kind {
            CellKind::None => "none".to_owned(),
            CellKind::One(kind) => format!("{kind:?}").to_lowercase(),
            CellKind::Changing => "changing".to_owned(),
        }
    }
}

/// Flies every sample of a cell. `flown` is called after each, from any thread.
///
/// # Errors
/// [`NotBare`] when the bare algorithm cannot fly it.
pub fn run(cell: Cell, request: &Request, flown: impl Fn() + Sync) -> Result<CellResult, NotBare> {
    let scenario = cell.scenario(request.seed);
    let samples: Vec<Vec<PoseError>> = (0..request.samples)
        .into_par_iter()
        .map(|sample| {
            let errors = fly(&scenario, sample, request);
            flown();
            errors
        })
        .collect::<Result<_, _>>()?;
    let rounds = samples.first().map_or(0, Vec::len);
    let curve: Vec<(f64, ErrorSummary)> = (0..rounds)
        .filter_map(|k| {
            let errors: Vec<PoseError> = samples.iter().map(|sample| sample[k]).collect();
            Some((k as f64 * scenario.period_s, ErrorSummary::of(&errors)?))
        })
        .collect();
    let last = curve.last().map(|(_, summary)| *summary);
    let number = |of: fn(&ErrorSummary) -> f64| last.as_ref().map_or(f64::NAN, of);
    Ok(CellResult {
        robots: cell.robots,
        kind: cell.kind_name(),
        mode: Mode::Paper.name().to_owned(),
        samples: request.samples,
        mean_error_m: number(|s| s.mean_norm_m),
        stderr_m: number(|s| s.mean_norm_stderr_m),
        std_m: number(|s| s.std_m),
        std_stderr_m: number(|s| s.std_stderr_m),
        rmse_m: number(|s| s.rmse_m),
        mean_vector_m: number(|s| s.norm_of_mean_m),
        orientation_rad: number(|s| s.mean_orientation_rad),
        orientation_stderr_rad: number(|s| s.mean_orientation_stderr_rad),
        curve,
    })
}

/// The error of robot 1 at every k of one sample.
fn fly(scenario: &Scenario, sample: u64, request: &Request) -> Result<Vec<PoseError>, NotBare> {
    let mut world = World::new(scenario, sample);
    let period_ns = world.period_ns();
    if request.engine == Engine::SolverOnly {
        let flown = solver_only::fly(&mut world, &request.optimiser)?;
        let error = |(k, estimates): (usize, &Vec<crate::truth::Pose>)| {
            PoseError::between(&world.pose(0, k as i64 * period_ns), &estimates[0])
        };
        return Ok(flown.iter().enumerate().map(error).collect());
    }
    let mut fleet = Fleet::with_configs(scenario, sample, |_, config| skein_vehicle::Config {
        mode: Mode::Paper,
        optimiser: request.optimiser,
        ..config
    });
    let rounds = nanos(scenario.duration_s) / period_ns;
    let errors = (0..=rounds).map(|k| {
        // Just before the next round, so that everything of this one has been heard.
        fleet.run_until((k + 1) * period_ns);
        let (truth, estimate) = fleet
            .scored(0)
            .expect("every vehicle of section V has a start pose");
        PoseError::between(&truth, &estimate)
    });
    Ok(errors.collect())
}

/// The results as people read them.
#[must_use]
pub fn table(results: &[CellResult]) -> String {
    let mut text = String::from(
        "robots  kind         mean |e| m        std m             RMSE m   |mean e| m  orientation rad\n",
    );
    for result in results {
        let _ = writeln!(
            text,
            "{:>6}  {:<11}  {:>6.3} +- {:<6.3}  {:>6.3} +- {:<6.3}  {:>6.3}   {:>6.3}      {:.4} +- {:.4}",
            result.robots,
            result.kind,
            result.mean_error_m,
            result.stderr_m,
            result.std_m,
            result.std_stderr_m,
            result.rmse_m,
            result.mean_vector_m,
            result.orientation_rad,
            result.orientation_stderr_rad,
        );
    }
    text
}

/// Every k of every cell, one row each.
#[must_use]
pub fn csv(results: &[CellResult]) -> String {
    let mut text = String::from(
        "robots,kind,mode,samples,time_s,mean_error_m,stderr_m,std_m,std_stderr_m,rmse_m,mean_vector_m,orientation_rad\n",
    );
    for result in results {
        for (time_s, s) in &result.curve {
            let _ = writeln!(
                text,
                "{},{},{},{},{time_s:.3},{},{},{},{},{},{},{}",
                result.robots,
                result.kind,
                result.mode,
                result.samples,
                s.mean_norm_m,
                s.mean_norm_stderr_m,
                s.std_m,
                s.std_stderr_m,
                s.rmse_m,
                s.norm_of_mean_m,
                s.mean_orientation_rad,
            );
        }
    }
    text
}

/// Figure 3 (by team size) and figure 4 (by kind), as file names and SVG texts.
///
/// # Errors
/// [`PlotError`] when there is nothing to draw.
pub fn figures(results: &[CellResult]) -> Result<Vec<(&'static str, String)>, PlotError> {
    let teams = results
        .iter()
        .filter(|r| r.kind == "pose" || r.kind == "none");
    let teams = teams.map(|r| curve(r, format!("n = {}", r.robots)));
    let kinds = results.iter().filter(|r| r.robots == 5 || r.kind == "none");
    let kinds = kinds.map(|r| {
        curve(
            r,
            if r.kind == "none" {
                "self loc.".to_owned()
            } else {
                r.kind.clone()
            },
        )
    });
    Ok(vec![
        (
            "figure-3-team-size.svg",
            plot::error_curves(
                "Robot 1, relative pose, by team size",
                &teams.collect::<Vec<_>>(),
            )?,
        ),
        (
            "figure-4-kinds.svg",
            plot::error_curves(
                "Robot 1, five robots, by kind of measurement",
                &kinds.collect::<Vec<_>>(),
            )?,
        ),
    ])
}

fn curve(result: &CellResult, label: String) -> ErrorCurve {
    let point = |(time_s, s): &(f64, ErrorSummary)| ErrorPoint {
        time_s: *time_s,
        mean_norm_m: s.mean_norm_m,
        std_m: s.std_m,
    };
    ErrorCurve {
        label,
        points: result.curve.iter().map(point).collect(),
    }
}

/// One realisation of figure 6: the path of robot 1 as it was, by odometry alone and with each kind.
#[derive(Clone, Debug)]
pub struct Figure6 {
    /// The drawing.
    pub svg: String,
    /// Final position error by `dead reckoning` and by each kind, in metres.
    pub final_error_m: Vec<(String, f64)>,
}

/// Flies two planar robots on straight parallel lines once with each kind.
///
/// # Errors
/// [`PlotError`] when the paths cannot be drawn.
pub fn figure_6(seed: u64) -> Result<Figure6, PlotError> {
    let mut scenario = Scenario::built_in("parallel-lines").expect("built in");
    scenario.seed = seed;
    let mut paths = Vec::new();
    let mut final_error_m = Vec::new();
    for kind in KINDS {
        scenario.sensor.kind = kind;
        let as_published = |_, config| skein_vehicle::Config {
            mode: Mode::Paper,
            ..config
        };
        let mut fleet = Fleet::with_configs(&scenario, 0, as_published);
        let period_ns = fleet.stage().period_ns();
        let (mut truth, mut reckoned, mut estimated) = (Vec::new(), Vec::new(), Vec::new());
        for k in 0..=nanos(scenario.duration_s) / period_ns {
            // Its drivers have prepared this round and not the next one.
            fleet.run_until(k * period_ns);
            let planar = |pose: &crate::truth::Pose| (pose.translation.x, pose.translation.y);
            truth.push(planar(&fleet.stage().pose(0, k * period_ns)));
            reckoned.push(planar(fleet.stage().dead_reckoning(0)));
            fleet.run_until((k + 1) * period_ns);
            estimated.extend(fleet.scored(0).map(|(_, estimate)| planar(&estimate)));
        }
        let end = |path: &[(f64, f64)]| {
            let (&(x, y), &(tx, ty)) = (
                path.last().unwrap_or(&(0.0, 0.0)),
                truth.last().unwrap_or(&(0.0, 0.0)),
            );
            (x - tx).hypot(y - ty)
        };
        if paths.is_empty() {
            final_error_m.push(("dead reckoning".to_owned(), end(&reckoned)));
            paths.push(Path {
                label: "truth".to_owned(),
                kind: PathKind::Truth,
                points_m: truth.clone(),
            });
            paths.push(Path {
                label: "self loc.".to_owned(),
                kind: PathKind::DeadReckoning,
                points_m: reckoned,
            });
        }
        let label = format!("{kind:?}").to_lowercase();
        final_error_m.push((label.clone(), end(&estimated)));
        paths.push(Path {
            label,
            kind: PathKind::Estimate,
            points_m: estimated,
        });
    }
    let svg = plot::paths("Robot 1 of two on parallel lines, one realisation", &paths)?;
    Ok(Figure6 { svg, final_error_m })
}
