//! Stories of whole fleets in virtual time, flown by the production vehicle and codec: what their users would see.
#![allow(clippy::unwrap_used)]

use nalgebra::Vector3;
use rayon::prelude::*;
use skein_estimation::Transform;
use skein_estimation::cooperative::{Mode, Robust};
use skein_estimation::time::{Span, Stamp};
use skein_proto::codec;
use skein_proto::exchange::Exchange;
use skein_proto::frame::{FixFrame, FixValue, Frame, RelativeFrame, RelativeValue};
use skein_proto::keys::boot_text;
use skein_proto::status::Status;
use skein_simworld::fleet::{Fleet, Logged, LoggedValue};
use skein_simworld::radio::Silence;
use skein_simworld::scenario::Scenario;
use skein_simworld::stage::Stage;
use skein_simworld::truth::Pose;
use skein_simworld::world::{Delivery, ODOMETRY, RELATIVE, World, nanos, numbers};
use skein_tests::stories::{altered, built_in, name, neighbour, status, why};
use skein_vehicle::{Config, Output, PacketKey, SensorConfig, Start, Vehicle};

/// Each vehicle for itself, robust.
const STAR: Mode = Mode::Star(Robust::DEFAULT);
/// The round of every scenario here, 0.2 s.
const PERIOD_NS: i64 = 200_000_000;

fn as_configured(_: usize, config: Config) -> Config {
    config
}

fn in_star(_: usize, config: Config) -> Config {
    Config {
        mode: STAR,
        ..config
    }
}

/// Squared errors of the estimate and of odometry alone, summed over the team at the end of the scenario.
fn squares_at_the_end<S: Stage>(
    fleet: &mut Fleet<S>,
    scenario: &Scenario,
    reckoned: impl Fn(&S, usize) -> Pose,
) -> (f64, f64) {
    let end_ns = nanos(scenario.duration_s);
    fleet.run_until(end_ns);
    // The world prepares a round one period ahead: until the end is handled, its odometry reaches exactly to the end.
    let alone = (0..fleet.len()).map(|vehicle| {
        let truth = fleet.stage().truth(vehicle, end_ns).unwrap();
        (reckoned(fleet.stage(), vehicle).translation.vector - truth.translation.vector)
            .norm_squared()
    });
    let alone = alone.sum();
    fleet.run_until(end_ns + PERIOD_NS);
    let together = (0..fleet.len())
        .map(|vehicle| fleet.position_error_m(vehicle).powi(2))
        .sum();
    (together, alone)
}

#[test]
fn over_a_bad_radio_a_flight_still_beats_dead_reckoning_and_the_loss_asked_for_is_the_loss_counted()
{
    let scenario = built_in("section-v-lossy");
    let (mut together, mut alone, mut sent, mut lost) = (0.0, 0.0, 0, 0);
    for sample in 0..10 {
        let mut fleet = Fleet::new(&scenario, sample);
        let squares =
            squares_at_the_end(&mut fleet, &scenario, |world, v| *world.dead_reckoning(v));
        together += squares.0;
        alone += squares.1;
        let count = fleet.radio().total();
        sent += count.sent;
        lost += count.lost;
    }
    let (together, alone) = ((together / 50.0f64).sqrt(), (alone / 50.0f64).sqrt());
    let loss = lost as f64 / sent as f64;
    eprintln!(
        "30 % loss, 100 ms: RMSE {together:.3} m, dead reckoning {alone:.3} m; {lost} of {sent} packets lost"
    );
    assert!(together < 0.4 * alone, "{together} against {alone}");
    let stderr = (0.3 * 0.7 / sent as f64).sqrt();
    assert!(
        (loss - 0.3).abs() < 4.0 * stderr,
        "{loss} of {sent} packets"
    );
}

/// Mean squared position error of robot 1 over the 100 rounds.
fn mean_square_m2(mut fleet: Fleet) -> f64 {
    let square = |k: i64| {
        fleet.run_until((k + 1) * PERIOD_NS);
        fleet.position_error_m(0).powi(2)
    };
    (1..=100).map(square).sum::<f64>() / 100.0
}

