//! What vehicles measure of each other tells nothing of where they all are together.

use nalgebra::{DMatrix, DVector, Vector6};

use super::super::normal::Sums;
use super::super::prior::Unknown;
use super::*;

/// Plain sums of everything in a window.
struct Everything {
    hessian: DMatrix<f64>,
}

impl Sums for Everything {
    fn add(&mut self, row: usize, column: usize, value: f64) {
        self.hessian[(row, column)] += value;
    }

    fn add_gradient(&mut self, _: usize, _: f64) {}
}

/// The Hessian of a window, poses first, and how much of it a twist of everything meets, relative to its size.
fn met_by_a_common_twist(window: &Window) -> (f64, f64) {
    let vehicles: Vec<VehicleId> = window.members.keys().copied().collect();
    let size = 6 * window.poses.len() + 4 * vehicles.len();
    let offset = |unknown: Unknown| match unknown {
        Unknown::Pose(id) => 6 * window.index(id),
        Unknown::Biases(vehicle) => {
            let at = vehicles.iter().position(|other| *other == vehicle);
            6 * window.poses.len() + 4 * at.unwrap()
        }
    };
    let mut sums = Everything {
        hessian: DMatrix::zeros(size, size),
    };
    let scales = NoiseScales::default();
    sums.prior(window, offset);
    for pair in window.stretches() {
        sums.stretch(window, pair, &scales, offset);
    }
    for edge in &window.edges {
        sums.edge(edge, &window.linearise(edge, &scales), offset);
    }
    let mut hessian = sums.hessian;
    hessian.fill_upper_triangle_with_lower_triangle();
    let mut largest: f64 = 0.0;
    for axis in 0..6 {
        let mut common = DVector::zeros(size);
        for pose in 0..window.poses.len() {
            common
                .rows_mut(6 * pose, 6)
                .copy_from(&Vector6::ith(axis, 1.0));
        }
        largest = largest.max((&hessian * common).amax());
    }
    (largest, hessian.amax())
}

/// A team of which nothing but relative poses is known: what `place` says of its members is taken back.
fn team_without_a_place(flight: &Flight, lag: u32) -> Team {
    let settings = Settings {
        lag: Lag {
            usual: lag,
            several: lag,
            distances: lag,
            few: lag,
            many: lag,
        },
        ..Settings::DEFAULT
    };
    let mut team = Team::new(id(0), PERIOD, settings);
    for (moment, truth) in flight.moments[0].iter().zip(&flight.truth[0]) {
        team.place(moment, truth).unwrap();
    }
    let prior = &mut team.window.prior;
    let mut offset = 0;
    for anchor in &prior.anchors {
        let dimension = anchor.unknown().dimension();
        if matches!(anchor.unknown(), Unknown::Pose(_)) {
            prior
                .lambda
                .view_mut((offset, offset), (dimension, dimension))
                .fill(0.0);
        }
        offset += dimension;
    }
    team
}

#[test]
fn a_twist_of_everybody_meets_nothing_before_and_after_marginalising() {
    let conditions = Conditions {
        kinds: EVERY_KIND.to_vec(),
        levers: true,
        ..Conditions::good(4, 8)
    };
    let flight = Flight::fly(SEED, &conditions);
    let mut team = team_without_a_place(&flight, 2);
    for round in 0..8 {
        flight.hear(&mut team, round);
        let window = &mut team.window;
        window.linearise_edges(&team.scales);
        window.weigh_edges(true, false);
        window.end_round();
        let (met, size) = met_by_a_common_twist(window);
        assert!(met < 1e-10 * size, "round {round}: {met} of {size}");
        window.recentre();
        window.marginalise(&team.scales);
        window.wander();
        let (met, size) = met_by_a_common_twist(window);
        assert!(met < 1e-10 * size, "round {round}, after: {met} of {size}");
    }
    assert!(team.window.poses.len() < 16, "something was marginalised");
    assert!(team.window.prior.dimension() > 0);
}

