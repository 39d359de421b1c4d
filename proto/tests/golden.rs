//! The bytes of every message, pinned: later versions append and change none of them. And what decoding refuses.
#![allow(clippy::unwrap_used)]

use proptest::prelude::*;
use skein_proto::VERSION_MINOR;
use skein_proto::anchor::Anchor;
use skein_proto::backlog::{Backlog, BacklogRound};
use skein_proto::codec::{Body, DecodeError, decode, encode};
use skein_proto::envelope::{ENVELOPE_BYTES, Envelope};
use skein_proto::estimate::{
    Covariance, Estimate, MutualCovariance, MutualEstimate, NeighbourEstimate, RangingCovariance,
    RangingEstimate, Velocity,
};
use skein_proto::exchange::{Echo, Exchange};
use skein_proto::features::{Feature, FeatureSet, Integrals, Track, TrackNumber};
use skein_proto::fixed::Fixed;
use skein_proto::frame::{
    BearingsFrame, FixFrame, FixValue, Frame, ImuFrame, OdometryFrame, RangesFrame, RelativeFrame,
    RelativeValue, TargetRange,
};
use skein_proto::growth::Growth;
use skein_proto::limits::{FIXES_PER_RECORD_MAX, RELAYED_PER_PACKET_MAX};
use skein_proto::measured::{Measured, MeasuredValue};
use skein_proto::name::Name;
use skein_proto::record::{Addressed, PeerEcho, Round, RoundFix, RoundRecord, Schedule};
use skein_proto::relay::{Relay, RelayedRound};
use skein_proto::status::Status;

/// As version 1.0 said them.
const GOLDEN_1_0: &str = include_str!("golden/messages.hex");
/// Packets as version 1.1 said them; frames have no minor version.
const GOLDEN_1_1: &str = include_str!("golden/messages-1-1.hex");
/// Packets as version 1.2 says them.
const GOLDEN_1_2: &str = include_str!("golden/messages-1-2.hex");

fn envelope() -> Envelope {
    Envelope {
        major: 0,
        minor: 0,
        body_bytes: 0,
        sequence: 7,
        boot: 0x0102_0304_0506_0708,
        sender: Name::parse("v1").unwrap().hash(),
        taken_ns: 1_800_000_000_200_000_000,
    }
}

const POSE: [f64; 6] = [0.1, -0.2, 0.3, 1.0, 2.0, -3.0];

fn measured(value: MeasuredValue) -> Measured {
    Measured {
        taken_offset_us: -40_000,
        value,
    }
}

fn measured_pose() -> Measured {
    measured(MeasuredValue::Pose {
        body_from_neighbour: POSE,
        rotation_sigma_rad: 0.02,
        translation_sigma_m: 0.001,
    })
}

fn exchange_with_one_pose() -> Exchange {
    Exchange {
        sent_ns: 1_800_000_000_201_000_000,
        status: Status::Tracking.code(),
        echo: Some(Echo {
            heard_ns: 1_800_000_000_001_000_000,
            received_ns: 1_800_000_000_002_000_000,
        }),
        prior: Some(POSE),
        measured: vec![measured_pose()],
    }
}

fn exchange_of_a_restarted_vehicle() -> Exchange {
    Exchange {
        sent_ns: 5,
        status: Status::Resuming.code(),
        echo: None,
        prior: None,
        measured: vec![],
    }
}

fn exchange_with_three_kinds() -> Exchange {
    Exchange {
        measured: vec![
            measured(MeasuredValue::Orientation {
                rotation_vector_rad: [0.1, -0.2, 0.3],
                sigma_rad: 0.02,
            }),
            measured(MeasuredValue::Bearing {
                direction: [0.6, 0.8, 0.0],
                origin_m: [0.3, 0.0, 0.1],
                sigma_rad: 0.02,
            }),
            measured(MeasuredValue::Distance {
                distance_m: 4.5,
                origin_m: [0.3, 0.0, 0.1],
                sigma_m: 0.05,
            }),
        ],
        ..exchange_with_one_pose()
    }
}

