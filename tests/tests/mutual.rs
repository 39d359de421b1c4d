//! Vehicles whose cameras see robots and not which robots: production vehicles and codec, in virtual time.

use nalgebra::Vector3;
use skein_proto::document::{EstimateDocument, MutualDocument, MutualStatus};
use skein_simworld::fleet::Fleet;
use skein_simworld::scenario::Scenario;
use skein_simworld::stage::Stage;
use skein_tests::stories::built_in;
use skein_vehicle::{Config, MutualConfig, MutualWay};

const SECOND_NS: i64 = 1_000_000_000;

/// A fleet that goes one of the two ways, and may or may not make bearings of features.
fn fleet(scenario: &Scenario, sample: u64, mutual: MutualConfig) -> Fleet {
    Fleet::with_configs(scenario, sample, |_, config| Config { mutual, ..config })
}

/// How far off what a vehicle says of a neighbour is.
#[derive(Clone, Copy, Debug)]
struct Error {
    bearing_deg: f64,
    /// As a part of the true distance.
    distance: f64,
    yaw_deg: f64,
}

fn error(fleet: &Fleet, of: usize, neighbour: usize, mutual: &MutualDocument) -> Option<Error> {
    let at_ns = fleet.stage().time_ns(of, mutual.taken_ns);
    let truth = |vehicle| fleet.stage().truth(vehicle, at_ns);
    let body_from_neighbour = truth(of)?.inverse() * truth(neighbour)?;
    let pose = mutual.pose.as_ref()?;
    let (found, true_place) = (
        Vector3::from(pose.position_m),
        body_from_neighbour.translation.vector,
    );
    let [w, x, y, z] = pose.quaternion_wxyz;
    let rotation = nalgebra::UnitQuaternion::new_normalize(nalgebra::Quaternion::new(w, x, y, z));
    Some(Error {
        bearing_deg: found.angle(&true_place).to_degrees(),
        distance: (found.norm() / true_place.norm() - 1.0).abs(),
        yaw_deg: rotation
            .angle_to(&body_from_neighbour.rotation)
            .to_degrees(),
    })
}

/// Everything that is said by bearings now: who says it, of whom, and what.
fn said(fleet: &Fleet) -> Vec<(usize, usize, MutualDocument)> {
    let mut said = Vec::new();
    for of in 0..fleet.len() {
        let neighbours = fleet.estimate(of).map(|estimate| &estimate.neighbours);
        for document in neighbours.into_iter().flatten() {
            let who = (0..fleet.len()).find(|who| fleet.stage().name(*who) == document.vehicle);
            if let (Some(who), Some(mutual)) = (who, &document.mutual) {
                said.push((of, who, mutual.clone()));
            }
        }
    }
    said
}

fn median(mut numbers: Vec<f64>) -> f64 {
    numbers.sort_by(f64::total_cmp);
    numbers[numbers.len() / 2]
}

#[test]
fn quadrotors_that_cannot_tell_each_other_apart_find_out_who_is_where() {
    let mut fleet = fleet(&built_in("square"), 1, MutualConfig::DEFAULT);
    fleet.run_until(25 * SECOND_NS);
    let mut errors = Vec::new();
    for second in 26..=35 {
        fleet.run_until(second * SECOND_NS);
        for (of, neighbour, mutual) in said(&fleet) {
            assert_eq!(
                mutual.status,
                MutualStatus::Converged,
                "v{of} of v{neighbour} at {second} s"
            );
            errors.push(error(&fleet, of, neighbour, &mutual).expect("it is converged"));
        }
    }
    assert_eq!(errors.len(), 10 * 4 * 3);
    let of = |pick: fn(&Error) -> f64| median(errors.iter().map(pick).collect());
    let (bearing_deg, distance, yaw_deg) = (
        of(|error| error.bearing_deg),
        of(|error| error.distance),
        of(|error| error.yaw_deg),
    );
    eprintln!(
        "medians: bearing {bearing_deg:.2} deg, distance {distance:.3}, orientation {yaw_deg:.2} deg"
    );
    assert!(bearing_deg < 2.5 && distance < 0.1 && yaw_deg < 3.0);
    for vehicle in 0..4 {
        let health = fleet
            .health(vehicle)
            .and_then(|health| health.mutual.as_ref());
        let health = health.expect("it has a camera");
        assert_eq!(health.why, None);
        assert!(
            health.attitude_settled && health.sets_heard > 1_000,
            "{health:?}"
        );
    }
}

