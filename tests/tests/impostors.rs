//! Stories of strangers: two processes under one name, recordings played again, names that nobody bears, packets of
//! other times and versions. Told by the production vehicle and codec in virtual time.
#![allow(clippy::unwrap_used)]

use skein_estimation::time::{Span, Stamp};
use skein_proto::codec;
use skein_proto::document::{HealthDocument, NeighbourHealth};
use skein_proto::envelope::Envelope;
use skein_proto::exchange::{Echo, Exchange};
use skein_proto::keys::boot_text;
use skein_proto::name::Name;
use skein_proto::record::RoundRecord;
use skein_proto::status::Status;
use skein_simworld::fleet::{Fleet, Logged, LoggedValue};
use skein_simworld::radio::RadioSettings;
use skein_simworld::scenario::Scenario;
use skein_simworld::stage::Stage;
use skein_simworld::world::nanos;
use skein_tests::stories::{name, neighbour};
use skein_vehicle::{Config, Input, Output, PacketKey, Start, ToldPose, Vehicle};
use std::collections::BTreeMap;

/// The one whose name is borne twice, and the one who bears it too.
const VICTIM: usize = 3;
const INTRUDER: usize = 4;
/// The others.
const HEARERS: std::ops::Range<usize> = 0..3;

fn scenario(delay_s: f64) -> Scenario {
    let mut scenario = Scenario::built_in("section-v").unwrap();
    scenario.radio.delay_s = delay_s;
    eprintln!(
        "scenario section-v, seed {}, delay {delay_s} s",
        scenario.seed
    );
    scenario
}

fn refused(health: &NeighbourHealth, word: &str) -> u64 {
    health.refused.get(word).copied().unwrap_or_default()
}

/// What some vehicles published as their estimates, in order.
fn estimates(log: &[Logged], of: std::ops::Range<usize>) -> Vec<&Logged> {
    log.iter()
        .filter(|entry| of.contains(&entry.vehicle))
        .filter(|entry| matches!(&entry.what, LoggedValue::Output(Output::Estimate { .. })))
        .collect()
}

/// Four robots that all see each other fly; the process of the fifth is not started yet.
fn four(delay_s: f64, sample: u64) -> Fleet {
    let hover = Scenario::built_in_text("hover").unwrap();
    let five = hover.replace("count = 4", "count = 5");
    let mut scenario = Scenario::parse(&five, "five").unwrap();
    scenario.radio.delay_s = delay_s;
    eprintln!("hover, five, seed {}, delay {delay_s} s", scenario.seed);
    let mut fleet = Fleet::new(&scenario, sample);
    fleet.kill(INTRUDER);
    fleet.log();
    fleet
}

/// The intruder starts under the name of v4 at 4.03 s. Tells when each hearer's health names both boots.
fn invaded(delay_s: f64, sample: u64) -> (Fleet, BTreeMap<usize, i64>) {
    let mut fleet = four(delay_s, sample);
    let began_ns = nanos(4.03);
    fleet.run_until(began_ns);
    fleet.impersonate(INTRUDER, VICTIM);
    let mut both = [VICTIM, INTRUDER].map(|vehicle| boot_text(fleet.config(vehicle).boot));
    both.sort();
    let mut found_ns = BTreeMap::new();
    while fleet.now_ns() < began_ns + nanos(2.0) {
        let before_ns = fleet.now_ns();
        fleet.run_until(before_ns + nanos(0.001));
        for hearer in HEARERS {
            let mut named = neighbour(&fleet, hearer, "v4").duplicate_boots.clone();
            named.sort();
            if named == both {
                found_ns.entry(hearer).or_insert(before_ns);
            }
        }
    }
    for (hearer, found_ns) in &found_ns {
        let after_s = (found_ns - began_ns) as f64 * 1e-9;
        eprintln!("v{} knows after {after_s:.3} s", hearer + 1);
    }
    (fleet, found_ns)
}