/// Ratio of two root mean squares over the same samples, and its standard error (delta method, paired).
fn paired_ratio(pairs: &[(f64, f64)]) -> (f64, f64) {
    let n = pairs.len() as f64;
    let mean = |of: &dyn Fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>() / n;
    let (plain, other) = (mean(&|pair| pair.0), mean(&|pair| pair.1));
    let squared = other / plain;
    let variance = mean(&|pair| (pair.1 - squared * pair.0).powi(2)) / (n - 1.0) / plain.powi(2);
    (squared.sqrt(), variance.sqrt() / (2.0 * squared.sqrt()))
}

#[test]
fn readings_that_are_late_mounted_and_out_of_phase_cost_robot_1_less_than_15_percent_of_the_papers_error()
 {
    let (plain, mounted) = (built_in("section-v"), built_in("section-v-mounted"));
    let fly = |scenario: &Scenario, sample, mode| {
        let in_mode = |_, config| Config { mode, ..config };
        mean_square_m2(Fleet::with_configs(scenario, sample, in_mode))
    };
    let flown: Vec<[f64; 4]> = (0..200)
        .into_par_iter()
        .map(|sample| {
            [
                fly(&plain, sample, Mode::Paper),
                fly(&mounted, sample, Mode::Paper),
                fly(&plain, sample, STAR),
                fly(&mounted, sample, STAR),
            ]
        })
        .collect();
    let ratio = |one: usize, other: usize| {
        let pairs: Vec<(f64, f64)> = flown.iter().map(|of| (of[one], of[other])).collect();
        paired_ratio(&pairs)
    };
    let ((paper, stderr), (star, star_stderr), (against, _)) =
        (ratio(0, 1), ratio(2, 3), ratio(1, 3));
    eprintln!(
        "{} samples: mounted / plain RMSE = {paper:.3} +- {stderr:.3}; in mode star {star:.3} +- \
         {star_stderr:.3}, where it is {against:.3} of the paper's",
        flown.len()
    );
    assert!(paper < 1.15, "{paper} +- {stderr}");
    // The star has less error to begin with, of which delay and distance take a larger part.
    assert!(star < 1.4, "{star} +- {star_stderr}");
    assert!(against < 1.0, "{against}");
}

#[test]
fn mounts_that_are_left_out_of_the_configuration_are_seen_in_the_error() {
    let (plain, mounted) = (built_in("section-v"), built_in("section-v-mounted"));
    let forgetful = |_, mut config: Config| {
        for sensor in &mut config.sensors {
            sensor.body_from_sensor = Transform::identity();
        }
        config
    };
    let pairs: Vec<(f64, f64)> = (0..10)
        .into_par_iter()
        .map(|sample| {
            let forgetful = Fleet::with_configs(&mounted, sample, forgetful);
            (
                mean_square_m2(Fleet::new(&plain, sample)),
                mean_square_m2(forgetful),
            )
        })
        .collect();
    let (ratio, stderr) = paired_ratio(&pairs);
    eprintln!(
        "{} samples: without mounts / plain RMSE = {ratio:.2} +- {stderr:.2}",
        pairs.len()
    );
    assert!(ratio > 3.0, "{ratio} +- {stderr}");
}

