//! A round of the team estimator with 4 and with 9 neighbours who all see each other, three rounds of lag, beside the
//! local step of a vehicle with the same neighbours and beside a dense solve of the same window.
#![allow(missing_docs, clippy::unwrap_used)]

mod dense;

use criterion::{BatchSize, BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::{Matrix6, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
use skein_estimation::cooperative::team::{Moment, Observation, Settings, Team};
use skein_estimation::cooperative::{
    Contact, Edge, Graph, Measurement, NodeIndex, Noise, Optimiser, Star, StarWorkspace, Weight,
};
use skein_estimation::odometry::{Growth, OdometryPoint};
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Odometry, Transform, VehicleId, World, so3};
use std::hint::black_box;
use std::time::Duration;

type Pose = Transform<World, Body>;

const PERIOD: Span = Span::millis(200);
/// Rounds after which the noise scales have settled and the window is full.
const STEADY_ROUNDS: usize = 60;
/// Rounds of the window: three of lag and the present one.
const WINDOW_ROUNDS: usize = 4;
/// Per round of odometry: rad and m per axis.
const ODOMETRY: (f64, f64) = (0.02, 0.005);
const NOISE: Noise = Noise {
    rotation_rad: 0.02,
    translation: 0.02,
};

/// Everything that was measured, `[round][vehicle]`.
struct Flight {
    truth: Vec<Vec<Pose>>,
    moments: Vec<Vec<Moment>>,
    /// `(from, to, what)`.
    sightings: Vec<Vec<(usize, usize, Observation)>>,
}

fn jitter(rng: &mut ChaCha8Rng, sigma: f64) -> Vector3<f64> {
    // Uniform, with this standard deviation.
    Vector3::from_fn(|_, _| sigma * 12f64.sqrt() * (rng.random::<f64>() - 0.5))
}

fn disturbed<To, From>(
    rng: &mut ChaCha8Rng,
    pose: &Transform<To, From>,
    (rotation_rad, translation_m): (f64, f64),
) -> Transform<To, From> {
    let (turn, shift) = (jitter(rng, rotation_rad), jitter(rng, translation_m));
    pose.retract(&turn, &(pose.rotation * shift))
}

impl Flight {
    /// Some vehicles on circles beside each other.
    fn fly(vehicles: usize) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let place = |vehicle: usize, round: usize| {
            let angle = vehicle as f64 + 0.1 * round as f64;
            let centre = Vector3::new(2.0 * (vehicle % 4) as f64, 2.0 * (vehicle / 4) as f64, 0.0);
            let around = Vector3::new(angle.cos(), angle.sin(), 0.1 * angle.sin());
            Pose::new(so3::exp(&Vector3::new(0.0, 0.1, angle)), centre + around)
        };
        let mut odometry = vec![Transform::<Odometry, Body>::identity(); vehicles];
        let mut growth = vec![Growth::zero(); vehicles];
        let mut flight = Self {
            truth: Vec::new(),
            moments: Vec::new(),
            sightings: Vec::new(),
        };
        for round in 0..=STEADY_ROUNDS {
            let truth: Vec<Pose> = (0..vehicles).map(|vehicle| place(vehicle, round)).collect();
            let instant = Stamp::from_nanos(PERIOD.as_nanos() * round as i64);
            let mut moments = Vec::new();
            for vehicle in 0..vehicles {
                if let Some(before) = flight.truth.last() {
                    let step = before[vehicle].inverse() * truth[vehicle];
                    odometry[vehicle] = odometry[vehicle] * disturbed(&mut rng, &step, ODOMETRY);
                    let position = odometry[vehicle].translation;
                    growth[vehicle] = growth[vehicle].after(&position, ODOMETRY.0, ODOMETRY.1);
                }
                moments.push(Moment {
                    vehicle: VehicleId(vehicle as u64 + 1),
                    instant,
                    point: OdometryPoint {
                        taken: instant,
                        segment: 0,
                        odometry_from_body: odometry[vehicle],
                        growth: growth[vehicle],
                    },
                });
            }
            let mut sightings = Vec::new();
            for from in 0..vehicles {
                for to in (0..vehicles).filter(|to| *to != from) {
                    let relative = (truth[from].inverse() * truth[to]).reframe();
                    let noise = (NOISE.rotation_rad, NOISE.translation);
                    let observation = Observation {
                        measurement: Measurement::pose(disturbed(&mut rng, &relative, noise))
                            .unwrap(),
                        noise: NOISE,
                        from_end: Transform::identity(),
                        to_end: Transform::identity(),
                    };
                    sightings.push((from, to, observation));
                }
            }
            flight.truth.push(truth);
            flight.moments.push(moments);
            flight.sightings.push(sightings);
        }
        flight
    }

    fn hear(&self, team: &mut Team, round: usize) {
        let moments = &self.moments[round];
        for moment in moments {
            team.heard(moment).unwrap();
        }
        for (from, to, observation) in &self.sightings[round] {
            // What is beyond the nearest is left out.
            let _ = team.measured(&moments[*from], &moments[*to], observation);
        }
    }

    /// The team before its last round.
    fn steady(&self, settings: Settings) -> Team {
        let mut team = Team::new(VehicleId(1), PERIOD, settings);
        for (moment, truth) in self.moments[0].iter().zip(&self.truth[0]) {
            team.start(moment, moment, truth, 1e-4, 1e-4).unwrap();
        }
        for round in 1..STEADY_ROUNDS {
            self.hear(&mut team, round);
            assert!(!team.solve().undetermined);
        }
        team
    }

    /// The last window as a graph: its first round is known, odometry ties the rounds. It has no biases and so is
    /// smaller than the team's.
    fn window(&self) -> Graph {
        let mut graph = Graph::new();
        let mut rng = ChaCha8Rng::seed_from_u64(6);
        let edge = |relative: Transform<_, _>, sigmas: (f64, f64)| {
            let (rotation, translation) = (sigmas.0.powi(-2), sigmas.1.powi(-2));
            let information = Matrix6::from_diagonal(&nalgebra::Vector6::new(
                rotation,
                rotation,
                rotation,
                translation,
                translation,
                translation,
            ));
            Edge::new(
                Measurement::pose(relative).unwrap(),
                Weight::Information(information),
            )
            .unwrap()
        };
        let rounds = STEADY_ROUNDS + 1 - WINDOW_ROUNDS..=STEADY_ROUNDS;
        let mut before: Vec<NodeIndex> = Vec::new();
        for round in rounds {
            let truth = &self.truth[round];
            let nodes: Vec<NodeIndex> = truth
                .iter()
                .map(|pose| {
                    graph
                        .add_node(disturbed(&mut rng, pose, (0.01, 0.02)))
                        .unwrap()
                })
                .collect();
            for (vehicle, node) in nodes.iter().enumerate() {
                if let Some(from) = before.get(vehicle) {
                    let of = |round: usize| self.moments[round][vehicle].point.odometry_from_body;
                    let step = of(round - 1).inverse() * of(round);
                    graph
                        .add_edge(*from, *node, edge(step.reframe(), ODOMETRY))
                        .unwrap();
                } else {
                    let known = edge(truth[vehicle].reframe(), (0.02, 0.05));
                    graph.add_edge(NodeIndex::REFERENCE, *node, known).unwrap();
                }
            }
            for (from, to, observation) in &self.sightings[round] {
                let seen = Edge::new(observation.measurement, Weight::Noise(NOISE)).unwrap();
                graph.add_edge(nodes[*from], nodes[*to], seen).unwrap();
            }
            before = nodes;
        }
        graph
    }

    /// What the paper's local step has of the last round.
    fn fill(&self, star: &mut Star) {
        let mut rng = ChaCha8Rng::seed_from_u64(7);
        let truth = &self.truth[STEADY_ROUNDS];
        let end = Transform::identity();
        star.restart(disturbed(&mut rng, &truth[0], (0.02, 0.05)))
            .unwrap();
        let neighbours: Vec<_> = truth[1..]
            .iter()
            .map(|pose| {
                let prior = disturbed(&mut rng, pose, (0.02, 0.05));
                star.add_neighbour(prior, Contact::FRESH).unwrap()
            })
            .collect();
        for (from, to, observation) in &self.sightings[STEADY_ROUNDS] {
            let measurement = observation.measurement;
            if *from == 0 {
                star.measured_by_me(neighbours[to - 1], measurement, Noise::UNIT, end, end)
                    .unwrap();
            } else if *to == 0 {
                star.measured_by_neighbour(
                    neighbours[from - 1],
                    measurement,
                    Noise::UNIT,
                    end,
                    end,
                )
                .unwrap();
            }
        }
    }
}

