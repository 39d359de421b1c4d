//! Vehicles that measure distances and nothing else: production vehicles and codec, in virtual time.

use std::collections::VecDeque;

use nalgebra::{Matrix3, Vector3};
use skein_estimation::time::Stamp;
use skein_proto::document::{
    EstimateDocument, FormationHealth, Permit, RangedBy, RangingDocument, RangingStatus,
};
use skein_proto::frame::Frame;
use skein_proto::status::Status;
use skein_simworld::fleet::{Fleet, Logged, LoggedValue, pose_of};
use skein_simworld::scenario::{Scenario, Start};
use skein_simworld::stage::Stage;
use skein_simworld::world::{Delivery, World};
use skein_tests::stories::{altered, built_in, position_sigma_m, status, why};
use skein_vehicle::{Input, Output, Vehicle, Work};

const SECOND_NS: i64 = 1_000_000_000;

/// A vehicle's idea of a neighbour by distances, if it has exactly one.
fn converged(fleet: &Fleet, of: usize, neighbour: usize) -> Option<&RangingDocument> {
    let name = fleet.stage().name(neighbour);
    let known = |known: &&_| named(known, name);
    let neighbours = &fleet.estimate(of)?.neighbours;
    let ranging = neighbours.iter().find(known)?.ranging.as_ref()?;
    (ranging.status == RangingStatus::Converged).then_some(ranging)
}

/// How far off that is (m, rad).
fn error(fleet: &Fleet, of: usize, neighbour: usize) -> Option<(f64, f64)> {
    let ranging = converged(fleet, of, neighbour)?;
    let at_ns = fleet.stage().time_ns(of, ranging.taken_ns);
    let truth = |vehicle| fleet.stage().truth(vehicle, at_ns);
    let true_pose = truth(of)?.inverse() * truth(neighbour)?;
    let pose = pose_of(ranging.pose.as_ref()?);
    let apart = true_pose.inverse() * pose;
    Some((apart.translation.vector.norm(), apart.rotation.angle()))
}

/// Its squared error in the plane over what it expects, per degree of freedom.
fn nees(fleet: &Fleet, of: usize, neighbour: usize) -> Option<f64> {
    let ranging = converged(fleet, of, neighbour)?;
    let at_ns = fleet.stage().time_ns(of, ranging.taken_ns);
    let truth = |vehicle| fleet.stage().truth(vehicle, at_ns);
    let true_pose = truth(of)?.inverse() * truth(neighbour)?;
    let [x, y, _] = ranging.reduced.as_ref()?.position_level_m;
    let off = Vector3::new(x, y, 0.0) - true_pose.translation.vector;
    let turned = ranging.reduced.as_ref()?.yaw_rad - true_pose.rotation.euler_angles().2;
    let [xx, xy, _, xw, yy, _, yw, _, _, ww] = ranging.reduced.as_ref()?.covariance_position_yaw?;
    let covariance = Matrix3::new(xx, xy, xw, xy, yy, yw, xw, yw, ww);
    let error = Vector3::new(off.x, off.y, turned.sin().atan2(turned.cos()));
    Some(error.dot(&(covariance.try_inverse()? * error)) / 3.0)
}

fn named(known: &skein_proto::document::NeighbourDocument, name: skein_proto::name::Name) -> bool {
    known.vehicle == name
}

/// The scenario with nobody knowing where it starts.
fn nobody_placed() -> Scenario {
    let mut scenario = built_in("ranges");
    for vehicle in scenario.team.vehicles_mut() {
        vehicle.start = Start::Unknown;
    }
    scenario
}

