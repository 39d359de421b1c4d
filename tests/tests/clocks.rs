//! Stories of time: clocks that differ, clocks that step, packets that come late, early, twice and out of order. Told by
//! the production vehicle and codec in virtual time.
#![allow(clippy::unwrap_used)]

use nalgebra::Vector3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use skein_estimation::Transform;
use skein_estimation::cooperative::{Mode, Optimiser, Robust};
use skein_estimation::time::{Span, Stamp};
use skein_proto::codec;
use skein_proto::document::{EstimateDocument, HealthDocument};
use skein_proto::envelope::Envelope;
use skein_proto::exchange::{Echo, Exchange};
use skein_proto::frame::{Frame, OdometryFrame};
use skein_proto::growth::Growth;
use skein_proto::measured::{Measured, MeasuredValue};
use skein_proto::record::{PeerEcho, Round, RoundRecord};
use skein_proto::status::Status;
use skein_simworld::fleet::{Fleet, LoggedValue};
use skein_simworld::radio::Radio;
use skein_simworld::scenario::Scenario;
use skein_simworld::stage::Stage;
use skein_simworld::world::{World, nanos};
use skein_tests::stories::{built_in, name};
use skein_vehicle::{
    Config, Input, MutualConfig, Output, PacketKey, RangingConfig, SensorConfig, Start, ToldPose,
    Vehicle,
};
use std::collections::BTreeMap;

/// Each vehicle for itself: what waits for a neighbour's clock there is its prior.
const STAR: Mode = Mode::Star(Robust::DEFAULT);
/// The round of every scenario here, 0.2 s.
const PERIOD_NS: i64 = 200_000_000;