#[test]
fn a_second_process_under_a_name_is_found_by_everybody_within_two_seconds_and_neither_is_used() {
    for delay_s in [0.0, 0.01, 0.1] {
        let (mut fleet, found_ns) = invaded(delay_s, 1);
        assert_eq!(found_ns.len(), HEARERS.len(), "{found_ns:?}");
        let counted = |fleet: &Fleet| -> Vec<NeighbourHealth> {
            HEARERS.map(|v| neighbour(fleet, v, "v4").clone()).collect()
        };
        fleet.run_until(nanos(7.05));
        let at_first = counted(&fleet);
        fleet.run_until(nanos(12.05));
        for (before, after) in at_first.iter().zip(counted(&fleet)) {
            assert_eq!(after.fused, before.fused);
            assert_eq!(after.accepted, before.accepted);
            // Two vehicles that send a record and at least greet once a second, for five seconds.
            let more = refused(&after, "duplicate_id") - refused(before, "duplicate_id");
            assert!(more >= 2 * (25 + 5) - 4, "{more}");
            assert!(!after.present, "{after:?}");
        }
        // Both are told by their own ears.
        for (vehicle, other) in [(VICTIM, INTRUDER), (INTRUDER, VICTIM)] {
            let namesake = fleet.health(vehicle).unwrap().namesake_boot.clone();
            assert_eq!(namesake, Some(boot_text(fleet.config(other).boot)));
        }
        for hearer in HEARERS {
            let status = fleet.estimate(hearer).unwrap().status;
            assert_eq!(status, Status::Tracking, "v{}", hearer + 1);
        }
    }
}

#[test]
fn the_others_fly_bit_by_bit_as_if_the_doubled_name_had_fallen_silent_when_it_was_found() {
    for (delay_s, sample) in [(0.0, 2), (0.01, 3), (0.1, 4)] {
        let (mut invaded, found_ns) = invaded(delay_s, sample);
        assert_eq!(found_ns.len(), HEARERS.len());
        invaded.run_until(nanos(15.0));

        let mut silent = four(delay_s, sample);
        let mut moments: Vec<(i64, usize)> = found_ns.iter().map(|(v, at)| (*at, *v)).collect();
        moments.sort_unstable();
        for (at_ns, hearer) in moments {
            silent.run_until(at_ns);
            silent.deafen(hearer, name("v4"));
        }
        silent.run_until(nanos(15.0));
        let (invaded, silent) = (invaded.take_log(), silent.take_log());
        assert!(estimates(&silent, HEARERS).len() > 3 * 80);
        assert!(estimates(&invaded, HEARERS) == estimates(&silent, HEARERS));
    }
}

#[test]
fn five_seconds_after_one_of_two_falls_silent_the_other_is_used_again_whichever_it_is() {
    for (gone, stays) in [(INTRUDER, VICTIM), (VICTIM, INTRUDER)] {
        let (mut fleet, _) = invaded(0.01, 5);
        fleet.run_until(nanos(8.01));
        fleet.kill(gone);
        let fused = |fleet: &Fleet| -> Vec<u64> {
            HEARERS.map(|v| neighbour(fleet, v, "v4").fused).collect()
        };
        let before = fused(&fleet);
        // Its last packets were heard at 8.0 s; the health is written once a second.
        fleet.run_until(nanos(12.9));
        assert_eq!(fused(&fleet), before);
        for hearer in HEARERS {
            assert_eq!(neighbour(&fleet, hearer, "v4").duplicate_boots.len(), 2);
        }
        fleet.run_until(nanos(16.0));
        let boot = boot_text(fleet.config(stays).boot);
        for hearer in HEARERS {
            let health = neighbour(&fleet, hearer, "v4");
            assert!(
                health.duplicate_boots.is_empty() && health.present,
                "{health:?}"
            );
            assert_eq!(health.boot.as_ref(), Some(&boot));
            assert!(health.clock_offset_s.is_some(), "{health:?}");
        }
        // Whoever measures v4 measures the victim; nobody's sensor takes the intruder for it.
        let total = |fused: &[u64]| fused.iter().sum::<u64>();
        let more = total(&fused(&fleet)) - total(&before);
        assert!(more > 5 || stays == INTRUDER, "{more}");
        assert_eq!(fleet.health(stays).unwrap().namesake_boot, None);
    }
}

