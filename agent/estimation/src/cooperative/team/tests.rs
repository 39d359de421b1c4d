//! A small flight whose truth is known, and what a team estimator makes of what was heard of it.

mod common_motion;
mod counted_once;
mod doubts;
mod factors;
mod hostile;
mod known_answers;
mod marginalising;
mod members;

use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::settings::{BiasRange, Lag};
use super::*;
use crate::cooperative::measurement::Kind;
use crate::odometry::Growth;
use crate::{Odometry, so3};

const SEED: u64 = 11;
const PERIOD: Span = Span::millis(200);
const EVERY_KIND: [Kind; 5] = [
    Kind::Pose,
    Kind::Orientation,
    Kind::Position,
    Kind::Bearing,
    Kind::Distance,
];

type Pose = Transform<World, Body>;

fn vector(rng: &mut ChaCha8Rng, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-size..=size))
}

/// Of unit variance, to a good approximation.
fn normal(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| (0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0)
}

fn transform<To, From>(rng: &mut ChaCha8Rng, angle: f64, size: f64) -> Transform<To, From> {
    Transform::new(so3::exp(&vector(rng, angle)), vector(rng, size))
}

/// The farther of how far two poses are turned (rad) and shifted (m) against each other.
fn apart<To, From>(a: &Transform<To, From>, b: &Transform<To, From>) -> f64 {
    so3::log(&(a.rotation.inverse() * b.rotation))
        .norm()
        .max((a.translation - b.translation).norm())
}

const fn id(vehicle: usize) -> VehicleId {
    VehicleId(vehicle as u64 + 1)
}

/// How well everybody's sensors work.
#[derive(Clone, Debug)]
struct Conditions {
    vehicles: usize,
    rounds: usize,
    /// Of each round of odometry: rad and m per axis.
    odometry: (f64, f64),
    measurement: Noise,
    kinds: Vec<Kind>,
    /// The odometer of the vehicle with this number says so much too little.
    short_odometer: Option<(usize, f64)>,
    /// Lever arms at both ends of every measurement.
    levers: bool,
}

impl Conditions {
    fn good(vehicles: usize, rounds: usize) -> Self {
        Self {
            vehicles,
            rounds,
            odometry: (0.002, 0.005),
            measurement: Noise {
                rotation_rad: 0.01,
                translation: 0.02,
            },
            kinds: vec![Kind::Pose],
            short_odometer: None,
            levers: false,
        }
    }

    /// Noise so small that nothing bends.
    fn linear(vehicles: usize, rounds: usize) -> Self {
        Self {
            odometry: (1e-4, 1e-4),
            measurement: Noise {
                rotation_rad: 1e-4,
                translation: 1e-4,
            },
            ..Self::good(vehicles, rounds)
        }
    }
}

/// What one vehicle measured of another.
#[derive(Clone, Copy, Debug)]
struct Sighting {
    from: usize,
    to: usize,
    observation: Observation,
}

/// Everything that happened.
#[derive(Clone, Debug)]
struct Flight {
    /// `[round][vehicle]`.
    truth: Vec<Vec<Pose>>,
    moments: Vec<Vec<Moment>>,
    sightings: Vec<Vec<Sighting>>,
}