/// Team RMSE of the own positions over the whole flight, in metres.
fn own_error_m(mut fleet: Fleet, until_s: i64) -> f64 {
    let mut squares = Vec::new();
    for second in 1..=until_s {
        fleet.run_until(second * SECOND_NS);
        squares.extend((0..fleet.len()).map(|vehicle| fleet.position_error_m(vehicle).powi(2)));
    }
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

#[test]
fn a_bearing_whose_neighbour_is_known_holds_the_own_pose() {
    let with = |bearings_to_cooperative| MutualConfig {
        bearings_to_cooperative,
        ..MutualConfig::DEFAULT
    };
    let square = built_in("square");
    let alone = own_error_m(fleet(&square, 2, with(false)), 40);
    let held = own_error_m(fleet(&square, 2, with(true)), 40);
    eprintln!("odometry alone {alone:.3} m, with identified bearings {held:.3} m");
    assert!(held < 0.6 * alone, "{held} against {alone}");
}

#[test]
fn robots_that_say_nothing_are_nobody() {
    let mut fleet = fleet(&built_in("eight"), 1, MutualConfig::DEFAULT);
    let bystanders = fleet.stage().scenario().bystanders.clone();
    assert_eq!(bystanders.len(), 2);
    fleet.run_until(20 * SECOND_NS);
    let (mut named, mut wrong) = (0_u32, 0_u32);
    for step in 0..20 {
        fleet.run_until(20 * SECOND_NS + step * SECOND_NS / 2);
        for of in 0..fleet.len() {
            let Some(estimate) = fleet.estimate(of) else {
                continue;
            };
            for (direction, name) in surely_named(estimate) {
                named += 1;
                wrong += u32::from(nearest_name(&fleet, of, estimate, &direction) != Some(name));
            }
        }
    }
    eprintln!("{named} features named, {wrong} of them wrongly");
    assert!(named > 200);
    assert!(
        f64::from(wrong) < 0.05 * f64::from(named),
        "{wrong} of {named}"
    );
}

/// The features of an estimate that are said to be somebody with 95 %.
fn surely_named(estimate: &EstimateDocument) -> Vec<(Vector3<f64>, String)> {
    let mut named = Vec::new();
    for feature in &estimate.features {
        let sure = feature
            .identities
            .iter()
            .find(|(_, probability)| **probability > 0.95);
        if let Some((name, _)) = sure {
            named.push((Vector3::from(feature.direction_level), name.clone()));
        }
    }
    named
}

/// Who truly is nearest to a direction in a vehicle's level frame; none when it is a robot without a name.
fn nearest_name(
    fleet: &Fleet,
    of: usize,
    estimate: &EstimateDocument,
    direction: &Vector3<f64>,
) -> Option<String> {
    let at_ns = fleet.stage().time_ns(of, estimate.taken_ns);
    let own = fleet.stage().truth(of, at_ns)?;
    let (_, _, yaw) = own.rotation.euler_angles();
    let world_from_level = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::z_axis(), yaw);
    let seen = world_from_level * direction;
    let angle = |position: &Vector3<f64>| (position - own.translation.vector).angle(&seen);
    let team = (0..fleet.len()).filter(|who| *who != of).map(|who| {
        let place = fleet
            .stage()
            .truth(who, at_ns)
            .expect("it flies")
            .translation
            .vector;
        (angle(&place), Some(fleet.stage().name(who).to_string()))
    });
    let bystanders = fleet
        .stage()
        .scenario()
        .bystanders
        .iter()
        .map(|trajectory| {
            let place = trajectory.pose_at(at_ns as f64 * 1e-9).translation.vector;
            (angle(&place), None)
        });
    let nearest = team.chain(bystanders).min_by(|a, b| a.0.total_cmp(&b.0))?;
    nearest.1
}

#[test]
fn the_published_way_flies_the_same_again_for_the_same_seed() {
    let published = MutualConfig {
        way: MutualWay::Published,
        ..MutualConfig::DEFAULT
    };
    let fly = || {
        let mut fleet = fleet(&built_in("square"), 3, published);
        fleet.run_until(6 * SECOND_NS);
        fleet.log();
        fleet.run_until(8 * SECOND_NS);
        let health = fleet.health(0).and_then(|health| health.mutual.clone());
        (fleet.take_log(), health.expect("it has a camera"))
    };
    let ((one, health), (two, _)) = (fly(), fly());
    assert!(health.work_done > 10, "{health:?}");
    assert!(one.len() > 1_000 && one == two);
}

#[test]
fn a_vehicle_that_cannot_locate_anybody_says_why() {
    let without = |change: fn(&mut Scenario)| {
        let mut scenario = built_in("square");
        change(&mut scenario);
        let mut fleet = fleet(&scenario, 0, MutualConfig::DEFAULT);
        fleet.run_until(3 * SECOND_NS);
        let health = fleet.health(0).expect("it tells its health");
        health.mutual.clone().and_then(|mutual| mutual.why)
    };
    let why = without(|scenario| scenario.camera = None).expect("it has a reason");
    assert!(why.contains("no camera frame"), "{why}");
    let why = without(|scenario| scenario.imu = None).expect("it has a reason");
    assert!(why.contains("no inertial reading"), "{why}");
    let why = without(|scenario| scenario.team.truncate(1)).expect("it has a reason");
    assert!(why.contains("no neighbour tells"), "{why}");
}