#[test]
fn a_process_that_is_started_again_at_once_under_a_lingering_token_is_no_duplicate() {
    for (delay_before_s, delay_s, sample) in
        [(0.0, 0.0, 6), (0.1, 0.1, 7), (0.3, 0.3, 8), (1.5, 0.01, 9)]
    {
        let mut fleet = four(delay_before_s, sample);
        let killed_ns = nanos(5.15);
        fleet.run_until(killed_ns);
        fleet.kill_under_a_lingering_token(VICTIM, 3.0);
        // Its last packets may come long after those of the next one.
        fleet.change_radio(&RadioSettings {
            delay_s,
            ..RadioSettings::default()
        });
        fleet.run_until(killed_ns + nanos(0.1));
        let place = skein_simworld::world::transform(&fleet.stage().pose(VICTIM, fleet.now_ns()));
        let start = Start::Pose(ToldPose::exact(place));
        fleet.restart(VICTIM, start);
        let boot = boot_text(fleet.config(VICTIM).boot);
        let mut known_ns = None;
        while fleet.now_ns() < nanos(13.0) {
            fleet.run_s(0.05);
            let healths = HEARERS.map(|v| neighbour(&fleet, v, "v4"));
            for health in healths.clone() {
                assert!(health.duplicate_boots.is_empty(), "{health:?}");
                assert_eq!(refused(health, "duplicate_id"), 0);
            }
            let mut healths = healths;
            if healths.all(|health| {
                health.boot.as_ref() == Some(&boot) && health.clock_offset_s.is_some()
            }) {
                known_ns.get_or_insert(fleet.now_ns());
            }
            if let Some(own) = fleet.health(VICTIM) {
                assert_eq!(own.namesake_boot, None);
            }
        }
        let after_s = (known_ns.unwrap() - killed_ns) as f64 * 1e-9;
        eprintln!(
            "delay {delay_before_s} s, then {delay_s} s: known again {after_s:.2} s after its death"
        );
        // Half a second of doubt after the dead one's last packet, or its own four echoes, and the second until the
        // next health.
        assert!(
            after_s < delay_before_s + 0.1 + 0.5 + 1.0 + 4.0 * (0.2 + delay_s),
            "{after_s} s"
        );
        for hearer in HEARERS {
            let health = neighbour(&fleet, hearer, "v4");
            assert!(
                health.present && health.status == Some(Status::Tracking),
                "{health:?}"
            );
        }
    }
}

/// Every packet that reached a vehicle from another.
fn packets_from(log: &[Logged], vehicle: usize, from: &str) -> Vec<(PacketKey, Vec<u8>)> {
    log.iter()
        .filter(|entry| entry.vehicle == vehicle)
        .filter_map(|entry| match &entry.what {
            LoggedValue::Input(Input::Packet { key, bytes }) if key.from() == name(from) => {
                Some((*key, bytes.clone()))
            }
            _ => None,
        })
        .collect()
}