fn round(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("team");
    group
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2))
        .sample_size(30);
    for neighbours in [4, 9] {
        let flight = Flight::fly(neighbours + 1);
        let everybody = Settings {
            nearest: neighbours,
            ..Settings::DEFAULT
        };
        let mut all = vec![("round", Settings::DEFAULT)];
        if neighbours > Settings::DEFAULT.nearest {
            all.push(("round, nobody left out", everybody));
        }
        for (name, settings) in all {
            let steady = flight.steady(settings);
            let mut after = steady.clone();
            flight.hear(&mut after, STEADY_ROUNDS);
            after.solve();
            let own = after.own().unwrap().world_from_body.translation;
            let error_m = (own - flight.truth[STEADY_ROUNDS][0].translation).norm();
            eprintln!(
                "{neighbours} neighbours, {name}: {:?}, {error_m:.3} m off",
                after.statistics()
            );
            group.bench_function(BenchmarkId::new(name, neighbours), |bencher| {
                bencher.iter_batched_ref(
                    || steady.clone(),
                    |team| {
                        flight.hear(team, STEADY_ROUNDS);
                        team.solve()
                    },
                    BatchSize::SmallInput,
                );
            });
        }
        let graph = flight.window();
        let iterations = Settings::DEFAULT.iterations;
        group.bench_function(BenchmarkId::new("dense", neighbours), |bencher| {
            bencher.iter(|| {
                let (nodes, _) = dense::gauss_newton(black_box(&graph), 0.0, iterations);
                let (hessian, _) = dense::normal_equations(&graph, &nodes);
                hessian.cholesky().unwrap().inverse()
            });
        });
        let mut star = Star::new(flight.truth[STEADY_ROUNDS][0]).unwrap();
        let mut workspace = StarWorkspace::new();
        group.bench_function(BenchmarkId::new("star", neighbours), |bencher| {
            bencher.iter(|| {
                flight.fill(&mut star);
                star.solve(&mut workspace, black_box(&Optimiser::gauss_newton()))
            });
        });
    }
    group.finish();
}

criterion_group!(benches, round);
criterion_main!(benches);
