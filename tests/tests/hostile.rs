//! A vehicle in mid-flight is fed garbage and absurdities in between honest packets and frames: it counts them, it
//! stays finite, and what cannot be decoded or is not from whom it says changes nothing at all.
#![allow(clippy::unwrap_used)]

use rand::seq::IndexedRandom;
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use skein_estimation::time::{Span, Stamp};
use skein_proto::anchor::Anchor;
use skein_proto::backlog::Backlog;
use skein_proto::codec::{self, decode};
use skein_proto::document::{EstimateDocument, HealthDocument};
use skein_proto::envelope::Envelope;
use skein_proto::estimate::Estimate;
use skein_proto::exchange::{Echo, Exchange};
use skein_proto::features::FeatureSet;
use skein_proto::fixed::Fixed;
use skein_proto::frame::{
    FixFrame, FixValue, Frame, OdometryFrame, RangesFrame, RelativeFrame, RelativeValue,
    TargetRange,
};
use skein_proto::growth::Growth;
use skein_proto::limits::GROWTH_MAX;
use skein_proto::measured::{Measured, MeasuredValue};
use skein_proto::name::Name;
use skein_proto::record::{Addressed, PeerEcho, Round, RoundFix, RoundRecord, Schedule};
use skein_proto::relay::Relay;
use skein_proto::status::Status;
use skein_simworld::fleet::{Fleet, LoggedValue};
use skein_simworld::scenario::Scenario;
use skein_simworld::stage::Stage;
use skein_simworld::world::nanos;
use skein_tests::stories::name;
use skein_vehicle::{Checkpoint, Config, Input, Output, PacketKey, Vehicle};

const SEED: u64 = 11;
const PIECES: usize = 100_000;

/// What v1 was given in an honest flight of five.
struct Flight {
    config: Config,
    started: Stamp,
    inputs: Vec<(Stamp, Input)>,
}

impl Flight {
    fn of_section_v() -> Self {
        let mut fleet = Fleet::new(&Scenario::built_in("section-v").unwrap(), 9);
        let started = Stamp::from_nanos(fleet.stage().stamp_ns(0, fleet.stage().begins_ns()));
        fleet.log();
        fleet.run_until(nanos(6.35));
        let log = fleet
            .take_log()
            .into_iter()
            .filter(|entry| entry.vehicle == 0);
        let input = |entry: skein_simworld::fleet::Logged| match entry.what {
            LoggedValue::Input(input) => Some((entry.stamp, input)),
            LoggedValue::Output(_) => None,
        };
        Self {
            config: fleet.config(0).clone(),
            started,
            inputs: log.filter_map(input).collect(),
        }
    }

    /// Flies it again. After each honest input, half-way to the next, `between` may feed what it likes.
    fn fly(&self, mut between: impl FnMut(usize, Stamp, &mut Pilot)) -> Pilot {
        let mut pilot = Pilot {
            vehicle: Vehicle::new(self.config.clone(), self.started),
            outputs: Vec::new(),
        };
        for (nth, (stamp, input)) in self.inputs.iter().enumerate() {
            pilot.feed(*stamp, input.clone());
            let next = self.inputs.get(nth + 1).map_or(*stamp, |(next, _)| *next);
            let half_way = *stamp + Span::from_nanos((next - *stamp).as_nanos() / 2);
            between(nth, half_way, &mut pilot);
        }
        // The last word is a health that counts everything.
        pilot.feed(self.started + Span::millis(9_050), Input::Wake);
        pilot
    }

    fn packets(&self) -> Vec<(PacketKey, Vec<u8>)> {
        let packet = |(_, input): &(Stamp, Input)| match input {
            Input::Packet { key, bytes } => Some((*key, bytes.clone())),
            _ => None,
        };
        self.inputs.iter().filter_map(packet).collect()
    }

    fn frames(&self) -> Vec<(Name, Vec<u8>)> {
        let frame = |(_, input): &(Stamp, Input)| match input {
            Input::Frame { sensor, bytes } => Some((*sensor, bytes.clone())),
            _ => None,
        };
        self.inputs.iter().filter_map(frame).collect()
    }
}

/// A vehicle and everything that came out of it.
struct Pilot {
    vehicle: Vehicle,
    outputs: Vec<Output>,
}

impl Pilot {
    fn feed(&mut self, now: Stamp, input: Input) {
        self.vehicle.handle(now, input);
        loop {
            match self.vehicle.poll() {
                Output::WakeAt(_) => return,
                output => {
                    check_finite(&output);
                    self.outputs.push(output);
                }
            }
        }
    }

    /// Everything but the health, which is there to show the difference.
    fn deeds(&self) -> Vec<&Output> {
        self.outputs
            .iter()
            .filter(|output| !matches!(output, Output::Health(_)))
            .collect()
    }

