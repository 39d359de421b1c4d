//! Encoding and decoding of what crosses the network, beside serde_json on the same values.
#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{Criterion, criterion_group, criterion_main};
use serde_json::{from_slice, to_vec};
use skein_proto::codec::{Body, decode, encode};
use skein_proto::envelope::{ENVELOPE_BYTES, Envelope};
use skein_proto::exchange::{Echo, Exchange};
use skein_proto::frame::{Frame, RelativeFrame, RelativeValue};
use skein_proto::growth::Growth;
use skein_proto::measured::{Measured, MeasuredValue};
use skein_proto::name::Name;
use skein_proto::record::{Addressed, PeerEcho, Round, RoundRecord};
use skein_proto::status::Status;
use std::hint::black_box;
use std::time::Duration;

const NOW_NS: i64 = 1_800_000_000_123_456_789;
const POSE: [f64; 6] = [
    0.123_456_789,
    -1.234_567_89,
    0.333_333_333,
    12.345_678_9,
    -2.618_033_988,
    3.041_592_65,
];

fn name(text: &str) -> Name {
    Name::parse(text).unwrap()
}

fn measured() -> Measured {
    let value = MeasuredValue::Pose {
        body_from_neighbour: POSE,
        rotation_sigma_rad: 0.02,
        translation_sigma_m: 0.001,
    };
    Measured {
        taken_offset_us: -12_345,
        value,
    }
}

/// With prior, one pose and an echo: the common one.
fn exchange() -> Exchange {
    Exchange {
        sent_ns: NOW_NS,
        status: Status::Tracking.code(),
        echo: Some(Echo {
            heard_ns: NOW_NS - 1,
            received_ns: NOW_NS - 2,
        }),
        prior: Some(POSE),
        measured: vec![measured()],
    }
}

/// Four neighbours measured in each of four rounds, as far as they fit.
fn record() -> RoundRecord {
    let addressed = |n: u64| Addressed {
        to: n,
        measured: measured(),
    };
    let round = |back, neighbours| Round {
        back,
        segment: 0,
        odometry_from_body: POSE,
        growth: Growth::Isotropic([0.125; 11]),
        measured: (0..neighbours).map(addressed).collect(),
    };
    RoundRecord {
        sent_ns: NOW_NS,
        period_us: 200_000,
        status: Status::Tracking.code(),
        body_from_target: None,
        schedule: None,
        echoes: vec![
            PeerEcho {
                to: 1,
                heard_ns: NOW_NS,
                received_ns: NOW_NS
            };
            4
        ],
        rounds: vec![round(0, 4), round(1, 4)],
        anchor: None,
        fixes: vec![],
    }
}

fn frame() -> Frame {
    let value = RelativeValue::Pose {
        sensor_from_target: POSE,
        rotation_sigma_rad: 0.02,
        translation_sigma_m: 0.001,
    };
    Frame::Relative(RelativeFrame {
        taken_ns: NOW_NS,
        target: name("v2"),
        value,
    })
}

fn envelope() -> Envelope {
    Envelope {
        major: 0,
        minor: 0,
        body_bytes: 0,
        sequence: 1,
        boot: 2,
        sender: name("v1").hash(),
        taken_ns: NOW_NS,
    }
}

fn message<B: Body>(criterion: &mut Criterion, what: &str, body: &B) {
    let packet = encode(envelope(), body).unwrap();
    let json = to_vec(&(envelope(), body)).unwrap();
    eprintln!(
        "{what}: {} bytes with {ENVELOPE_BYTES} of envelope, {} in JSON",
        packet.len(),
        json.len()
    );
    let mut group = criterion.benchmark_group(what);
    group
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_millis(900))
        .sample_size(30);
    group.bench_function("encode", |bencher| {
        bencher.iter(|| encode(envelope(), black_box(body)).unwrap())
    });
    group.bench_function("encode serde_json", |bencher| {
        bencher.iter(|| to_vec(&(envelope(), black_box(body))).unwrap())
    });
    group.bench_function("decode", |bencher| {
        bencher.iter(|| decode::<B>(black_box(&packet)).unwrap())
    });
    group.bench_function("decode serde_json", |bencher| {
        bencher.iter(|| from_slice::<(Envelope, B)>(black_box(&json)).unwrap());
    });
    group.finish();
}

fn packets(criterion: &mut Criterion) {
    message(criterion, "exchange", &exchange());
    message(criterion, "record", &record());
}

/// A frame has both forms; its yardstick is serde_json without the checks.
fn frames(criterion: &mut Criterion) {
    let frame = frame();
    let (binary, json) = (frame.encode(), to_vec(&frame).unwrap());
    eprintln!("frame: {} bytes, {} in JSON", binary.len(), json.len());
    let mut group = criterion.benchmark_group("frame");
    group
        .warm_up_time(Duration::from_millis(300))
        .measurement_time(Duration::from_millis(900))
        .sample_size(30);
    group.bench_function("encode binary", |bencher| {
        bencher.iter(|| black_box(&frame).encode())
    });
    group.bench_function("encode serde_json", |bencher| {
        bencher.iter(|| to_vec(black_box(&frame)).unwrap())
    });
    group.bench_function("decode binary", |bencher| {
        bencher.iter(|| Frame::decode(black_box(&binary)).unwrap())
    });
    group.bench_function("decode JSON", |bencher| {
        bencher.iter(|| Frame::decode(black_box(&json)).unwrap())
    });
    group.bench_function("decode serde_json", |bencher| {
        bencher.iter(|| from_slice::<Frame>(black_box(&json)).unwrap())
    });
    group.finish();
}

criterion_group!(benches, packets, frames);
criterion_main!(benches);