impl Flight {
    fn fly(seed: u64, conditions: &Conditions) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let team = conditions.vehicles;
        let mut truth: Vec<Pose> = (0..team)
            .map(|vehicle| {
                let place =
                    Vector3::new(3.0 * (vehicle % 3) as f64, 3.0 * (vehicle / 3) as f64, 0.0);
                Transform::new(
                    so3::exp(&vector(&mut rng, 1.0)),
                    place + vector(&mut rng, 0.5),
                )
            })
            .collect();
        let mut odometry = vec![Transform::<Odometry, Body>::identity(); team];
        let mut growth = vec![Growth::zero(); team];
        let mut flight = Self {
            truth: Vec::new(),
            moments: Vec::new(),
            sightings: Vec::new(),
        };
        for round in 0..conditions.rounds {
            for vehicle in 0..team {
                if round == 0 {
                    break;
                }
                let ahead = Vector3::new(0.3, 0.0, 0.05) + vector(&mut rng, 0.05);
                let step = Transform::<Body, Body>::new(so3::exp(&vector(&mut rng, 0.2)), ahead);
                truth[vehicle] = truth[vehicle] * step;
                truth[vehicle].rotation.renormalize();
                let (rotation_rad, translation_m) = conditions.odometry;
                let mut said = step;
                if let Some((whose, short)) = conditions.short_odometer
                    && whose == vehicle
                {
                    said.translation /= 1.0 + short;
                }
                let error = Transform::<Body, Body>::new(
                    so3::exp(&(normal(&mut rng) * rotation_rad)),
                    normal(&mut rng) * translation_m,
                );
                odometry[vehicle] = odometry[vehicle] * said * error;
                odometry[vehicle].rotation.renormalize();
                growth[vehicle] = growth[vehicle].after(
                    &odometry[vehicle].translation,
                    rotation_rad,
                    translation_m,
                );
            }
            let instant = Stamp::from_nanos(PERIOD.as_nanos() * round as i64);
            let moment = |vehicle: usize| Moment {
                vehicle: id(vehicle),
                instant,
                point: OdometryPoint {
                    // Everybody's clock is another.
                    taken: instant + Span::secs(100 * vehicle as i64),
                    segment: 0,
                    odometry_from_body: odometry[vehicle],
                    growth: growth[vehicle],
                },
            };
            flight.moments.push((0..team).map(moment).collect());
            flight.truth.push(truth.clone());
            let mut sightings = Vec::new();
            for from in 0..team {
                for to in (0..team).filter(|to| *to != from) {
                    for kind in &conditions.kinds {
                        let ends = if conditions.levers {
                            (transform(&mut rng, 1.0, 0.3), transform(&mut rng, 1.0, 0.3))
                        } else {
                            (Transform::identity(), Transform::identity())
                        };
                        sightings.push(Sighting {
                            from,
                            to,
                            observation: observe(
                                &mut rng,
                                *kind,
                                &conditions.measurement,
                                (&truth[from], &truth[to]),
                                ends,
                            ),
                        });
                    }
                }
            }
            flight.sightings.push(sightings);
        }
        flight
    }

    /// A team that knows where everybody started.
    fn team(&self, settings: Settings) -> Team {
        let mut team = Team::new(id(0), PERIOD, settings);
        for (moment, truth) in self.moments[0].iter().zip(&self.truth[0]) {
            team.start(moment, moment, truth, 1e-4, 1e-4).unwrap();
        }
        team
    }

    fn tell(&self, team: &mut Team, sighting: &Sighting, round: usize) -> Result<(), Unused> {
        let moments = &self.moments[round];
        team.measured(
            &moments[sighting.from],
            &moments[sighting.to],
            &sighting.observation,
        )
    }

    /// A round as it was heard.
    fn hear(&self, team: &mut Team, round: usize) {
        for moment in &self.moments[round] {
            team.heard(moment).unwrap();
        }
        for sighting in &self.sightings[round] {
            let told = self.tell(team, sighting, round);
            assert!(
                matches!(told, Ok(()) | Err(Unused::Quarantined | Unused::LeftOut)),
                "{told:?}"
            );
        }
    }

    /// What one vehicle has nothing to do with.
    fn hear_all_but(&self, team: &mut Team, round: usize, silent: usize) {
        for moment in &self.moments[round] {
            if moment.vehicle != id(silent) {
                team.heard(moment).unwrap();
            }
        }
        for sighting in &self.sightings[round] {
            if sighting.from != silent && sighting.to != silent {
                let told = self.tell(team, sighting, round);
                assert!(matches!(told, Ok(()) | Err(Unused::LeftOut)), "{told:?}");
            }
        }
    }

    /// All rounds from one on.
    fn follow(&self, team: &mut Team, from: usize) {
        for round in from..self.moments.len() {
            self.hear(team, round);
            assert!(!team.solve().undetermined, "round {round}");
        }
    }

    fn own_error_m(&self, team: &Team, round: usize) -> f64 {
        let own = team.own().unwrap().world_from_body.translation;
        (own - self.truth[round][0].translation).norm()
    }
}

/// A measurement of two poses as a sensor with this noise takes it.
fn observe(
    rng: &mut ChaCha8Rng,
    kind: Kind,
    noise: &Noise,
    (from, to): (&Pose, &Pose),
    (from_end, to_end): (Transform<Body, Sensor>, Transform<Body, Sensor>),
) -> Observation {
    let seen: Transform<Sensor, Sensor> = (*from * from_end).inverse() * (*to * to_end);
    let turned: UnitQuaternion<f64> = seen.rotation * so3::exp(&(normal(rng) * noise.rotation_rad));
    let moved = seen.translation + normal(rng) * noise.translation;
    let tilt = so3::exp(&(normal(rng) * noise.rotation_rad));
    let measurement = match kind {
        Kind::Pose => Measurement::pose(Transform::new(turned, moved)),
        Kind::Orientation => Measurement::orientation(turned),
        Kind::Position => Measurement::position(moved),
        Kind::Bearing => Measurement::bearing(tilt * seen.translation.normalize()),
        Kind::Distance => {
            let error = normal(rng).x * noise.translation;
            Measurement::distance((seen.translation.norm() + error).abs())
        }
    };
    Observation {
        measurement: measurement.unwrap(),
        noise: *noise,
        from_end,
        to_end,
    }
}

/// Neither kernel nor gate, no biases, no floor: what is left is least squares.
fn least_squares(lag: u32) -> Settings {
    let none = BiasRange {
        start: 1e-9,
        room: 1e-9,
        held: 1e-9,
        walk: 0.0,
    };
    let mut settings = Settings::DEFAULT;
    settings.lag = Lag {
        usual: lag,
        several: lag,
        distances: lag,
        few: lag,
        many: lag,
    };
    settings.gate = 1e12;
    settings.cauchy = 1e12;
    settings.bias.gyro = none;
    settings.bias.scale = none;
    settings.odometry_floor = (0.0, 0.0);
    settings
}

impl Team {
    /// A round in which the noise is what it is said to be.
    fn solve_with_stated_noise(&mut self) -> Report {
        let report = self.solve();
        self.scales = NoiseScales::default();
        for member in self.window.members.values_mut() {
            member.scale = ScalePair::of_one();
        }
        report
    }
}
