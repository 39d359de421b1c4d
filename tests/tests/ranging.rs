//! Vehicles that measure distances and nothing else: production vehicles and codec, in virtual time.

use skein_proto::document::{EstimateDocument, Permit, RangingStatus};
use skein_proto::frame::Frame;
use skein_proto::status::Status;
use skein_simworld::fleet::{Fleet, pose_of};
use skein_simworld::scenario::{Scenario, Start};
use skein_simworld::stage::Stage;
use skein_simworld::world::{Delivery, World};
use skein_tests::stories::{altered, built_in, position_sigma_m, status, why};

const SECOND_NS: i64 = 1_000_000_000;

/// How far off a vehicle's idea of a neighbour by distances is (m, rad), if it has exactly one.
fn error(fleet: &Fleet, of: usize, neighbour: usize) -> Option<(f64, f64)> {
    let name = fleet.stage().name(neighbour);
    let estimate = fleet.estimate(of)?;
    let known = |known: &&_| named(known, name);
    let ranging = estimate.neighbours.iter().find(known)?.ranging.as_ref()?;
    if ranging.status != RangingStatus::Converged {
        return None;
    }
    let at_ns = fleet.stage().time_ns(of, ranging.taken_ns);
    let truth = |vehicle| fleet.stage().truth(vehicle, at_ns);
    let true_pose = truth(of)?.inverse() * truth(neighbour)?;
    let pose = pose_of(ranging.pose.as_ref()?);
    let apart = true_pose.inverse() * pose;
    Some((apart.translation.vector.norm(), apart.rotation.angle()))
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
