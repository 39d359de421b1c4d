//! Offsets and weights of edges: the parts of the normal equations must be derivatives of the cost at the nodes.

use std::f64::consts::{FRAC_PI_2, PI};

use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

use super::*;

const SEED: u64 = 11;

fn vector(rng: &mut ChaCha8Rng, size: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| rng.random_range(-size..size))
}

fn node<To, From>(rng: &mut ChaCha8Rng, angle: f64, size: f64) -> Transform<To, From> {
    Transform::new(
        so3::exp(&(vector(rng, 1.0).normalize() * angle)),
        vector(rng, size),
    )
}

/// One edge of each kind and weight, between ends that disagree by `turn`.
fn edges(rng: &mut ChaCha8Rng, from: &Node, to: &Node, turn: f64, offsets: bool) -> Vec<Edge> {
    let mut offset = || {
        if offsets {
            node::<Body, Sensor>(rng, 0.7, 0.5)
        } else {
            Transform::identity()
        }
    };
    let (from_offset, to_offset) = (offset(), offset());
    let truth = (*from * from_offset).inverse() * (*to * to_offset);
    let seen = truth * node(rng, turn, 0.3);
    let direction = seen
        .translation
        .try_normalize(1e-12)
        .unwrap_or(Vector3::x());
    let measurements = [
        Measurement::pose(seen).unwrap(),
        Measurement::orientation(seen.rotation).unwrap(),
        Measurement::position(seen.translation).unwrap(),
        Measurement::bearing(direction).unwrap(),
        Measurement::distance(seen.translation.norm()).unwrap(),
    ];
    let root = Matrix6::from_fn(|_, _| rng.random_range(-1.0..1.0));
    let information = root * root.transpose();
    let noise = Weight::Noise(Noise {
        rotation_rad: 0.5,
        translation: 0.25,
    });
    let mut all = vec![
        Edge::with_offsets(
            measurements[0],
            Weight::Information(information),
            from_offset,
            to_offset,
        )
        .unwrap(),
    ];
    for measurement in measurements {
        for weight in [Weight::Unit, noise] {
            all.push(Edge::with_offsets(measurement, weight, from_offset, to_offset).unwrap());
        }
    }
    all
}

fn moved(pose: &Node, k: usize, step: f64) -> Node {
    let mut by = [0.0; 6];
    by[k] = step;
    pose.retract(
        &Vector3::new(by[0], by[1], by[2]),
        &Vector3::new(by[3], by[4], by[5]),
    )
}

/// The gradient is the numeric derivative of the cost, and the normal equations hold the same gradient and cost.
fn check_edge(edge: &Edge, from: &Node, to: &Node, step: f64, tolerance: f64) {
    let gradient = edge.gradient(from, to);
    let (normal, cost) = edge.linearise(from, to);
    let about = format!("seed {SEED}, {:?}, {:?}", edge.measurement(), edge.weight());
    assert!(
        (cost - edge.cost(from, to)).abs() <= 1e-12 * (1.0 + cost),
        "{about}"
    );
    let size = 1.0 + normal.from.norm() + normal.to.norm();
    assert!(
        (2.0 * normal.from - gradient.from).norm() < 1e-10 * size,
        "{about}"
    );
    assert!(
        (2.0 * normal.to - gradient.to).norm() < 1e-10 * size,
        "{about}"
    );
    for k in 0..6 {
        let by_from = edge.cost(&moved(from, k, step), to) - edge.cost(&moved(from, k, -step), to);
        let by_to = edge.cost(from, &moved(to, k, step)) - edge.cost(from, &moved(to, k, -step));
        assert!(
            (by_from / (2.0 * step) - gradient.from[k]).abs() < tolerance * size,
            "{about}, from {k}"
        );
        assert!(
            (by_to / (2.0 * step) - gradient.to[k]).abs() < tolerance * size,
            "{about}, to {k}"
        );
    }
}