fn record() -> RoundRecord {
    let upper: [f64; 21] = std::array::from_fn(|i| i as f64 * 0.25);
    let compact: [f64; 11] = std::array::from_fn(|i| i as f64 * 0.5);
    let position = measured(MeasuredValue::Position {
        position_m: [1.0, 2.0, 3.0],
        sigma_m: 0.001,
    });
    let round = |back, growth, measured| Round {
        back,
        segment: 1,
        odometry_from_body: POSE,
        growth,
        measured,
    };
    RoundRecord {
        sent_ns: 1_800_000_000_201_000_000,
        period_us: 200_000,
        status: Status::DeadReckoning.code(),
        body_from_target: Some([0.0, 0.0, 0.0, 0.1, 0.0, 0.2]),
        schedule: Some(Schedule {
            round: 9,
            phase: 2,
            state: 1,
            draw: 0xdead_beef,
            moves: 3,
        }),
        echoes: vec![PeerEcho {
            to: Name::parse("v2").unwrap().hash(),
            heard_ns: 11,
            received_ns: 12,
        }],
        rounds: vec![
            round(
                0,
                Growth::Isotropic(compact),
                vec![Addressed {
                    to: Name::parse("v2").unwrap().hash(),
                    measured: position,
                }],
            ),
            round(1, Growth::Full(upper), vec![]),
            round(2, Growth::Unknown, vec![]),
        ],
        anchor: None,
        fixes: vec![],
    }
}

fn record_with_absolute_information() -> RoundRecord {
    let growth = Growth::Isotropic(std::array::from_fn(|i| i as f64 * 0.125));
    let fix = |back, fix| RoundFix { back, fix };
    RoundRecord {
        anchor: Some(Anchor {
            taken_ns: 1_799_999_999_900_000_000,
            segment: 1,
            odometry_from_body: [0.0, 0.0, 0.1, 0.5, 0.0, 0.0],
            growth,
            world_from_body: POSE,
            rotation_sigma_rad: 0.01,
            translation_sigma_m: 0.02,
        }),
        fixes: vec![
            fix(
                0,
                Fixed::Pose {
                    world_from_body: POSE,
                    rotation_sigma_rad: 0.02,
                    translation_sigma_m: 1.5,
                },
            ),
            fix(
                0,
                Fixed::Position {
                    position_m: [5.0, 6.0, 1.0],
                    point_m: [0.3, 0.0, 0.1],
                    sigma_m: 0.5,
                },
            ),
            fix(
                2,
                Fixed::Orientation {
                    rotation_vector_rad: [0.0, 0.0, 1.0],
                    sigma_rad: 0.1,
                },
            ),
        ],
        ..record()
    }
}

fn backlog() -> Backlog {
    let RoundRecord { rounds, fixes, .. } = record_with_absolute_information();
    let entry = |taken_ns, round: &Round, fixes| BacklogRound {
        taken_ns,
        round: Round {
            back: 0,
            ..round.clone()
        },
        fixes,
    };
    Backlog {
        remaining: 300,
        rounds: vec![
            entry(1_799_999_999_800_000_000, &rounds[2], vec![]),
            entry(
                1_800_000_000_200_000_000,
                &rounds[0],
                vec![fixes[0].fix, fixes[1].fix],
            ),
        ],
    }
}

fn relay() -> Relay {
    let BacklogRound {
        taken_ns,
        round,
        fixes,
    } = backlog().rounds.remove(1);
    let RoundRecord { anchor, .. } = record_with_absolute_information();
    let whole = RelayedRound {
        of: Name::parse("v3").unwrap(),
        boot: 0x1112_1314_1516_1718,
        taken_ns,
        clock_offset_ns: -1_500_000_000,
        clock_error_ns: 700_000,
        period_us: 200_000,
        status: Status::Tracking.code(),
        body_from_target: Some([0.0, 0.0, 0.0, 0.1, 0.0, 0.2]),
        round,
        fixes,
        anchor,
    };
    let bare = RelayedRound {
        of: Name::parse("v4").unwrap(),
        body_from_target: None,
        round: Round {
            measured: vec![],
            ..whole.round.clone()
        },
        fixes: vec![],
        anchor: None,
        ..whole.clone()
    };
    Relay {
        sent_ns: 1_800_000_000_201_000_000,
        rounds: vec![whole, bare],
    }
}

