//! Derivatives of the two factors by finite differences, in twists of the world.

use nalgebra::{Vector4, Vector6};

use super::super::measured_edge::{Linear, MeasuredEdge, PoseId};
use super::super::noise_scales::ScalePair;
use super::super::stretch::Stretch;
use super::*;

const STEP: f64 = 1e-6;

fn moved(pose: &Pose, axis: usize, step: f64) -> Pose {
    let mut twist = Vector6::zeros();
    twist[axis] = step;
    se3::exp::<World, World>(&twist) * *pose
}

fn edge(observation: &Observation, from: Option<PoseId>) -> MeasuredEdge {
    MeasuredEdge {
        from,
        to: PoseId(1),
        from_end: observation.from_end,
        to_end: observation.to_end,
        measurement: observation.measurement,
        noise: observation.noise,
        by: id(0),
        of: id(1),
        is_new: true,
        failed_gate: false,
        is_apart: false,
        linear: Linear::default(),
        weight: 1.0,
    }
}

/// The derivative of an edge's residual in a twist of its far end is its Jacobian, in one of its near end the opposite.
fn check_edge(edge: &MeasuredEdge, from: &Pose, to: &Pose, tolerance: f64) {
    let scales = ScalePair::default();
    let at = |from: &Pose, to: &Pose| edge.linearise(from, to, &scales).residual;
    let twist = edge.linearise(from, to, &scales).twist;
    for axis in 0..6 {
        let by_to =
            (at(from, &moved(to, axis, STEP)) - at(from, &moved(to, axis, -STEP))) / (2.0 * STEP);
        let by_from =
            (at(&moved(from, axis, STEP), to) - at(&moved(from, axis, -STEP), to)) / (2.0 * STEP);
        let column = twist.column(axis);
        let size = tolerance * (1.0 + twist.norm());
        assert!(
            (by_to - column).norm() < size && (by_from + column).norm() < size,
            "seed {SEED}, {:?}, axis {axis}: {by_to} {by_from} {column}",
            edge.measurement
        );
    }
}

#[test]
fn a_measurement_bends_with_the_twist_of_either_end_as_its_jacobian_says() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    for size in [3.0, 100.0] {
        for _ in 0..40 {
            let (from, to) = (
                transform(&mut rng, 1.7, size),
                transform(&mut rng, 1.7, size),
            );
            for kind in EVERY_KIND {
                // Far from what was measured: half a radian and half a metre.
                let noise = Noise {
                    rotation_rad: 0.3,
                    translation: 0.5,
                };
                let ends = (transform(&mut rng, 1.7, 1.0), transform(&mut rng, 1.7, 1.0));
                let seen = observe(&mut rng, kind, &noise, (&from, &to), ends);
                check_edge(&edge(&seen, Some(PoseId(0))), &from, &to, 1e-7 * size);
            }
        }
    }
}

#[test]
fn a_fix_bends_with_the_twist_of_what_it_fixes() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    for _ in 0..40 {
        // The world, seen from a window whose origin is elsewhere.
        let world = Transform::new(UnitQuaternion::identity(), vector(&mut rng, 50.0));
        let to = transform(&mut rng, 1.7, 3.0);
        for kind in EVERY_KIND {
            let noise = Noise {
                rotation_rad: 0.2,
                translation: 0.5,
            };
            let ends = (transform(&mut rng, 1.0, 5.0), transform(&mut rng, 1.7, 1.0));
            let seen = observe(&mut rng, kind, &noise, (&world, &to), ends);
            check_edge(&edge(&seen, None), &world, &to, 1e-6);
        }
    }
}

