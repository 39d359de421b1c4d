//! Every impairment measured: what was asked of the radio is what packets meet.

use super::*;
use skein_proto::faults::Faults;
use skein_proto::name::Name;

const MS: i64 = 1_000_000;
const SECOND: i64 = 1_000 * MS;

fn radio(settings: &RadioSettings) -> Radio {
    Radio::new(settings, Streams::new(9, 0))
}

/// Verdicts on packets of 100 bytes from 0 to 1, sent at these times.
fn verdicts(radio: &mut Radio, times_ns: impl Iterator<Item = i64>) -> Vec<Verdict> {
    times_ns
        .map(|now_ns| radio.transmit(now_ns, 0, 1, 3.0, 100))
        .collect()
}

/// Every so often, so many times.
fn every(gap_ns: i64, n: i64) -> impl Iterator<Item = i64> {
    (0..n).map(move |k| k * gap_ns)
}

fn arrival_ns(verdict: &Verdict) -> Option<i64> {
    match verdict {
        Verdict::Deliver { at_ns, .. } => Some(*at_ns),
        Verdict::Lost(_) => None,
    }
}

fn share_lost(verdicts: &[Verdict]) -> f64 {
    let lost = verdicts.iter().filter(|v| arrival_ns(v).is_none()).count();
    lost as f64 / verdicts.len() as f64
}

/// Mean length of the runs of lost packets.
fn mean_run(verdicts: &[Verdict]) -> f64 {
    let runs = verdicts.chunk_by(|a, b| arrival_ns(a).is_none() == arrival_ns(b).is_none());
    let lengths: Vec<usize> = runs
        .filter(|run| arrival_ns(&run[0]).is_none())
        .map(<[Verdict]>::len)
        .collect();
    lengths.iter().sum::<usize>() as f64 / lengths.len() as f64
}

fn delivered(at_ns: i64) -> Verdict {
    Verdict::Deliver {
        at_ns,
        copy_at_ns: None,
    }
}

const SILENCED: Verdict = Verdict::Lost(Reason::Barred(Barrier::Silenced));
const PARTITIONED: Verdict = Verdict::Lost(Reason::Barred(Barrier::Partitioned));
const OUT_OF_RANGE: Verdict = Verdict::Lost(Reason::Barred(Barrier::OutOfRange));

#[test]
fn the_loss_asked_for_is_the_loss_counted() {
    for loss in [0.0, 0.3, 0.6, 1.0] {
        let mut radio = radio(&RadioSettings {
            loss,
            ..RadioSettings::default()
        });
        let n = 20_000;
        let lost = share_lost(&verdicts(&mut radio, every(1_000, n)));
        let count = radio.count(0, 1);
        assert!((lost - loss).abs() < 0.011, "loss {loss}: {lost}");
        assert_eq!(count.lost as f64, (lost * n as f64).round());
        assert_eq!(
            (count.sent, count.delivered + count.lost),
            (n as u64, n as u64)
        );
        assert_eq!(count.sent_bytes, 100 * n as u64);
    }
}

#[test]
fn the_two_directions_and_every_pair_lose_independently() {
    let mut radio = radio(&RadioSettings {
        loss: 0.5,
        ..RadioSettings::default()
    });
    let n = 10_000;
    let together = (0..n)
        .filter(|k| {
            let forth = radio.transmit(*k, 0, 1, 1.0, 1);
            let back = radio.transmit(*k, 1, 0, 1.0, 1);
            forth == Verdict::Lost(Reason::Chance) && back == Verdict::Lost(Reason::Chance)
        })
        .count() as f64;
    assert!((together / n as f64 - 0.25).abs() < 0.02, "{together}");
}