#[test]
fn gradients_pass_through_the_offsets_at_random_poses() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    for round in 0..40 {
        let (angle, turn) = (rng.random_range(0.0..PI), rng.random_range(0.0..2.5));
        let (from, to) = (node(&mut rng, angle, 5.0), node(&mut rng, angle, 5.0));
        for edge in edges(&mut rng, &from, &to, turn, round % 4 != 0) {
            check_edge(&edge, &from, &to, 1e-6, 1e-7);
        }
    }
}

#[test]
fn gradients_pass_through_the_offsets_near_zero_and_near_half_a_turn() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    for turn in [0.0, 1e-9, 1e-5, PI - 1e-2, PI - 1e-4] {
        let (from, to) = (node(&mut rng, turn, 5.0), node(&mut rng, 1.0, 5.0));
        for edge in edges(&mut rng, &from, &to, turn, true) {
            check_edge(&edge, &from, &to, 1e-6, 1e-6);
        }
    }
}

#[test]
fn gradients_pass_through_the_offsets_near_coincidence() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    for distance in [1e-2, 1e-4] {
        let from: Node = node(&mut rng, 1.0, 5.0);
        let mut to: Node = node(&mut rng, 1.0, 5.0);
        to.translation = from.translation + Vector3::new(distance, 0.0, 0.0);
        for edge in edges(&mut rng, &from, &to, 0.5, false) {
            check_edge(&edge, &from, &to, 1e-4 * distance, 1e-4);
        }
    }
}

#[test]
fn the_normal_matrix_is_that_of_the_jacobian() {
    // H = J^T W J, J by differences of the residual at the nodes, for a pose in product form.
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let (from, to): (Node, Node) = (node(&mut rng, 1.0, 5.0), node(&mut rng, 2.0, 5.0));
    let all = edges(&mut rng, &from, &to, 0.8, true);
    let edge = all
        .iter()
        .find(|e| e.measurement.kind() == Kind::Pose && *e.weight() == Weight::Unit)
        .unwrap();
    let Measurement::Pose(pose) = edge.measurement() else {
        unreachable!()
    };
    let residual = |from: &Node, to: &Node| {
        pose.residual(&(*from * *edge.from_offset()), &(*to * *edge.to_offset()))
    };
    let (mut by_from, mut by_to) = (Matrix6::zeros(), Matrix6::zeros());
    for k in 0..6 {
        let h = 1e-6;
        by_from.set_column(
            k,
            &((residual(&moved(&from, k, h), &to) - residual(&moved(&from, k, -h), &to))
                / (2.0 * h)),
        );
        by_to.set_column(
            k,
            &((residual(&from, &moved(&to, k, h)) - residual(&from, &moved(&to, k, -h)))
                / (2.0 * h)),
        );
    }
    let (normal, _) = edge.linearise(&from, &to);
    assert!((normal.from_from - by_from.transpose() * by_from).norm() < 1e-7);
    assert!((normal.from_to - by_from.transpose() * by_to).norm() < 1e-7);
    assert!((normal.to_to - by_to.transpose() * by_to).norm() < 1e-7);
}

#[test]
fn a_lever_arm_by_hand() {
    // A node at the origin turned a quarter about z, its antenna 1 m ahead: the antenna is at (0, 1, 0). Turning the
    // node by w about z moves the antenna by -w along x. Seen from the world's origin at (0.5, 1, 0).
    let antenna = Transform::new(UnitQuaternion::identity(), Vector3::x());
    let seen = Measurement::position(Vector3::new(0.5, 1.0, 0.0)).unwrap();
    let fix = Edge::with_offsets(seen, Weight::Unit, Transform::identity(), antenna).unwrap();
    let node = Node::new(
        so3::exp(&Vector3::new(0.0, 0.0, FRAC_PI_2)),
        Vector3::zeros(),
    );
    assert!((fix.cost(&Node::identity(), &node) - 0.25).abs() < 1e-15);
    // r = (0.5, 0, 0); dr/dw_z = (1, 0, 0); dr/ddelta = -I: gradient of r.r is (0,0,1, -1,0,0).
    let gradient = fix.gradient(&Node::identity(), &node);
    assert!((gradient.to - Vector6::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0)).norm() < 1e-14);
}

