//! Levelling on virtual quadrotors: the sensor and the flights of Cognetti et al., with and without a bias of the gyro.

use super::{GAINS, RecordingResult, level};
use crate::inertial_recording::InertialReading;
use crate::mutual_scenario::{Flight, MutualScenario};
use crate::mutual_world::MutualWorld;
use crate::quadrotor::ImuSettings;
use crate::statistics::mean_and_stderr;
use nalgebra::Vector3;
use rayon::prelude::*;
use serde::Serialize;
use skein_estimation::mutual::attitude::{Attitude, Settings};

/// What comes before this is not scored (s): they hover for the first two.
const SCORED_FROM_S: f64 = 5.0;

/// A kind of flight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Case {
    /// What the table calls it.
    pub name: &'static str,
    /// How they fly.
    pub flight: Flight,
    /// Bias of the gyro on every axis, deg/s.
    pub rate_bias_deg_s: f64,
    /// Bias of the accelerometer on every axis, m/s^2.
    pub force_bias_m_s2: f64,
}

/// All of them.
pub const CASES: [Case; 6] = [
    case("weave", Flight::Weave, 0.0, 0.0),
    case("weave, gyro 0.2 deg/s", Flight::Weave, 0.2, 0.0),
    case("weave, both biases", Flight::Weave, 0.2, 0.05),
    case("circle", Flight::Round, 0.0, 0.0),
    case("circle, gyro 0.2 deg/s", Flight::Round, 0.2, 0.0),
    case("legs, gyro 0.2 deg/s", Flight::Legs, 0.2, 0.0),
];

const fn case(
    name: &'static str,
    flight: Flight,
    rate_bias_deg_s: f64,
    force_bias_m_s2: f64,
) -> Case {
    Case {
        name,
        flight,
        rate_bias_deg_s,
        force_bias_m_s2,
    }
}

/// One case: one object of the JSON output. Means over flights (each of them four quadrotors), with standard errors.
#[derive(Clone, Debug, Serialize)]
pub struct CaseResult {
    /// What was flown.
    pub case: &'static str,
    /// How many flights.
    pub samples: u64,
    /// The seed.
    pub seed: u64,
    /// Mean error of the tilt, degrees.
    pub mean_deg: f64,
    /// Its standard error.
    pub mean_stderr_deg: f64,
    /// RMSE of the tilt, degrees.
    pub rmse_deg: f64,
    /// Squared error over variance, of each axis.
    pub nees: f64,
    /// Estimated over true level acceleration.
    pub gain: f64,
    /// How far the heading drifts in a minute, mean of its absolute, degrees.
    pub drift_deg_per_min: f64,
    /// Mean error of the filters of [`GAINS`], degrees.
    pub fixed_gain_mean_deg: [f64; GAINS.len()],
}

/// What one quadrotor made of its flight.
struct Levelled {
    result: RecordingResult,
    /// Sums of estimated by true, and of true by true, level acceleration.
    along: f64,
    square: f64,
    drift_deg_per_min: f64,
}

/// Flies a case. `flown` is called after each flight, from any thread.
#[must_use]
pub fn run(case: &Case, samples: u64, seed: u64, flown: impl Fn() + Sync) -> CaseResult {
    let scenario = MutualScenario {
        seed,
        flight: case.flight,
        imu: ImuSettings {
            rate_bias_deg_s: case.rate_bias_deg_s,
            force_bias_m_s2: case.force_bias_m_s2,
            ..ImuSettings::default()
        },
        ..MutualScenario::square()
    };
    let flights: Vec<Vec<Levelled>> = (0..samples)
        .into_par_iter()
        .map(|sample| {
            let world = MutualWorld::new(&scenario, sample);
            let team = (0..world.robots()).map(|vehicle| fly(&world, vehicle));
            let team = team.collect();
            flown();
            team
        })
        .collect();
    let of_flight = |value: fn(&Levelled) -> f64| {
        let mean = move |team: &Vec<Levelled>| {
            team.iter().map(value).sum::<f64>() / team.len().max(1) as f64
        };
        mean_and_stderr(flights.iter().map(mean))
    };
    let sum = |value: fn(&Levelled) -> f64| flights.iter().flatten().map(value).sum::<f64>();
    let (mean_deg, mean_stderr_deg) = of_flight(|one| one.result.tilt.mean_deg);
    let team = sum(|_| 1.0);
    let fixed = |index: usize| {
        let means = flights.iter().flatten();
        means
            .map(|one| one.result.fixed_gain[index].mean_deg)
            .sum::<f64>()
            / team
    };
    CaseResult {
        case: case.name,
        samples,
        seed,
        mean_deg,
        mean_stderr_deg,
        rmse_deg: of_flight(|one| one.result.tilt.rmse_deg.powi(2)).0.sqrt(),
        nees: of_flight(|one| one.result.nees).0,
        gain: sum(|one| one.along) / sum(|one| one.square),
        drift_deg_per_min: of_flight(|one| one.drift_deg_per_min).0,
        fixed_gain_mean_deg: std::array::from_fn(fixed),
    }
}

fn fly(world: &MutualWorld, vehicle: usize) -> Levelled {
    let scenario = world.scenario();
    let samples = (scenario.duration_s * scenario.imu.rate_hz) as usize;
    let mut attitude = Attitude::new(Settings::standard());
    let mut readings = Vec::with_capacity(samples);
    let (mut along, mut square) = (0.0, 0.0);
    let mut heading_errors_rad: Vec<(f64, f64)> = Vec::new();
    for index in 0..samples {
        let sample = world.imu(vehicle, index);
        let truth = world.motion(vehicle, sample.taken_s);
        let reading = InertialReading {
            time_s: sample.taken_s,
            rate_rad_s: sample.rate_rad_s,
            force_m_s2: sample.force_m_s2,
            up: Some(truth.pose.rotation.inverse() * Vector3::z()),
            is_scored: sample.taken_s >= SCORED_FROM_S,
        };
        attitude.update(
            1.0 / scenario.imu.rate_hz,
            &sample.rate_rad_s,
            &sample.force_m_s2,
        );
        if reading.is_scored {
            let (sin, cos) = truth.heading_rad.sin_cos();
            let world = truth.acceleration_m_s2;
            let level = (cos * world.x + sin * world.y, cos * world.y - sin * world.x);
            let estimated =
                attitude.level_from_body() * (sample.force_m_s2 - attitude.force_bias_m_s2());
            along += estimated.x * level.0 + estimated.y * level.1;
            square += level.0 * level.0 + level.1 * level.1;
            heading_errors_rad.push((sample.taken_s, attitude.yaw_rad() - truth.heading_rad));
        }
        readings.push(reading);
    }
    let drift = heading_errors_rad
        .first()
        .zip(heading_errors_rad.last())
        .map_or(0.0, |(first, last)| {
            (last.1 - first.1) / (last.0 - first.0).max(1.0)
        });
    Levelled {
        result: level("", &readings, &Settings::standard())
            .expect("a virtual flight is longer than what is not scored"),
        along,
        square,
        drift_deg_per_min: (drift * 60.0).to_degrees().abs(),
    }
}