#[test]
fn bursts_take_the_share_of_the_time_and_last_as_long_as_asked_for_at_any_packet_rate() {
    let burst = Burst {
        share: 0.1,
        mean_s: 0.5,
        loss: 1.0,
    };
    let settings = RadioSettings {
        burst: Some(burst),
        ..RadioSettings::default()
    };
    // 20 000 s hold some 4000 bursts: one standard deviation is 0.002 of the share and 1.6 % of the length.
    for gap_ns in [20 * MS, 200 * MS] {
        let n = 20_000 * SECOND / gap_ns;
        let verdicts = verdicts(&mut radio(&settings), every(gap_ns, n));
        let lost = share_lost(&verdicts);
        assert!((lost - burst.share).abs() < 0.008, "{gap_ns} ns: {lost}");
        // Seen at packets `gap` apart the chain stays bad with 1 - (1 - share)(1 - exp(-gap / memory)).
        let gap_s = gap_ns as f64 * 1e-9;
        let memory_s = burst.mean_s * (1.0 - burst.share);
        let expected = 1.0 / ((1.0 - burst.share) * (1.0 - (-gap_s / memory_s).exp()));
        let run = mean_run(&verdicts);
        assert!(
            (run / expected - 1.0).abs() < 0.065,
            "{gap_ns} ns: runs of {run} packets, expected {expected}"
        );
        if gap_ns == 20 * MS {
            // Seen as closely as this, a run is a burst.
            let length_s = run * gap_s;
            assert!((length_s / burst.mean_s - 1.0).abs() < 0.09, "{length_s} s");
        }
    }
}

#[test]
fn bursts_do_not_care_when_packets_are_sent_and_lose_on_top_of_chance() {
    let mut radio = radio(&RadioSettings {
        loss: 0.2,
        burst: Some(Burst {
            share: 0.25,
            mean_s: 0.3,
            loss: 0.8,
        }),
        ..RadioSettings::default()
    });
    // Ten packets within 10 ms, then half a second of nothing.
    let times = (0..400_000).map(|k| (k / 10) * 500 * MS + (k % 10) * MS);
    let verdicts = verdicts(&mut radio, times);
    let count = radio.count(0, 1);
    let expected = 1.0 - (1.0 - 0.2) * (1.0 - 0.25 * 0.8);
    let lost = share_lost(&verdicts);
    assert!((lost - expected).abs() < 0.008, "{lost}, not {expected}");
    let by_chance = count.lost as f64 / count.sent as f64;
    assert!((by_chance - 0.2).abs() < 0.003, "{by_chance}");
    assert_eq!(count.lost + count.burst + count.delivered, count.sent);
}

#[test]
fn a_packet_takes_the_delay_asked_for() {
    let mut radio = radio(&RadioSettings {
        delay_s: 0.1,
        ..RadioSettings::default()
    });
    assert_eq!(radio.transmit(-50, 0, 1, 1.0, 1), delivered(99_999_950));
}

#[test]
fn jitter_spreads_evenly_about_the_delay() {
    let (delay_s, jitter_s) = (0.1, 0.05);
    let mut radio = radio(&RadioSettings {
        delay_s,
        jitter_s,
        ..RadioSettings::default()
    });
    let n = 50_000;
    let taken: Vec<f64> = every(SECOND, n)
        .zip(verdicts(&mut radio, every(SECOND, n)))
        .map(|(sent, verdict)| (arrival_ns(&verdict).unwrap() - sent) as f64 * 1e-9)
        .collect();
    let mean = taken.iter().sum::<f64>() / n as f64;
    let variance = taken.iter().map(|t| (t - mean).powi(2)).sum::<f64>() / n as f64;
    // A uniform distribution of this half width; four standard errors.
    assert!((mean - delay_s).abs() < 0.0006, "mean {mean} s");
    let spread = jitter_s / 3.0_f64.sqrt();
    assert!((variance.sqrt() / spread - 1.0).abs() < 0.01, "{variance}");
    assert!(
        taken
            .iter()
            .all(|t| (delay_s - jitter_s..=delay_s + jitter_s).contains(t))
    );
    assert_eq!(radio.total().reordered, 0, "a second apart none overtakes");
}

#[test]
fn as_many_packets_are_overtaken_as_are_held_back() {
    let probability = 0.05;
    let mut radio = radio(&RadioSettings {
        delay_s: 0.02,
        reorder: Some(Reorder {
            probability,
            delay_s: 0.095,
        }),
        ..RadioSettings::default()
    });
    let n = 50_000;
    let arrivals: Vec<i64> = verdicts(&mut radio, every(10 * MS, n))
        .iter()
        .filter_map(arrival_ns)
        .collect();
    let mut overtaken = 0;
    let mut overtaking = 0;
    for (k, at_ns) in arrivals.iter().enumerate() {
        let later = &arrivals[k + 1..arrivals.len().min(k + 30)];
        let earlier = &arrivals[k.saturating_sub(30)..k];
        overtaken += u64::from(later.iter().any(|other| other < at_ns));
        overtaking += u64::from(earlier.iter().any(|other| other > at_ns));
    }
    let share = overtaken as f64 / n as f64;
    assert!((share - probability).abs() < 0.004, "{share}");
    assert_eq!(radio.count(0, 1).reordered, overtaking);
    // It overtakes when it is not held back and one of the nine before it is.
    let expected = (1.0 - probability) * (1.0 - (1.0 - probability).powi(9));
    let share = overtaking as f64 / n as f64;
    assert!((share - expected).abs() < 0.02, "{share}, not {expected}");
}

