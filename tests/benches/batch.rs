//! The centralised solve against size: histories of teams in a grid, of the kind of section V, beside a dense solve of
//! the same graph where it is small enough.
#![allow(missing_docs, clippy::unwrap_used)]

mod dense;

use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use nalgebra::Vector3;
use skein_estimation::cooperative::{
    Edge, Graph, Measurement, NodeIndex, Optimiser, Weight, solve,
};
use skein_estimation::{Body, Sensor, Transform, World, so3};
use std::hint::black_box;
use std::time::Duration;

type Pose = Transform<World, Body>;

const ROBOTS: usize = 5;

fn jitter(n: usize, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| size * (12.9898 * (3 * n + axis + 1) as f64).sin())
}

/// A history of five robots over some rounds: odometry from round to round, and every neighbouring pair measures each
/// other in every round. The initial poses are dead reckoning; the first ones are known.
fn history(rounds: usize) -> Graph {
    let mut graph = Graph::new();
    let truth = |robot: usize, round: usize| {
        let (t, lane) = (round as f64, robot as f64);
        Pose::new(
            so3::exp(&Vector3::new(0.2 * (0.3 * t).sin(), 0.1, 0.2 * t)),
            Vector3::new(0.2 * t, 2.0 * lane + (0.5 * t).sin(), lane),
        )
    };
    let noisy =
        |relative: Pose, n: usize| relative.retract(&jitter(n, 0.02), &jitter(n + 7, 0.001));
    let edge = |relative: Pose| {
        let relative: Transform<Sensor, Sensor> = relative.reframe();
        Edge::new(Measurement::pose(relative).unwrap(), Weight::Unit).unwrap()
    };
    let mut last: Vec<(NodeIndex, Pose)> = Vec::new();
    for round in 0..rounds {
        let mut these = Vec::new();
        for robot in 0..ROBOTS {
            let n = round * ROBOTS + robot;
            if let Some((before, reckoned)) = last.get(robot) {
                let motion = noisy(
                    (truth(robot, round - 1).inverse() * truth(robot, round)).reframe(),
                    n,
                );
                let here: Pose = (*reckoned * motion.reframe::<Body, Body>()).reframe();
                let node = graph.add_node(here).unwrap();
                graph.add_edge(*before, node, edge(motion)).unwrap();
                these.push((node, here));
            } else {
                let node = graph.add_node(truth(robot, 0)).unwrap();
                graph
                    .add_edge(NodeIndex::REFERENCE, node, edge(truth(robot, 0)))
                    .unwrap();
                these.push((node, truth(robot, 0)));
            }
            if robot > 0 {
                let (a, b) = (truth(robot - 1, round), truth(robot, round));
                let (a_node, b_node) = (these[robot - 1].0, these[robot].0);
                graph
                    .add_edge(
                        a_node,
                        b_node,
                        edge(noisy((a.inverse() * b).reframe(), n + 1_000)),
                    )
                    .unwrap();
                graph
                    .add_edge(
                        b_node,
                        a_node,
                        edge(noisy((b.inverse() * a).reframe(), n + 2_000)),
                    )
                    .unwrap();
            }
        }
        last = these;
    }
    graph
}

fn centralised(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("batch");
    group
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_millis(1_500))
        .sample_size(10);
    for rounds in [4, 10, 20, 100, 400] {
        let graph = history(rounds);
        let poses = graph.nodes().len() - 1;
        let mut solved = graph.clone();
        let answer = solve(&mut solved, &Optimiser::gauss_newton(), |_| ());
        eprintln!("{poses} poses, sparse: {answer:?}");
        group.bench_function(BenchmarkId::new("sparse", poses), |bencher| {
            bencher.iter_batched_ref(
                || graph.clone(),
                |graph| solve(graph, black_box(&Optimiser::gauss_newton()), |_| ()),
                criterion::BatchSize::LargeInput,
            );
        });
        if poses > 100 {
            continue;
        }
        let (nodes, iterations) = dense::gauss_newton(&graph, 1e-6, 50);
        eprintln!("{poses} poses, dense: {iterations} iterations");
        for (dense, sparse) in nodes.iter().zip(solved.nodes()) {
            assert!(
                (dense.translation - sparse.translation).norm() < 1e-3,
                "both give one answer"
            );
        }
        group.bench_function(BenchmarkId::new("dense", poses), |bencher| {
            bencher.iter(|| dense::gauss_newton(black_box(&graph), 1e-6, 50));
        });
    }
    group.finish();
}

criterion_group!(benches, centralised);
criterion_main!(benches);