#[test]
fn whoever_goes_and_was_never_located_tells_nothing_of_who_measured_it() {
    let conditions = Conditions {
        kinds: vec![Kind::Distance],
        ..Conditions::good(2, 1)
    };
    let flight = Flight::fly(SEED, &conditions);
    let mut team = team_without_a_place(&flight, 2);
    let known = DMatrix::from_diagonal_element(6, 6, 4.0);
    team.window
        .prior
        .lambda
        .view_mut((0, 0), (6, 6))
        .copy_from(&known);
    flight.hear(&mut team, 0);
    team.window.linearise_edges(&team.scales);
    team.window.weigh_edges(true, false);
    team.window.end_round();
    team.forget(id(1));
    assert_eq!(team.window.poses.len(), 1);
    let left = team.window.prior.lambda.view((0, 0), (6, 6)).into_owned();
    assert!((left - known).norm() < 1e-6);
}

#[test]
fn two_hundred_rounds_together_do_not_tell_a_team_where_it_is() {
    let flight = Flight::fly(SEED, &Conditions::good(4, 200));
    let mut team = Team::new(id(0), PERIOD, Settings::DEFAULT);
    for (vehicle, moment) in flight.moments[0].iter().enumerate() {
        team.place(moment, &flight.truth[0][vehicle]).unwrap();
    }
    flight.follow(&mut team, 0);
    let covariance = team.own().unwrap().covariance;
    // Four vehicles whose places are guarded by 3 rad and 1 km each: the team's is known by half of that at best.
    let turned = covariance.fixed_view::<3, 3>(0, 0).trace().sqrt();
    let moved = covariance.fixed_view::<3, 3>(3, 3).trace().sqrt();
    assert!(turned > 2.0 && moved > 800.0, "{turned} rad, {moved} m");
    let between = team.relative(id(1)).unwrap().covariance;
    assert!(between.trace() < 1e-2, "{between}");
}

/// The same flight somewhere else.
fn shifted(flight: &Flight, by: &Vector3<f64>) -> Flight {
    let mut flight = flight.clone();
    for pose in flight.truth.iter_mut().flatten() {
        pose.translation += by;
    }
    flight
}

#[test]
fn where_in_the_world_a_team_flies_changes_nothing() {
    let flight = Flight::fly(SEED, &Conditions::good(4, 25));
    let mut here = flight.team(Settings::DEFAULT);
    flight.follow(&mut here, 1);
    let here = here.own().unwrap();
    for (far_m, tolerance) in [(1e3, 1e-9), (1e5, 1e-7)] {
        let by = Vector3::new(far_m, -0.5 * far_m, 0.3 * far_m);
        let far = shifted(&flight, &by);
        let mut team = far.team(Settings::DEFAULT);
        far.follow(&mut team, 1);
        let there = team.own().unwrap();
        let back = Transform::new(
            there.world_from_body.rotation,
            there.world_from_body.translation - by,
        );
        assert!(apart(&back, &here.world_from_body) < tolerance, "{far_m} m");
        let off = (there.covariance - here.covariance).norm() / here.covariance.norm();
        assert!(off < tolerance, "{far_m} m: {off}");
    }
}

#[test]
fn a_team_that_walks_a_hundred_kilometres_away_keeps_its_digits() {
    // One step of a hundred metres a round, the same for all, on top of the flight.
    let near = Flight::fly(SEED, &Conditions::good(4, 40));
    let mut team = near.team(Settings::DEFAULT);
    let mut moved = near.team(Settings::DEFAULT);
    near.follow(&mut team, 1);
    let before = team.own().unwrap().covariance;
    // The frame's origin is moved behind the estimator's back, as the round's own recentring would.
    for round in 1..40 {
        let shift = Vector3::new(2500.0, 1000.0, -500.0);
        moved.window.prior.recentre(&shift);
        for pose in &mut moved.window.poses {
            pose.world_from_body.translation -= shift;
        }
        near.hear(&mut moved, round);
        assert!(!moved.solve().undetermined, "round {round}");
    }
    let after = moved.own().unwrap().covariance;
    assert!((after - before).norm() < 1e-7 * before.norm());
}