#[test]
fn as_many_packets_come_twice_as_asked_for_and_the_copy_later() {
    let mut radio = radio(&RadioSettings {
        loss: 0.5,
        delay_s: 0.1,
        duplicate: Some(Duplicate {
            probability: 0.2,
            delay_s: 0.03,
        }),
        ..RadioSettings::default()
    });
    let copied = verdicts(&mut radio, every(SECOND, 40_000))
        .iter()
        .filter_map(|verdict| match verdict {
            Verdict::Deliver { at_ns, copy_at_ns } => copy_at_ns.map(|copy| copy - at_ns),
            Verdict::Lost(_) => None,
        })
        .inspect(|later_ns| assert_eq!(*later_ns, 30 * MS))
        .count() as u64;
    let count = radio.count(0, 1);
    let share = copied as f64 / count.delivered as f64;
    assert!((share - 0.2).abs() < 0.011, "{share}");
    assert_eq!(count.duplicated, copied);
}

#[test]
fn a_link_s_own_settings_hold_one_way_only() {
    let own = |from, to| LinkOverride {
        from,
        to,
        loss: None,
        delay_s: None,
        jitter_s: None,
        silent: false,
    };
    let mut radio = radio(&RadioSettings {
        delay_s: 0.01,
        links: vec![
            LinkOverride {
                loss: Some(0.9),
                delay_s: Some(0.2),
                ..own(0, 1)
            },
            LinkOverride {
                silent: true,
                ..own(2, 0)
            },
        ],
        ..RadioSettings::default()
    });
    for k in 0..10_000 {
        let forth = radio.transmit(k, 0, 1, 1.0, 1);
        assert!(matches!(forth, Verdict::Lost(Reason::Chance)) || forth == delivered(k + 200 * MS));
        for (from, to) in [(1, 0), (0, 2), (1, 2), (2, 1)] {
            assert_eq!(radio.transmit(k, from, to, 1.0, 1), delivered(k + 10 * MS));
        }
        assert_eq!(radio.transmit(k, 2, 0, 1.0, 1), SILENCED);
    }
    let share = radio.count(0, 1).lost as f64 / 10_000.0;
    assert!((share - 0.9).abs() < 0.012, "{share}");
}

#[test]
fn the_reach_ends_at_its_range() {
    let mut radio = radio(&RadioSettings {
        range_m: Some(7.0),
        ..RadioSettings::default()
    });
    assert_eq!(radio.transmit(0, 0, 1, 6.999, 1), delivered(0));
    assert_eq!(radio.transmit(0, 0, 1, 7.0, 1), OUT_OF_RANGE);
    assert_eq!(radio.count(0, 1).out_of_range, 1);
}

#[test]
fn a_silence_cuts_off_its_vehicles_in_both_directions_and_ends() {
    let silence = Silence {
        from_s: 4.0,
        to_s: 14.0,
        vehicles: vec![2],
    };
    let mut radio = radio(&RadioSettings {
        silences: vec![silence],
        ..RadioSettings::default()
    });
    assert_eq!(radio.transmit(5 * SECOND, 2, 0, 1.0, 1), SILENCED);
    assert_eq!(radio.transmit(5 * SECOND, 0, 2, 1.0, 1), SILENCED);
    assert_ne!(radio.transmit(5 * SECOND, 0, 1, 1.0, 1), SILENCED);
    assert_ne!(radio.transmit(14 * SECOND, 0, 2, 1.0, 1), SILENCED);
    assert_eq!(radio.total().silenced, 2);
}