fn estimate() -> Estimate {
    let covariance = Some(Covariance::BodyTwistRotationFirst(std::array::from_fn(
        |i| i as f64,
    )));
    Estimate {
        status: Status::Tracking.code(),
        world_from_body: Some(POSE),
        velocity: Some(Velocity {
            linear_world_m_s: [1.0, 0.0, 0.0],
            angular_body_rad_s: [0.0, 0.0, 0.1],
        }),
        covariance,
        neighbours: vec![NeighbourEstimate {
            vehicle: Name::parse("v2").unwrap().hash(),
            status: Status::Alone.code(),
            taken_offset_us: -100_000,
            body_from_neighbour: Some(POSE),
            covariance,
        }],
        mutual: vec![],
        ranging: vec![],
        permit: 0,
    }
}

fn estimate_by_bearings() -> Estimate {
    let numbers = std::array::from_fn(|n| n as f64 * 0.125);
    let neighbour = MutualEstimate {
        vehicle: Name::parse("v2").unwrap().hash(),
        modes: 1,
        taken_offset_us: -30_000,
        identity_probability: 0.875,
        reduced: Some([1.0, 2.0, 3.0, 0.1, 0.2, 0.3, -3.0]),
        covariance: Some(MutualCovariance::PositionVelocityYaw(numbers, numbers)),
    };
    let unknown = MutualEstimate {
        vehicle: Name::parse("v3").unwrap().hash(),
        modes: 0,
        taken_offset_us: 0,
        identity_probability: 0.0,
        reduced: None,
        covariance: None,
    };
    let ranged = RangingEstimate {
        vehicle: Name::parse("v2").unwrap().hash(),
        modes: 1,
        taken_offset_us: -20_000,
        reduced: Some([1.0, 2.0, 3.0, -3.0]),
        covariance: Some(RangingCovariance::PositionYaw(std::array::from_fn(|n| {
            n as f64 * 0.25
        }))),
    };
    Estimate {
        mutual: vec![neighbour, unknown],
        ranging: vec![ranged],
        permit: 2,
        ..estimate()
    }
}

fn feature_set() -> FeatureSet {
    FeatureSet {
        sent_ns: 1_800_000_000_201_000_000,
        roll_rad: 0.1,
        pitch_rad: -0.2,
        yaw_rate_rad_s: 0.3,
        acceleration_m_s2: [0.1, 0.2, 9.8],
        integrals: Integrals {
            elapsed_s: 12.5,
            yaw_rad: -7.0,
            velocity_m_s: [0.1, 0.2, 0.3],
            position_m: [1.0, 2.0, 3.0],
        },
        features: vec![
            Feature {
                azimuth_rad: 3.0,
                zenith_rad: 1.5,
                sigma_rad: 0.0625,
                track: Some(TrackNumber(258)),
            },
            Feature {
                azimuth_rad: -3.0,
                zenith_rad: 0.5,
                sigma_rad: 0.0625,
                track: None,
            },
        ],
        tracks: vec![Track {
            number: TrackNumber(258),
            azimuth_rad: -1.0,
            zenith_rad: 1.5,
            variance_rad2: 0.0009765625,
            confirmed: 1,
        }],
    }
}