#[test]
fn vehicles_that_know_nothing_but_distances_find_out_where_the_others_are() {
    let mut fleet = Fleet::new(&nobody_placed(), 1);
    fleet.run_until(40 * SECOND_NS);
    let mut errors_m = Vec::new();
    for of in 0..fleet.len() {
        assert_eq!(
            status(&fleet, of),
            Status::Unplaced,
            "there is no common frame"
        );
        for neighbour in (0..fleet.len()).filter(|neighbour| *neighbour != of) {
            let (apart_m, turned_rad) =
                error(&fleet, of, neighbour).unwrap_or_else(|| panic!("v{of} of v{neighbour}"));
            assert!(
                apart_m < 1.0 && turned_rad < 0.15,
                "v{of} of v{neighbour}: {apart_m:.2} m, {turned_rad:.3} rad"
            );
            errors_m.push(apart_m);
        }
    }
    errors_m.sort_by(f64::total_cmp);
    let median_m = errors_m[errors_m.len() / 2];
    assert!(median_m < 0.4, "{errors_m:.2?}");
}

#[test]
fn a_vehicle_without_a_pose_joins_by_distances_and_is_then_one_of_the_team() {
    let mut fleet = Fleet::new(&built_in("ranges"), 1);
    let placed_ns = (1..=40)
        .map(|second| second * SECOND_NS)
        .find(|at_ns| {
            fleet.run_until(*at_ns);
            status(&fleet, 3) == Status::Tracking
        })
        .expect("it is placed within 40 s");
    fleet.run_until(placed_ns + 10 * SECOND_NS);
    for vehicle in 0..fleet.len() {
        assert_eq!(status(&fleet, vehicle), Status::Tracking);
        // Distances of 0.1 m hold a team that knows its starts to 0.4 m.
        let error_m = fleet.position_error_m(vehicle);
        let sigma_m = position_sigma_m(&fleet, vehicle);
        assert!(
            error_m < 1.2 && error_m < 4.0 * sigma_m,
            "v{vehicle}: {error_m:.2} m of {sigma_m:.2} m"
        );
    }
    let health = fleet.health(3).unwrap().ranging.as_ref().unwrap();
    assert_eq!(health.placed, 1);
    let own = fleet.estimate(3).unwrap();
    assert!(
        own.neighbours.iter().all(|known| known.ranging.is_none()),
        "its distances are measurements of the common estimate now"
    );
}

#[test]
fn a_vehicle_that_lost_its_pose_with_its_odometry_joins_again_by_distances() {
    let mut scenario = built_in("ranges");
    for vehicle in scenario.team.vehicles_mut() {
        vehicle.start = Start::Pose;
    }
    let as_configured = |_, config| config;
    let blinded = |_: &World, vehicle, instant_ns, deliveries: &mut Vec<Delivery>| {
        if vehicle == 3 && (20 * SECOND_NS..23 * SECOND_NS).contains(&instant_ns) {
            deliveries.retain(|delivery| !matches!(delivery.frame, Frame::Odometry(_)));
        }
    };
    let mut fleet = altered(&scenario, 1, as_configured, blinded);
    fleet.run_until(24 * SECOND_NS);
    assert_eq!(status(&fleet, 3), Status::Lost, "{}", why(&fleet, 3));
    let found_ns = (25..=50)
        .map(|second| second * SECOND_NS)
        .find(|at_ns| {
            fleet.run_until(*at_ns);
            status(&fleet, 3) == Status::Tracking
        })
        .unwrap_or_else(|| panic!("{}", why(&fleet, 3)));
    fleet.run_until(found_ns + 5 * SECOND_NS);
    let (error_m, sigma_m) = (fleet.position_error_m(3), position_sigma_m(&fleet, 3));
    assert!(
        error_m < 1.2 && error_m < 4.0 * sigma_m,
        "{error_m:.2} m of {sigma_m:.2} m"
    );
}

fn moves(estimate: Option<&EstimateDocument>) -> bool {
    let motion = estimate.and_then(|estimate| estimate.motion);
    motion.is_some_and(|motion| motion.permit == Permit::Move)
}

#[test]
fn vehicles_that_take_turns_never_move_together_and_all_move() {
    let mut scenario = nobody_placed();
    scenario.schedule = true;
    let mut fleet = Fleet::new(&scenario, 1);
    let mut moved = vec![0; fleet.len()];
    for tenth in 0..600 {
        fleet.run_until(tenth * SECOND_NS / 10);
        let moving: Vec<usize> = (0..fleet.len())
            .filter(|vehicle| moves(fleet.estimate(*vehicle)))
            .collect();
        assert!(
            moving.len() <= 1,
            "all hear each other, yet {moving:?} move"
        );
        for vehicle in moving {
            moved[vehicle] += 1;
        }
    }
    assert!(moved.iter().all(|times| *times > 50), "{moved:?}");
}