#[test]
fn a_killed_vehicle_is_missed_comes_back_under_a_new_boot_without_a_prior_and_harms_nobody() {
    let scenario = built_in("section-v");
    // From 8 s on nobody sees v5, and it measures orientations only: nobody can tell it where it is.
    let unplaceable = |_: &World, vehicle, instant_ns, deliveries: &mut Vec<Delivery>| {
        deliveries.retain_mut(|delivery| match &mut delivery.frame {
            Frame::Relative(frame) if instant_ns > nanos(8.0) => {
                if vehicle == 4 {
                    frame.value = as_kind(&frame.value, 1);
                }
                frame.target != name("v5")
            }
            _ => true,
        });
    };
    let killed = || {
        let mut fleet = altered(&scenario, 4, in_star, unplaceable);
        fleet.run_until(nanos(5.0));
        fleet.kill(4);
        fleet.run_until(nanos(8.0));
        fleet
    };
    // Given: v5 was killed 3 s ago, the presence timeout.
    let mut fleet = killed();
    let first_boot = boot_text(fleet.config(4).boot);
    for vehicle in 0..4 {
        let health = neighbour(&fleet, vehicle, "v5");
        assert!(!health.present, "v{} still counts on v5", vehicle + 1);
        assert_eq!(status(&fleet, vehicle), Status::Tracking);
    }
    // When: it comes back without a start pose.
    fleet.run_until(nanos(10.05));
    fleet.restart(4, Start::Unknown);
    fleet.log();
    fleet.run_until(nanos(12.05));
    // Then: within 2 s its new boot is known and present to all.
    let second_boot = boot_text(fleet.config(4).boot);
    assert_ne!(first_boot, second_boot);
    for vehicle in 0..4 {
        let health = neighbour(&fleet, vehicle, "v5");
        assert!(health.present, "v{}: {health:?}", vehicle + 1);
        assert_eq!(health.boot.as_ref(), Some(&second_boot));
        assert!(health.echoes >= 4, "its clock is known: {health:?}");
        assert_eq!(status(&fleet, vehicle), Status::Tracking);
    }
    assert_eq!(status(&fleet, 4), Status::Unplaced);
    fleet.run_until(nanos(20.0));

    let log = fleet.take_log();
    let exchanges: Vec<Exchange> = log
        .iter()
        .filter(|entry| entry.vehicle == 4)
        .filter_map(sent_exchange)
        .collect();
    assert!(exchanges.len() > 50, "it takes part: {}", exchanges.len());
    assert!(
        exchanges.iter().all(|exchange| exchange.prior.is_none()),
        "it has nothing to say of where it is"
    );
    assert!(
        exchanges
            .iter()
            .any(|exchange| !exchange.measured.is_empty()),
        "it says what it measures"
    );

    // And the others' estimates are bit by bit those of a flight in which it stays dead.
    let mut without = killed();
    without.run_until(nanos(20.0));
    for vehicle in 0..4 {
        let (with, without) = (
            fleet.estimate(vehicle).unwrap(),
            without.estimate(vehicle).unwrap(),
        );
        assert_eq!(with.taken_ns, without.taken_ns);
        assert_eq!(with.pose, without.pose, "v{}", vehicle + 1);
        assert_eq!(with.velocity, without.velocity);
    }
}

fn sent_exchange(entry: &Logged) -> Option<Exchange> {
    match &entry.what {
        LoggedValue::Output(Output::Send {
            key: PacketKey::Exchange { .. },
            bytes,
        }) => Some(codec::decode::<Exchange>(bytes).unwrap().1),
        _ => None,
    }
}

#[test]
fn a_vehicle_out_of_the_radio_s_reach_is_missed_though_nobody_said_that_it_left() {
    let mut scenario = built_in("hover");
    scenario.radio.silences = vec![Silence {
        from_s: 5.0,
        to_s: 12.0,
        vehicles: vec![3],
    }];
    let mut fleet = Fleet::new(&scenario, 0);
    fleet.run_until(nanos(7.0));
    assert!(
        neighbour(&fleet, 0, "v4").present,
        "silent for 2 s, with a timeout of 3 s"
    );
    // The timeout, and the second until the next health.
    fleet.run_until(nanos(9.1));
    for vehicle in 0..3 {
        assert!(
            !neighbour(&fleet, vehicle, "v4").present,
            "v{}",
            vehicle + 1
        );
        assert_eq!(status(&fleet, vehicle), Status::Tracking);
    }
    assert_eq!(status(&fleet, 3), Status::Alone);
    fleet.run_until(nanos(14.0));
    assert!((0..3).all(|vehicle| neighbour(&fleet, vehicle, "v4").present));
    assert_eq!(status(&fleet, 3), Status::Tracking);
}