    fn health(&self) -> &HealthDocument {
        let health = |output: &'_ Output| matches!(output, Output::Health(_));
        match self.outputs.iter().rfind(|output| health(output)) {
            Some(Output::Health(document)) => document,
            _ => panic!("no health"),
        }
    }

    fn estimate(&self) -> &EstimateDocument {
        let found = self.outputs.iter().rev().find_map(|output| match output {
            Output::Estimate { document, .. } => Some(document),
            _ => None,
        });
        found.unwrap()
    }
}

/// Whatever comes out can be decoded again, so every number in it is finite and within its range.
fn check_finite(output: &Output) {
    match output {
        Output::Send {
            key: PacketKey::Exchange { .. },
            bytes,
        } => drop(decode::<Exchange>(bytes).unwrap()),
        Output::Send {
            key: PacketKey::Odometry { .. },
            bytes,
        } => drop(decode::<RoundRecord>(bytes).unwrap()),
        Output::Send {
            key: PacketKey::Features { .. },
            bytes,
        } => drop(decode::<FeatureSet>(bytes).unwrap()),
        Output::Send {
            key: PacketKey::Backlog { .. },
            ..
        } => panic!("a backlog is an answer"),
        Output::Send {
            key: PacketKey::Relay { .. },
            bytes,
        } => drop(decode::<Relay>(bytes).unwrap()),
        Output::Estimate { packet, document } => {
            decode::<Estimate>(packet).unwrap();
            let poses = document
                .neighbours
                .iter()
                .filter_map(|neighbour| neighbour.pose);
            for pose in poses.chain(document.pose) {
                let numbers = pose
                    .position_m
                    .iter()
                    .chain(&pose.quaternion_wxyz)
                    .chain(&pose.yaw_pitch_roll_deg);
                assert!(
                    numbers.into_iter().all(|number| number.is_finite()),
                    "{document:?}"
                );
            }
        }
        Output::Checkpoint(checkpoint) => {
            let vehicle = name("v1");
            let bytes = checkpoint.encode(vehicle);
            assert_eq!(Checkpoint::decode(vehicle, &bytes), Ok(*checkpoint));
        }
        Output::Answer { packets, .. } => {
            for bytes in packets {
                decode::<Backlog>(bytes).unwrap();
            }
        }
        Output::Health(_) | Output::Ask { .. } | Output::Work(_) | Output::WakeAt(_) => {}
    }
}

/// Everything that was counted as accepted or refused.
fn counted(health: &HealthDocument) -> u64 {
    let neighbours = health
        .neighbours
        .values()
        .flat_map(|n| n.accepted.values().chain(n.refused.values()));
    let sensors = health
        .sensors
        .values()
        .map(|s| s.accepted + s.refused.values().sum::<u64>());
    neighbours.sum::<u64>() + sensors.sum::<u64>() + health.refused.values().sum::<u64>()
}

fn random_bytes(rng: &mut impl Rng, most: usize) -> Vec<u8> {
    let mut bytes = vec![0; rng.random_range(0..=most)];
    rng.fill_bytes(&mut bytes);
    bytes
}

/// Some bytes of an honest message, changed.
fn damaged(honest: &[u8], rng: &mut impl Rng) -> Vec<u8> {
    let mut bytes = honest.to_vec();
    match rng.random_range(0..4) {
        0 => bytes.truncate(rng.random_range(0..bytes.len())),
        1 => bytes.extend(random_bytes(rng, 64)),
        2 => {
            let at = rng.random_range(0..bytes.len());
            bytes[at] ^= 1 << rng.random_range(0..8);
        }
        _ => {
            for _ in 0..rng.random_range(1..8) {
                let at = rng.random_range(0..bytes.len());
                bytes[at] = rng.random();
            }
        }
    }
    bytes
}

/// Any key: of team-mates, of strangers, of this vehicle itself, to this vehicle or to others.
fn any_key(rng: &mut impl Rng) -> PacketKey {
    let who = |rng: &mut _| {
        name(
            ["v1", "v2", "v3", "v4", "v5", "nobody", "x"]
                .choose(rng)
                .unwrap(),
        )
    };
    let from = who(rng);
    if rng.random() {
        PacketKey::Odometry { from }
    } else if rng.random_ratio(1, 4) {
        PacketKey::Backlog { from }
    } else if rng.random_ratio(1, 4) {
        PacketKey::Features { from }
    } else if rng.random_ratio(1, 4) {
        PacketKey::Relay { from }
    } else {
        PacketKey::Exchange {
            from,
            to: if rng.random_bool(0.8) {
                name("v1")
            } else {
                who(rng)
            },
        }
    }
}

