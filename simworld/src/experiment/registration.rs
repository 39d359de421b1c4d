//! Registration of single anonymous scans, nothing known before: how often every neighbour is where it is said to be, and
//! how often every sighting is who it is said to be; the published method beside ours, and beside both what remains
//! undecided to who knows where all robots are.

pub mod cell;
pub mod report;
pub mod scan;

use self::cell::Cell;
use self::scan::{Scan, direction};
use crate::statistics::mean_and_stderr;
use crate::streams::Streams;
use nalgebra::{Matrix4, Rotation3, Vector3};
use rayon::prelude::*;
use serde::Serialize;
use skein_estimation::VehicleId;
use skein_estimation::mutual::direction::{difference, wrapped};
use skein_estimation::mutual::registration::{
    Belief, Job, Method, Neighbour, Outcome, Pose, Search, Settings, Sighting, Solution,
};

/// Who registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Registrar {
    /// Ours.
    SingleScan,
    /// P-MultiBeaReg3D.
    Published,
    /// Ours, told where everybody is: what a search could find at most.
    PosesKnown,
}

/// All of them, in the order of the table.
pub const REGISTRARS: [Registrar; 3] = [
    Registrar::SingleScan,
    Registrar::Published,
    Registrar::PosesKnown,
];

/// What is asked for.
#[derive(Clone, Copy)]
pub struct Request<'a> {
    /// Scans a cell.
    pub samples: u64,
    /// Seed of all random streams. Every registrar has the same scans.
    pub seed: u64,
    /// Seconds that have passed since any instant.
    pub clock_s: &'a (dyn Fn() -> f64 + Sync),
}

/// The result of one registrar on the scans of one cell: one object of the JSON output. Shares have their standard errors
/// beside them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CellResult {
    /// What the scans were like.
    #[serde(flatten)]
    pub cell: Cell,
    /// Who registered.
    pub registrar: Registrar,
    /// How many scans.
    pub samples: u64,
    /// Their seed.
    pub seed: u64,
    /// Share of scans whose likeliest solution has the direction and the yaw of every neighbour within four standard
    /// deviations of a sighting.
    pub pose: f64,
    /// Its standard error.
    pub pose_stderr: f64,
    /// Share of scans of which some surviving solution has.
    pub pose_in_any: f64,
    /// Share of scans whose likeliest solution has every sighting of every robot right.
    pub strict: f64,
    /// Its standard error.
    pub strict_stderr: f64,
    /// Share of scans whose likeliest solution has every sighting of this robot right.
    pub own_strict: f64,
    /// Solutions that survive, on average.
    pub solutions: f64,
    /// Mean of the squared errors of direction and yaw over their covariance, a degree of freedom, of the scans with
    /// every neighbour in place; one if the covariance is right.
    pub nees_per_dof: f64,
    /// Scans of which something was cut to bound the work.
    pub cut: f64,
    /// Time a scan, milliseconds, on whatever else the machine was doing.
    pub time_ms: f64,
}

/// How one scan was registered.
struct Score {
    pose: bool,
    pose_in_any: bool,
    strict: bool,
    own_strict: bool,
    solutions: usize,
    /// Squared errors over their covariances, and of how many numbers.
    nees: (f64, f64),
    cut: bool,
    time_s: f64,
}

/// Registers every scan of a cell. `registered` is called after each, from any thread.
#[must_use]
pub fn run(
    cell: &Cell,
    registrar: Registrar,
    request: &Request<'_>,
    registered: impl Fn() + Sync,
) -> CellResult {
    let scores: Vec<Score> = (0..request.samples)
        .into_par_iter()
        .map(|sample| {
            let scan = Scan::new(cell, &Streams::new(request.seed, sample));
            let job = job(&scan, cell, registrar);
            let begun_s = (request.clock_s)();
            let outcome = job.run();
            let time_s = (request.clock_s)() - begun_s;
            registered();
            score(&scan, cell, &outcome, time_s)
        })
        .collect();
    let share =
        |of: fn(&Score) -> bool| mean_and_stderr(scores.iter().map(|one| f64::from(of(one))));
    let mean = |of: fn(&Score) -> f64| mean_and_stderr(scores.iter().map(of)).0;
    let (pose, pose_stderr) = share(|one| one.pose);
    let (strict, strict_stderr) = share(|one| one.strict);
    let numbers = mean(|one| one.nees.1);
    CellResult {
        cell: *cell,
        registrar,
        samples: request.samples,
        seed: request.seed,
        pose,
        pose_stderr,
        pose_in_any: share(|one| one.pose_in_any).0,
        strict,
        strict_stderr,
        own_strict: share(|one| one.own_strict).0,
        solutions: mean(|one| one.solutions as f64),
        nees_per_dof: if numbers > 0.0 {
            mean(|one| one.nees.0) / numbers
        } else {
            0.0
        },
        cut: share(|one| one.cut).0,
        time_ms: 1e3 * mean(|one| one.time_s),
    }
}