#[test]
fn a_vehicle_whose_odometry_stops_says_that_it_is_lost_and_why() {
    let scenario = built_in("hover");
    let mut fleet = altered(
        &scenario,
        0,
        as_configured,
        |_, vehicle, instant_ns, deliveries| {
            if vehicle == 2 && instant_ns > nanos(5.0) {
                deliveries.retain(|delivery| delivery.sensor != name(ODOMETRY));
            }
        },
    );
    fleet.run_until(nanos(5.5));
    assert_eq!(
        status(&fleet, 2),
        Status::Tracking,
        "half a second can be bridged"
    );
    fleet.run_until(nanos(8.0));
    assert_eq!(status(&fleet, 2), Status::Lost);
    assert!(
        why(&fleet, 2).starts_with("no odometry for "),
        "{}",
        why(&fleet, 2)
    );
    assert_eq!(
        fleet.estimate(2).unwrap().pose,
        None,
        "no pose is better than an old one"
    );
    assert_eq!(
        neighbour(&fleet, 0, "v3").status,
        Some(Status::Lost),
        "the others are told"
    );
    assert!(
        [0, 1, 3]
            .iter()
            .all(|vehicle| status(&fleet, *vehicle) == Status::Tracking)
    );
}

#[test]
fn with_nobody_present_a_vehicle_says_that_it_is_alone() {
    let mut scenario = built_in("section-v");
    scenario.team.truncate(1);
    let mut fleet = Fleet::new(&scenario, 0);
    fleet.run_until(nanos(3.0));
    assert_eq!(status(&fleet, 0), Status::Alone);
    assert!(
        why(&fleet, 0).contains("no neighbour is present"),
        "{}",
        why(&fleet, 0)
    );
    assert!(
        fleet.estimate(0).unwrap().pose.is_some(),
        "odometry alone is still an estimate"
    );
}

#[test]
fn a_team_without_a_pose_says_why_and_what_to_do_and_one_that_is_fixed_places_the_others() {
    let scenario = built_in("hover");
    let config = |index, config: Config| {
        let mut config = Config {
            start: Start::Unknown,
            ..config
        };
        if index == 1 {
            config.sensors.push(SensorConfig {
                name: name("beacon"),
                driver: "simworld".to_owned(),
                body_from_sensor: Transform::new(
                    nalgebra::UnitQuaternion::identity(),
                    Vector3::new(0.1, 0.0, 0.2),
                ),
            });
        }
        config
    };
    let mut fleet = altered(
        &scenario,
        0,
        config,
        |world, vehicle, instant_ns, deliveries| {
            // Two fixes of one vehicle, and no more: one alone might be wrong.
            if vehicle == 1 && (nanos(5.0)..nanos(5.4)).contains(&instant_ns) {
                let world_from_sensor =
                    world.pose(1, instant_ns) * Pose::translation(0.1, 0.0, 0.2);
                let value = FixValue::Pose {
                    world_from_sensor: numbers(&world_from_sensor),
                    rotation_sigma_rad: 0.01,
                    translation_sigma_m: 0.01,
                };
                let frame = Frame::Fix(FixFrame {
                    taken_ns: world.stamp_ns(1, instant_ns),
                    value,
                });
                // Before the odometry that opens the round.
                let delivery = Delivery {
                    at_ns: instant_ns,
                    sensor: name("beacon"),
                    frame,
                };
                deliveries.insert(0, delivery);
            }
        },
    );
    fleet.run_until(nanos(5.0));
    for vehicle in 0..4 {
        assert_eq!(status(&fleet, vehicle), Status::Unplaced);
        let why = why(&fleet, vehicle);
        for remedy in [
            "nobody present is located",
            "[start]",
            "@rpc/set_pose",
            "fix",
        ] {
            assert!(why.contains(remedy), "{why}");
        }
    }
    // The second fix agrees with the first, a quarter of a period after its round.
    fleet.run_until(nanos(5.25) + 1);
    assert_eq!(status(&fleet, 1), Status::Tracking);
    assert!(fleet.position_error_m(1) < 0.05);
    fleet.run_until(nanos(6.5));
    for vehicle in 0..4 {
        assert_eq!(
            status(&fleet, vehicle),
            Status::Tracking,
            "v{}",
            vehicle + 1
        );
        let error_m = fleet.position_error_m(vehicle);
        assert!(error_m < 0.5, "v{}: {error_m} m", vehicle + 1);
    }
}