#[test]
fn odometry_bends_with_both_ends_and_with_its_biases() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let settings = Settings::DEFAULT;
    for (turn, size) in [(0.2, 0.5), (1.5, 20.0)] {
        for _ in 0..40 {
            let origin: Transform<Odometry, Body> = transform(&mut rng, 1.7, 30.0);
            let step: Transform<Body, Body> = transform(&mut rng, turn, size);
            let point = |at: i64, odometry_from_body: Transform<Odometry, Body>| OdometryPoint {
                taken: Stamp::from_nanos(at * 200_000_000),
                segment: 0,
                odometry_from_body,
                growth: Growth::zero(),
            };
            let (earlier, mut later) = (point(1, origin), point(4, origin * step));
            for part in [0.3, 0.7, 1.0] {
                let on_the_way = origin
                    .translation
                    .lerp(&later.odometry_from_body.translation, part);
                later.growth = later.growth.after(&on_the_way, 0.02, 0.1);
            }
            let stretch = Stretch {
                earlier: &earlier,
                later: &later,
            };
            let biases = Vector4::from_fn(|_, _| rng.random_range(-0.05..0.05));
            let from: Pose = transform(&mut rng, 1.7, 10.0);
            let to = from * step * transform::<Body, Body>(&mut rng, 0.4, 0.5);
            let linearise = |from: &Pose, to: &Pose, biases: &Vector4<f64>| {
                stretch
                    .linearise(from, to, biases, (1.0, 1.0), &settings, 0.2)
                    .unwrap()
            };
            let at = |from: &Pose, to: &Pose, biases: &Vector4<f64>| {
                linearise(from, to, biases).residual
            };
            let linear = linearise(&from, &to, &biases);
            let tolerance = 1e-6 * (1.0 + linear.twist.norm());
            for axis in 0..6 {
                let column = linear.twist.column(axis);
                let ahead = at(&from, &moved(&to, axis, STEP), &biases);
                let behind = at(&from, &moved(&to, axis, -STEP), &biases);
                let by_to = (ahead - behind) / (2.0 * STEP);
                let ahead = at(&moved(&from, axis, STEP), &to, &biases);
                let behind = at(&moved(&from, axis, -STEP), &to, &biases);
                let by_from = (ahead - behind) / (2.0 * STEP);
                assert!(
                    (by_to - column).norm() < tolerance && (by_from + column).norm() < tolerance,
                    "seed {SEED}, axis {axis}: {by_to} {by_from} {column}"
                );
            }
            for axis in 0..4 {
                let step = Vector4::ith(axis, STEP);
                let ahead = at(&from, &to, &(biases + step));
                let behind = at(&from, &to, &(biases - step));
                let numeric = (ahead - behind) / (2.0 * STEP);
                assert!((numeric - linear.bias.column(axis)).norm() < tolerance);
            }
        }
    }
}

#[test]
fn what_odometry_predicts_fits_it() {
    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let flight = Flight::fly(SEED, &Conditions::good(1, 4));
    let (earlier, later) = (&flight.moments[1][0].point, &flight.moments[2][0].point);
    let stretch = Stretch { earlier, later };
    for _ in 0..20 {
        let from: Pose = transform(&mut rng, 1.7, 10.0);
        let biases = Vector4::from_fn(|_, _| rng.random_range(-0.05..0.05));
        let to = stretch.predict(&from, &biases);
        let linear = stretch
            .linearise(&from, &to, &biases, (1.0, 1.0), &Settings::DEFAULT, 0.2)
            .unwrap();
        assert!(linear.residual.norm() < 1e-9, "{}", linear.residual);
    }
}

#[test]
fn a_long_way_without_a_word_is_integrated_as_its_parts_would_be() {
    // A gyroscope that says too little, on a straight way: the far end swings aside by half the angle.
    let ahead = |metres: f64, taken: i64| OdometryPoint {
        taken: Stamp::from_nanos(taken * 1_000_000_000),
        segment: 0,
        odometry_from_body: Transform::new(
            UnitQuaternion::identity(),
            Vector3::new(metres, 0.0, 0.0),
        ),
        growth: Growth::zero(),
    };
    let (earlier, later) = (ahead(0.0, 0), ahead(8.0, 4));
    let stretch = Stretch {
        earlier: &earlier,
        later: &later,
    };
    let rate_rad_s = 0.01;
    let end = stretch.predict(&Pose::identity(), &Vector4::new(0.0, 0.0, rate_rad_s, 0.05));
    let angle = rate_rad_s * 4.0;
    assert!((so3::log(&end.rotation).z - angle).abs() < 1e-9);
    let metres = 8.0 * 1.05;
    assert!((end.translation.x - metres).abs() < 5e-3);
    assert!((end.translation.y - metres * angle / 2.0).abs() < 5e-3);
}