#[test]
fn a_partition_begins_and_heals_on_schedule_and_cuts_only_between_its_groups() {
    let mut radio = radio(&RadioSettings {
        partitions: vec![Partition {
            from_s: 4.0,
            to_s: 9.0,
            groups: vec![vec![0, 1], vec![2, 3]],
        }],
        ..RadioSettings::default()
    });
    let across = [(0, 2), (2, 0), (1, 3), (3, 1)];
    let within = [(0, 1), (1, 0), (2, 3), (4, 0), (3, 4)];
    for (now_ns, is_cut) in [
        (-SECOND, false),
        (4 * SECOND - 1, false),
        (4 * SECOND, true),
        (9 * SECOND - 1, true),
        (9 * SECOND, false),
    ] {
        for (from, to) in across {
            let verdict = radio.transmit(now_ns, from, to, 1.0, 1);
            assert_eq!(verdict == PARTITIONED, is_cut, "{from} to {to}, {now_ns}");
        }
        for (from, to) in within {
            assert_eq!(radio.transmit(now_ns, from, to, 1.0, 1), delivered(now_ns));
        }
    }
    assert_eq!(radio.total().partitioned, 8);
}

#[test]
fn a_rate_limit_is_the_throughput_under_load_and_costs_nothing_below_it() {
    let limit = RateLimit {
        bytes_per_s: 10_000.0,
        bucket_bytes: 2_000.0,
        queue_bytes: 5_000.0,
    };
    let settings = RadioSettings {
        rate_limit: Some(limit),
        ..RadioSettings::default()
    };
    // 100 bytes every 2.5 ms are four times as much, every 12.5 ms are less than the limit.
    let seconds = 100;
    let mut loaded = radio(&settings);
    let n = seconds * SECOND / (2_500_000);
    for (sent, verdict) in every(2_500_000, n).zip(verdicts(&mut loaded, every(2_500_000, n))) {
        if let Some(at_ns) = arrival_ns(&verdict) {
            assert!(at_ns - sent <= SECOND / 2, "the queue holds half a second");
        }
    }
    let through = loaded.count(0, 1).delivered as f64 * 100.0;
    let allowed = limit.bytes_per_s * seconds as f64 + limit.bucket_bytes + limit.queue_bytes;
    assert!(
        (allowed - 200.0..=allowed).contains(&through),
        "{through} of {allowed}"
    );
    let count = loaded.count(0, 1);
    assert_eq!(count.delivered + count.rate_limited, count.sent);
    assert_eq!(count.reordered, 0, "a queue keeps the order");

    let mut idle = radio(&settings);
    for now_ns in every(12_500_000, 8_000) {
        assert_eq!(idle.transmit(now_ns, 0, 1, 1.0, 100), delivered(now_ns));
    }
}

/// Everything at once, in a fleet of four.
fn everything() -> RadioSettings {
    RadioSettings {
        range_m: Some(50.0),
        loss: 0.2,
        delay_s: 0.1,
        jitter_s: 0.05,
        burst: Some(Burst {
            share: 0.2,
            mean_s: 0.4,
            loss: 0.9,
        }),
        reorder: Some(Reorder {
            probability: 0.1,
            delay_s: 0.2,
        }),
        duplicate: Some(Duplicate {
            probability: 0.1,
            delay_s: 0.05,
        }),
        rate_limit: Some(RateLimit {
            bytes_per_s: 20_000.0,
            bucket_bytes: 2_000.0,
            queue_bytes: 1_000.0,
        }),
        links: vec![LinkOverride {
            from: 0,
            to: 3,
            loss: Some(0.6),
            delay_s: Some(0.3),
            jitter_s: Some(0.0),
            silent: false,
        }],
        silences: vec![Silence {
            from_s: 2.0,
            to_s: 3.0,
            vehicles: vec![1],
        }],
        partitions: vec![Partition {
            from_s: 5.0,
            to_s: 7.0,
            groups: vec![vec![0, 1], vec![2, 3]],
        }],
    }
}

/// Packets of a busy fleet of four that drifts apart: time, ends, distance, bytes.
fn traffic() -> impl Iterator<Item = (i64, usize, usize, f64, usize)> {
    (0..40_000).filter_map(|k: i64| {
        let (from, to) = ((k % 4) as usize, (k / 4 % 4) as usize);
        let now_ns = k * 250_000;
        let apart_m = if from + to == 5 {
            now_ns as f64 * 7e-9
        } else {
            3.0
        };
        (from != to).then_some((now_ns, from, to, apart_m, 50 + (k % 7) as usize * 20))
    })
}

#[test]
fn the_same_seed_gives_the_same_verdicts_and_another_gives_others() {
    let fly = |sample| -> Vec<Verdict> {
        let mut radio = Radio::new(&everything(), Streams::new(9, sample));
        traffic()
            .map(|(now_ns, from, to, apart_m, bytes)| {
                radio.transmit(now_ns, from, to, apart_m, bytes)
            })
            .collect()
    };
    assert!(fly(0) == fly(0));
    assert!(fly(0) != fly(1));
}

