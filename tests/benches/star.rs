//! The local step of one vehicle with 1 to 8 neighbours: Gauss-Newton and the paper's descent by the star's Schur
//! elimination, each from the priors and from warm ones, beside a dense solve of the same star.
#![allow(missing_docs, clippy::unwrap_used)]

mod dense;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use skein_estimation::cooperative::{
    Contact, Edge, Graph, Measurement, NodeIndex, Noise, Optimiser, Star, StarWorkspace, Weight,
};
use skein_estimation::{Body, Sensor, Transform, World, so3};
use std::hint::black_box;
use std::time::Duration;

type Pose = Transform<World, Body>;
type Seen = Transform<Sensor, Sensor>;

/// A round as its pieces: priors that are off by some centimetres and degrees, and what either measured of the other.
struct Round {
    own: Pose,
    /// Prior of a neighbour, `centre_from_neighbour` as the centre saw it, and the inverse as the neighbour saw it.
    neighbours: Vec<(Pose, Seen, Seen)>,
}

/// A small number that is another for every `n`.
fn jitter(n: usize, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| size * (12.9898 * (3 * n + axis + 1) as f64).sin())
}

fn perturbed(pose: &Pose, n: usize, turn_rad: f64, shift_m: f64) -> Pose {
    pose.retract(&jitter(n, turn_rad), &jitter(n + 100, shift_m))
}

impl Round {
    /// Priors after one period of section V's odometry: 0.02 rad and some centimetres off.
    fn of(neighbours: usize) -> Self {
        let centre = Pose::new(
            so3::exp(&Vector3::new(0.1, 0.2, 0.3)),
            Vector3::new(1.0, 2.0, 3.0),
        );
        let neighbour = |n: usize| {
            let angle = n as f64;
            let place = Vector3::new(
                1.0 + 3.0 * angle.cos(),
                2.0 + 3.0 * angle.sin(),
                3.0 + 0.4 * angle,
            );
            let truth = Pose::new(so3::exp(&Vector3::new(-0.1, 0.1, angle)), place);
            let seen: Pose = (centre.inverse() * truth).reframe();
            let seen_back: Pose = (truth.inverse() * centre).reframe();
            let measured = |pose: Pose, n| perturbed(&pose, n, 0.02, 0.001).reframe();
            (
                perturbed(&truth, n + 1, 0.03, 0.08),
                measured(seen, n + 200),
                measured(seen_back, n + 300),
            )
        };
        Self {
            own: perturbed(&centre, 0, 0.03, 0.08),
            neighbours: (0..neighbours).map(neighbour).collect(),
        }
    }

    /// Fills a star as a vehicle does in every round.
    fn fill(&self, star: &mut Star) {
        star.restart(self.own).unwrap();
        let end = Transform::identity();
        for (prior, mine, theirs) in &self.neighbours {
            let neighbour = star.add_neighbour(*prior, Contact::FRESH).unwrap();
            star.measured_by_me(
                neighbour,
                Measurement::pose(*mine).unwrap(),
                Noise::UNIT,
                end,
                end,
            )
            .unwrap();
            star.measured_by_neighbour(
                neighbour,
                Measurement::pose(*theirs).unwrap(),
                Noise::UNIT,
                end,
                end,
            )
            .unwrap();
        }
    }

    /// The same as a graph: each prior is a pose edge from the reference.
    fn graph(&self) -> Graph {
        let mut graph = Graph::new();
        let edge = |relative: Transform<Sensor, Sensor>| {
            Edge::new(Measurement::pose(relative).unwrap(), Weight::Unit).unwrap()
        };
        let mut add = |prior: Pose| {
            let node = graph.add_node(prior).unwrap();
            graph
                .add_edge(NodeIndex::REFERENCE, node, edge(prior.reframe()))
                .unwrap();
            node
        };
        let centre = add(self.own);
        let others: Vec<NodeIndex> = self
            .neighbours
            .iter()
            .map(|(prior, ..)| add(*prior))
            .collect();
        for (other, (_, mine, theirs)) in others.into_iter().zip(&self.neighbours) {
            graph.add_edge(centre, other, edge(*mine)).unwrap();
            graph.add_edge(other, centre, edge(*theirs)).unwrap();
        }
        graph
    }
}

fn local_step(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("star");
    group
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_millis(900))
        .sample_size(30);
    for neighbours in [1, 2, 4, 8] {
        let round = Round::of(neighbours);
        let mut star = Star::new(round.own).unwrap();
        let mut workspace = StarWorkspace::new();
        group.bench_function(BenchmarkId::new("fill alone", neighbours), |bencher| {
            bencher.iter(|| black_box(&round).fill(&mut star));
        });
        let mut answers = Vec::new();
        for (name, optimiser) in [
            ("gauss_newton", Optimiser::gauss_newton()),
            ("descent", Optimiser::descent()),
        ] {
            round.fill(&mut star);
            let solution = star.solve(&mut workspace, &optimiser);
            eprintln!(
                "{neighbours} neighbours, {name}: {:?} after {} iterations",
                solution.status, solution.iterations
            );
            answers.push(solution.world_from_body);
            group.bench_function(BenchmarkId::new(name, neighbours), |bencher| {
                bencher.iter(|| {
                    round.fill(&mut star);
                    star.solve(&mut workspace, black_box(&optimiser))
                });
            });
        }
        let step_norm_max = 1e-6;
        let (nodes, iterations) = dense::gauss_newton(&round.graph(), step_norm_max, 50);
        eprintln!("{neighbours} neighbours, dense: {iterations} iterations");
        answers.push(nodes[1]);
        for answer in &answers {
            let apart = (answer.translation - answers[0].translation).norm();
            assert!(apart < 1e-3, "all three give one answer: {apart} m apart");
        }
        group.bench_function(BenchmarkId::new("dense", neighbours), |bencher| {
            bencher.iter(|| dense::gauss_newton(&black_box(&round).graph(), step_norm_max, 50));
        });
    }
    group.finish();
}

criterion_group!(benches, local_step);
criterion_main!(benches);