#[test]
fn weights_that_cannot_be_are_refused() {
    let distance = Measurement::distance(1.0).unwrap();
    let pose = Measurement::pose(Transform::identity()).unwrap();
    let identity = Matrix6::identity();
    let of_another = Edge::new(distance, Weight::Information(identity));
    assert_eq!(
        of_another,
        Err(Refusal::WeightOfAnotherKind {
            kind: Kind::Distance
        })
    );
    assert_eq!(
        Edge::new(pose, Weight::Information(-identity)),
        Err(Refusal::BadWeight)
    );
    assert_eq!(
        Edge::new(pose, Weight::Information(identity * f64::NAN)),
        Err(Refusal::BadWeight)
    );
    let mut skew = identity;
    skew[(0, 1)] = 0.5;
    assert_eq!(
        Edge::new(pose, Weight::Information(skew)),
        Err(Refusal::BadWeight)
    );
    assert!(Edge::new(pose, Weight::Information(Matrix6::zeros())).is_ok());
    let silent = Weight::Noise(Noise {
        rotation_rad: 0.1,
        translation: 0.0,
    });
    assert_eq!(
        Edge::new(distance, silent),
        Err(Refusal::BadNoise {
            kind: Kind::Distance
        })
    );
}

#[test]
fn the_share_of_the_gradient_is_the_slope_of_the_robust_cost() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let scale = Scale {
        rotation_rad: 0.3,
        translation_m: 0.5,
    };
    for round in 0..20 {
        let turn = rng.random_range(0.0..2.0);
        let (from, to) = (node(&mut rng, 1.0, 5.0), node(&mut rng, 1.0, 5.0));
        for edge in edges(&mut rng, &from, &to, turn, round % 4 != 0) {
            if matches!(edge.weight(), Weight::Information(_)) {
                continue;
            }
            let judged = edge.judged(&scale, &from, &to);
            let mut normal = Normal::zero();
            edge.add_share_linearised(&from, &to, judged.share, &mut normal.sums());
            let size = 1.0 + normal.from.norm() + normal.to.norm();
            for k in 0..6 {
                let h = 1e-6;
                let cost = |from: &Node, to: &Node| edge.judged(&scale, from, to).cost;
                let by_from = cost(&moved(&from, k, h), &to) - cost(&moved(&from, k, -h), &to);
                let by_to = cost(&from, &moved(&to, k, h)) - cost(&from, &moved(&to, k, -h));
                let about = format!("seed {SEED}, {:?}, {k}", edge.measurement());
                let off_from = (by_from / (2.0 * h) - 2.0 * normal.from[k]).abs();
                let off_to = (by_to / (2.0 * h) - 2.0 * normal.to[k]).abs();
                assert!(off_from < 1e-6 * size && off_to < 1e-6 * size, "{about}");
            }
        }
    }
}

#[test]
fn wrong_orientation_takes_the_position_of_a_pose_with_it() {
    // Half a metre off in place alone is one scale; turned by a radian besides, hardly anything is left.
    let scale = Scale {
        rotation_rad: 0.3,
        translation_m: 0.4,
    };
    let at = |turn: f64| {
        let seen = Transform::new(
            so3::exp(&Vector3::new(0.0, 0.0, turn)),
            Vector3::new(0.5, 0.0, 0.0),
        );
        let edge = Edge::new(Measurement::pose(seen).unwrap(), Weight::Unit).unwrap();
        edge.judged(&scale, &Node::identity(), &Node::identity())
            .share
    };
    // s = 0.25 / 0.25, then (0.25 + 1) / 0.25.
    assert!((at(0.0) - 0.25).abs() < 1e-12);
    assert!((at(1.0) - 1.0 / 36.0).abs() < 1e-12);
}