#[test]
fn no_impairment_shifts_the_luck_of_another() {
    // One draw a packet decides on loss by chance, whatever else is switched on meanwhile: whoever got as far as chance
    // met what the link's stream holds for it.
    let only_loss = RadioSettings {
        loss: 0.2,
        ..RadioSettings::default()
    };
    let mut all = everything();
    all.links.clear();
    let mut changing = radio(&only_loss);
    let mut luck: BTreeMap<(usize, usize), ChaCha8Rng> = BTreeMap::new();
    let mut compared = 0;
    for (k, (now_ns, from, to, apart_m, bytes)) in traffic().enumerate() {
        if k % 3_000 == 0 {
            let rules = if k % 6_000 == 0 { &all } else { &only_loss };
            changing.change(rules);
        }
        let stream = luck
            .entry((from, to))
            .or_insert_with(|| Streams::new(9, 0).pair(from, to, Purpose::Radio));
        let unlucky = stream.random::<f64>() < 0.2;
        match changing.transmit(now_ns, from, to, apart_m, bytes) {
            Verdict::Lost(Reason::Barred(_) | Reason::RateLimited) => {}
            verdict => {
                compared += 1;
                assert_eq!(
                    verdict == Verdict::Lost(Reason::Chance),
                    unlucky,
                    "packet {k}"
                );
            }
        }
    }
    assert!(compared > 15_000, "{compared}");
}

#[test]
fn a_live_agent_that_is_told_of_the_radio_judges_as_the_radio_does() {
    let settings = everything();
    let names: Vec<Name> = ["ada", "bob", "cyd", "dan"]
        .map(|name| Name::parse(name).unwrap())
        .into();
    let streams = Streams::new(9, 0);
    let mut radio = Radio::new(&settings, streams);
    let mut live: BTreeMap<(usize, usize), (ChaCha8Rng, ChaCha8Rng, faults::Link)> =
        BTreeMap::new();
    for (now_ns, from, to, apart_m, bytes) in traffic() {
        let distance_m = |a: usize, b: usize| if a + b == from + to { apart_m } else { 3.0 };
        // The way of a live agent: the document over the network, its rule for the pair, its link with its own luck.
        let told = settings.faults(now_ns as f64 * 1e-9, &names, distance_m);
        let text = serde_json::to_vec(&told).unwrap();
        let heard = Faults::parse(&text).unwrap();
        let (chance, others, link) = live.entry((from, to)).or_insert_with(|| {
            (
                streams.pair(from, to, Purpose::Radio),
                streams.pair(from, to, Purpose::RadioImpairments),
                faults::Link::default(),
            )
        });
        let draws = Draws::take(&mut || chance.random(), &mut || others.random());
        let verdict = link.judge(&heard.rule(names[from], names[to]), now_ns, bytes, &draws);
        assert_eq!(
            verdict,
            radio.transmit(now_ns, from, to, apart_m, bytes),
            "at {now_ns} ns from {from} to {to}"
        );
    }
    for ((from, to), (_, _, link)) in &live {
        assert_eq!(link.count(), radio.count(*from, *to));
    }
    let nothing_missing = radio.total().by_reason();
    assert!(
        nothing_missing.iter().all(|(_, count)| *count > 100),
        "{nothing_missing:?}"
    );
}

#[test]
fn what_live_agents_are_told_is_within_the_bounds_of_their_document() {
    let names = |n: usize| -> Vec<Name> {
        (0..n)
            .map(|k| Name::parse(&format!("v{k}")).unwrap())
            .collect()
    };
    let mut settings = everything();
    settings.silences[0].vehicles.clear();
    for (apart_m, now_s) in [(3.0, 2.5), (90.0, 2.5), (3.0, 6.0)] {
        let told = |n: usize| settings.faults(now_s, &names(n), |_, _| apart_m).check();
        assert_eq!(told(64), Ok(()), "64 vehicles are 2016 pairs");
        assert_eq!(told(65).is_ok(), now_s > 3.0, "65 are 2080");
    }
    let turns: Vec<f64> = settings.turns_s().collect();
    assert_eq!(turns, [2.0, 3.0, 5.0, 7.0]);
}
