//! Stories of vehicles that were out of reach: what they missed is asked for and answered, once, and what nobody asked for
//! changes nothing. Told by the production vehicle and codec in virtual time.
#![allow(clippy::unwrap_used)]

use skein_estimation::cooperative::{Mode, Robust};
use skein_proto::backlog::Backlog;
use skein_proto::codec::{decode, encode};
use skein_proto::document::NeighbourHealth;
use skein_proto::envelope::Envelope;
use skein_proto::name::Name;
use skein_proto::record::RoundRecord;
use skein_simworld::fleet::{Fleet, Logged, LoggedValue};
use skein_simworld::scenario::Scenario;
use skein_simworld::world::nanos;
use skein_vehicle::{Config, Input, Output, PacketKey};
use std::collections::BTreeSet;

/// The vehicle that goes deaf.
const DEAF: usize = 0;
const PERIOD_S: f64 = 0.2;
/// Rounds told while it is deaf.
const MISSED: usize = 20;
/// When it hears again.
const RETURN_S: f64 = 10.05;

fn name(text: &str) -> Name {
    Name::parse(text).unwrap()
}

fn section_v() -> Scenario {
    Scenario::built_in("section-v").unwrap()
}

fn asking(_: usize, config: Config) -> Config {
    Config {
        mode: Mode::Team,
        ..config
    }
}

fn not_asking(_: usize, config: Config) -> Config {
    Config {
        mode: Mode::Star(Robust::DEFAULT),
        ..config
    }
}

fn others(fleet: &Fleet) -> Vec<Name> {
    (0..fleet.len())
        .filter(|vehicle| *vehicle != DEAF)
        .map(|vehicle| fleet.config(vehicle).vehicle)
        .collect()
}

/// A fleet whose first vehicle hears nothing of the others for some rounds, up to its return.
fn deafened(mut fleet: Fleet) -> Fleet {
    fleet.run_until(nanos(RETURN_S - MISSED as f64 * PERIOD_S));
    for other in others(&fleet) {
        fleet.deafen(DEAF, other);
    }
    fleet.log();
    fleet.run_until(nanos(RETURN_S));
    for other in others(&fleet) {
        fleet.undeafen(DEAF, other);
    }
    fleet
}

fn neighbour(fleet: &Fleet, of: Name) -> &NeighbourHealth {
    &fleet.health(DEAF).unwrap().neighbours[of.as_str()]
}

fn accepted(fleet: &Fleet, of: Name, word: &str) -> u64 {
    let health = neighbour(fleet, of);
    health.accepted.get(word).copied().unwrap_or_default()
}

fn refused(fleet: &Fleet, of: Name, word: &str) -> u64 {
    let health = neighbour(fleet, of);
    health.refused.get(word).copied().unwrap_or_default()
}

/// The instants of one vehicle's rounds that reached the deaf one, by its records and by its backlogs.
fn heard(log: &[Logged], of: Name) -> (BTreeSet<i64>, BTreeSet<i64>) {
    let (mut by_records, mut by_backlogs) = (BTreeSet::new(), BTreeSet::new());
    for entry in log.iter().filter(|entry| entry.vehicle == DEAF) {
        let LoggedValue::Input(Input::Packet { key, bytes }) = &entry.what else {
            continue;
        };
        match *key {
            PacketKey::Odometry { from } if from == of => {
                let (envelope, record) = decode::<RoundRecord>(bytes).unwrap();
                let period_ns = i64::from(record.period_us) * 1_000;
                let rounds = record.rounds.iter();
                by_records.extend(
                    rounds.map(|round| envelope.taken_ns - i64::from(round.back) * period_ns),
                );
            }
            PacketKey::Backlog { from } if from == of => {
                let (_, backlog) = decode::<Backlog>(bytes).unwrap();
                by_backlogs.extend(backlog.rounds.iter().map(|round| round.taken_ns));
            }
            _ => {}
        }
    }
    (by_records, by_backlogs)
}