/// Mean squared position error of the whole team from 2 s on, of the last word of everybody on each of its instants.
fn mean_square_m2(scenario: &Scenario, sample: u64, ahead_s: impl Fn(usize) -> f64) -> f64 {
    let mut world = World::new(scenario, sample);
    for vehicle in 0..world.vehicles() {
        world.step_clock(vehicle, nanos(ahead_s(vehicle)));
    }
    let radio = Radio::new(&scenario.radio, world.streams());
    let in_star = |_, config| Config {
        mode: STAR,
        ..config
    };
    let mut fleet = Fleet::on(world, radio, in_star);
    fleet.log();
    fleet.run_until(nanos(20.0));
    let mut last_word = BTreeMap::new();
    for entry in fleet.take_log() {
        if let LoggedValue::Output(Output::Estimate { document, .. }) = entry.what {
            last_word.insert((entry.vehicle, document.taken_ns), document.pose);
        }
    }
    let squares: Vec<f64> = last_word
        .into_iter()
        .map(|((vehicle, taken_ns), pose)| {
            let at_ns = fleet.stage().time_ns(vehicle, taken_ns);
            (at_ns, fleet.stage().pose(vehicle, at_ns), pose)
        })
        .filter(|(at_ns, ..)| *at_ns >= nanos(2.0))
        .map(|(_, truth, pose)| {
            let estimate = Vector3::from(pose.unwrap().position_m);
            (estimate - truth.translation.vector).norm_squared()
        })
        .collect();
    squares.iter().sum::<f64>() / squares.len() as f64
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
fn clocks_that_are_seconds_apart_cost_the_team_nothing() {
    for (delay_s, phase_s) in [(0.0, 0.0), (0.0, 0.07), (0.1, 0.0), (0.1, 0.07)] {
        let ratio = ratio_of_errors(delay_s, [phase_s, phase_s + 5.0]);
        eprintln!("delay {delay_s} s, phase {phase_s} s: 5 s apart / together = {ratio:?}");
        assert!(ratio.0 < 1.05, "{ratio:?}");
    }
}

/// Not of clocks but of rounds out of phase: a round ends when the neighbour's next one has begun, so everybody hears of
/// it later.
#[test]
fn rounds_out_of_phase_cost_the_team_less_than_a_third() {
    for delay_s in [0.0, 0.1] {
        let ratio = ratio_of_errors(delay_s, [0.0, 0.07]);
        eprintln!("delay {delay_s} s: out of phase / in phase = {ratio:?}");
        assert!(ratio.0 < 1.33, "{ratio:?}");
    }
}

/// RMSE of a flight in which every other clock is ahead by the second of two times, over that of one in which it is
/// ahead by the first; and the standard error.
fn ratio_of_errors(delay_s: f64, ahead_s: [f64; 2]) -> (f64, f64) {
    let mut scenario = built_in("section-v");
    scenario.radio.delay_s = delay_s;
    let pair = |sample| {
        let [one, other] = ahead_s.map(|ahead_s| {
            let ahead_s = |vehicle| ahead_s * (vehicle % 2) as f64;
            mean_square_m2(&scenario, sample, ahead_s)
        });
        (one, other)
    };
    let pairs: Vec<(f64, f64)> = (0..SAMPLES).into_par_iter().map(pair).collect();
    paired_ratio(&pairs)
}

const SAMPLES: u64 = 40;

#[test]
fn a_clock_that_steps_in_flight_disturbs_nobody_else_and_is_told_anew_within_two_seconds() {
    let mut scenario = built_in("hover");
    scenario.radio.delay_s = 0.01;
    for (by_s, bound_m) in [(5.0, 0.2), (-5.0, 0.2)] {
        let fly = |stepped: bool| {
            let mut fleet = Fleet::new(&scenario, 3);
            fleet.run_until(nanos(8.05));
            if stepped {
                fleet.step_clock(2, by_s);
            }
            let mut worst_m = 0.0f64;
            while fleet.now_ns() < nanos(20.0) {
                fleet.run_s(0.2);
                for other in [0, 1, 3] {
                    assert_eq!(fleet.estimate(other).unwrap().status, Status::Tracking);
                    worst_m = worst_m.max(fleet.position_error_m(other));
                }
            }
            (fleet, worst_m)
        };
        let ((_, worst_of_plain_m), (fleet, worst_m)) = (fly(false), fly(true));
        eprintln!(
            "step {by_s} s: worst of the others {worst_m:.3} m, without {worst_of_plain_m:.3} m"
        );
        assert!(worst_m < bound_m, "{worst_m} m");
        for hearer in [0, 1, 3] {
            let health = &fleet.health(hearer).unwrap().neighbours["v3"];
            assert_eq!(health.clock_stepped, 1, "{health:?}");
            let offset_s = health.clock_offset_s.unwrap();
            assert!((offset_s - by_s).abs() < 0.001, "{offset_s}");
            for other in ["v1", "v2", "v4"] {
                let others = &fleet.health(hearer).unwrap().neighbours;
                assert!(
                    others
                        .get(other)
                        .is_none_or(|health| health.clock_stepped == 0)
                );
            }
        }
    }
}

/// A neighbour played by the test: it stands 3 m east of v1, sees it in every round, and always knows where it is,
/// whatever its clock does.
struct Puppet {
    ahead_ns: i64,
    sequence: u32,
    heard: Option<Echo>,
}

impl Puppet {
    const BOOT: u64 = 77;

    fn stamp_ns(&self, at_ns: i64) -> i64 {
        at_ns + self.ahead_ns
    }

    fn hear(&mut self, at_ns: i64, key: &PacketKey, bytes: &[u8]) {
        let heard_ns = match key {
            PacketKey::Exchange { .. } => codec::decode::<Exchange>(bytes).unwrap().1.sent_ns,
            PacketKey::Odometry { .. } => codec::decode::<RoundRecord>(bytes).unwrap().1.sent_ns,
            PacketKey::Features { .. } => unreachable!("section V has no cameras"),
            PacketKey::Backlog { .. } | PacketKey::Relay { .. } => {
                unreachable!("nobody asked, nobody relays")
            }
        };
        self.heard = Some(Echo {
            heard_ns,
            received_ns: self.stamp_ns(at_ns),
        });
    }

    /// What it says when a round of its clock begins.
    fn speak(&mut self, at_ns: i64) -> [(PacketKey, Vec<u8>); 2] {
        let (from, to) = (name("v2"), name("v1"));
        let sent_ns = self.stamp_ns(at_ns);
        self.sequence += 1;
        let envelope = Envelope {
            major: 0,
            minor: 0,
            body_bytes: 0,
            sequence: self.sequence,
            boot: Self::BOOT,
            sender: from.hash(),
            taken_ns: sent_ns,
        };
        let exchange = Exchange {
            sent_ns,
            status: Status::Tracking.code(),
            echo: self.heard,
            prior: Some([0.0, 0.0, 0.0, 3.0, 0.0, 0.0]),
            measured: vec![Measured {
                taken_offset_us: 0,
                value: MeasuredValue::Pose {
                    body_from_neighbour: [0.0, 0.0, 0.0, -3.0, 0.0, 0.0],
                    rotation_sigma_rad: 0.01,
                    translation_sigma_m: 0.01,
                },
            }],
        };
        let echo = |echo: Echo| PeerEcho {
            to: to.hash(),
            heard_ns: echo.heard_ns,
            received_ns: echo.received_ns,
        };
        let round = |back| Round {
            back,
            segment: 0,
            odometry_from_body: [0.0; 6],
            growth: Growth::Unknown,
            measured: Vec::new(),
        };
        let record = RoundRecord {
            sent_ns,
            period_us: 200_000,
            status: Status::Tracking.code(),
            body_from_target: None,
            schedule: None,
            echoes: self.heard.map(echo).into_iter().collect(),
            rounds: (0..4).map(round).collect(),
            anchor: None,
            fixes: Vec::new(),
        };
        [
            (
                PacketKey::Exchange { from, to },
                codec::encode(envelope, &exchange).unwrap(),
            ),
            (
                PacketKey::Odometry { from },
                codec::encode(envelope, &record).unwrap(),
            ),
        ]
    }
}

/// v1 and the puppet, whose packets take 10 ms each way. Time advances by milliseconds.
struct Stand {
    vehicle: Vehicle,
    puppet: Puppet,
    now_ns: i64,
    to_vehicle: Vec<(i64, PacketKey, Vec<u8>)>,
    to_puppet: Vec<(i64, PacketKey, Vec<u8>)>,
    estimate: Option<Box<EstimateDocument>>,
    health: Option<Box<HealthDocument>>,
}

impl Stand {
    const EPOCH_NS: i64 = 1_800_000_000_000_000_000;
    const WAY_NS: i64 = 10_000_000;

    fn new() -> Self {
        let config = Config {
            vehicle: name("v1"),
            boot: 1,
            period: Span::millis(200),
            round_wait: Span::millis(300),
            start: Start::Pose(ToldPose::by_hand(Transform::identity())),
            // The puppet tells a prior and no odometry to smooth.
            mode: STAR,
            optimiser: Optimiser::gauss_newton(),
            mutual: MutualConfig::DEFAULT,
            ranging: RangingConfig::DEFAULT,
            sensors: vec![SensorConfig {
                name: name("odometry"),
                driver: "test".to_owned(),
                body_from_sensor: Transform::identity(),
            }],
            body_from_target: Transform::identity(),
            presence_timeout: Span::secs(3),
            repeats: 3,
            relay: false,
            estimate_spacing: Span::ZERO,
        };
        let mut stand = Self {
            vehicle: Vehicle::new(config, Stamp::from_nanos(Self::EPOCH_NS)),
            puppet: Puppet {
                ahead_ns: 3_000_000_000,
                sequence: 0,
                heard: None,
            },
            now_ns: Self::EPOCH_NS,
            to_vehicle: Vec::new(),
            to_puppet: Vec::new(),
            estimate: None,
            health: None,
        };
        stand.feed(Input::Appeared {
            vehicle: name("v2"),
            boot: Puppet::BOOT,
        });
        stand
    }

    fn feed(&mut self, input: Input) {
        self.vehicle.handle(Stamp::from_nanos(self.now_ns), input);
        loop {
            match self.vehicle.poll() {
                Output::WakeAt(_) => return,
                Output::Send { key, bytes } => {
                    self.to_puppet
                        .push((self.now_ns + Self::WAY_NS, key, bytes));
                }
                Output::Estimate { document, .. } => self.estimate = Some(document),
                Output::Health(document) => self.health = Some(document),
                Output::Checkpoint(_)
                | Output::Ask { .. }
                | Output::Work(_)
                | Output::Answer { .. } => {}
            }
        }
    }

    fn run_ms(&mut self, millis: i64) {
        for _ in 0..millis {
            self.now_ns += 1_000_000;
            let now_ns = self.now_ns;
            for (_, key, bytes) in self.to_puppet.extract_if(.., |(at, ..)| *at <= now_ns) {
                self.puppet.hear(now_ns, &key, &bytes);
            }
            let arrived: Vec<_> = self
                .to_vehicle
                .extract_if(.., |(at, ..)| *at <= now_ns)
                .collect();
            for (_, key, bytes) in arrived {
                self.feed(Input::Packet { key, bytes });
            }
            if self.puppet.stamp_ns(now_ns) % PERIOD_NS == 0 {
                for (key, bytes) in self.puppet.speak(now_ns) {
                    self.to_vehicle.push((now_ns + Self::WAY_NS, key, bytes));
                }
            }
            if now_ns % PERIOD_NS == 0 {
                let frame = Frame::Odometry(OdometryFrame {
                    since_ns: now_ns - PERIOD_NS,
                    taken_ns: now_ns,
                    motion: [0.0; 6],
                    rotation_sigma_rad: 0.001,
                    translation_sigma_m: 0.001,
                });
                self.feed(Input::Frame {
                    sensor: name("odometry"),
                    bytes: frame.encode(),
                });
            }
            self.feed(Input::Wake);
        }
    }

    /// When the puppet was last used in a solution.
    fn used_at_ns(&self) -> Option<i64> {
        let estimate = self.estimate.as_ref()?;
        estimate.neighbours.first()?.taken_ns
    }
}

#[test]
fn a_neighbour_whose_clock_stepped_is_used_again_within_two_seconds() {
    for by_ms in [
        -60_000, -5_000, -500, -130, -20, 20, 130, 500, 5_000, 60_000,
    ] {
        // What a round trip of 20 ms leaves open, either time, and 5 ms more are no step: the offset just follows.
        let steps = u64::from(i64::abs(by_ms) > 25);
        let mut stand = Stand::new();
        stand.run_ms(7_050);
        assert!(stand.now_ns - stand.used_at_ns().unwrap() < 2 * PERIOD_NS);
        let stepped_ns = stand.now_ns;
        stand.puppet.ahead_ns += by_ms * 1_000_000;
        let mut again_ms = None;
        for millis in 1..=8_000 {
            stand.run_ms(1);
            let pose = stand.estimate.as_ref().unwrap().pose.unwrap();
            let error_m = pose.position_m.iter().map(|x| x * x).sum::<f64>().sqrt();
            assert!(error_m < 1e-6, "step {by_ms} ms: {error_m} m");
            let health = &stand.health.as_ref().unwrap().neighbours["v2"];
            let anew = health.clock_stepped == steps;
            if anew
                && stand
                    .used_at_ns()
                    .is_some_and(|used_ns| used_ns > stepped_ns)
            {
                again_ms.get_or_insert(millis);
            }
        }
        let again_ms = again_ms.unwrap();
        eprintln!("step {by_ms} ms: used again after {again_ms} ms");
        assert!(again_ms <= 2_000, "step {by_ms} ms: {again_ms} ms");
        assert!(stand.now_ns - stand.used_at_ns().unwrap() < 2 * PERIOD_NS);
        let health = &stand.health.as_ref().unwrap().neighbours["v2"];
        let offset_s = health.clock_offset_s.unwrap() - 3.0;
        assert!(
            (offset_s - by_ms as f64 * 1e-3).abs() < 1e-4,
            "{offset_s} s"
        );
        assert_eq!(health.clock_stepped, steps);
    }
}

#[test]
fn one_forged_echo_moves_nothing() {
    let mut stand = Stand::new();
    stand.run_ms(7_050);
    let before = stand.health.as_ref().unwrap().neighbours["v2"].clone();
    // Another stands up as v2 once, with a clock of its own and an honest echo.
    let ahead_ns = stand.puppet.ahead_ns;
    stand.puppet.ahead_ns += 700_000_000;
    stand.puppet.heard.as_mut().unwrap().received_ns += 700_000_000;
    let forged = stand.puppet.speak(stand.now_ns);
    stand.puppet.heard.as_mut().unwrap().received_ns -= 700_000_000;
    stand.puppet.ahead_ns = ahead_ns;
    for (key, bytes) in forged {
        stand.feed(Input::Packet { key, bytes });
    }
    stand.run_ms(3_000);
    let after = &stand.health.as_ref().unwrap().neighbours["v2"];
    assert_eq!(after.clock_stepped, 0);
    assert_eq!(after.clock_offset_s, before.clock_offset_s);
    assert!(after.fused > before.fused + 10, "{after:?}");
    assert!(stand.now_ns - stand.used_at_ns().unwrap() < 2 * PERIOD_NS);
}

/// v1's estimates of one flight, by the time that they speak of; each packet reaches it once for each of `delays`.
fn listened(
    scenario: &Scenario,
    mut delays: impl FnMut() -> Vec<Span>,
) -> (Vec<EstimateDocument>, HealthDocument, u64) {
    let mut fleet = Fleet::new(scenario, 12);
    let started = Stamp::from_nanos(fleet.stage().stamp_ns(0, fleet.stage().begins_ns()));
    fleet.log();
    fleet.run_until(nanos(12.0));
    let mut inputs: Vec<(Stamp, Input)> = Vec::new();
    let mut packets = 0;
    for entry in fleet
        .take_log()
        .into_iter()
        .filter(|entry| entry.vehicle == 0)
    {
        match entry.what {
            LoggedValue::Input(packet @ Input::Packet { .. }) => {
                packets += 1;
                for delay in delays() {
                    inputs.push((entry.stamp + delay, packet.clone()));
                }
            }
            LoggedValue::Input(Input::Wake) | LoggedValue::Output(_) => {}
            LoggedValue::Input(input) => inputs.push((entry.stamp, input)),
        }
    }
    inputs.sort_by_key(|(at, _)| *at);
    let mut vehicle = Vehicle::new(fleet.config(0).clone(), started);
    let (mut estimates, mut health) = (Vec::<EstimateDocument>::new(), None);
    let mut wake_at = started;
    let mut feed = |now, input| {
        vehicle.handle(now, input);
        loop {
            match vehicle.poll() {
                Output::WakeAt(at) => return at,
                Output::Health(document) => health = Some(*document),
                Output::Estimate { document, .. } => {
                    estimates.retain(|known| known.taken_ns != document.taken_ns);
                    estimates.push(*document);
                }
                Output::Send { .. }
                | Output::Checkpoint(_)
                | Output::Ask { .. }
                | Output::Work(_)
                | Output::Answer { .. } => {}
            }
        }
    };
    let end = started + Span::secs(15);
    for (at, input) in inputs.into_iter().chain([(end, Input::Wake)]) {
        while wake_at < at {
            wake_at = feed(wake_at, Input::Wake);
        }
        wake_at = feed(at, input);
    }
    (estimates, health.unwrap(), packets)
}

#[test]
fn packets_that_come_late_twice_and_out_of_order_give_the_same_estimates_and_are_counted() {
    let mut scenario = built_in("hover");
    scenario.radio.delay_s = 0.01;
    let (in_order, plain_health, _) = listened(&scenario, || vec![Span::ZERO]);
    let mut rng = ChaCha8Rng::seed_from_u64(21);
    let (shuffled, health, packets) = listened(&scenario, || {
        let mut delay = || Span::micros(rng.random_range(0..100_000));
        vec![delay(), delay()]
    });
    let duplicates: u64 = health
        .neighbours
        .values()
        .filter_map(|health| health.refused.get("duplicate"))
        .sum();
    // The first packets may be overtaken before anything was heard; they count as heard then.
    assert!(
        (packets..packets + 10).contains(&duplicates),
        "{duplicates} of {packets}"
    );
    assert_eq!(in_order.len(), shuffled.len());
    let mut worst_m = 0.0f64;
    for (one, other) in in_order.iter().zip(&shuffled) {
        assert_eq!(one.taken_ns, other.taken_ns);
        let (Some(one), Some(other)) = (one.pose, other.pose) else {
            assert_eq!((one.pose, other.pose), (None, None));
            continue;
        };
        let apart = |axis: usize| (one.position_m[axis] - other.position_m[axis]).powi(2);
        worst_m = worst_m.max((0..3).map(apart).sum::<f64>().sqrt());
    }
    let fused = |health: &HealthDocument| -> u64 {
        health.neighbours.values().map(|health| health.fused).sum()
    };
    eprintln!(
        "worst difference {worst_m:.5} m; fused {} in order, {} shuffled",
        fused(&plain_health),
        fused(&health)
    );
    assert!(worst_m < 0.01, "{worst_m} m");
    assert!(fused(&health) + 10 >= fused(&plain_health));
}