#[test]
fn a_recording_played_again_changes_nothing_and_is_counted_to_the_last_packet() {
    let fly = |with_replays: bool| {
        let mut fleet = Fleet::new(&scenario(0.01), 9);
        fleet.log();
        fleet.run_until(nanos(4.0));
        let mut recorded = BTreeMap::new();
        let log = fleet.take_log();
        for hearer in HEARERS {
            recorded.insert(hearer, packets_from(&log, hearer, "v4"));
        }
        // The recorded process is gone; v1 is started again too, and has never heard of it.
        let start = |fleet: &Fleet, vehicle| {
            let pose = fleet.stage().pose(vehicle, fleet.now_ns());
            Start::Pose(ToldPose::exact(skein_simworld::world::transform(&pose)))
        };
        for vehicle in [VICTIM, 0] {
            fleet.kill(vehicle);
            let start = start(&fleet, vehicle);
            fleet.restart(vehicle, start);
        }
        fleet.log();
        fleet.run_until(nanos(8.0));
        let log = fleet.take_log();
        for hearer in HEARERS {
            // And the one that flies now.
            let now = packets_from(&log, hearer, "v4");
            recorded.get_mut(&hearer).unwrap().extend(now);
        }
        fleet.log();
        let before = HEARERS.map(|v| refusals(neighbour(&fleet, v, "v4")));
        let before: Vec<u64> = before.collect();
        let mut injected = vec![0; HEARERS.len()];
        let mut queues: Vec<_> = recorded.into_values().map(Vec::into_iter).collect();
        while fleet.now_ns() < nanos(14.0) {
            fleet.run_s(0.01);
            for (hearer, queue) in queues.iter_mut().enumerate().filter(|_| with_replays) {
                if let Some((key, bytes)) = queue.next() {
                    fleet.inject(hearer, key, bytes);
                    injected[hearer] += 1;
                }
            }
        }
        fleet.run_until(nanos(15.5));
        let after = HEARERS.map(|v| refusals(neighbour(&fleet, v, "v4")));
        let counted: Vec<u64> = after
            .zip(before)
            .map(|(after, before)| after - before)
            .collect();
        let words = HEARERS.map(|v| neighbour(&fleet, v, "v4").refused.clone());
        eprintln!("{injected:?} injected; {:?}", words.collect::<Vec<_>>());
        (fleet.take_log(), counted, injected)
    };
    let (plain, refused_of_plain, _) = fly(false);
    let (haunted, refused, injected) = fly(true);
    assert!(injected.iter().all(|count| *count > 50), "{injected:?}");
    for ((refused, honest), injected) in refused.iter().zip(refused_of_plain).zip(injected) {
        assert_eq!(*refused, honest + injected);
    }
    assert!(estimates(&plain, 0..5) == estimates(&haunted, 0..5));
}

fn refusals(health: &NeighbourHealth) -> u64 {
    health.refused.values().sum()
}

/// A packet of v2 to v1 with another head and other times; never an echo of a stamp of v1's.
fn forged(
    honest: &(PacketKey, Vec<u8>),
    head: impl Fn(Envelope) -> Envelope,
    sent_ns: impl Fn(i64) -> i64,
) -> (PacketKey, Vec<u8>) {
    let (key, bytes) = honest;
    let bytes = match key {
        PacketKey::Exchange { .. } => {
            let (envelope, body) = codec::decode::<Exchange>(bytes).unwrap();
            let sent_ns = sent_ns(body.sent_ns);
            let echo = body.echo.map(|echo| Echo {
                heard_ns: 1,
                ..echo
            });
            codec::encode(
                head(envelope),
                &Exchange {
                    sent_ns,
                    echo,
                    ..body
                },
            )
        }
        PacketKey::Odometry { .. } => {
            let (envelope, body) = codec::decode::<RoundRecord>(bytes).unwrap();
            let sent_ns = sent_ns(body.sent_ns);
            let echoes = Vec::new();
            codec::encode(
                head(envelope),
                &RoundRecord {
                    sent_ns,
                    echoes,
                    ..body
                },
            )
        }
        PacketKey::Features { .. } => unreachable!("section V has no cameras"),
        PacketKey::Backlog { .. } | PacketKey::Relay { .. } => {
            unreachable!("nobody asked, nobody relays")
        }
    };
    (*key, bytes.unwrap())
}