/// Two robots that drive straight, of which either may be on both sides of the other's path for all that their distances
/// say, and a third that turns.
fn two_straight() -> Scenario {
    let text = r#"
name = "two-straight"
description = "Two robots on straight lines and one on a circle, by distances alone"
duration_s = 40.0
period_s = 0.2
standstill_s = 2.0
seed = 1
planar = true

[[team.vehicles]]
start = "unknown"
trajectory.line = { start_m = [0, 0, 0], velocity_mps = [0.8, 0, 0] }

[[team.vehicles]]
start = "unknown"
trajectory.line = { start_m = [2, 7, 0], velocity_mps = [0.7, 0.2, 0] }

[[team.vehicles]]
start = "unknown"
trajectory.circle = { centre_m = [9, 3, 0], radius_m = 3, period_s = 22, phase_deg = 200 }

[sensor]
kind = "distance"
range_m = 60.0
noise = { distance_std_m = 0.1 }

[odometry]
rotation_concentration = 250_000
translation_std_m = 0.01
"#;
    Scenario::parse(text, "two-straight").expect("it is one")
}

fn formation(fleet: &Fleet, of: usize) -> FormationHealth {
    let health = fleet.health(of).and_then(|health| health.ranging.clone());
    let formation = health.and_then(|ranging| ranging.formation);
    formation.expect("it hears two that measure each other")
}

#[test]
fn two_that_drive_straight_know_each_others_side_by_a_third_that_turns() {
    let mut fleet = Fleet::new(&two_straight(), 1);
    let (mut squares, mut told) = (Vec::new(), 0);
    for tenth in 120..=200 {
        fleet.run_until(tenth * SECOND_NS / 10);
        for (of, neighbour) in [(0, 1), (1, 0)] {
            let Some(ranging) = converged(&fleet, of, neighbour) else {
                continue;
            };
            assert_eq!(ranging.by, Some(RangedBy::All), "its distances leave two");
            let (apart_m, turned_rad) = error(&fleet, of, neighbour).expect("it has one place");
            assert!(
                apart_m < 2.5 && turned_rad < 0.5,
                "v{of} of v{neighbour} at {tenth}: {apart_m:.2} m, {turned_rad:.3} rad"
            );
            squares.extend(nees(&fleet, of, neighbour));
            told += 1;
        }
    }
    assert!(told > 80, "most of the time: {told} of 162");
    let nees = squares.iter().sum::<f64>() / squares.len() as f64;
    assert!((0.1..3.0).contains(&nees), "{nees}");
    let formation = formation(&fleet, 0);
    assert!(formation.work_done >= 10, "{formation:?}");
    assert!(formation.work_begun <= 20, "one a second: {formation:?}");
    assert_eq!(formation.work_dropped, 0);
}

#[test]
fn a_team_that_hears_a_third_less_knows_where_all_are_before_its_pairs_do() {
    let mut scenario = nobody_placed();
    scenario.radio.loss = 0.3;
    let mut fleet = Fleet::new(&scenario, 1);
    let others = |of: usize| (0..4).filter(move |neighbour| *neighbour != of);
    let told = |fleet: &Fleet| {
        let pairs = (0..4).flat_map(|of| others(of).map(move |neighbour| (of, neighbour)));
        pairs
            .map(|(of, neighbour)| Some((converged(fleet, of, neighbour)?.by, of, neighbour)))
            .collect::<Option<Vec<_>>>()
    };
    let told = (1..=100)
        .find_map(|tenth| {
            fleet.run_until(tenth * SECOND_NS / 10);
            told(&fleet)
        })
        .expect("within 10 s; by pairs alone it takes 17");
    let by_all: Vec<_> = told
        .iter()
        .filter(|told| told.0 == Some(RangedBy::All))
        .collect();
    assert!(by_all.len() > 2, "{told:?}");
    for (_, of, neighbour) in by_all {
        let (apart_m, turned_rad) = error(&fleet, *of, *neighbour).expect("it has one place");
        assert!(
            apart_m < 2.0 && turned_rad < 0.4,
            "v{of} of v{neighbour}: {apart_m:.2} m, {turned_rad:.3} rad"
        );
    }
}

