//! The centralised solver on small graphs whose answer is known.

use std::f64::consts::PI;

use nalgebra::{UnitQuaternion, Vector3};
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::*;
use crate::cooperative::edge::{Edge, Weight};
use crate::cooperative::graph::NodeIndex;
use crate::cooperative::measurement::{Measurement, Noise};
use crate::so3;
use crate::transform::{Sensor, Transform};

const SEED: u64 = 3;

fn vector(rng: &mut ChaCha8Rng, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-size..size))
}

fn pose(rng: &mut ChaCha8Rng, angle: f64, size: f64) -> Node {
    Node::new(so3::exp(&vector(rng, angle)), vector(rng, size))
}

fn apart(a: &Node, b: &Node) -> f64 {
    a.rotation
        .angle_to(&b.rotation)
        .max((a.translation - b.translation).norm())
}

/// A chain of true poses with pose edges along it, closures of every kind, and guesses that are off.
fn history(rng: &mut ChaCha8Rng, length: usize, weight: Weight) -> (Graph, Vec<Node>) {
    let mut graph = Graph::new();
    let truth: Vec<Node> = (0..length).map(|_| pose(rng, 0.8, 5.0)).collect();
    for (k, node) in truth.iter().enumerate() {
        let off = pose(rng, 0.2, 0.5);
        let guess = Node::new(
            node.rotation * off.rotation,
            node.translation + off.translation,
        );
        let index = graph.add_node(if k == 0 { *node } else { guess }).unwrap();
        if k == 0 {
            graph.hold(index).unwrap();
        }
    }
    let seen = |a: usize, b: usize| -> Transform<Sensor, Sensor> {
        (truth[a].inverse() * truth[b]).reframe()
    };
    let names: Vec<NodeIndex> = graph.indices().skip(1).collect();
    let mut tie = |a: usize, b: usize, measurement: Measurement| {
        graph
            .add_edge(names[a], names[b], Edge::new(measurement, weight).unwrap())
            .unwrap();
    };
    for k in 1..length {
        tie(k - 1, k, Measurement::pose(seen(k - 1, k)).unwrap());
    }
    for k in 0..length {
        let other = (k * 5 + 3) % length;
        if other == k {
            continue;
        }
        let relative = seen(k, other);
        tie(
            k,
            other,
            match k % 5 {
                0 => Measurement::pose(relative).unwrap(),
                1 => Measurement::orientation(relative.rotation).unwrap(),
                2 => Measurement::position(relative.translation).unwrap(),
                3 => Measurement::bearing(relative.translation.normalize()).unwrap(),
                _ => Measurement::distance(relative.translation.norm()).unwrap(),
            },
        );
    }
    (graph, truth)
}

#[test]
fn a_history_of_all_kinds_comes_back_to_the_truth_by_both_optimisers() {
    let noise = Weight::Noise(Noise {
        rotation_rad: 0.5,
        translation: 0.7,
    });
    for weight in [Weight::Unit, noise] {
        // Descent needs tens of thousands of iterations on a longer chain.
        for (optimiser, length) in [(Optimiser::gauss_newton(), 40), (Optimiser::descent(), 4)] {
            let mut rng = ChaCha8Rng::seed_from_u64(SEED);
            let (mut graph, truth) = history(&mut rng, length, weight);
            let solution = solve(&mut graph, &optimiser, |_| ());
            assert!(
                solution.status.is_settled(),
                "{optimiser:?}: {:?}",
                solution.status
            );
            assert!(
                solution.cost_after < 1e-8,
                "{optimiser:?}: {}",
                solution.cost_after
            );
            for (node, truth) in graph.nodes()[1..].iter().zip(&truth) {
                assert!(
                    apart(node, truth) < 1e-3,
                    "{optimiser:?}: {}",
                    apart(node, truth)
                );
            }
        }
    }
}

#[test]
fn the_cost_falls_with_every_accepted_iteration() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let (mut graph, _) = history(&mut rng, 30, Weight::Unit);
    let mut costs = Vec::new();
    let solution = solve(&mut graph, &Optimiser::gauss_newton(), |progress| {
        costs.push(progress.cost)
    });
    assert_eq!(costs.len(), solution.iterations + 1);
    assert!(costs.windows(2).all(|pair| pair[1] <= pair[0]), "{costs:?}");
    assert!((graph.cost() - solution.cost_after).abs() < 1e-15);
}