/// A flight of five in which `pester` injects what it likes into v1, beside one in which nobody does; both logs from
/// 5 s on, and the health of v1 before and after. Nobody hears less of v1 for it.
fn pestered(
    pester: impl Fn(&mut Fleet, &[(PacketKey, Vec<u8>)], u64),
) -> ([Vec<Logged>; 2], [HealthDocument; 2]) {
    let fly = |pestered: bool| {
        let mut fleet = Fleet::new(&scenario(0.01), 10);
        fleet.log();
        fleet.run_until(nanos(5.05));
        let log = fleet.take_log();
        let before = fleet.health(0).unwrap().clone();
        fleet.log();
        for step in 0..200 {
            let heard = packets_from(&log, 0, "v2");
            if pestered {
                pester(&mut fleet, &heard[heard.len() - 2..], step);
            }
            fleet.run_s(0.02);
        }
        fleet.run_until(nanos(11.0));
        let after = fleet.health(0).unwrap().clone();
        let echoes: Vec<u64> = (1..5).map(|v| neighbour(&fleet, v, "v1").echoes).collect();
        (fleet.take_log(), [before, after], echoes)
    };
    let ((plain, _, echoes_of_plain), (log, healths, echoes)) = (fly(false), fly(true));
    assert_eq!(echoes, echoes_of_plain);
    ([plain, log], healths)
}

#[test]
fn packets_from_the_future_and_from_long_ago_are_refused_and_counted_and_take_nobody_s_number() {
    const HOUR: i64 = 3_600_000_000_000;
    let ([plain, log], [before, after]) = pestered(|fleet, heard, step| {
        for honest in heard {
            // The very numbers that v2 is about to use.
            let sequence = |head: Envelope| head.sequence + 1 + u32::try_from(step / 10).unwrap();
            for by_ns in [-HOUR, HOUR] {
                let head = |head: Envelope| Envelope {
                    sequence: sequence(head),
                    taken_ns: head.taken_ns + by_ns,
                    ..head
                };
                let (key, bytes) = forged(honest, head, |sent_ns| sent_ns + by_ns);
                fleet.inject(0, key, bytes);
            }
        }
    });
    let more = |word: &str| {
        let [before, after] = [&before, &after].map(|health| &health.neighbours["v2"]);
        refused(after, word) - refused(before, word)
    };
    assert!(
        more("from_the_future") >= 400,
        "{}",
        more("from_the_future")
    );
    assert!(more("too_late") >= 400, "{}", more("too_late"));
    assert!(estimates(&plain, 0..5) == estimates(&log, 0..5));
}

#[test]
fn a_flood_of_names_that_nobody_bears_and_of_boots_that_never_echo_changes_nothing() {
    let ([plain, log], [_, after]) = pestered(|fleet, heard, step| {
        for k in 0..50u64 {
            let phantom = name(&format!("phantom_{}", step * 50 + k));
            for honest in heard {
                // Fresh in every respect but one: it cannot know what v1 said.
                let ahead_ns = fleet.now_ns() - nanos(5.0);
                let of = |head: Envelope, sender: Name, boot: u64| Envelope {
                    sender: sender.hash(),
                    boot,
                    taken_ns: head.taken_ns + ahead_ns,
                    ..head
                };
                let sent = |sent_ns| sent_ns + ahead_ns;
                let (key, bytes) = forged(honest, |head| of(head, phantom, k), sent);
                let key = match key {
                    PacketKey::Exchange { to, .. } => PacketKey::Exchange { from: phantom, to },
                    PacketKey::Odometry { .. } => PacketKey::Odometry { from: phantom },
                    PacketKey::Features { .. } => PacketKey::Features { from: phantom },
                    PacketKey::Backlog { .. } => PacketKey::Backlog { from: phantom },
                    PacketKey::Relay { .. } => PacketKey::Relay { from: phantom },
                };
                fleet.inject(0, key, bytes);
                let claimed = 1_000 + step * 50 + k;
                let (key, bytes) = forged(honest, |head| of(head, name("v2"), claimed), sent);
                fleet.inject(0, key, bytes);
            }
        }
    });
    assert_eq!(after.neighbours.len(), 64);
    for present in ["v2", "v3", "v4", "v5"] {
        assert!(after.neighbours[present].present, "{present}");
    }
    let claimed = refused(&after.neighbours["v2"], "unproven_boot");
    assert_eq!(claimed, 20_000);
    assert!(estimates(&plain, 0..5) == estimates(&log, 0..5));
}

