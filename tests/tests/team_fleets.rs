//! What happens to whole fleets in mode `team`, the default: parts that meet, fixes that come back, a sensor that lies,
//! and what its packets weigh.
#![allow(clippy::unwrap_used)]

use nalgebra::{Point3, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use skein_estimation::{Transform, World as WorldFrame};
use skein_proto::frame::{FixFrame, FixValue, Frame, RelativeValue};
use skein_proto::status::Status;
use skein_simworld::fleet::{Fleet, LoggedValue};
use skein_simworld::scenario::Scenario;
use skein_simworld::stage::Stage;
use skein_simworld::world::{Delivery, World, nanos};
use skein_tests::stories::{altered, built_in, name, nees, neighbour, position_sigma_m, status};
use skein_vehicle::{Config, Output, PacketKey, SensorConfig, Start, ToldPose};
use std::f64::consts::TAU;

/// The round of every scenario here, 0.2 s.
const PERIOD_NS: i64 = 200_000_000;
/// Flights of each story.
const SAMPLES: u64 = 2;
/// The receiver of fixes.
const RECEIVER: &str = "gnss";
/// Where its antenna is on the body, metres.
const ANTENNA_M: [f64; 3] = [0.2, 0.0, 0.1];
/// Standard deviation of a fix per axis, metres.
const FIX_SIGMA_M: f64 = 0.05;

/// The configuration of a vehicle with a receiver of fixes.
fn with_receiver(mut config: Config) -> Config {
    let antenna = Vector3::from(ANTENNA_M);
    config.sensors.push(SensorConfig {
        name: name(RECEIVER),
        driver: "simworld".to_owned(),
        body_from_sensor: Transform::new(UnitQuaternion::identity(), antenna),
    });
    config
}

/// A fix of a vehicle's antenna at a round, before the odometry that opens it.
fn fix(world: &World, vehicle: usize, instant_ns: i64, chance: &mut ChaCha8Rng) -> Delivery {
    let antenna = world.pose(vehicle, instant_ns) * Point3::from(ANTENNA_M);
    // Of the same variance as a normal one, and nowhere farther.
    let span_m = FIX_SIGMA_M * 3.0_f64.sqrt();
    let noisy = antenna
        .coords
        .map(|axis| axis + chance.random_range(-span_m..span_m));
    Delivery {
        at_ns: instant_ns,
        sensor: name(RECEIVER),
        frame: Frame::Fix(FixFrame {
            taken_ns: world.stamp_ns(vehicle, instant_ns),
            value: FixValue::Position {
                position_m: noisy.into(),
                sigma_m: FIX_SIGMA_M,
            },
        }),
    }
}

/// When the second sub-team is beside the first, and when the flight ends, seconds.
const BESIDE_S: f64 = 20.0;
const AFTER_S: f64 = 30.0;
/// How far off the second one's operator thought that it started: everybody by the same, as a map is turned.
const TURNED_RAD: f64 = 0.05;
const SHIFTED_M: [f64; 3] = [1.0, -0.5, 0.3];

/// Three vehicles that circle about a place, and three that come from 50 m away and circle beside them from then on.
fn two_sub_teams() -> Scenario {
    let mut text = String::from(
        "name = \"two-sub-teams\"\nduration_s = 40.0\n[sensor]\nkind = \"pose\"\nrange_m = 7.0\n\
         miss_probability = 0.25\n[radio]\nrange_m = 20.0\n",
    );
    for vehicle in 0..6 {
        let nth = f64::from(vehicle % 3);
        text += "[[team.vehicles]]\ntrajectory.waypoints = [\n";
        for half_seconds in 0..=80 {
            let t_s = 0.5 * f64::from(half_seconds);
            let away_m = match vehicle {
                0..3 => 0.0,
                _ => 4.0 + 2.5 * (BESIDE_S - t_s).max(0.0),
            };
            let turned = TAU * (t_s / (15.0 + 3.0 * nth) + nth / 3.0);
            let place = [
                away_m + 2.0 * turned.cos(),
                3.0 * nth + 2.0 * turned.sin() - 3.0,
                1.0 + nth + 0.5 * turned.sin(),
            ];
            let yaw_deg = (turned.to_degrees() + 90.0) % 360.0;
            text += &format!("  {{ t_s = {t_s}, position_m = {place:?}, yaw_deg = {yaw_deg} }},\n");
        }
        text += "]\n";
    }
    Scenario::parse(&text, "two sub-teams").unwrap()
}

/// Where the second sub-team's operator thinks that it starts, and that he may be wrong.
fn told_wrong(config: Config) -> Config {
    let Start::Pose(told) = config.start else {
        unreachable!("the scenario places everybody");
    };
    let error: Transform<WorldFrame, WorldFrame> = Transform::new(
        UnitQuaternion::from_euler_angles(0.0, 0.0, TURNED_RAD),
        Vector3::from(SHIFTED_M),
    );
    Config {
        start: Start::Pose(ToldPose {
            world_from_body: error * told.world_from_body,
            rotation_sigma_rad: 0.1,
            translation_sigma_m: 2.0,
        }),
        ..config
    }
}

/// The last round before anybody of one sub-team can see anybody of the other.
fn meeting_ns(world: &World) -> i64 {
    let place = |vehicle, instant_ns| world.pose(vehicle, instant_ns).translation.vector;
    let sees = |instant_ns: &i64| {
        let mut pairs = (0..3).flat_map(|one| (3..6).map(move |other| (one, other)));
        pairs.any(|(one, other)| (place(one, *instant_ns) - place(other, *instant_ns)).norm() < 7.0)
    };
    let rounds = (50..).map(|round| round * PERIOD_NS);
    rounds.clone().find(sees).unwrap() - PERIOD_NS
}

/// The error of a vehicle's position and how large it expects it to be, metres.
fn error<S: Stage>(fleet: &Fleet<S>, vehicle: usize) -> (Vector3<f64>, f64) {
    let (truth, estimate) = fleet.scored(vehicle).unwrap();
    let off = estimate.translation.vector - truth.translation.vector;
    (off, position_sigma_m(fleet, vehicle))
}

/// Root of a mean of squares.
fn root_mean(squares: &[f64]) -> f64 {
    (squares.iter().sum::<f64>() / squares.len() as f64).sqrt()
}

/// Everybody who was ever put into quarantine by anybody, by index: who, whom.
fn accused<S: Stage>(fleet: &Fleet<S>) -> Vec<(usize, usize)> {
    let pairs = (0..fleet.len()).flat_map(|by| (0..fleet.len()).map(move |of| (by, of)));
    let is_accused = |(by, of): &(usize, usize)| {
        let health = fleet.health(*by).unwrap();
        let of = health.neighbours.get(fleet.config(*of).vehicle.as_str());
        of.is_some_and(|health| health.quarantined || health.quarantines > 0)
    };
    pairs.filter(is_accused).collect()
}

#[test]
fn of_two_sub_teams_that_meet_the_one_with_fixes_stays_and_the_other_is_right_within_two_seconds() {
    const FIXED: usize = 0;
    let scenario = two_sub_teams();
    let fly = |sample| {
        let mut chance = ChaCha8Rng::seed_from_u64(sample);
        let gives_fixes = move |world: &World, vehicle, instant_ns, deliveries: &mut Vec<_>| {
            if vehicle == FIXED && instant_ns > 0 {
                deliveries.insert(0, fix(world, vehicle, instant_ns, &mut chance));
            }
        };
        let config = |vehicle, config| match vehicle {
            FIXED => with_receiver(config),
            1 | 2 => config,
            _ => told_wrong(config),
        };
        let mut fleet = altered(&scenario, sample, config, gives_fixes);
        let meeting_ns = meeting_ns(&fleet.stage().world);
        fleet.run_until(meeting_ns);
        let lost = [3, 4, 5].map(|vehicle| fleet.position_error_m(vehicle).powi(2));
        // Truth moves and odometry with it: what changes an error from round to round is what the others said.
        let mut before = [0, 1, 2].map(|vehicle| error(&fleet, vehicle));
        for round in 1..=10 {
            fleet.run_until(meeting_ns + round * PERIOD_NS);
            for (vehicle, (then, sigma_m)) in before.iter_mut().enumerate() {
                let (now, now_sigma_m) = error(&fleet, vehicle);
                let (moved_m, v) = ((now - *then).norm(), vehicle + 1);
                assert!(
                    moved_m < 3.0 * *sigma_m,
                    "sample {sample}, v{v}: {moved_m} m of {sigma_m} m"
                );
                (*then, *sigma_m) = (now, now_sigma_m);
            }
        }
        let found = [3, 4, 5].map(|vehicle| fleet.position_error_m(vehicle).powi(2));
        let meant = [3, 4, 5].map(|vehicle| nees(&fleet, vehicle));
        assert!((0..6).all(|vehicle| status(&fleet, vehicle) == Status::Tracking));
        fleet.run_until(nanos(AFTER_S));
        // Not on the first words over the radio either, when where the others are follows from their starts alone.
        assert_eq!(accused(&fleet), [], "sample {sample}");
        (lost, found, meant)
    };
    let flown: Vec<_> = (0..SAMPLES).into_par_iter().map(fly).collect();
    let lost_m = root_mean(&flown.iter().flat_map(|of| of.0).collect::<Vec<_>>());
    let found_m = root_mean(&flown.iter().flat_map(|of| of.1).collect::<Vec<_>>());
    let nees = flown.iter().flat_map(|of| of.2).sum::<f64>() / (3 * SAMPLES) as f64;
    println!("the others were {lost_m:.3} m off and are {found_m:.3} m off; NEES {nees:.2}");
    assert!(lost_m > 1.0 && found_m < 0.15, "{lost_m} {found_m}");
    assert!((0.3..2.0).contains(&nees), "{nees}");
}

#[test]
fn fixes_that_one_vehicle_regains_after_a_minute_put_everybody_right() {
    const FIXED: usize = 2;
    const REGAINED_S: f64 = 60.0;
    let scenario = built_in("section-v");
    let fly = |sample| {
        let mut chance = ChaCha8Rng::seed_from_u64(sample);
        let gives_fixes = move |world: &World, vehicle, instant_ns, deliveries: &mut Vec<_>| {
            if vehicle == FIXED && instant_ns >= nanos(REGAINED_S) {
                deliveries.insert(0, fix(world, vehicle, instant_ns, &mut chance));
            }
        };
        let config = |vehicle, config| match vehicle {
            FIXED => with_receiver(config),
            _ => config,
        };
        let mut fleet = altered(&scenario, sample, config, gives_fixes);
        fleet.run_until(nanos(REGAINED_S));
        let before = [0, 1, 2, 3, 4].map(|vehicle| fleet.position_error_m(vehicle).powi(2));
        fleet.run_until(nanos(REGAINED_S + 5.0));
        let after = [0, 1, 2, 3, 4].map(|vehicle| fleet.position_error_m(vehicle).powi(2));
        let meant = [0, 1, 2, 3, 4].map(|vehicle| nees(&fleet, vehicle));
        assert!((0..5).all(|vehicle| status(&fleet, vehicle) == Status::Tracking));
        assert_eq!(accused(&fleet), [], "sample {sample}");
        (before, after, meant)
    };
    let flown: Vec<_> = (0..SAMPLES).into_par_iter().map(fly).collect();
    let before_m = root_mean(&flown.iter().flat_map(|of| of.0).collect::<Vec<_>>());
    let after_m = root_mean(&flown.iter().flat_map(|of| of.1).collect::<Vec<_>>());
    let nees = flown.iter().flat_map(|of| of.2).sum::<f64>() / (5 * SAMPLES) as f64;
    println!("{before_m:.3} m off before, {after_m:.3} m five seconds later; NEES {nees:.2}");
    assert!(
        after_m < 0.5 * before_m && after_m < 0.08,
        "{before_m} {after_m}"
    );
    assert!((0.3..2.0).contains(&nees), "{nees}");
}

/// When a sensor begins to measure a metre too far to the left, and when it ends, seconds.
const LIES_S: std::ops::Range<f64> = 8.0..12.0;
const LIAR: usize = 1;
/// Rounds of lies after which everybody has it in quarantine: of 40 flights 35 needed ten or less, and 5 eleven.
const FOUND_OUT_ROUNDS: i64 = 11;
/// Honest rounds after which it is believed again.
const BELIEVED_ROUNDS: i64 = 20;

#[test]
fn a_sensor_that_is_a_metre_off_is_soon_in_quarantine_and_believed_again_twenty_rounds_after_it_is_mended()
 {
    // Everybody sees everybody in three rounds of four: rounds in which it measures nothing tell nothing of it.
    let scenario = built_in("hover");
    let lies = |_: &World, vehicle, instant_ns, deliveries: &mut Vec<Delivery>| {
        let is_time = (nanos(LIES_S.start)..nanos(LIES_S.end)).contains(&instant_ns);
        for delivery in deliveries {
            if let Frame::Relative(frame) = &mut delivery.frame
                && let RelativeValue::Pose {
                    sensor_from_target, ..
                } = &mut frame.value
                && vehicle == LIAR
                && is_time
            {
                sensor_from_target[4] += 1.0;
            }
        }
    };
    let others = [0, 2, 3];
    let fly = |sample| {
        let mut fleet = altered(&scenario, sample, |_, config| config, lies);
        let quarantined =
            |fleet: &Fleet<_>| others.map(|vehicle| neighbour(fleet, vehicle, "v2").quarantined);
        fleet.run_until(nanos(LIES_S.start));
        assert_eq!(quarantined(&fleet), [false; 3], "sample {sample}");
        // A quarantine is told at once.
        fleet.run_until(nanos(LIES_S.start) + FOUND_OUT_ROUNDS * PERIOD_NS);
        assert_eq!(quarantined(&fleet), [true; 3], "sample {sample}");
        fleet.run_until(nanos(LIES_S.end));
        assert_eq!(quarantined(&fleet), [true; 3], "sample {sample}");
        let worst_m = others.map(|vehicle| fleet.position_error_m(vehicle));
        assert!(worst_m.iter().all(|error_m| *error_m < 0.3), "{worst_m:?}");
        // Its end is told with the next health, once a second.
        fleet.run_until(nanos(LIES_S.end) + BELIEVED_ROUNDS * PERIOD_NS + nanos(0.1));
        assert_eq!(quarantined(&fleet), [false; 3], "sample {sample}");
        let once = others.map(|vehicle| neighbour(&fleet, vehicle, "v2").quarantines);
        assert_eq!(once, [1; 3], "sample {sample}");
        let innocent = accused(&fleet).into_iter().filter(|(_, of)| *of != LIAR);
        assert_eq!(innocent.collect::<Vec<_>>(), [], "sample {sample}");
    };
    (0..4).into_par_iter().for_each(fly);
}

/// What the documentation says that a vehicle sends to each neighbour in a round, bytes.
const RECORDED_BYTES: f64 = 1000.0;
const EXCHANGED_BYTES: f64 = 110.0;

#[test]
fn a_round_costs_each_neighbour_as_many_bytes_as_the_documentation_says() {
    let mut fleet = Fleet::new(&built_in("section-v"), 0);
    fleet.run_until(nanos(2.0));
    fleet.log();
    fleet.run_until(nanos(20.0));
    let (mut records, mut exchanges) = (0, 0);
    for entry in fleet.take_log() {
        match entry.what {
            // Everybody hears it.
            LoggedValue::Output(Output::Send {
                key: PacketKey::Odometry { .. },
                bytes,
            }) => records += 4 * bytes.len(),
            LoggedValue::Output(Output::Send { bytes, .. }) => exchanges += bytes.len(),
            _ => {}
        }
    }
    let links_and_rounds = f64::from(5 * 4 * 90);
    let (records, exchanges) = (
        records as f64 / links_and_rounds,
        exchanges as f64 / links_and_rounds,
    );
    println!("a round and neighbour: {records:.0} bytes in records, {exchanges:.0} in exchanges");
    assert!((0.9 * RECORDED_BYTES..RECORDED_BYTES).contains(&records));
    assert!((0.9 * EXCHANGED_BYTES..EXCHANGED_BYTES).contains(&exchanges));
}
