//! Rounds that are repeated for those who do not hear their tellers: who learns what by that, and what it may cost nobody.
#![allow(clippy::unwrap_used)]

use rayon::prelude::*;
use skein_proto::codec;
use skein_proto::document::{NeighbourDocument, PoseDocument};
use skein_proto::envelope::{ENVELOPE_BYTES, Envelope};
use skein_proto::limits::PACKET_BYTES_MAX;
use skein_proto::name::Name;
use skein_proto::relay::Relay;
use skein_simworld::fleet::{Fleet, LoggedValue};
use skein_simworld::scenario::Scenario;
use skein_simworld::world::nanos;
use skein_tests::stories::{built_in, nees};
use skein_vehicle::{Config, Input, Output, PacketKey};

const SAMPLES: u64 = 4;
const END_S: f64 = 20.0;

fn relaying(_: usize, config: Config) -> Config {
    Config {
        relay: true,
        ..config
    }
}

fn silent(_: usize, config: Config) -> Config {
    config
}

/// Section V, where vehicles hear each other as far as they see, and no clock is right.
fn short_radio() -> Scenario {
    let mut scenario = built_in("section-v");
    scenario.radio.range_m = Some(7.0);
    scenario.clocks.ahead_s_max = 3_600.0;
    scenario
}

fn landed(scenario: &Scenario, sample: u64, config: fn(usize, Config) -> Config) -> Fleet {
    let mut fleet = Fleet::with_configs(scenario, sample, config);
    fleet.run_until(nanos(END_S) + nanos(0.3));
    fleet
}

/// What some vehicle said of itself and of the others, estimate by estimate.
fn told(fleet: &mut Fleet, vehicle: usize) -> Vec<(Option<PoseDocument>, Vec<NeighbourDocument>)> {
    let log = fleet.take_log().into_iter();
    log.filter(|entry| entry.vehicle == vehicle)
        .filter_map(|entry| match entry.what {
            LoggedValue::Output(Output::Estimate { document, .. }) => {
                Some((document.pose, document.neighbours))
            }
            _ => None,
        })
        .collect()
}