#[test]
fn a_graph_that_hangs_on_nothing_stays_finite_and_says_so() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let mut graph = Graph::new();
    let nodes: Vec<NodeIndex> = (0..4)
        .map(|_| graph.add_node(pose(&mut rng, 1.0, 3.0)).unwrap())
        .collect();
    let seen = Measurement::pose(Transform::new(UnitQuaternion::identity(), Vector3::x())).unwrap();
    graph
        .add_edge(nodes[0], nodes[1], Edge::new(seen, Weight::Unit).unwrap())
        .unwrap();
    let lonely = *graph.pose(nodes[3]).unwrap();
    let solution = solve(&mut graph, &Optimiser::gauss_newton(), |_| ());
    assert_eq!(
        solution.status,
        SolveStatus::Degenerate(Degeneracy::Unobservable)
    );
    assert!(solution.cost_after < 1e-12);
    assert_eq!(*graph.pose(nodes[3]).unwrap(), lonely);
}

#[test]
fn coincident_ends_and_half_turns_are_said() {
    let node = Node::new(UnitQuaternion::identity(), Vector3::new(1.0, 1.0, 1.0));
    let turned = Node::new(so3::exp(&Vector3::new(0.0, 0.0, PI)), node.translation);
    let cases = [
        (
            node,
            Measurement::distance(2.0).unwrap(),
            Degeneracy::CoincidentEnds,
        ),
        (
            node,
            Measurement::bearing(Vector3::x()).unwrap(),
            Degeneracy::CoincidentEnds,
        ),
        (
            turned,
            Measurement::orientation(UnitQuaternion::identity()).unwrap(),
            Degeneracy::OppositeOrientation,
        ),
    ];
    for (other, measurement, degeneracy) in cases {
        for optimiser in [
            Optimiser::gauss_newton().with_iterations_max(1),
            Optimiser::descent(),
        ] {
            let mut graph = Graph::new();
            let a = graph.add_node(node).unwrap();
            let b = graph.add_node(other).unwrap();
            graph.hold(a).unwrap();
            graph.hold(b).unwrap();
            graph
                .add_edge(a, b, Edge::new(measurement, Weight::Unit).unwrap())
                .unwrap();
            let solution = solve(&mut graph, &optimiser, |_| ());
            assert_eq!(
                solution.status,
                SolveStatus::Degenerate(degeneracy),
                "{optimiser:?}"
            );
        }
    }
}

#[test]
fn an_empty_graph_is_its_own_answer() {
    let mut graph = Graph::new();
    assert_eq!(
        solve(&mut graph, &Optimiser::descent(), |_| ()).status,
        SolveStatus::NothingMeasured
    );
}

#[test]
fn a_fix_with_a_lever_arm_places_a_node() {
    // Orientation fixed from the reference, the antenna 1 m ahead of the body seen at (3, 0, 0).
    let mut graph = Graph::new();
    let node = graph
        .add_node(Node::new(
            so3::exp(&Vector3::new(0.1, 0.0, 0.0)),
            Vector3::zeros(),
        ))
        .unwrap();
    let antenna = Transform::new(UnitQuaternion::identity(), Vector3::x());
    let upright = Measurement::orientation(UnitQuaternion::identity()).unwrap();
    let at = Measurement::position(Vector3::new(3.0, 0.0, 0.0)).unwrap();
    graph
        .add_fix(node, upright, Weight::Unit, Transform::identity())
        .unwrap();
    graph.add_fix(node, at, Weight::Unit, antenna).unwrap();
    let solution = solve(&mut graph, &Optimiser::gauss_newton(), |_| ());
    assert_eq!(solution.status, SolveStatus::Converged);
    assert!(
        apart(
            graph.pose(node).unwrap(),
            &Node::new(UnitQuaternion::identity(), Vector3::new(2.0, 0.0, 0.0))
        ) < 1e-7
    );
}
