//! A short window says what a long one says, and what the batch of the whole history says.

use nalgebra::Matrix6;

use super::*;
use crate::cooperative::{Edge, Graph, NodeIndex, Optimiser, Weight, solve};

const ROUNDS: usize = 14;
const STARTED: f64 = 1e-4;

/// The pose of every vehicle in the last round, by a solver of the whole history at once.
fn batch(flight: &Flight) -> Vec<Pose> {
    let mut graph = Graph::new();
    let nodes: Vec<Vec<NodeIndex>> = flight
        .truth
        .iter()
        .map(|truth| {
            truth
                .iter()
                .map(|pose| graph.add_node(*pose).unwrap())
                .collect()
        })
        .collect();
    let pose_edge = |relative: Transform<Sensor, Sensor>, information: Matrix6<f64>| {
        let symmetric = (information + information.transpose()) * 0.5;
        Edge::new(
            Measurement::pose(relative).unwrap(),
            Weight::Information(symmetric),
        )
        .unwrap()
    };
    for (node, start) in nodes[0].iter().zip(&flight.truth[0]) {
        let edge = pose_edge(start.reframe(), Matrix6::identity() * STARTED.powi(-2));
        graph.add_edge(NodeIndex::REFERENCE, *node, edge).unwrap();
    }
    for round in 1..nodes.len() {
        for (vehicle, node) in nodes[round].iter().enumerate() {
            let point = |round: usize| &flight.moments[round][vehicle].point;
            let (earlier, later) = (point(round - 1), point(round));
            let step = earlier.odometry_from_body.inverse() * later.odometry_from_body;
            let gathered = later.growth.since(&earlier.growth).covariance();
            // A twist in odometry axes, seen from the later body.
            let to_odometry = se3::adjoint(&later.odometry_from_body);
            let information =
                to_odometry.transpose() * gathered.try_inverse().unwrap() * to_odometry;
            graph
                .add_edge(
                    nodes[round - 1][vehicle],
                    *node,
                    pose_edge(step.reframe(), information),
                )
                .unwrap();
        }
        for sighting in &flight.sightings[round] {
            let seen = &sighting.observation;
            let edge = Edge::with_offsets(
                seen.measurement,
                Weight::Noise(seen.noise),
                seen.from_end,
                seen.to_end,
            );
            let (from, to) = (nodes[round][sighting.from], nodes[round][sighting.to]);
            graph.add_edge(from, to, edge.unwrap()).unwrap();
        }
    }
    solve(&mut graph, &Optimiser::gauss_newton(), |_| {});
    let last = nodes.last().unwrap().iter();
    last.map(|node| *graph.pose(*node).unwrap()).collect()
}

fn smoothed(flight: &Flight, lag: u32) -> Team {
    let mut team = flight.team(least_squares(lag));
    for round in 1..flight.moments.len() {
        flight.hear(&mut team, round);
        assert!(!team.solve_with_stated_noise().undetermined);
    }
    team
}

#[test]
fn whatever_the_lag_a_flight_of_small_noise_ends_where_the_batch_ends_it() {
    let conditions = Conditions {
        kinds: vec![Kind::Pose, Kind::Bearing, Kind::Distance],
        levers: true,
        ..Conditions::linear(4, ROUNDS)
    };
    let flight = Flight::fly(SEED, &conditions);
    let batch = batch(&flight);
    let whole = smoothed(&flight, ROUNDS as u32);
    assert_eq!(whole.statistics().poses, 4 * ROUNDS as u64);
    let expected = whole.own().unwrap();
    for lag in [0, 3, ROUNDS as u32] {
        let team = smoothed(&flight, lag);
        for (vehicle, pose) in batch.iter().enumerate() {
            let (_, estimate) = team.world_from(id(vehicle)).unwrap();
            let off = apart(&estimate, pose);
            let error = apart(pose, &flight.truth[ROUNDS - 1][vehicle]);
            assert!(
                off < 1e-3 * error,
                "lag {lag}, {vehicle}: {off} m of {error} m"
            );
        }
        let covariance = team.own().unwrap().covariance;
        let off = (covariance - expected.covariance).norm() / expected.covariance.norm();
        assert!(off < 1e-3, "lag {lag}: {off}");
    }
}

#[test]
fn a_window_that_holds_everything_is_the_batch() {
    let flight = Flight::fly(SEED, &Conditions::good(4, ROUNDS));
    let batch = batch(&flight);
    let team = smoothed(&flight, ROUNDS as u32);
    for (vehicle, pose) in batch.iter().enumerate() {
        let (_, estimate) = team.world_from(id(vehicle)).unwrap();
        let off = apart(&estimate, pose);
        assert!(off < 1e-6, "{vehicle}: {off}");
    }
}

#[test]
fn a_short_window_loses_little_of_noise_that_bends() {
    let flight = Flight::fly(SEED, &Conditions::good(4, 60));
    let batch = batch(&flight);
    for lag in [0, 3] {
        let team = smoothed(&flight, lag);
        for (vehicle, pose) in batch.iter().enumerate() {
            let (_, estimate) = team.world_from(id(vehicle)).unwrap();
            let off = apart(&estimate, pose);
            let error = apart(pose, &flight.truth[59][vehicle]);
            assert!(
                off < 0.1 * error,
                "lag {lag}, {vehicle}: {off} m of {error} m"
            );
        }
    }
}

#[test]
fn what_the_covariance_says_is_what_flights_show() {
    let mut sum = 0.0;
    let flights = 40;
    for seed in 0..flights {
        let flight = Flight::fly(seed, &Conditions::good(3, 20));
        let mut team = flight.team(least_squares(3));
        for round in 1..20 {
            flight.hear(&mut team, round);
            team.solve_with_stated_noise();
        }
        let own = team.own().unwrap();
        let twist = se3::log(&(own.world_from_body.inverse() * flight.truth[19][0]));
        sum += twist.dot(&(own.covariance.try_inverse().unwrap() * twist));
    }
    // A chi-squared of 240 degrees of freedom, over as many: within four standard deviations.
    let nees = sum / (6.0 * flights as f64);
    assert!((0.63..1.37).contains(&nees), "{nees}");
}