/// What a sensor of another kind would have told of the same sight.
fn as_kind(value: &RelativeValue, kind: usize) -> RelativeValue {
    let RelativeValue::Pose {
        sensor_from_target: [a, b, c, x, y, z],
        rotation_sigma_rad,
        translation_sigma_m,
    } = *value
    else {
        panic!("{value:?}")
    };
    let place = Vector3::new(x, y, z);
    match kind {
        0 => *value,
        1 => RelativeValue::Orientation {
            rotation_vector_rad: [a, b, c],
            sigma_rad: rotation_sigma_rad,
        },
        2 => RelativeValue::Position {
            position_m: place.into(),
            sigma_m: translation_sigma_m,
        },
        3 => RelativeValue::Bearing {
            direction: place.normalize().into(),
            sigma_rad: rotation_sigma_rad,
        },
        _ => RelativeValue::Distance {
            distance_m: place.norm(),
            sigma_m: translation_sigma_m,
        },
    }
}

#[test]
fn every_pair_may_measure_another_kind_in_every_round() {
    let scenario = built_in("section-v");
    let (mut together, mut alone) = (0.0, 0.0);
    for sample in 0..6 {
        let mut fleet = altered(
            &scenario,
            sample,
            in_star,
            |_, vehicle, instant_ns, deliveries| {
                let round = usize::try_from(instant_ns.div_euclid(PERIOD_NS).max(0)).unwrap();
                for (nth, delivery) in deliveries.iter_mut().enumerate() {
                    if let Frame::Relative(frame) = &mut delivery.frame {
                        frame.value = as_kind(&frame.value, (round + 2 * vehicle + nth) % 5);
                    }
                }
            },
        );
        let squares = squares_at_the_end(&mut fleet, &scenario, |stage, v| {
            *stage.world.dead_reckoning(v)
        });
        together += squares.0;
        alone += squares.1;
        for vehicle in 0..5 {
            let health = fleet.health(vehicle).unwrap();
            assert!(health.rounds.solved > 60, "{:?}", health.rounds);
            let fused: u64 = health.neighbours.values().map(|other| other.fused).sum();
            assert!(fused > 100, "v{}: {fused}", vehicle + 1);
            for (other, health) in &health.neighbours {
                // A first contact with somebody whose round is complete comes too late, see below.
                let harmless = |why: &String| {
                    ["clock_unknown", "no_prior", "too_late"].contains(&why.as_str())
                };
                assert!(
                    health.refused.keys().all(harmless),
                    "v{} of {other}: {health:?}",
                    vehicle + 1
                );
            }
        }
    }
    let (together, alone) = ((together / 30.0f64).sqrt(), (alone / 30.0f64).sqrt());
    eprintln!("kinds in turn: RMSE {together:.3} m, dead reckoning {alone:.3} m");
    assert!(together < 0.5 * alone, "{together} against {alone}");
}

/// Every vehicle's estimates in the order in which it published them.
fn estimates(log: &[Logged]) -> Vec<&Logged> {
    log.iter()
        .filter(|entry| matches!(&entry.what, LoggedValue::Output(Output::Estimate { .. })))
        .collect()
}

#[test]
fn readings_of_names_that_nobody_bears_are_counted_and_change_nothing() {
    let scenario = built_in("section-v");
    let fly = |mode: fn(usize, Config) -> Config, strangers: bool| {
        let mut fleet = altered(
            &scenario,
            2,
            mode,
            move |world, vehicle, instant_ns, deliveries| {
                if !strangers || instant_ns <= 0 {
                    return;
                }
                for stranger in ["ghost", "v99"] {
                    let value = RelativeValue::Distance {
                        distance_m: 3.0,
                        sigma_m: 0.1,
                    };
                    let frame = RelativeFrame {
                        taken_ns: world.stamp_ns(vehicle, instant_ns),
                        target: name(stranger),
                        value,
                    };
                    let frame = Frame::Relative(frame);
                    deliveries.insert(
                        0,
                        Delivery {
                            at_ns: instant_ns,
                            sensor: name(RELATIVE),
                            frame,
                        },
                    );
                }
            },
        );
        fleet.log();
        fleet.run_until(nanos(10.1));
        fleet
    };
    // Two readings in each of 49 rounds, none of a name whose clock is known; the health of 10 s comes before round 50. In
    // mode `team` they count when their rounds leave the window, ten rounds later.
    type Configured = fn(usize, Config) -> Config;
    let modes: [(Configured, u64); 2] = [(in_star, 98), (as_configured, 78)];
    for (mode, times) in modes {
        let (mut plain, mut haunted) = (fly(mode, false), fly(mode, true));
        for vehicle in 0..5 {
            let refused = |fleet: &Fleet<_>| fleet.health(vehicle).unwrap().refused.clone();
            assert!(refused(&plain).is_empty());
            let expected = [("clock_unknown".to_owned(), times)].into();
            assert_eq!(refused(&haunted), expected);
        }
        assert!(estimates(&plain.take_log()) == estimates(&haunted.take_log()));
    }
}

