//! What a graph takes and what it refuses.

use nalgebra::{UnitQuaternion, Vector3};

use super::*;
use crate::cooperative::measurement::{Kind, Noise};

fn two_nodes() -> (Graph, NodeIndex, NodeIndex) {
    let mut graph = Graph::new();
    let a = graph.add_node(Transform::identity()).unwrap();
    let b = graph
        .add_node(Transform::new(UnitQuaternion::identity(), Vector3::x()))
        .unwrap();
    (graph, a, b)
}

fn distance(metres: f64, translation: f64) -> Edge {
    let noise = Noise {
        rotation_rad: 1.0,
        translation,
    };
    Edge::new(Measurement::distance(metres).unwrap(), Weight::Noise(noise)).unwrap()
}

#[test]
fn measurements_that_exclude_each_other_are_refused() {
    let (mut graph, a, b) = two_nodes();
    graph.add_edge(a, b, distance(1.0, 0.01)).unwrap();
    graph.add_edge(a, b, distance(1.1, 0.01)).unwrap();
    let refused = graph.add_edge(a, b, distance(3.0, 0.01));
    assert!(
        matches!(refused, Err(Refusal::Contradicts { kind: Kind::Distance, sigmas }) if sigmas > 100.0)
    );
    // The other direction is another sensor; a wide one excludes nothing.
    graph.add_edge(b, a, distance(3.0, 0.01)).unwrap();
    graph.add_edge(a, b, distance(3.0, 1.0)).unwrap();
    assert_eq!(graph.edges().len(), 4);
}

#[test]
fn another_lever_arm_is_another_measurement() {
    let (mut graph, a, b) = two_nodes();
    graph.add_edge(a, b, distance(1.0, 0.01)).unwrap();
    let ahead = Transform::new(UnitQuaternion::identity(), Vector3::new(2.0, 0.0, 0.0));
    let far = *distance(3.0, 0.01).measurement();
    let weight = Weight::Noise(Noise {
        rotation_rad: 1.0,
        translation: 0.01,
    });
    graph
        .add_edge(a, b, Edge::with_offsets(far, weight, ahead, ahead).unwrap())
        .unwrap();
}

#[test]
fn an_edge_needs_two_nodes_that_exist() {
    let (mut graph, a, _) = two_nodes();
    assert_eq!(
        graph.add_edge(a, a, distance(1.0, 0.1)),
        Err(Refusal::SameNode)
    );
    let (other, _, _) = two_nodes();
    let mut larger = other;
    let stranger = larger.add_node(Transform::identity()).unwrap();
    assert_eq!(
        graph.add_edge(a, stranger, distance(1.0, 0.1)),
        Err(Refusal::UnknownNode { index: 3 })
    );
    assert_eq!(graph.hold(stranger), Err(Refusal::UnknownNode { index: 3 }));
}

#[test]
fn a_pose_that_is_none_is_refused() {
    let nowhere = Transform::new(UnitQuaternion::identity(), Vector3::new(0.0, f64::NAN, 0.0));
    assert!(matches!(
        Graph::new().add_node(nowhere),
        Err(Refusal::NotFinite { .. })
    ));
}