/// Something that resembles a packet or a frame; `flight` gives the honest ones that are damaged.
fn piece(
    packets: &[(PacketKey, Vec<u8>)],
    frames: &[(Name, Vec<u8>)],
    rng: &mut ChaCha8Rng,
) -> Input {
    if rng.random_bool(0.6) {
        let (honest_key, honest) = packets.choose(rng).unwrap();
        let (key, bytes) = match rng.random_range(0..5) {
            0 => (any_key(rng), random_bytes(rng, 1_400)),
            // Under the key of somebody else: the hash in it gives it away.
            1 => (any_key(rng), honest.clone()),
            2 => (any_key(rng), damaged(honest, rng)),
            _ => (*honest_key, damaged(honest, rng)),
        };
        Input::Packet { key, bytes }
    } else {
        let (sensor, honest) = frames.choose(rng).unwrap();
        let (sensor, bytes) = match rng.random_range(0..5) {
            0 => (*sensor, random_bytes(rng, 20_000)),
            1 => (name("unheard_of"), honest.clone()),
            2 => {
                let text = serde_json::to_vec(&Frame::decode(honest).unwrap()).unwrap();
                (*sensor, damaged(&text, rng))
            }
            _ => (*sensor, damaged(honest, rng)),
        };
        Input::Frame { sensor, bytes }
    }
}

/// Whether nothing of it may be used: it cannot be decoded, or it is not from whom or for whom the key says.
fn is_void(input: &Input) -> bool {
    let me = name("v1");
    let from_another = |envelope: &Envelope, from: Name| envelope.sender != from.hash();
    match input {
        Input::Packet { key, bytes } => match *key {
            PacketKey::Exchange { from, to } => {
                from == me
                    || to != me
                    || decode::<Exchange>(bytes).map_or(true, |(head, _)| from_another(&head, from))
            }
            PacketKey::Odometry { from } => {
                from == me
                    || decode::<RoundRecord>(bytes)
                        .map_or(true, |(head, _)| from_another(&head, from))
            }
            PacketKey::Features { from } => {
                from == me
                    || decode::<FeatureSet>(bytes)
                        .map_or(true, |(head, _)| from_another(&head, from))
            }
            // Nobody asked.
            PacketKey::Backlog { .. } => true,
            PacketKey::Relay { from } => {
                from == me
                    || decode::<Relay>(bytes).map_or(true, |(head, _)| from_another(&head, from))
            }
        },
        Input::Frame { sensor, bytes } => {
            *sensor == name("unheard_of") || Frame::decode(bytes).is_err()
        }
        _ => false,
    }
}

#[test]
fn garbage_is_counted_to_the_last_piece_and_changes_nothing() {
    eprintln!("seed {SEED}");
    let flight = Flight::of_section_v();
    let (packets, frames) = (flight.packets(), flight.frames());
    let honest = flight.fly(|_, _, _| {});

    let mut rng = ChaCha8Rng::seed_from_u64(SEED);
    let each = PIECES.div_ceil(flight.inputs.len());
    let mut fed = 0;
    let pestered = flight.fly(|_, now, pilot| {
        for _ in 0..each {
            let garbage = std::iter::repeat_with(|| piece(&packets, &frames, &mut rng))
                .find(is_void)
                .unwrap();
            pilot.feed(now, garbage);
            fed += 1;
        }
    });
    assert!(fed >= PIECES as u64);
    assert_eq!(honest.estimate().status, Status::Tracking);
    assert!(
        honest.deeds() == pestered.deeds(),
        "estimates and packets are those of the flight without it"
    );
    assert_eq!(counted(pestered.health()) - counted(honest.health()), fed);
    let words: Vec<&String> = pestered.health().neighbours["v2"].refused.keys().collect();
    eprintln!("{fed} pieces, words of v2: {words:?}");
    for word in [
        "malformed",
        "not_finite",
        "not_for_me",
        "out_of_range",
        "too_long",
        "trailing",
        "truncated",
        "version",
        "wrong_hash",
    ] {
        assert!(
            words.iter().any(|known| *known == word),
            "{word} is missing in {words:?}"
        );
    }
}

#[test]
fn damaged_messages_that_still_decode_leave_everything_finite_and_counted() {
    eprintln!("seed {SEED}");
    let flight = Flight::of_section_v();
    let (packets, frames) = (flight.packets(), flight.frames());
    let mut rng = ChaCha8Rng::seed_from_u64(SEED + 1);
    let each = PIECES.div_ceil(flight.inputs.len());
    let (mut fed, mut decodable) = (0, 0);
    let pestered = flight.fly(|_, now, pilot| {
        for _ in 0..each {
            let piece = piece(&packets, &frames, &mut rng);
            decodable += u64::from(!is_void(&piece));
            pilot.feed(now, piece);
            fed += 1;
        }
    });
    eprintln!(
        "{fed} pieces, {decodable} of them decodable; in the end {:?}",
        pestered.estimate().status
    );
    assert!(decodable > 1_000, "{decodable}");
    // Each piece is counted once on arrival; a measurement may be counted again when its round is solved.
    let honest = flight
        .inputs
        .iter()
        .filter(|(_, input)| matches!(input, Input::Packet { .. } | Input::Frame { .. }));
    assert!(counted(pestered.health()) >= fed + honest.count() as u64);
}