#[test]
fn vehicles_that_hear_each_other_through_others_only_are_half_as_far_off() {
    let scenario = short_radio();
    let squares = |config: fn(usize, Config) -> Config| -> (f64, f64) {
        let flown = (0..SAMPLES).into_par_iter().map(|sample| {
            let fleet = landed(&scenario, sample, config);
            let of = |vehicle| {
                (
                    fleet.position_error_m(vehicle).powi(2),
                    nees(&fleet, vehicle),
                )
            };
            let add = |sum: (f64, f64), of: (f64, f64)| (sum.0 + of.0, sum.1 + of.1);
            (0..5).map(of).fold((0.0, 0.0), add)
        });
        let sum = flown.reduce(|| (0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        let count = 5.0 * SAMPLES as f64;
        ((sum.0 / count).sqrt(), sum.1 / count)
    };
    let (alone_m, alone_nees) = squares(silent);
    let (relayed_m, relayed_nees) = squares(relaying);
    println!("{alone_m:.3} m (NEES {alone_nees:.2}), relayed {relayed_m:.3} m ({relayed_nees:.2})");
    assert!(relayed_m < 0.7 * alone_m, "{relayed_m} {alone_m}");
    assert!((0.5..1.6).contains(&relayed_nees), "{relayed_nees}");
}

#[test]
fn where_everybody_hears_everybody_what_is_repeated_changes_not_a_bit() {
    let scenario = built_in("section-v");
    let fly = |config: fn(usize, Config) -> Config| {
        let mut fleet = Fleet::with_configs(&scenario, 0, config);
        fleet.log();
        fleet.run_until(nanos(8.0));
        let relayed: u64 = (0..5)
            .flat_map(|vehicle| fleet.health(vehicle).unwrap().neighbours.values())
            .map(|other| other.accepted.get("relay").copied().unwrap_or_default())
            .sum();
        (told(&mut fleet, 0), relayed)
    };
    let ((plain, none), (repeated, many)) = (fly(silent), fly(relaying));
    assert!(none == 0 && many > 500, "{none} {many}");
    assert!(plain == repeated);
}

/// Vehicles in a line that hear and see the next one only.
fn line_of(vehicles: u32) -> Scenario {
    let mut text = String::from(
        "name = \"line\"\nduration_s = 10.0\n[sensor]\nkind = \"pose\"\nrange_m = 7.0\n\
         [radio]\nrange_m = 7.0\n[clocks]\nahead_s_max = 3600.0\n",
    );
    for nth in 0..vehicles {
        let x_m = 5.0 * f64::from(nth);
        text += "[[team.vehicles]]\n";
        text += &format!("trajectory.hover = {{ position_m = [{x_m:.1}, 0.0, 2.0] }}\n");
    }
    Scenario::parse(&text, "line").unwrap()
}

#[test]
fn who_is_two_hops_away_is_seen_with_its_covariance_and_its_clock_is_known_by_the_relay_s() {
    let mut fleet = Fleet::with_configs(&line_of(3), 0, relaying);
    fleet.run_until(nanos(8.0));
    for (vehicle, other) in [(0, 2), (2, 0)] {
        let of = fleet.config(other).vehicle;
        let estimate = fleet.estimate(vehicle).unwrap();
        let seen = estimate.neighbours.iter().find(|seen| seen.vehicle == of);
        let seen = seen.expect("it is told of");
        let x_m = seen.pose.unwrap().position_m[0];
        assert!((x_m.abs() - 10.0).abs() < 0.2, "{x_m} m");
        assert!(seen.covariance.is_some());
        let health = &fleet.health(vehicle).unwrap().neighbours[of.as_str()];
        assert!(!health.present, "out of reach all the same");
        let ahead_s = |v| fleet.stage().clock_ahead_ns(v) as f64 * 1e-9;
        let error_s = health.clock_offset_s.unwrap() - (ahead_s(other) - ahead_s(vehicle));
        assert!(error_s.abs() <= health.clock_error_s.unwrap(), "{health:?}");
        assert!(health.accepted["relayed_rounds"] > 20, "{health:?}");
    }
    // The one in the middle hears both, and itself from both: it takes nothing from either.
    let middle = fleet.health(1).unwrap();
    assert!(!middle.neighbours.contains_key("v2"));
    for of in ["v1", "v3"] {
        assert!(
            !middle.neighbours[of]
                .accepted
                .contains_key("relayed_rounds")
        );
    }
}

#[test]
fn nothing_is_repeated_twice_and_no_packet_is_longer_than_a_datagram() {
    let mut fleet = Fleet::with_configs(&line_of(4), 0, relaying);
    fleet.log();
    fleet.run_until(nanos(8.0));
    let names: Vec<Name> = (0..4)
        .map(|vehicle| fleet.config(vehicle).vehicle)
        .collect();
    let far = fleet.health(0).unwrap().neighbours.get("v4");
    assert!(far.is_none_or(|far| far.accepted.is_empty()), "three hops");
    for entry in fleet.take_log() {
        if let LoggedValue::Output(Output::Send {
            key: PacketKey::Relay { .. },
            bytes,
        }) = entry.what
        {
            assert!(bytes.len() <= ENVELOPE_BYTES + PACKET_BYTES_MAX);
            let (_, relay) = codec::decode::<Relay>(&bytes).unwrap();
            for round in relay.rounds {
                let of = names.iter().position(|name| *name == round.of).unwrap();
                assert_eq!(
                    of.abs_diff(entry.vehicle),
                    1,
                    "it hears its neighbours only"
                );
            }
        }
    }
}

#[test]
fn a_relay_that_lies_moves_nobody_who_hears_the_others_himself() {
    let scenario = built_in("section-v");
    let fly = |forge: bool| {
        let mut fleet = Fleet::with_configs(&scenario, 0, relaying);
        let mut published = Vec::new();
        for round in 0..40 {
            fleet.run_until(round * 200_000_000);
            let log = fleet.take_log();
            fleet.log();
            let heard = log.iter().find_map(|entry| match &entry.what {
                LoggedValue::Input(Input::Packet { key, bytes })
                    if entry.vehicle == 0 && matches!(key, PacketKey::Relay { .. }) =>
                {
                    Some((*key, bytes.clone()))
                }
                _ => None,
            });
            published.extend(log.into_iter().filter_map(|entry| match entry.what {
                LoggedValue::Output(Output::Estimate { document, .. }) if entry.vehicle == 0 => {
                    Some((document.pose, document.neighbours))
                }
                _ => None,
            }));
            if let (true, Some((key, bytes))) = (forge, heard) {
                let (head, mut relay) = codec::decode::<Relay>(&bytes).unwrap();
                for round in &mut relay.rounds {
                    // Of another clock, another boot, another place.
                    round.taken_ns += 100_000_000;
                    round.clock_offset_ns += 700_000_000;
                    round.boot ^= u64::from(round.round.segment % 2 == 0);
                    round.round.odometry_from_body[3] += 5.0;
                }
                let head = Envelope {
                    sequence: head.sequence + 2,
                    ..head
                };
                fleet.inject(0, key, codec::encode(head, &relay).unwrap());
            }
        }
        published
    };
    let (alone, beset) = (fly(false), fly(true));
    assert!(alone.len() > 50 && alone == beset);
}