#[test]
fn a_phantom_beside_the_robot_that_it_is_taken_for_is_counted_and_changes_nothing() {
    let mut scenario = built_in("hover");
    // Nobody is ever missed, so that each phantom comes second.
    scenario.sensor.miss_probability = 0.0;
    let fly = |phantoms: usize| {
        let mut scenario = scenario.clone();
        scenario.sensor.false_positives.phantoms = phantoms;
        let mut fleet = Fleet::new(&scenario, 3);
        fleet.log();
        fleet.run_until(nanos(10.1));
        fleet
    };
    let (mut plain, mut haunted) = (fly(0), fly(2));
    let superseded = |fleet: &Fleet| -> u64 {
        let health = (0..4).flat_map(|vehicle| fleet.health(vehicle).unwrap().neighbours.values());
        health
            .filter_map(|neighbour| neighbour.refused.get("superseded"))
            .sum()
    };
    assert_eq!(superseded(&plain), 0);
    // Four observers of two phantoms each for 50 rounds, some out of the sensor's range.
    assert!(
        (200..=400).contains(&superseded(&haunted)),
        "{}",
        superseded(&haunted)
    );
    assert!(estimates(&plain.take_log()) == estimates(&haunted.take_log()));
}

#[test]
fn a_neighbour_with_another_period_is_reported_and_used() {
    let scenario = built_in("hover");
    let slow = |index, config: Config| {
        if index == 1 {
            Config {
                period: Span::millis(400),
                round_wait: Span::millis(600),
                ..config
            }
        } else {
            config
        }
    };
    let mut fleet = Fleet::with_configs(&scenario, 0, slow);
    fleet.run_until(nanos(20.0));
    assert_eq!(neighbour(&fleet, 0, "v2").other_period_s, Some(0.4));
    assert_eq!(neighbour(&fleet, 1, "v1").other_period_s, Some(0.2));
    assert_eq!(neighbour(&fleet, 0, "v3").other_period_s, None);
    assert!(
        neighbour(&fleet, 0, "v2").fused > 20,
        "{:?}",
        neighbour(&fleet, 0, "v2")
    );
    for vehicle in 0..4 {
        assert_eq!(status(&fleet, vehicle), Status::Tracking);
        let (error, alone) = (fleet.position_error_m(vehicle), 1.0);
        assert!(error < alone, "v{}: {error} m", vehicle + 1);
    }
}

#[test]
fn the_first_contact_between_strangers_counts_in_the_round_in_which_it_happens() {
    let mut scenario = built_in("hover");
    scenario.team.truncate(2);
    scenario.sensor.miss_probability = 0.0;
    // The contact falls onto every phase of the greetings, which are sent once a second.
    let contacts = [(21, 0.0), (22, 0.0), (23, 0.1), (24, 0.1), (25, 0.0)];
    let modes: [fn(usize, Config) -> Config; 2] = [in_star, as_configured];
    let each = modes
        .into_iter()
        .flat_map(|mode| contacts.map(|contact| (mode, contact)));
    for (mode, (round, delay_s)) in each {
        scenario.radio.delay_s = delay_s;
        let contact_ns = round * PERIOD_NS;
        let mut fleet = altered(&scenario, 0, mode, |_, vehicle, instant_ns, deliveries| {
            // Only v1 sees v2, once.
            if (vehicle, instant_ns) != (0, contact_ns) {
                deliveries.retain(|delivery| delivery.sensor == name(ODOMETRY));
            }
        });
        fleet.run_until(contact_ns);
        assert_eq!(
            [status(&fleet, 0), status(&fleet, 1)],
            [Status::DeadReckoning; 2]
        );
        // There and back again, and no round is solved before a quarter of the period is over.
        fleet.run_until(contact_ns + (2 * nanos(delay_s)).max(PERIOD_NS / 4) + 1);
        let both = [status(&fleet, 0), status(&fleet, 1)];
        assert_eq!(
            both,
            [Status::Tracking; 2],
            "round {round}, delay {delay_s} s"
        );
    }
}