fn frames() -> Vec<(&'static str, Frame)> {
    let target = Name::parse("v2").unwrap();
    let taken_ns = 1_800_000_000_000_000_000;
    let relative = |value| {
        Frame::Relative(RelativeFrame {
            taken_ns,
            target,
            value,
        })
    };
    let fix = |value| Frame::Fix(FixFrame { taken_ns, value });
    vec![
        (
            "frame odometry",
            Frame::Odometry(OdometryFrame {
                since_ns: taken_ns - 20_000_000,
                taken_ns,
                motion: POSE,
                rotation_sigma_rad: 0.002,
                translation_sigma_m: 0.01,
            }),
        ),
        (
            "frame pose",
            relative(RelativeValue::Pose {
                sensor_from_target: POSE,
                rotation_sigma_rad: 0.02,
                translation_sigma_m: 0.001,
            }),
        ),
        (
            "frame orientation",
            relative(RelativeValue::Orientation {
                rotation_vector_rad: [0.1, 0.2, 0.3],
                sigma_rad: 0.02,
            }),
        ),
        (
            "frame position",
            relative(RelativeValue::Position {
                position_m: [1.0, 2.0, 3.0],
                sigma_m: 0.1,
            }),
        ),
        (
            "frame bearing",
            relative(RelativeValue::Bearing {
                direction: [0.6, 0.8, 0.0],
                sigma_rad: 0.02,
            }),
        ),
        (
            "frame distance",
            relative(RelativeValue::Distance {
                distance_m: 4.5,
                sigma_m: 0.1,
            }),
        ),
        (
            "frame fix pose",
            fix(FixValue::Pose {
                world_from_sensor: POSE,
                rotation_sigma_rad: 0.02,
                translation_sigma_m: 1.0,
            }),
        ),
        (
            "frame fix position",
            fix(FixValue::Position {
                position_m: [1.0, 2.0, 3.0],
                sigma_m: 1.5,
            }),
        ),
        (
            "frame fix orientation",
            fix(FixValue::Orientation {
                rotation_vector_rad: [0.0, 0.0, 1.0],
                sigma_rad: 0.1,
            }),
        ),
        (
            "frame fix landmark",
            fix(FixValue::Landmark {
                landmark_m: [5.0, 6.0, 1.0],
                position_m: [1.0, 2.0, 3.0],
                sigma_m: 0.1,
            }),
        ),
        (
            "frame ranges",
            Frame::Ranges(RangesFrame {
                taken_ns,
                ranges: vec![TargetRange {
                    target,
                    distance_m: 4.5,
                    sigma_m: 0.1,
                }],
            }),
        ),
        (
            "frame bearings",
            Frame::Bearings(BearingsFrame {
                taken_ns,
                sigma_rad: 0.05,
                directions: vec![[0.6, 0.8, 0.0]],
            }),
        ),
        (
            "frame imu",
            Frame::Imu(ImuFrame {
                taken_ns,
                angular_rate_rad_s: [0.0, 0.0, 0.1],
                specific_force_m_s2: [0.0, 0.0, 9.81],
                rate_sigma_rad_s: 0.01,
                force_sigma_m_s2: 0.1,
            }),
        ),
    ]
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn unhex(text: &str) -> Vec<u8> {
    (0..text.len())
        .step_by(2)
        .map(|at| u8::from_str_radix(&text[at..at + 2], 16).unwrap())
        .collect()
}

/// The bytes of a line of golden text.
fn bytes_of(golden: &str, wanted: &str) -> Vec<u8> {
    let line = golden
        .lines()
        .find(|line| line.split(": ").next() == Some(wanted))
        .unwrap();
    unhex(line.split(": ").nth(1).unwrap())
}

fn packets() -> Vec<(&'static str, Vec<u8>)> {
    vec![
        (
            "exchange with one pose",
            encode(envelope(), &exchange_with_one_pose()).unwrap(),
        ),
        (
            "exchange of a restarted vehicle",
            encode(envelope(), &exchange_of_a_restarted_vehicle()).unwrap(),
        ),
        (
            "exchange with three kinds",
            encode(envelope(), &exchange_with_three_kinds()).unwrap(),
        ),
        ("round record", encode(envelope(), &record()).unwrap()),
        ("estimate", encode(envelope(), &estimate()).unwrap()),
        (
            "round record with absolute information",
            encode(envelope(), &record_with_absolute_information()).unwrap(),
        ),
        ("backlog", encode(envelope(), &backlog()).unwrap()),
        ("feature set", encode(envelope(), &feature_set()).unwrap()),
        (
            "estimate by bearings",
            encode(envelope(), &estimate_by_bearings()).unwrap(),
        ),
        ("relay", encode(envelope(), &relay()).unwrap()),
    ]
}

#[test]
fn no_golden_byte_has_changed() {
    let text = |messages: Vec<(&str, Vec<u8>)>| -> String {
        messages
            .iter()
            .map(|(name, bytes)| format!("{name}: {}\n", hex(bytes)))
            .collect()
    };
    const CHANGED: &str = "the wire format changed; what is pinned may only be appended to";
    assert_eq!(text(packets()), GOLDEN_1_2, "{CHANGED}");
    let frames = frames().into_iter();
    let frames = text(frames.map(|(name, frame)| (name, frame.encode())).collect());
    assert!(GOLDEN_1_0.ends_with(&frames), "{CHANGED}");
}

#[test]
fn a_packet_of_the_version_before_differs_by_what_was_appended_only() {
    let since_1_0 = [
        ("exchange with one pose", 0),
        ("exchange of a restarted vehicle", 0),
        ("exchange with three kinds", 0),
        ("round record", 2),
        ("estimate", 0),
    ];
    let since_1_1 = [
        ("exchange with one pose", 0),
        ("round record", 0),
        ("round record with absolute information", 0),
        ("backlog", 0),
        ("estimate", 3),
    ];
    let versions = [
        (GOLDEN_1_0, 1, GOLDEN_1_1, &since_1_0),
        (GOLDEN_1_1, 2, GOLDEN_1_2, &since_1_1),
    ];
    for (older, minor, newer, messages) in versions {
        for (name, appended) in messages {
            let mut before = bytes_of(older, name);
            before[1] = minor;
            before.extend(vec![0; *appended]);
            let body_bytes = u16::try_from(before.len() - ENVELOPE_BYTES).unwrap();
            before[2..4].copy_from_slice(&body_bytes.to_le_bytes());
            assert_eq!(hex(&before), hex(&bytes_of(newer, name)), "{name}");
        }
    }
}

#[test]
fn a_record_of_the_version_before_has_all_its_own_fields_and_nothing_behind_them() {
    let before = bytes_of(GOLDEN_1_0, "round record");
    let with_body = |body: &[u8]| {
        let mut packet = [&before[..ENVELOPE_BYTES], body].concat();
        let body_bytes = u16::try_from(body.len()).unwrap();
        packet[2..4].copy_from_slice(&body_bytes.to_le_bytes());
        decode::<RoundRecord>(&packet).map(|(_, record)| record)
    };
    let body = &before[ENVELOPE_BYTES..];
    assert_eq!(with_body(body), Ok(record()));
    // The last byte is a list without entries, which a zero of the absent fields could be taken for.
    for cut in 1..=4 {
        let cut = with_body(&body[..body.len() - cut]);
        assert_eq!(cut, Err(DecodeError::Malformed));
    }
    let trailing = |bytes| Err(DecodeError::Trailing { bytes });
    assert_eq!(with_body(&[body, &[0]].concat()), trailing(1));
    assert_eq!(with_body(&[body, &[0, 0]].concat()), trailing(2));
}

#[test]
fn golden_bytes_decode_to_what_was_encoded() {
    for golden in [GOLDEN_1_0, GOLDEN_1_1, GOLDEN_1_2] {
        let bytes_of = |wanted| bytes_of(golden, wanted);
        let (head, exchange) = decode::<Exchange>(&bytes_of("exchange with one pose")).unwrap();
        assert_eq!(
            (head.sequence, head.boot, head.taken_ns),
            (7, envelope().boot, envelope().taken_ns)
        );
        assert_eq!(exchange, exchange_with_one_pose());
        assert_eq!(
            decode::<Exchange>(&bytes_of("exchange with three kinds"))
                .unwrap()
                .1,
            exchange_with_three_kinds()
        );
        assert_eq!(
            decode::<RoundRecord>(&bytes_of("round record")).unwrap().1,
            record()
        );
        assert_eq!(
            decode::<Estimate>(&bytes_of("estimate")).unwrap().1,
            estimate()
        );
    }
    for golden in [GOLDEN_1_1, GOLDEN_1_2] {
        let absolute = bytes_of(golden, "round record with absolute information");
        assert_eq!(
            decode::<RoundRecord>(&absolute).unwrap().1,
            record_with_absolute_information()
        );
        assert_eq!(
            decode::<Backlog>(&bytes_of(golden, "backlog")).unwrap().1,
            backlog()
        );
    }
    assert_eq!(
        decode::<FeatureSet>(&bytes_of(GOLDEN_1_2, "feature set"))
            .unwrap()
            .1,
        feature_set()
    );
    assert_eq!(
        decode::<Estimate>(&bytes_of(GOLDEN_1_2, "estimate by bearings"))
            .unwrap()
            .1,
        estimate_by_bearings()
    );
    for (name, frame) in frames() {
        assert_eq!(Frame::decode(&bytes_of(GOLDEN_1_0, name)).unwrap(), frame);
    }
}

#[test]
fn a_fix_belongs_to_a_round_of_its_record_and_their_number_is_bounded() {
    let wrong = |change: fn(&mut RoundRecord)| {
        let mut record = record_with_absolute_information();
        change(&mut record);
        encode(envelope(), &record).map_err(|error| error.0)
    };
    let out_of_range = |field| Err(DecodeError::OutOfRange { field });
    assert_eq!(
        wrong(|record| record.fixes[2].back = 3),
        out_of_range("fixes: back")
    );
    let many = wrong(|record| record.fixes = vec![record.fixes[2]; FIXES_PER_RECORD_MAX + 1]);
    assert_eq!(
        many,
        Err(DecodeError::TooMany {
            field: "fixes",
            count: 9,
            max: 8
        })
    );
    let certain = wrong(|record| record.anchor.as_mut().unwrap().rotation_sigma_rad = 0.0);
    assert_eq!(certain, out_of_range("anchor: rotation sigma"));
    let nowhere = wrong(|record| {
        record.fixes[1].fix = Fixed::Position {
            position_m: [f64::NAN; 3],
            point_m: [0.0; 3],
            sigma_m: 1.0,
        };
    });
    let field = "fixed position";
    assert_eq!(nowhere, Err(DecodeError::NotFinite { field }));
}

#[test]
fn a_backlog_is_in_order_and_bounded() {
    let wrong = |change: fn(&mut Backlog)| {
        let mut backlog = backlog();
        change(&mut backlog);
        encode(envelope(), &backlog).map_err(|error| error.0)
    };
    let out_of_range = |field| Err(DecodeError::OutOfRange { field });
    let turned = wrong(|backlog| backlog.rounds.reverse());
    assert_eq!(turned, out_of_range("rounds: taken_ns"));
    let twice = wrong(|backlog| backlog.rounds[1] = backlog.rounds[0].clone());
    assert_eq!(twice, out_of_range("rounds: taken_ns"));
    let back = wrong(|backlog| backlog.rounds[0].round.back = 1);
    assert_eq!(back, out_of_range("rounds: back"));
    let rounds = |count| {
        let first = &backlog().rounds[0];
        let nth = |nth| BacklogRound {
            taken_ns: nth,
            ..first.clone()
        };
        let backlog = Backlog {
            remaining: 0,
            rounds: (0..count).map(nth).collect(),
        };
        encode(envelope(), &backlog).map_err(|error| error.0)
    };
    assert!(rounds(100).is_ok());
    let (field, count, max) = ("rounds", 101, 100);
    assert_eq!(rounds(101), Err(DecodeError::TooMany { field, count, max }));
}

#[test]
fn a_relay_is_bounded_and_holds_whole_rounds_only() {
    let wrong = |change: fn(&mut Relay)| {
        let mut relay = relay();
        change(&mut relay);
        encode(envelope(), &relay).map_err(|error| error.0)
    };
    let out_of_range = |field| Err(DecodeError::OutOfRange { field });
    let back = wrong(|relay| relay.rounds[0].round.back = 1);
    assert_eq!(back, out_of_range("rounds: back"));
    let negative = wrong(|relay| relay.rounds[0].clock_error_ns = -1);
    assert_eq!(negative, out_of_range("clock_error_ns"));
    let bare = relay().rounds.remove(1);
    let with = |count| Relay {
        sent_ns: 1,
        rounds: vec![bare.clone(); count],
    };
    let too_many = encode(envelope(), &with(RELAYED_PER_PACKET_MAX + 1)).map_err(|error| error.0);
    assert_eq!(
        too_many,
        Err(DecodeError::TooMany {
            field: "rounds",
            count: RELAYED_PER_PACKET_MAX + 1,
            max: RELAYED_PER_PACKET_MAX
        })
    );
    // So many are short enough for a datagram only if they are few.
    assert!(encode(envelope(), &with(4)).is_ok());
    let too_long = encode(envelope(), &with(RELAYED_PER_PACKET_MAX)).map_err(|error| error.0);
    assert!(matches!(too_long, Err(DecodeError::TooLong { .. })));
}

#[test]
fn an_exchange_with_prior_one_pose_and_echo_takes_at_most_176_bytes() {
    assert_eq!(
        encode(envelope(), &exchange_with_one_pose()).unwrap().len(),
        169
    );
}

#[test]
fn another_major_version_is_refused_before_its_body_is_read() {
    let mut packet = encode(envelope(), &exchange_with_one_pose()).unwrap();
    packet[0] = 2;
    packet[40] = 0xff;
    assert_eq!(
        decode::<Exchange>(&packet),
        Err(DecodeError::Version {
            major: 2,
            minor: VERSION_MINOR
        })
    );
}

#[test]
fn bytes_behind_a_known_body_are_accepted_from_a_newer_minor_version_only() {
    let mut packet = encode(envelope(), &exchange_with_one_pose()).unwrap();
    packet.push(42);
    assert_eq!(
        decode::<Exchange>(&packet),
        Err(DecodeError::Trailing { bytes: 1 }),
        "behind the announced body"
    );
    packet[2] += 1;
    assert_eq!(
        decode::<Exchange>(&packet),
        Err(DecodeError::Trailing { bytes: 1 }),
        "inside the body, same version"
    );
    packet[1] = VERSION_MINOR + 1;
    assert_eq!(
        decode::<Exchange>(&packet).unwrap().1,
        exchange_with_one_pose()
    );
}

#[test]
fn numbers_that_are_not_finite_are_refused_by_field() {
    let wrong = Exchange {
        prior: Some([f64::NAN; 6]),
        ..exchange_with_one_pose()
    };
    assert!(
        encode(envelope(), &wrong).is_err(),
        "we do not send them either"
    );
    let mut packet = encode(envelope(), &exchange_with_one_pose()).unwrap();
    let prior_at = ENVELOPE_BYTES + 8 + 1 + 17 + 1;
    packet[prior_at..prior_at + 8].copy_from_slice(&f64::INFINITY.to_le_bytes());
    assert_eq!(
        decode::<Exchange>(&packet),
        Err(DecodeError::NotFinite { field: "prior" })
    );
}

#[test]
fn lists_hold_their_bound_and_no_more() {
    let with = |n| Exchange {
        measured: vec![measured_pose(); n],
        ..exchange_with_one_pose()
    };
    assert!(encode(envelope(), &with(3)).is_ok());
    assert!(encode(envelope(), &with(4)).is_err());
}

#[test]
fn a_packet_longer_than_any_of_its_kind_is_not_read() {
    let max = ENVELOPE_BYTES + Exchange::BYTES_MAX;
    assert!(
        matches!(decode::<Exchange>(&vec![1; max]), Err(e) if !matches!(e, DecodeError::TooLong { .. }))
    );
    assert_eq!(
        decode::<Exchange>(&vec![1; max + 1]),
        Err(DecodeError::TooLong {
            bytes: max + 1,
            max
        })
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(2000))]

    #[test]
    fn no_mutation_of_a_packet_makes_decoding_panic(
        which in 0..10usize,
        flips in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..8),
        cut in any::<prop::sample::Index>(),
        shorten in any::<bool>(),
    ) {
        let mut packet = packets()[which].1.clone();
        for (at, byte) in flips {
            let at = at.index(packet.len());
            packet[at] = byte;
        }
        if shorten {
            packet.truncate(cut.index(packet.len()));
        }
        let _ = (decode::<Exchange>(&packet), decode::<RoundRecord>(&packet), decode::<Backlog>(&packet), decode::<Estimate>(&packet), decode::<FeatureSet>(&packet), decode::<Relay>(&packet), Frame::decode(&packet));
        if let Ok((_, exchange)) = decode::<Exchange>(&packet) {
            prop_assert!(exchange.prior.iter().flatten().all(|n| n.is_finite()));
        }
    }

    #[test]
    fn no_bytes_make_decoding_panic(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        let _ = (decode::<Exchange>(&bytes), decode::<RoundRecord>(&bytes), decode::<Backlog>(&bytes), decode::<Estimate>(&bytes), decode::<FeatureSet>(&bytes), decode::<Relay>(&bytes), Frame::decode(&bytes));
    }
}
