//! Vehicles that lose their pose and get it back: checkpoints, unknown starts, an operator's word, interrupted odometry
//! and fixes that return after an outage. In virtual time, with the production vehicle and codec.
#![allow(clippy::unwrap_used)]

use skein_estimation::cooperative::{Mode, Robust};
use skein_estimation::time::{Span, Stamp};
use skein_proto::codec;
use skein_proto::exchange::Exchange;
use skein_proto::frame::{FixFrame, FixValue, Frame};
use skein_proto::status::Status;
use skein_simworld::fleet::{Fleet, Logged, LoggedValue};
use skein_simworld::radio::{RadioSettings, Silence};
use skein_simworld::stage::Stage;
use skein_simworld::truth::Pose;
use skein_simworld::world::{Delivery, ODOMETRY, World, nanos, numbers};
use skein_tests::stories::{altered, built_in, name, status, why};
use skein_vehicle::{Checkpoint, Config, Input, Output, PacketKey, SensorConfig, Start};

fn robust(_: usize, config: Config) -> Config {
    Config {
        mode: Mode::Star(Robust::DEFAULT),
        ..config
    }
}

/// Flies on until a vehicle has a status; how long that took, in seconds.
fn until<S: Stage>(fleet: &mut Fleet<S>, vehicle: usize, wanted: Status, within_s: f64) -> f64 {
    let from_ns = fleet.now_ns();
    while fleet
        .estimate(vehicle)
        .is_none_or(|estimate| estimate.status != wanted)
    {
        fleet.run_s(0.01);
        let took_s = (fleet.now_ns() - from_ns) as f64 * 1e-9;
        assert!(took_s <= within_s, "not {wanted:?} within {within_s} s");
    }
    (fleet.now_ns() - from_ns) as f64 * 1e-9
}

fn priors_sent(log: &[Logged], vehicle: usize) -> Vec<(Stamp, bool)> {
    let of = log.iter().filter(|entry| entry.vehicle == vehicle);
    let sent = of.filter_map(|entry| match &entry.what {
        LoggedValue::Output(Output::Send {
            key: PacketKey::Exchange { .. },
            bytes,
        }) => {
            let (_, exchange) = codec::decode::<Exchange>(bytes).unwrap();
            Some((entry.stamp, exchange.prior.is_some()))
        }
        _ => None,
    });
    sent.collect()
}

#[test]
fn a_killed_vehicle_resumes_from_its_checkpoint_misleads_nobody_and_is_placed_by_its_neighbours() {
    let mut fleet = Fleet::with_configs(&built_in("section-v"), 4, robust);
    fleet.run_until(nanos(5.0));
    fleet.kill(4);
    let checkpoint = fleet.checkpoint(4).unwrap();
    fleet.run_until(nanos(8.0));
    fleet.log();
    // When: it is started again with what it wrote down last, 3 s ago and metres from where it is now.
    fleet.restart(4, Start::Checkpoint(checkpoint));
    let resumed_s = until(&mut fleet, 4, Status::Resuming, 1.0);
    // Then: it says at once where it thinks it is, how old that is, and what it waits for.
    let text = why(&fleet, 4);
    assert!(fleet.estimate(4).unwrap().pose.is_some());
    assert!(
        text.contains("checkpoint at") && text.contains(" s old"),
        "{text}"
    );
    let placed_s = until(&mut fleet, 4, Status::Tracking, 3.0);
    eprintln!("resuming after {resumed_s:.2} s, placed after {placed_s:.2} s more");
    assert!(
        fleet.position_error_m(4) < 1.0,
        "{} m",
        fleet.position_error_m(4)
    );
    // And no exchange carried a prior before it was placed.
    fleet.run_s(1.0);
    let log = fleet.take_log();
    let placed_at = log
        .iter()
        .find_map(|entry| match &entry.what {
            LoggedValue::Output(Output::Estimate { document, .. })
                if entry.vehicle == 4 && document.status == Status::Tracking =>
            {
                Some(entry.stamp)
            }
            _ => None,
        })
        .unwrap();
    let sent = priors_sent(&log, 4);
    assert!(sent.iter().all(|(at, prior)| !prior || *at >= placed_at));
    assert!(sent.iter().any(|(_, prior)| *prior) && sent.iter().any(|(_, prior)| !prior));
}