const STAMPS_NS: [i64; 7] = [i64::MIN, i64::MIN + 1, -1, 0, 1, i64::MAX - 1, i64::MAX];
const FAR_M: f64 = 1e7;

/// A time near enough to be believed, or one that is not.
fn stamp_ns(now: Stamp, rng: &mut impl Rng) -> i64 {
    let near_ns = now.as_nanos() + Span::millis(rng.random_range(-1_500..1_500)).as_nanos();
    let far_ns = now
        .as_nanos()
        .saturating_add(Span::secs(rng.random_range(-100_000..100_000)).as_nanos());
    match rng.random_range(0..6) {
        0 => *STAMPS_NS.choose(rng).unwrap(),
        1 => far_ns,
        _ => near_ns,
    }
}

fn sigma(rng: &mut impl Rng) -> f64 {
    *[f64::from(f32::MIN_POSITIVE), 1e-3, 1.0, 1e6]
        .choose(rng)
        .unwrap()
}

fn place(rng: &mut impl Rng) -> [f64; 3] {
    std::array::from_fn(|_| *[-FAR_M, -1.0, 0.0, 1e-300, 1.0, FAR_M].choose(rng).unwrap())
}

fn rotation(rng: &mut impl Rng) -> [f64; 3] {
    let axis = rng.random_range(0..3);
    let mut vector = [0.0; 3];
    vector[axis] = *[
        -3.2,
        -std::f64::consts::PI,
        0.0,
        1e-300,
        std::f64::consts::PI,
        3.2,
    ]
    .choose(rng)
    .unwrap();
    vector
}

fn pose(rng: &mut impl Rng) -> [f64; 6] {
    let ([a, b, c], [x, y, z]) = (rotation(rng), place(rng));
    [a, b, c, x, y, z]
}