#[test]
fn whoever_starts_again_is_placed_again_by_its_new_odometry() {
    let mut fleet = Fleet::new(&two_straight(), 1);
    fleet.run_until(14 * SECOND_NS);
    assert!(error(&fleet, 0, 1).is_some());
    fleet.kill(1);
    fleet.restart(1, skein_vehicle::Start::Unknown);
    fleet.run_until(16 * SECOND_NS);
    assert_eq!(
        error(&fleet, 0, 1),
        None,
        "of its new life nothing is known"
    );
    let (apart_m, _) = (20..30)
        .find_map(|second| {
            fleet.run_until(second * SECOND_NS);
            error(&fleet, 0, 1)
        })
        .expect("it has moved enough");
    assert!(apart_m < 2.5, "{apart_m:.2} m");
}

/// What the first vehicle of a fleet was given and what it said; and what it says when it is given the same again, but
/// of computations only what `run` makes of them.
fn repeated(seed: u64, run: impl Fn(&Work) -> bool) -> (Vec<Output>, Vec<Output>) {
    let mut fleet = Fleet::new(&two_straight(), seed);
    let started = Stamp::from_nanos(fleet.stage().stamp_ns(0, fleet.stage().begins_ns()));
    fleet.log();
    fleet.run_until(15 * SECOND_NS);
    let mut vehicle = Vehicle::new(fleet.config(0).clone(), started);
    let (mut first, mut second) = (Vec::new(), Vec::new());
    let mut works: VecDeque<Box<Work>> = VecDeque::new();
    let log = fleet.take_log().into_iter();
    for Logged { stamp, what, .. } in log.filter(|entry| entry.vehicle == 0) {
        let mut input = match what {
            LoggedValue::Output(output) => {
                first.push(output);
                continue;
            }
            LoggedValue::Input(input) => input,
        };
        if let Input::Done { number, done } = &mut input {
            let work = works.iter().find(|work| work.number() == *number);
            let work = work.filter(|work| run(work));
            *done = work.map(|work| Box::new(work.run()));
        }
        vehicle.handle(stamp, input);
        loop {
            let output = vehicle.poll();
            if let Output::Work(work) = &output {
                works.push_front(work.clone());
            }
            let last = matches!(output, Output::WakeAt(_));
            second.push(output);
            if last {
                break;
            }
        }
    }
    (first, second)
}

#[test]
fn a_flight_with_computations_is_repeated_bit_by_bit() {
    let (flown, again) = repeated(3, |_| true);
    let works = |outputs: &[Output]| {
        let is_work = |output: &&Output| matches!(output, Output::Work(_));
        outputs.iter().filter(is_work).count()
    };
    assert!(works(&flown) > 5);
    // The fleet begins to log after the vehicle was made: what came of that is not in its log.
    assert_eq!(flown.len(), again.len());
    assert!(flown == again, "an output differs");
    let (twice, _) = repeated(3, |_| true);
    assert!(flown == twice, "two flights differ");
}

#[test]
fn computations_that_never_come_back_are_counted_and_asked_for_again() {
    let (_, outputs) = repeated(3, |_| false);
    let mut dropped = 0;
    for output in &outputs {
        match output {
            Output::Health(health) => {
                let formation = health.ranging.as_ref();
                let formation = formation.and_then(|ranging| ranging.formation.as_ref());
                dropped = formation.map_or(0, |formation| formation.work_dropped);
            }
            Output::Estimate { document, .. } => {
                let by = |known: &skein_proto::document::NeighbourDocument| {
                    known.ranging.as_ref().and_then(|ranging| ranging.by)
                };
                let all = document.neighbours.iter().filter_map(by);
                assert!(all.clone().all(|by| by == RangedBy::Pair));
            }
            _ => {}
        }
    }
    assert_eq!(dropped, 1);
}