#[test]
fn a_forged_number_far_ahead_does_not_mute_its_victim() {
    let ([plain, log], [before, after]) = pestered(|fleet, heard, step| {
        for honest in heard {
            let head = |head: Envelope| Envelope {
                sequence: [
                    u32::MAX,
                    head.sequence ^ (1 << 31),
                    head.sequence + 1_000_000,
                ][step as usize % 3],
                ..head
            };
            let (key, bytes) = forged(honest, head, |sent_ns| sent_ns);
            fleet.inject(0, key, bytes);
        }
    });
    let [before, after] = [&before, &after].map(|health| &health.neighbours["v2"]);
    // While v2 has not yet said 64 things, the last number before zero counts as one of its first.
    let words = ["out_of_sequence", "duplicate"];
    let counted: u64 = words.iter().map(|word| refused(after, word)).sum();
    assert_eq!(counted, 400, "{after:?}");
    let (echoes, seconds) = (after.echoes - before.echoes, 6.0);
    assert!(echoes as f64 >= 4.0 * seconds, "{echoes} in {seconds} s");
    assert!(estimates(&plain, 0..5) == estimates(&log, 0..5));
}

/// What v1 was given in a flight, fed again into a fresh v1 with its packets changed.
fn flown_again(mut change: impl FnMut(&mut Vec<u8>)) -> (Vec<Output>, HealthDocument) {
    let mut fleet = Fleet::new(&scenario(0.01), 11);
    let started = Stamp::from_nanos(fleet.stage().stamp_ns(0, fleet.stage().begins_ns()));
    fleet.log();
    fleet.run_until(nanos(6.0));
    let config: Config = fleet.config(0).clone();
    let mut vehicle = Vehicle::new(config, started);
    let (mut estimates, mut health) = (Vec::new(), None);
    let mut drain = |vehicle: &mut Vehicle| {
        loop {
            match vehicle.poll() {
                Output::WakeAt(_) => return,
                Output::Health(document) => health = Some(*document),
                output @ Output::Estimate { .. } => estimates.push(output),
                Output::Send { .. }
                | Output::Checkpoint(_)
                | Output::Ask { .. }
                | Output::Work(_)
                | Output::Answer { .. } => {}
            }
        }
    };
    for entry in fleet
        .take_log()
        .into_iter()
        .filter(|entry| entry.vehicle == 0)
    {
        let LoggedValue::Input(mut input) = entry.what else {
            continue;
        };
        if let Input::Packet { bytes, .. } = &mut input {
            change(bytes);
        }
        vehicle.handle(entry.stamp, input);
        drain(&mut vehicle);
    }
    vehicle.handle(started + Span::millis(9_000), Input::Wake);
    drain(&mut vehicle);
    (estimates, health.unwrap())
}

#[test]
fn a_newer_minor_version_is_understood_and_a_newer_major_one_is_refused_by_its_word() {
    let (plain, _) = flown_again(|_| {});
    let (newer_minor, health) = flown_again(|bytes| {
        // A field that this program does not know.
        bytes[1] += 1;
        let body_bytes = u16::from_le_bytes([bytes[2], bytes[3]]) + 5;
        bytes[2..4].copy_from_slice(&body_bytes.to_le_bytes());
        bytes.extend([1, 2, 3, 4, 5]);
    });
    assert!(plain == newer_minor);
    assert!(health.neighbours.values().all(|health| health.fused > 0));

    let (newer_major, health) = flown_again(|bytes| bytes[0] += 1);
    assert!(plain != newer_major);
    for health in health.neighbours.values() {
        assert!(health.accepted.is_empty() && health.fused == 0);
        assert!(refused(health, "version") > 50, "{health:?}");
    }
}