/// The packets of backlogs that reached the deaf vehicle.
fn backlogs(log: &[Logged]) -> Vec<(PacketKey, Vec<u8>)> {
    let packets = log.iter().filter(|entry| entry.vehicle == DEAF);
    packets
        .filter_map(|entry| match &entry.what {
            LoggedValue::Input(Input::Packet { key, bytes })
                if matches!(key, PacketKey::Backlog { .. }) =>
            {
                Some((*key, bytes.clone()))
            }
            _ => None,
        })
        .collect()
}

fn estimates(log: &[Logged]) -> Vec<&Output> {
    let outputs = log.iter().filter_map(|entry| match &entry.what {
        LoggedValue::Output(output @ Output::Estimate { .. }) => Some(output),
        _ => None,
    });
    outputs.collect()
}

#[test]
fn a_vehicle_that_was_deaf_has_what_it_missed_within_a_second_of_its_return() {
    let mut fleet = deafened(Fleet::with_configs(&section_v(), 1, asking));
    fleet.run_s(1.0);
    let log = fleet.take_log();
    // The next health.
    fleet.run_s(1.0);
    for other in others(&fleet) {
        let (by_records, by_backlogs) = heard(&log, other);
        // Its newest record repeats three rounds: the others are missing.
        let missing: Vec<i64> = by_backlogs.difference(&by_records).copied().collect();
        let rounds = accepted(&fleet, other, "backlog_rounds");
        assert_eq!(rounds, missing.len() as u64, "{other}");
        assert!(
            (MISSED as u64 - 4..=MISSED as u64).contains(&rounds),
            "{rounds} of {other}"
        );
        let step = nanos(PERIOD_S);
        let all: Vec<i64> = by_records.union(&by_backlogs).copied().collect();
        assert!(
            all.windows(2).all(|pair| pair[1] - pair[0] == step),
            "{all:?}"
        );
        assert_eq!(
            accepted(&fleet, other, "backlog"),
            1,
            "one question, one answer"
        );
        assert_eq!(refused(&fleet, other, "unasked"), 0);
    }
}

#[test]
fn who_does_not_ask_is_told_nothing() {
    let fly = |config: fn(usize, Config) -> Config| {
        let mut fleet = deafened(Fleet::with_configs(&section_v(), 1, config));
        fleet.run_s(2.0);
        fleet.take_log()
    };
    let quiet = fly(not_asking);
    assert!(backlogs(&quiet).is_empty());
    let asked = |entry: &Logged| matches!(entry.what, LoggedValue::Output(Output::Ask { .. }));
    assert!(!quiet.iter().any(asked));
    assert!(fly(asking).iter().any(asked));
}

#[test]
fn a_lost_answer_is_asked_for_again_a_second_later() {
    let mut lossy = section_v();
    lossy.radio.loss = 0.3;
    let mut fleet = deafened(Fleet::with_configs(&lossy, 3, asking));
    fleet.run_s(6.0);
    let log = fleet.take_log();
    let mut questions = Vec::new();
    for entry in log.iter().filter(|entry| entry.vehicle == DEAF) {
        if let LoggedValue::Output(Output::Ask { to, .. }) = entry.what {
            questions.push((to, entry.stamp));
        }
    }
    let mut again = 0;
    for other in others(&fleet) {
        let of_it = questions.iter().filter(|(to, _)| *to == other);
        let stamps: Vec<_> = of_it.map(|(_, stamp)| *stamp).collect();
        assert!(
            stamps
                .windows(2)
                .all(|pair| (pair[1] - pair[0]).as_secs_f64() >= 1.0)
        );
        again += stamps.len().saturating_sub(1);
        assert!(accepted(&fleet, other, "backlog_rounds") >= 10, "{other}");
    }
    assert!(again > 0, "three packets in ten are lost");
}