fn direction(rng: &mut impl Rng) -> [f64; 3] {
    *[[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]
        .choose(rng)
        .unwrap()
}

fn measured(rng: &mut impl Rng) -> Measured {
    let sigma = |rng: &mut _| sigma(rng) as f32;
    let value = match rng.random_range(0..5) {
        0 => MeasuredValue::Pose {
            body_from_neighbour: pose(rng),
            rotation_sigma_rad: sigma(rng),
            translation_sigma_m: sigma(rng),
        },
        1 => MeasuredValue::Orientation {
            rotation_vector_rad: rotation(rng),
            sigma_rad: sigma(rng),
        },
        2 => MeasuredValue::Position {
            position_m: place(rng),
            sigma_m: sigma(rng),
        },
        3 => MeasuredValue::Bearing {
            direction: direction(rng),
            origin_m: place(rng),
            sigma_rad: sigma(rng),
        },
        _ => MeasuredValue::Distance {
            distance_m: *[0.0, FAR_M].choose(rng).unwrap(),
            origin_m: place(rng),
            sigma_m: sigma(rng),
        },
    };
    Measured {
        taken_offset_us: *[i32::MIN, -1_000_000, -1, 0, 1, i32::MAX]
            .choose(rng)
            .unwrap(),
        value,
    }
}

/// A packet that decodes and is from whom it says, with numbers at their limits.
fn extreme_packet(now: Stamp, envelope: Envelope, from: Name, rng: &mut ChaCha8Rng) -> Input {
    let sent_ns = stamp_ns(now, rng);
    let taken_ns = if rng.random() {
        sent_ns.saturating_sub(rng.random_range(0..1_000_000_000))
    } else {
        stamp_ns(now, rng)
    };
    let sequence = if rng.random_bool(0.01) {
        u32::MAX
    } else {
        envelope.sequence.wrapping_add(rng.random_range(0..50))
    };
    let boot = if rng.random_bool(0.3) {
        rng.random_range(0..10)
    } else {
        envelope.boot
    };
    let envelope = Envelope {
        sequence,
        boot,
        taken_ns,
        ..envelope
    };
    let status = rng.random_range(0..=8);
    if rng.random() {
        let count = rng.random_range(0..=3);
        let exchange = Exchange {
            sent_ns,
            status,
            echo: rng.random::<bool>().then(|| Echo {
                heard_ns: stamp_ns(now, rng),
                received_ns: stamp_ns(now, rng),
            }),
            prior: rng.random::<bool>().then(|| pose(rng)),
            measured: (0..count).map(|_| measured(rng)).collect(),
        };
        let key = PacketKey::Exchange {
            from,
            to: name("v1"),
        };
        return Input::Packet {
            key,
            bytes: codec::encode(envelope, &exchange).unwrap(),
        };
    }
    // As many rounds and measurements as fit: 8 rounds of few, or one of 16.
    let (rounds, each) = if rng.random() {
        (rng.random_range(0..=5), 0)
    } else {
        (1, 9)
    };
    let round = |rng: &mut ChaCha8Rng| Round {
        back: *[0, 1, 255].choose(rng).unwrap(),
        segment: *[0, 255].choose(rng).unwrap(),
        odometry_from_body: pose(rng),
        growth: if rng.random() {
            Growth::Unknown
        } else {
            Growth::Isotropic([GROWTH_MAX; 11])
        },
        measured: (0..each)
            .map(|_| Addressed {
                to: name("v1").hash(),
                measured: measured(rng),
            })
            .collect(),
    };
    let rounds: Vec<Round> = (0..rounds).map(|_| round(rng)).collect();
    let sigma_f32 = |rng: &mut _| sigma(rng) as f32;
    let fixes = rounds.first().map(|round| RoundFix {
        back: round.back,
        fix: Fixed::Pose {
            world_from_body: pose(rng),
            rotation_sigma_rad: sigma_f32(rng),
            translation_sigma_m: sigma_f32(rng),
        },
    });
    let anchor = rng.random_bool(0.3).then(|| Anchor {
        taken_ns: stamp_ns(now, rng),
        segment: 255,
        odometry_from_body: pose(rng),
        growth: Growth::Isotropic([GROWTH_MAX; 11]),
        world_from_body: pose(rng),
        rotation_sigma_rad: sigma_f32(rng),
        translation_sigma_m: sigma_f32(rng),
    });
    let record = RoundRecord {
        sent_ns,
        period_us: *[0, 1, 200_000, u32::MAX].choose(rng).unwrap(),
        status,
        body_from_target: rng.random::<bool>().then(|| pose(rng)),
        schedule: rng.random::<bool>().then_some(Schedule {
            round: u32::MAX,
            phase: u16::MAX,
            state: 255,
            draw: u64::MAX,
            moves: u32::MAX,
        }),
        echoes: vec![
            PeerEcho {
                to: name("v1").hash(),
                heard_ns: stamp_ns(now, rng),
                received_ns: stamp_ns(now, rng)
            };
            4
        ],
        rounds,
        anchor,
        fixes: fixes.into_iter().collect(),
    };
    match codec::encode(envelope, &record) {
        Ok(bytes) => Input::Packet {
            key: PacketKey::Odometry { from },
            bytes,
        },
        // Too long with this luck.
        Err(_) => Input::Wake,
    }
}

/// A frame that decodes, with numbers at their limits.
fn extreme_frame(now: Stamp, with_odometry: bool, rng: &mut ChaCha8Rng) -> Input {
    let taken_ns = stamp_ns(now, rng);
    let target = name(
        ["v1", "v2", "v3", "v4", "v5", "nobody"]
            .choose(rng)
            .unwrap(),
    );
    let frame = match rng.random_range(0..if with_odometry { 5 } else { 4 }) {
        0 | 1 => {
            let value = match rng.random_range(0..5) {
                0 => RelativeValue::Pose {
                    sensor_from_target: pose(rng),
                    rotation_sigma_rad: sigma(rng),
                    translation_sigma_m: sigma(rng),
                },
                1 => RelativeValue::Orientation {
                    rotation_vector_rad: rotation(rng),
                    sigma_rad: sigma(rng),
                },
                2 => RelativeValue::Position {
                    position_m: place(rng),
                    sigma_m: sigma(rng),
                },
                3 => RelativeValue::Bearing {
                    direction: direction(rng),
                    sigma_rad: sigma(rng),
                },
                _ => RelativeValue::Distance {
                    distance_m: FAR_M,
                    sigma_m: sigma(rng),
                },
            };
            Frame::Relative(RelativeFrame {
                taken_ns,
                target,
                value,
            })
        }
        2 => {
            let range = TargetRange {
                target,
                distance_m: *[0.0, FAR_M].choose(rng).unwrap(),
                sigma_m: sigma(rng),
            };
            Frame::Ranges(RangesFrame {
                taken_ns,
                ranges: vec![range; 32],
            })
        }
        3 => {
            let value = match rng.random_range(0..3) {
                0 => FixValue::Pose {
                    world_from_sensor: pose(rng),
                    rotation_sigma_rad: sigma(rng),
                    translation_sigma_m: sigma(rng),
                },
                1 => FixValue::Position {
                    position_m: place(rng),
                    sigma_m: sigma(rng),
                },
                _ => FixValue::Orientation {
                    rotation_vector_rad: rotation(rng),
                    sigma_rad: sigma(rng),
                },
            };
            Frame::Fix(FixFrame { taken_ns, value })
        }
        _ => {
            let since_ns = stamp_ns(now, rng);
            let (since_ns, taken_ns) = (since_ns.min(taken_ns), since_ns.max(taken_ns));
            Frame::Odometry(OdometryFrame {
                since_ns,
                taken_ns,
                motion: pose(rng),
                rotation_sigma_rad: sigma(rng),
                translation_sigma_m: sigma(rng),
            })
        }
    };
    let sensor = name(if matches!(frame, Frame::Odometry(_)) {
        "odometry"
    } else {
        "relative"
    });
    let bytes = if rng.random() {
        frame.encode()
    } else {
        serde_json::to_vec(&frame).unwrap()
    };
    Input::Frame { sensor, bytes }
}

/// Tokens of any boot come and go.
fn any_token(rng: &mut ChaCha8Rng) -> Input {
    let vehicle = name(["v1", "v2", "v5", "nobody"].choose(rng).unwrap());
    let boot = *[0, 1, u64::MAX].choose(rng).unwrap();
    if rng.random() {
        Input::Appeared { vehicle, boot }
    } else {
        Input::Vanished { vehicle, boot }
    }
}

/// A flight among absurd packets and frames; the heads of honest packets lend them a boot and a sequence.
fn fly_among_extremes(with_odometry: bool, pieces: usize) -> Pilot {
    let flight = Flight::of_section_v();
    let packets = flight.packets();
    let mut rng = ChaCha8Rng::seed_from_u64(SEED + 2);
    let each = pieces.div_ceil(flight.inputs.len());
    let quiet_from = flight.inputs.len() - flight.inputs.len() / 4;
    flight.fly(|nth, now, pilot| {
        for _ in 0..if nth < quiet_from { each } else { 0 } {
            let (key, honest) = packets.choose(&mut rng).unwrap();
            let head = match key {
                PacketKey::Exchange { .. } => decode::<Exchange>(honest).unwrap().0,
                PacketKey::Odometry { .. } => decode::<RoundRecord>(honest).unwrap().0,
                PacketKey::Features { .. } => unreachable!("section V has no cameras"),
                PacketKey::Backlog { .. } | PacketKey::Relay { .. } => {
                    unreachable!("nobody asked, nobody relays")
                }
            };
            let input = match rng.random_range(0..10) {
                0..5 => extreme_packet(now, head, key.from(), &mut rng),
                5..9 => extreme_frame(now, with_odometry, &mut rng),
                _ => any_token(&mut rng),
            };
            pilot.feed(now, input);
        }
    })
}

#[test]
fn absurd_numbers_that_decode_leave_every_output_finite() {
    eprintln!("seed {SEED}");
    let pilot = fly_among_extremes(false, 50_000);
    eprintln!(
        "in the end {:?} at {:?}",
        pilot.estimate().status,
        pilot.estimate().pose.map(|pose| pose.position_m)
    );
    eprintln!("{:?}", pilot.health().rounds);
    assert!(pilot.health().rounds.solved > 10);
}

#[test]
fn absurd_odometry_leaves_every_output_finite() {
    eprintln!("seed {SEED}");
    let pilot = fly_among_extremes(true, 50_000);
    eprintln!(
        "in the end {:?} at {:?}",
        pilot.estimate().status,
        pilot.estimate().pose.map(|pose| pose.position_m)
    );
    eprintln!("{:?}", pilot.health().rounds);
}

/// Packets that strangers feed to a flying vehicle, and those that go to the decoders alone: a million together.
const FORGED: usize = 250_000;
const DECODED: usize = 750_000;
/// Names that strangers take. With those of the team they fit among the neighbours of a vehicle, so that none is
/// forgotten with its counts.
const STRANGERS: u32 = 40;

/// An honest packet or two, no longer what they were: bits flipped, cut short, made longer, one head on another's body,
/// or nothing but chance.
fn mutated(packets: &[(PacketKey, Vec<u8>)], rng: &mut ChaCha8Rng) -> Vec<u8> {
    let (_, honest) = packets.choose(rng).unwrap();
    let mut bytes = honest.clone();
    match rng.random_range(0..6) {
        0 => {
            for _ in 0..rng.random_range(1..=8) {
                let at = rng.random_range(0..bytes.len());
                bytes[at] ^= 1 << rng.random_range(0..8);
            }
        }
        1 => bytes.truncate(rng.random_range(0..bytes.len())),
        2 => bytes.extend(random_bytes(rng, 200)),
        3 => {
            let (_, other) = packets.choose(rng).unwrap();
            bytes.truncate(rng.random_range(0..=bytes.len()));
            bytes.extend(&other[rng.random_range(0..other.len())..]);
        }
        4 => bytes = random_bytes(rng, 1_400),
        // The length in the head says what follows: the damage behind it is found by the body's own rules.
        _ => {
            let body = random_bytes(rng, 300);
            bytes.truncate(32);
            bytes.extend(&body);
            bytes[2..4].copy_from_slice(&(body.len() as u16).to_le_bytes());
        }
    }
    bytes
}

/// The packets as they would have been in a flight an hour ago: nothing in them echoes what is sent in this one.
fn an_hour_ago(packets: Vec<(PacketKey, Vec<u8>)>) -> Vec<(PacketKey, Vec<u8>)> {
    const HOUR_NS: i64 = 3_600_000_000_000;
    let older = |(key, bytes): (PacketKey, Vec<u8>)| {
        let head = |envelope: Envelope| Envelope {
            taken_ns: envelope.taken_ns - HOUR_NS,
            ..envelope
        };
        let bytes = match key {
            PacketKey::Exchange { .. } => {
                let (envelope, mut exchange) = decode::<Exchange>(&bytes).unwrap();
                exchange.sent_ns -= HOUR_NS;
                if let Some(echo) = &mut exchange.echo {
                    echo.heard_ns -= HOUR_NS;
                    echo.received_ns -= HOUR_NS;
                }
                codec::encode(head(envelope), &exchange).unwrap()
            }
            PacketKey::Odometry { .. } => {
                let (envelope, mut record) = decode::<RoundRecord>(&bytes).unwrap();
                record.sent_ns -= HOUR_NS;
                for echo in &mut record.echoes {
                    echo.heard_ns -= HOUR_NS;
                    echo.received_ns -= HOUR_NS;
                }
                codec::encode(head(envelope), &record).unwrap()
            }
            PacketKey::Features { .. } => unreachable!("section V has no cameras"),
            PacketKey::Backlog { .. } | PacketKey::Relay { .. } => {
                unreachable!("nobody asked, nobody relays")
            }
        };
        (key, bytes)
    };
    packets.into_iter().map(older).collect()
}

#[test]
fn a_quarter_of_a_million_forged_packets_of_strangers_move_no_estimate_by_a_bit() {
    eprintln!("seed {SEED}");
    let flight = Flight::of_section_v();
    // Strangers do not hear the fleet: whoever echoes what is sent now lives, and is a neighbour like any other.
    let packets = an_hour_ago(flight.packets());
    let honest = flight.fly(|_, _, _| {});

    let mut rng = ChaCha8Rng::seed_from_u64(SEED + 3);
    let each = FORGED.div_ceil(flight.inputs.len());
    let (mut fed, mut decodable) = (0, 0);
    let pestered = flight.fly(|_, now, pilot| {
        for _ in 0..each {
            let from = name(&format!("stranger{}", rng.random_range(0..STRANGERS)));
            // One in four is whole but for who sent it.
            let mut bytes = if rng.random_ratio(1, 4) {
                packets.choose(&mut rng).unwrap().1.clone()
            } else {
                mutated(&packets, &mut rng)
            };
            if let Some(sender) = bytes.get_mut(16..24) {
                sender.copy_from_slice(&from.hash().to_le_bytes());
            }
            let to = name("v1");
            let (key, decodes) = if rng.random() {
                let key = PacketKey::Odometry { from };
                (key, decode::<RoundRecord>(&bytes).is_ok())
            } else {
                let key = PacketKey::Exchange { from, to };
                (key, decode::<Exchange>(&bytes).is_ok())
            };
            decodable += u64::from(decodes);
            pilot.feed(now, Input::Packet { key, bytes });
            fed += 1;
        }
    });
    let strangers = pestered.health().neighbours.len() - honest.health().neighbours.len();
    eprintln!("{fed} packets of {strangers} strangers, {decodable} of them decodable");
    assert!(fed >= FORGED as u64 && decodable > 20_000);
    assert_eq!(strangers, STRANGERS as usize);
    assert_eq!(honest.estimate().status, Status::Tracking);
    let estimates = |pilot: &Pilot| -> Vec<Output> {
        let is_estimate = |output: &&Output| matches!(output, Output::Estimate { .. });
        pilot.outputs.iter().filter(is_estimate).cloned().collect()
    };
    assert!(
        estimates(&honest) == estimates(&pestered),
        "every estimate is that of the flight without them, bit by bit"
    );
    assert_eq!(counted(pestered.health()) - counted(honest.health()), fed);
}

/// Whether bytes are a message, which can then be said again: its numbers are in range, its lists within bounds.
fn is_message<M: codec::Body + PartialEq + std::fmt::Debug>(bytes: &[u8]) -> bool {
    let Ok((envelope, message)) = decode::<M>(bytes) else {
        return false;
    };
    let again = codec::encode(envelope, &message).unwrap();
    let (_, same) = decode::<M>(&again).unwrap();
    assert_eq!(same, message);
    true
}

#[test]
fn three_quarters_of_a_million_mutated_packets_are_messages_or_errors_to_every_decoder() {
    eprintln!("seed {SEED}");
    let flight = Flight::of_section_v();
    let packets = flight.packets();
    let frames = flight.frames();
    let mut rng = ChaCha8Rng::seed_from_u64(SEED + 4);
    let (mut messages, mut errors) = (0, 0);
    let mut tally = |is_message: bool| {
        if is_message {
            messages += 1;
        } else {
            errors += 1;
        }
    };
    for _ in 0..DECODED / 5 {
        let bytes = mutated(&packets, &mut rng);
        tally(is_message::<Exchange>(&bytes));
        tally(is_message::<RoundRecord>(&bytes));
        tally(is_message::<Estimate>(&bytes));
        tally(Frame::decode(&bytes).is_ok());
        let frame = frames.choose(&mut rng).unwrap();
        tally(Frame::decode(&damaged(&frame.1, &mut rng)).is_ok());
    }
    eprintln!("{messages} messages, {errors} errors");
    assert_eq!(messages + errors, DECODED);
    assert!(messages > 1_000, "{messages}");
}

/// A text of a person cut at every byte, and with each bit of it flipped at least once in three texts of `flips`.
fn spoilt(text: &str, flips: usize, rng: &mut ChaCha8Rng) -> Vec<String> {
    let bytes = text.as_bytes();
    let lossy = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let mut spoilt: Vec<String> = (0..bytes.len()).map(|cut| lossy(&bytes[..cut])).collect();
    for nth in 0..flips {
        let mut flipped = bytes.to_vec();
        let at = nth % bytes.len();
        flipped[at] ^= 1 << rng.random_range(0..8);
        if nth >= bytes.len() {
            let at = rng.random_range(0..bytes.len());
            flipped[at] ^= 1 << rng.random_range(0..8);
        }
        spoilt.push(lossy(&flipped));
    }
    spoilt
}

/// The example with the keys that stand in comments, but for those of another network and of recordings.
fn every_key() -> String {
    let root = concat!(env!("CARGO_MANIFEST_DIR"), "/../agent/examples/skein.toml");
    let text = std::fs::read_to_string(root).unwrap();
    let mut whole = String::new();
    for line in text.lines() {
        let uncommented = line.strip_prefix("# ").unwrap_or(line);
        let excluded = ["zenoh_config", "[clock]", "rate ", "driver "];
        let is_key =
            toml_like(uncommented) && !excluded.iter().any(|key| uncommented.starts_with(key));
        whole.push_str(if is_key { uncommented } else { line });
        whole.push('\n');
    }
    whole
}

/// Whether a line of a comment is a key or a table and not a sentence.
fn toml_like(line: &str) -> bool {
    let is_name =
        |word: &str| !word.is_empty() && word.chars().all(|c| c.is_ascii_lowercase() || c == '_');
    let table = line
        .strip_prefix('[')
        .and_then(|rest| rest.split(']').next());
    let key = line.split_once(" = ").map(|(key, _)| key);
    table.or(key).is_some_and(is_name)
}

#[test]
fn a_configuration_cut_or_damaged_anywhere_is_read_or_refused_with_its_place() {
    eprintln!("seed {SEED}");
    let text = every_key();
    let folder = std::path::Path::new("/nonexistent");
    let parse = |text: &str| skein_agent::config::parse(text, "skein.toml", folder);
    let whole = parse(&text).map_err(|error| error.mistake()).unwrap();
    assert!(whole.log.is_some() && whole.faults.is_some(), "{text}");
    let mut rng = ChaCha8Rng::seed_from_u64(SEED + 5);
    let (mut read, mut refused) = (0, 0);
    for spoilt in spoilt(&text, 3 * text.len(), &mut rng) {
        match parse(&spoilt) {
            Ok(_) => read += 1,
            Err(error) => {
                let mistake = error.mistake();
                assert!(
                    mistake.line.is_some() && !mistake.message.is_empty(),
                    "{mistake:?} of\n{spoilt}"
                );
                refused += 1;
            }
        }
    }
    eprintln!("{read} are configurations, {refused} are refused with a place");
    assert!(read > 100 && refused > 1_000);
}

#[test]
fn a_scenario_cut_or_damaged_anywhere_is_read_or_refused_with_its_place() {
    eprintln!("seed {SEED}");
    let mut rng = ChaCha8Rng::seed_from_u64(SEED + 6);
    for scenario in Scenario::built_in_names() {
        let text = Scenario::built_in_text(scenario).unwrap();
        let (mut read, mut refused) = (0, 0);
        for spoilt in spoilt(text, 3 * text.len(), &mut rng) {
            match Scenario::parse(&spoilt, scenario) {
                Ok(_) => read += 1,
                Err(error) => {
                    let said = error.to_string();
                    let place = said
                        .split_once(&format!("{scenario}:"))
                        .map(|(_, rest)| rest);
                    assert!(
                        place.is_some_and(|rest| rest.starts_with(|c: char| c.is_ascii_digit())),
                        "{said}\n{spoilt}"
                    );
                    refused += 1;
                }
            }
        }
        eprintln!("{scenario}: {read} are scenarios, {refused} are refused with a place");
        assert!(read > 50 && refused > 100);
    }
}