fn job(scan: &Scan, cell: &Cell, registrar: Registrar) -> Job {
    let sigma_rad = cell.noise_deg.to_radians();
    let mut sightings = scan.seen.iter().map(|seen| -> Vec<Sighting> {
        let sighting = |direction| Sighting {
            direction,
            sigma_rad,
        };
        seen.iter().map(|one| sighting(one.direction)).collect()
    });
    let own = sightings.next().unwrap_or_default();
    let neighbours = sightings.zip(1..).map(|(sightings, robot)| Neighbour {
        vehicle: VehicleId(robot as u64),
        sightings,
        belief: (registrar == Registrar::PosesKnown).then(|| known(scan, robot)),
    });
    Job {
        own,
        neighbours: neighbours.collect(),
        method: match registrar {
            Registrar::SingleScan | Registrar::PosesKnown => Method::SingleScan,
            Registrar::Published => Method::Published,
        },
        settings: Settings {
            search: Search::Unexplained,
            ..Settings::default()
        },
    }
}

/// Where the robot truly is, to within 10 cm and 6 deg.
fn known(scan: &Scan, robot: usize) -> Belief {
    let level_from_world = Rotation3::from_axis_angle(&Vector3::z_axis(), -scan.yaws_rad[0]);
    Belief::Gaussian {
        mean: Pose {
            position_m: level_from_world * (scan.positions_m[robot] - scan.positions_m[0]),
            yaw_rad: wrapped(scan.yaws_rad[robot] - scan.yaws_rad[0]),
        },
        covariance: Matrix4::identity() * 0.01,
    }
}

fn score(scan: &Scan, cell: &Cell, outcome: &Outcome, time_s: f64) -> Score {
    let within_rad = 4.0 * cell.noise_deg.to_radians();
    let first = outcome.solutions.first();
    let in_place = |solution: &Solution| {
        let errors = errors(scan, solution);
        errors.len() + 1 == cell.robots
            && errors
                .iter()
                .all(|one| one.xy().norm() < within_rad && one.z.abs() < within_rad)
    };
    let right = |solution: &Solution, robot: usize| {
        let who = scan.seen[robot].iter().map(|one| one.who);
        who.eq(solution.seen[robot].iter().copied())
    };
    let pose = first.is_some_and(in_place);
    let mut nees = (0.0, 0.0);
    if let Some(solution) = first.filter(|_| pose) {
        for (error, placed) in errors(scan, solution).iter().zip(&solution.placed) {
            if let Some(cholesky) = placed.covariance.cholesky() {
                nees.0 += error.dot(&cholesky.solve(error));
                nees.1 += 3.0;
            }
        }
    }
    Score {
        pose,
        pose_in_any: outcome.solutions.iter().any(in_place),
        strict: first.is_some_and(|one| (0..cell.robots).all(|robot| right(one, robot))),
        own_strict: first.is_some_and(|one| right(one, 0)),
        solutions: outcome.solutions.len(),
        nees,
        cut: outcome.cut != Default::default(),
        time_s,
    }
}

/// By placed neighbour: the errors of the direction along its tangents and of the yaw (rad).
fn errors(scan: &Scan, solution: &Solution) -> Vec<Vector3<f64>> {
    let placed = solution.placed.iter();
    placed
        .map(|placed| {
            let robot = placed.vehicle.0 as usize;
            let (azimuth, zenith) = scan.angles_rad(0, robot);
            let across = difference(&placed.direction, &direction(azimuth, zenith));
            let yaw = scan.yaws_rad[robot] - scan.yaws_rad[0] - placed.yaw_rad;
            Vector3::new(across.x, across.y, wrapped(yaw))
        })
        .collect()
}

impl Registrar {
    /// What it is called.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::SingleScan => "single scan",
            Self::Published => "published",
            Self::PosesKnown => "poses known",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use cell::cells;

    #[test]
    fn six_robots_with_a_degree_of_noise_are_all_found() {
        let cell = cells()
            .into_iter()
            .find(|one| (one.robots, one.noise_deg) == (6, 1.0))
            .unwrap();
        let request = Request {
            samples: 10,
            seed: 1,
            clock_s: &|| 0.0,
        };
        let result = run(&cell, Registrar::SingleScan, &request, || {});
        assert_eq!((result.pose, result.pose_in_any), (1.0, 1.0));
    }
}