#[test]
fn a_checkpoint_ahead_of_the_clock_is_shown_and_never_used() {
    let mut fleet = Fleet::with_configs(&built_in("hover"), 1, robust);
    fleet.run_until(nanos(5.0));
    let checkpoint = fleet.checkpoint(0).unwrap();
    fleet.kill(0);
    fleet.change_radio(&RadioSettings {
        loss: 1.0,
        ..RadioSettings::default()
    });
    let tomorrow = Checkpoint {
        taken: checkpoint.taken + Span::secs(86_400),
        ..checkpoint
    };
    fleet.restart(0, Start::Checkpoint(tomorrow));
    fleet.run_s(2.0);
    assert_eq!(status(&fleet, 0), Status::Unplaced);
    assert_eq!(fleet.estimate(0).unwrap().pose, None);
    assert!(
        why(&fleet, 0).contains("ahead of this computer's clock"),
        "{}",
        why(&fleet, 0)
    );
}

#[test]
fn a_vehicle_alone_goes_on_resuming_and_writes_no_new_checkpoint() {
    let mut scenario = built_in("hover");
    scenario.team.truncate(1);
    let mut fleet = Fleet::with_configs(&scenario, 1, robust);
    fleet.run_until(nanos(5.0));
    let checkpoint = fleet.checkpoint(0).unwrap();
    fleet.kill(0);
    fleet.run_s(1.0);
    fleet.restart(0, Start::Checkpoint(checkpoint));
    fleet.run_s(10.0);
    assert_eq!(status(&fleet, 0), Status::Resuming);
    assert_eq!(
        fleet.checkpoint(0),
        Some(checkpoint),
        "its age goes on counting from the first"
    );
    assert!(
        why(&fleet, 0).contains("@rpc/set_pose"),
        "{}",
        why(&fleet, 0)
    );
}

/// An operator who stands beside the vehicle with a tape measure.
const fn set_pose(world_from_body: [f64; 6]) -> Input {
    Input::SetPose {
        world_from_body,
        rotation_sigma_rad: 0.02,
        translation_sigma_m: 0.05,
    }
}

#[test]
fn an_operator_s_word_places_one_vehicle_and_it_places_the_others() {
    let unplaced = |index, config| Config {
        start: Start::Unknown,
        ..robust(index, config)
    };
    let mut fleet = Fleet::with_configs(&built_in("hover"), 2, unplaced);
    fleet.run_until(nanos(3.0));
    assert!((0..4).all(|vehicle| status(&fleet, vehicle) == Status::Unplaced));
    let world_from_body = numbers(&fleet.stage().pose(2, nanos(3.0)));
    fleet.give(2, set_pose(world_from_body));
    for vehicle in 0..4 {
        until(&mut fleet, vehicle, Status::Tracking, 2.0);
        let error_m = fleet.position_error_m(vehicle);
        assert!(error_m < 0.3, "v{}: {error_m} m", vehicle + 1);
    }
    // A word that is no pose is counted and changes nothing.
    let before = fleet.estimate(2).unwrap().pose;
    let world_from_body = [f64::NAN, 0.0, 0.0, 1.0, 2.0, 3.0];
    fleet.give(2, set_pose(world_from_body));
    assert_eq!(fleet.estimate(2).unwrap().pose, before);
    fleet.run_s(1.1);
    assert_eq!(fleet.health(2).unwrap().refused.get("set_pose"), Some(&1));
}

#[test]
fn a_vehicle_whose_odometry_was_interrupted_is_placed_again_by_its_neighbours() {
    let gap = |_: &World, vehicle, instant_ns, deliveries: &mut Vec<Delivery>| {
        if vehicle == 1 && (nanos(5.0)..nanos(7.5)).contains(&instant_ns) {
            deliveries.retain(|delivery| delivery.sensor != name(ODOMETRY));
        }
    };
    let mut fleet = altered(&built_in("section-v"), 5, robust, gap);
    fleet.run_until(nanos(7.0));
    assert_eq!(status(&fleet, 1), Status::Lost);
    fleet.run_until(nanos(7.5));
    let took_s = until(&mut fleet, 1, Status::Tracking, 3.0);
    eprintln!("placed again after {took_s:.2} s");
    assert!(
        fleet.position_error_m(1) < 1.0,
        "{} m",
        fleet.position_error_m(1)
    );
}