#[test]
fn a_first_contact_with_somebody_who_has_heard_all_others_already_counts_too() {
    let mut scenario = built_in("hover");
    scenario.team.truncate(3);
    scenario.sensor.miss_probability = 0.0;
    let mut late = 0;
    for contact in 21..26 {
        // v1 and v2 see each other in every round; v3 sees v1 from the contact on, and nobody sees v3.
        let mut fleet = altered(
            &scenario,
            0,
            as_configured,
            |_, vehicle, instant_ns, deliveries| {
                deliveries.retain(|delivery| match (&delivery.frame, vehicle) {
                    (Frame::Relative(frame), 0) => frame.target == name("v2"),
                    (Frame::Relative(frame), 1) => frame.target == name("v1"),
                    (Frame::Relative(frame), _) => {
                        frame.target == name("v1") && instant_ns >= contact * PERIOD_NS
                    }
                    _ => true,
                });
            },
        );
        fleet.run_until(nanos(10.1));
        let health = neighbour(&fleet, 0, "v3");
        late += health.refused.get("too_late").copied().unwrap_or_default();
        let rounds = u64::try_from(49 - contact).unwrap();
        assert!(
            health.fused >= rounds,
            "{} of {rounds}, {:?}",
            health.fused,
            health.refused
        );
    }
    assert_eq!(
        late, 0,
        "a complete round waits a little for whoever else may come"
    );
}

#[test]
fn two_flights_of_one_seed_are_the_same_bit_by_bit_whatever_happens_in_them() {
    let mut scenario = built_in("section-v-mounted");
    scenario.radio = built_in("section-v-lossy").radio;
    let fly = |sample| {
        let mut fleet = Fleet::new(&scenario, sample);
        fleet.log();
        fleet.run_until(nanos(3.0));
        fleet.kill(3);
        fleet.run_until(nanos(5.0));
        fleet.restart(3, Start::Unknown);
        fleet.run_until(nanos(8.0));
        fleet.take_log()
    };
    let (one, two, other) = (fly(6), fly(6), fly(7));
    assert!(one.len() > 4_000, "{}", one.len());
    assert!(one == two);
    assert!(one != other, "another sample is another flight");
}

#[test]
fn a_logged_flight_fed_into_fresh_vehicles_gives_every_output_again() {
    let mut scenario = built_in("section-v-mounted");
    scenario.radio = built_in("section-v-lossy").radio;
    let mut fleet = Fleet::new(&scenario, 8);
    fleet.log();
    let begins_ns = fleet.stage().begins_ns();
    fleet.run_until(nanos(10.0));
    let log = fleet.take_log();
    for vehicle in 0..5 {
        let started = Stamp::from_nanos(fleet.stage().stamp_ns(vehicle, begins_ns));
        let mut again = Vehicle::new(fleet.config(vehicle).clone(), started);
        let mut outputs = 0;
        for entry in log.iter().filter(|entry| entry.vehicle == vehicle) {
            match &entry.what {
                LoggedValue::Input(input) => again.handle(entry.stamp, input.clone()),
                LoggedValue::Output(output) => {
                    assert!(
                        again.poll() == *output,
                        "v{}, output {outputs}",
                        vehicle + 1
                    );
                    outputs += 1;
                }
            }
        }
        assert!(outputs > 500, "{outputs}");
    }
}
