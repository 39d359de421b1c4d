//! From a driver's frame to the estimate that it moves, live: an agent on the loopback address is given odometry over
//! Zenoh and its estimate is received by a subscriber. Beside it, in the same run, what Zenoh itself takes: one bare put
//! of the same size, and one there and an estimate's size back.
#![allow(missing_docs, clippy::unwrap_used)]

use criterion::{Criterion, criterion_group, criterion_main};
use skein_agent::{Agent, Clock, DriverSettings, NetworkSettings, Settings, new_boot};
use skein_estimation::Transform;
use skein_estimation::cooperative::{Mode, Optimiser};
use skein_estimation::time::{Span, Stamp};
use skein_proto::document::EstimateDocument;
use skein_proto::frame::{Frame, OdometryFrame};
use skein_proto::keys::Key;
use skein_proto::name::Name;
use skein_vehicle::{Config, MutualConfig, RangingConfig, SensorConfig, Start, ToldPose};
use std::sync::mpsc::{Receiver, channel};
use std::time::Duration;
use zenoh::qos::CongestionControl;
use zenoh::{Session, Wait};

const PATIENCE: Duration = Duration::from_secs(10);

fn name(text: &str) -> Name {
    Name::parse(text).unwrap()
}

fn agent(clock: Clock) -> Agent {
    let vehicle = Config {
        vehicle: name("v1"),
        boot: new_boot(),
        period: Span::millis(200),
        round_wait: Span::millis(300),
        start: Start::Pose(ToldPose::by_hand(Transform::identity())),
        mode: Mode::default(),
        optimiser: Optimiser::default(),
        mutual: MutualConfig::DEFAULT,
        ranging: RangingConfig::DEFAULT,
        sensors: vec![SensorConfig {
            name: name("odometry"),
            driver: "zenoh".to_owned(),
            body_from_sensor: Transform::identity(),
        }],
        body_from_target: Transform::identity(),
        presence_timeout: Span::secs(3),
        repeats: 3,
        relay: false,
        estimate_spacing: Span::ZERO,
    };
    let settings = Settings {
        fleet: name("latency"),
        vehicle,
        drivers: [(name("odometry"), DriverSettings::Zenoh)].into(),
        network: NetworkSettings::loopback(vec![]),
        clock,
        log: None,
        checkpoint: None,
        rpc: false,
        faults: None,
    };
    let agent = Agent::start(settings).unwrap();
    assert!(agent.wait_open(PATIENCE), "no session");
    agent
}

fn session(connect: Vec<String>) -> Session {
    zenoh::open(NetworkSettings::loopback(connect).zenoh().unwrap())
        .wait()
        .unwrap()
}

fn locators(session: &Session) -> Vec<String> {
    session
        .info()
        .locators()
        .wait()
        .iter()
        .map(ToString::to_string)
        .collect()
}

/// What arrives under a key, by the callback that an agent uses too.
fn hear(session: &Session, key: &str) -> Receiver<Vec<u8>> {
    let (sender, receiver) = channel();
    let callback = move |sample: zenoh::sample::Sample| {
        // Nobody listens any more when the benchmark is over.
        let _ = sender.send(sample.payload().to_bytes().into_owned());
    };
    session
        .declare_subscriber(key.to_owned())
        .callback(callback)
        .background()
        .wait()
        .unwrap();
    receiver
}

fn put(session: &Session, key: &str, bytes: Vec<u8>) {
    session
        .put(key, bytes)
        .congestion_control(CongestionControl::Drop)
        .express(true)
        .wait()
        .unwrap();
}

fn frame_to_estimate(criterion: &mut Criterion) {
    let clock = Clock::real();
    let agent = agent(clock);
    let client = session(agent.locators());
    let driver_key = Key::Driver {
        of: name("v1"),
        sensor: name("odometry"),
    }
    .in_fleet(name("latency"));
    let estimates = hear(
        &client,
        &Key::Estimate { of: name("v1") }.in_fleet(name("latency")),
    );

    let mut since = clock.now();
    let mut next_frame = |taken: Stamp| {
        let frame = OdometryFrame {
            since_ns: since.as_nanos(),
            taken_ns: taken.as_nanos(),
            motion: [0.0, 0.0, 1e-4, 1e-4, 0.0, 0.0],
            rotation_sigma_rad: 1e-3,
            translation_sigma_m: 1e-3,
        };
        since = taken;
        Frame::Odometry(frame).encode()
    };
    let frame_bytes = next_frame(clock.now()).len();
    // The estimate of this very frame, as its bytes.
    let mut round_trip = |patience: Duration| {
        let taken = clock.now();
        put(&client, &driver_key, next_frame(taken));
        while let Ok(bytes) = estimates.recv_timeout(patience) {
            let document: EstimateDocument = serde_json::from_slice(&bytes).unwrap();
            if document.taken_ns == taken.as_nanos() {
                return Some(bytes);
            }
        }
        None
    };
    // Until the declarations have met, frames reach nobody.
    let estimate = (0..100)
        .find_map(|_| round_trip(Duration::from_millis(100)))
        .unwrap();
    eprintln!(
        "a frame of {frame_bytes} bytes, an estimate of {} bytes",
        estimate.len()
    );

    let mut group = criterion.benchmark_group("latency");
    group
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(3))
        .sample_size(50);
    group.bench_function("frame to estimate", |bencher| {
        bencher.iter(|| round_trip(PATIENCE).unwrap())
    });

    let (here, there) = {
        let there = session(vec![]);
        (session(locators(&there)), there)
    };
    let heard_there = hear(&there, "raw/there");
    let heard_here = hear(&here, "raw/back");
    let meet = |from: &Session, key: &str, heard: &Receiver<Vec<u8>>| {
        (0..100).find_map(|_| {
            put(from, key, vec![0]);
            heard.recv_timeout(Duration::from_millis(100)).ok()
        })
    };
    meet(&here, "raw/there", &heard_there).unwrap();
    meet(&there, "raw/back", &heard_here).unwrap();
    while heard_there.try_recv().is_ok() || heard_here.try_recv().is_ok() {}
    group.bench_function("raw put", |bencher| {
        bencher.iter(|| {
            put(&here, "raw/there", vec![1; frame_bytes]);
            heard_there.recv_timeout(PATIENCE).unwrap()
        });
    });
    let (answering, answer_bytes) = (there.clone(), estimate.len());
    let answer = move |_: zenoh::sample::Sample| put(&answering, "raw/back", vec![2; answer_bytes]);
    there
        .declare_subscriber("raw/ask")
        .callback(answer)
        .background()
        .wait()
        .unwrap();
    meet(&here, "raw/ask", &heard_here).unwrap();
    while heard_here.recv_timeout(Duration::from_millis(200)).is_ok() {}
    group.bench_function("raw put there and back", |bencher| {
        bencher.iter(|| {
            put(&here, "raw/ask", vec![3; frame_bytes]);
            heard_here.recv_timeout(PATIENCE).unwrap()
        });
    });
    group.finish();
    agent.stop();
}

criterion_group!(benches, frame_to_estimate);
criterion_main!(benches);