#[test]
fn what_was_not_asked_for_changes_nothing_and_is_counted() {
    let answered = {
        let mut fleet = deafened(Fleet::with_configs(&section_v(), 1, asking));
        fleet.run_s(1.0);
        backlogs(&fleet.take_log())
    };
    let (key, honest) = answered
        .into_iter()
        .find(|(key, _)| key.from() == name("v2"))
        .unwrap();
    let (head, body) = decode::<Backlog>(&honest).unwrap();
    let as_if = |envelope: Envelope| encode(envelope, &body).unwrap();
    let forged = [
        // A recording of an answer that was used already: its hole is closed.
        ("unasked", honest.clone()),
        ("unproven_boot", as_if(Envelope { boot: 99, ..head })),
        ("wrong_hash", as_if(Envelope { sender: 99, ..head })),
        ("truncated", honest[..honest.len() - 1].to_vec()),
    ];
    let fly = |is_forged: bool| {
        let mut fleet = deafened(Fleet::with_configs(&section_v(), 1, asking));
        fleet.run_s(1.5);
        for (_, bytes) in forged.iter().filter(|_| is_forged) {
            fleet.inject(DEAF, key, bytes.clone());
        }
        fleet.run_s(3.0);
        fleet
    };
    let (mut plain, mut pestered) = (fly(false), fly(true));
    for (why, _) in forged {
        let counted = |fleet| refused(fleet, name("v2"), why);
        assert_eq!(counted(&pestered), counted(&plain) + 1, "{why}");
    }
    let rounds = |fleet| accepted(fleet, name("v2"), "backlog_rounds");
    assert_eq!(rounds(&pestered), rounds(&plain));
    let (plain, pestered) = (plain.take_log(), pestered.take_log());
    assert!(estimates(&plain) == estimates(&pestered));
}

#[test]
fn an_answer_is_used_for_the_missing_rounds_only() {
    let mut slow = section_v();
    slow.radio.delay_s = 0.02;
    let fleet = || deafened(Fleet::with_configs(&slow, 1, asking));
    let (key, head, honest) = {
        let mut fleet = fleet();
        fleet.run_s(1.0);
        let answers = backlogs(&fleet.take_log());
        let from_v2 = |(key, _): &&(PacketKey, Vec<u8>)| key.from() == name("v2");
        let (key, bytes) = answers.iter().find(from_v2).unwrap().clone();
        let (head, backlog) = decode::<Backlog>(&bytes).unwrap();
        (key, head, backlog)
    };
    // The same again, but before its answer comes another one: of a time that was not asked for.
    let mut fleet = fleet();
    let asked = |fleet: &mut Fleet| {
        let log = fleet.take_log();
        fleet.log();
        let asks_v2 = |entry: &Logged| matches!(entry.what, LoggedValue::Output(Output::Ask { to, .. }) if to == name("v2"));
        log.iter().any(asks_v2)
    };
    while !asked(&mut fleet) {
        fleet.run_s(0.001);
    }
    for by_s in [-1_000.0, 1_000.0] {
        let mut astray = Backlog {
            remaining: 1,
            ..honest.clone()
        };
        for round in &mut astray.rounds {
            round.taken_ns += nanos(by_s);
        }
        fleet.inject(DEAF, key, encode(head, &astray).unwrap());
    }
    fleet.run_s(2.0);
    let astray = 2 * honest.rounds.len() as u64;
    assert_eq!(refused(&fleet, name("v2"), "unasked"), astray);
    let rounds = accepted(&fleet, name("v2"), "backlog_rounds");
    let missed = MISSED as u64 - 4..=MISSED as u64;
    assert!(missed.contains(&rounds), "{rounds}");
}

#[test]
fn a_question_for_another_boot_is_answered_with_nothing_and_counted() {
    let mut fleet = Fleet::with_configs(&section_v(), 1, asking);
    fleet.run_until(nanos(3.0));
    let boot = fleet.config(DEAF).boot;
    fleet.log();
    for (query, boot) in [(1_001, boot), (1_002, boot + 1)] {
        let since_ns = i64::MIN;
        fleet.give(
            DEAF,
            Input::Asked {
                query,
                since_ns,
                boot,
            },
        );
    }
    let answers: Vec<(u64, usize)> = fleet
        .take_log()
        .iter()
        .filter_map(|entry| match &entry.what {
            LoggedValue::Output(Output::Answer { query, packets }) => Some((*query, packets.len())),
            _ => None,
        })
        .collect();
    assert_eq!(answers, [(1_001, 1), (1_002, 0)]);
    fleet.run_s(1.5);
    assert_eq!(fleet.health(DEAF).unwrap().refused["old_boot"], 1);
}