#[test]
fn fixes_that_come_back_after_an_outage_pull_back_who_had_drifted_and_throw_nobody_who_was_right() {
    // v1 has position fixes throughout, v2 has them until 4 s and again from 14 s; between them they hear nothing.
    let beacon = |index: usize, config| {
        let mut config = robust(index, config);
        config.sensors.push(SensorConfig {
            name: name("gps"),
            driver: "simworld".to_owned(),
            body_from_sensor: skein_estimation::Transform::identity(),
        });
        config
    };
    let fixed = |world: &World, vehicle: usize, instant_ns: i64, deliveries: &mut Vec<Delivery>| {
        let outage = vehicle == 1 && (nanos(4.0)..nanos(14.0)).contains(&instant_ns);
        if instant_ns <= 0 || vehicle > 1 || outage {
            return;
        }
        let place: Pose = world.pose(vehicle, instant_ns);
        let value = FixValue::Position {
            position_m: place.translation.vector.into(),
            sigma_m: 0.02,
        };
        let frame = Frame::Fix(FixFrame {
            taken_ns: world.stamp_ns(vehicle, instant_ns),
            value,
        });
        let at_ns = instant_ns;
        let sensor = name("gps");
        deliveries.insert(
            0,
            Delivery {
                at_ns,
                sensor,
                frame,
            },
        );
    };
    let mut scenario = built_in("section-v");
    scenario.team.truncate(2);
    // How v2 stood before and after its fixes came back, and by how much v1's error rose at worst from one moment to the
    // next. Between two fixes v1 is as wrong as its heading makes it, which is no jump: so it is held against a flight in
    // which they never hear each other again.
    let fly = |silent_until_s: f64, sample: u64| {
        let mut scenario = scenario.clone();
        scenario.radio.silences = vec![Silence {
            from_s: 4.0,
            to_s: silent_until_s,
            vehicles: vec![],
        }];
        let mut fleet = altered(&scenario, sample, beacon, fixed);
        fleet.run_until(nanos(13.99));
        let before_m = fleet.position_error_m(1);
        let mut error_m = fleet.position_error_m(0);
        let mut jump_m: f64 = 0.0;
        while fleet.now_ns() < nanos(18.0) {
            fleet.run_s(0.05);
            jump_m = jump_m.max(fleet.position_error_m(0) - error_m);
            error_m = fleet.position_error_m(0);
        }
        (before_m, fleet.position_error_m(1), jump_m)
    };
    let samples = 8;
    let (mut before_m, mut after_m) = (0.0, 0.0);
    let (mut jump_m, mut alone_m) = (0.0, 0.0);
    for sample in 0..samples {
        let (before, after, jump) = fly(14.0, sample);
        before_m += before / samples as f64;
        after_m += after / samples as f64;
        jump_m += jump / samples as f64;
        alone_m += fly(100.0, sample).2 / samples as f64;
    }
    eprintln!(
        "v2: {before_m:.3} m before, {after_m:.3} m after; v1 jumps by {jump_m:.3} m, {alone_m:.3} m were v2 never heard"
    );
    assert!(before_m > 0.5, "it had drifted: {before_m} m");
    assert!(after_m < 0.1, "{after_m} m");
    assert!(jump_m < alone_m + 0.03, "{jump_m} m against {alone_m} m");
}

#[test]
fn a_vehicle_whose_clock_is_set_mid_flight_is_lost_says_so_and_is_placed_again() {
    // A clock that is set back stands still for the vehicle until it has caught up, five seconds later.
    for (by_s, placed_within_s) in [(5.0, 3.0), (-5.0, 8.0)] {
        let scenario = built_in("section-v");
        let mut fleet = Fleet::with_configs(&scenario, 6, robust);
        fleet.run_until(nanos(6.0));
        fleet.step_clock(2, by_s);
        let lost_s = until(&mut fleet, 2, Status::Lost, 1.0);
        let placed_s = until(&mut fleet, 2, Status::Tracking, placed_within_s);
        eprintln!("{by_s} s: lost after {lost_s:.2} s, placed {placed_s:.2} s later");
        fleet.run_s(1.0);
        for vehicle in 0..5 {
            let error_m = fleet.position_error_m(vehicle);
            assert!(error_m < 0.6, "{by_s} s, v{}: {error_m} m", vehicle + 1);
        }
    }
}
