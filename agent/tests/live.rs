//! Agents over real Zenoh on the loopback address: they find each other, answer, fly, stop, and repeat their logs.
#![allow(clippy::unwrap_used)]

mod team;

use skein_agent::{
    Agent, Clock, DriverSettings, FaultSettings, NetworkSettings, Settings, TimedFrame,
};
use skein_estimation::time::{Span, Stamp};
use skein_estimation::transform::Transform;
use skein_proto::codec;
use skein_proto::document::{ErrorDocument, EstimateDocument};
use skein_proto::estimate::Estimate;
use skein_proto::faults::Faults;
use skein_proto::frame::{Frame, OdometryFrame, RelativeFrame, RelativeValue};
use skein_proto::keys::Key;
use skein_proto::status::Status;
use skein_vehicle::{Start, ToldPose};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};
use team::{name, neighbour, settings_of, started, until};
use zenoh::Wait;

fn settings(fleet: &str, vehicle: &str, clock: Clock, connect: Vec<String>) -> Settings {
    Settings {
        clock,
        ..settings_of(fleet, vehicle, NetworkSettings::loopback(connect))
    }
}

fn observer(connect: Vec<String>) -> zenoh::Session {
    zenoh::open(NetworkSettings::loopback(connect).zenoh().unwrap())
        .wait()
        .unwrap()
}

/// Asks until somebody answers: a query before the declarations have arrived ends without a reply.
fn ask(session: &zenoh::Session, selector: &str) -> Result<Vec<u8>, Vec<u8>> {
    let mut answer = None;
    until(selector, || {
        let replies = session
            .get(selector)
            .timeout(Duration::from_secs(1))
            .wait()
            .unwrap();
        answer = replies
            .into_iter()
            .next()
            .map(|reply| match reply.result() {
                Ok(sample) => Ok(sample.payload().to_bytes().into_owned()),
                Err(error) => Err(error.payload().to_bytes().into_owned()),
            });
        answer.is_some()
    });
    answer.unwrap()
}

#[test]
#[expect(clippy::disallowed_methods, reason = "what is promised is real time")]
fn two_agents_find_each_other_and_a_stop_is_quick_and_seen() {
    let clock = Clock::real();
    let first = started(settings("finding", "v1", clock, vec![]));
    let second = started(settings("finding", "v2", clock, first.locators()));
    let present = |agent: &Agent, of: &str| neighbour(agent, of).present;
    until("v1 and v2 see each other", || {
        present(&first, "v2") && present(&second, "v1")
    });
    until("clocks are known", || {
        let offset_s = neighbour(&first, "v2").clock_offset_s;
        offset_s.is_some_and(|s| s.abs() < 0.05)
    });
    let process = first.latest_health().unwrap().process.clone().unwrap();
    assert!(process.session_open && process.peers == 1, "{process:?}");

    let since = Instant::now();
    second.stop();
    assert!(
        since.elapsed() < Duration::from_secs(1),
        "{:?}",
        since.elapsed()
    );
    until("v1 sees v2 go", || !present(&first, "v2"));
}

#[test]
fn a_query_is_answered_in_json_in_bytes_and_with_a_reason() {
    let agent = started(settings("asking", "v1", Clock::real(), vec![]));
    let session = observer(agent.locators());
    let key = Key::Estimate { of: name("v1") }.in_fleet(name("asking"));

    let json = ask(&session, &key).unwrap();
    let document: EstimateDocument = serde_json::from_slice(&json).unwrap();
    assert_eq!(document.vehicle, name("v1"));

    let packet = ask(&session, &format!("{key}?encoding=postcard")).unwrap();
    let (envelope, _) = codec::decode::<Estimate>(&packet).unwrap();
    assert_eq!(envelope.sender, name("v1").hash());

    let error = ask(&session, &format!("{key}?form=xml")).unwrap_err();
    let error: ErrorDocument = serde_json::from_slice(&error).unwrap();
    assert_eq!(error.code, "unknown_parameter");
    session.close().wait().unwrap();
}

#[test]
fn any_program_can_be_the_driver() {
    let mut settings = settings("driving", "v1", Clock::real(), vec![]);
    settings.drivers = BTreeMap::from([(name("odometry"), DriverSettings::Zenoh)]);
    let clock = settings.clock;
    let agent = started(settings);
    let session = observer(agent.locators());
    let key = Key::Driver {
        of: name("v1"),
        sensor: name("odometry"),
    }
    .in_fleet(name("driving"));
    let mut since = clock.now();
    until("a frame is accepted", || {
        let taken = clock.now();
        let text = format!(
            r#"{{"odometry":{{"since_ns":{},"taken_ns":{},"motion":[0,0,0,0.01,0,0],"rotation_sigma_rad":0.001,"translation_sigma_m":0.001}}}}"#,
            since.as_nanos(),
            taken.as_nanos()
        );
        since = taken;
        session.put(&key, text).wait().unwrap();
        agent
            .latest_health()
            .is_some_and(|health| health.sensors["odometry"].accepted > 0)
    });
    session.close().wait().unwrap();
}

#[test]
fn total_loss_between_vehicles_is_total_and_counted() {
    let clock = Clock::real();
    let mut lossy = settings("losing", "v1", clock, vec![]);
    lossy.faults = Some(FaultSettings { seed: 1 });
    let deaf = started(lossy);
    let observer = observer(deaf.locators());
    let key = "losing/@v1/@sim/faults";
    until("the faults arrive", || {
        // Nobody answers a put: what shows that it arrived is that packets are taken away below.
        observer
            .put(
                key,
                serde_json::to_vec(&Faults {
                    loss: 1.0,
                    ..Faults::default()
                })
                .unwrap(),
            )
            .wait()
            .unwrap();
        observer.info().peers_zid().wait().count() > 0
    });
    let speaking = started(settings("losing", "v2", clock, deaf.locators()));
    until("packets are lost", || {
        deaf.latest_health()
            .and_then(|health| health.process.clone())
            .is_some_and(|process| process.faults_dropped > 5)
    });
    let heard = neighbour(&deaf, "v2").bytes;
    assert_eq!(heard, 0, "liveliness is seen, but no packet is");
    speaking.stop();
    observer.close().wait().unwrap();
}

/// Odometry at 20 Hz along x, and a pose of the other, one metre to the left of `v1`, five times a second.
fn flight(
    start: Stamp,
    seconds: i64,
    other: &str,
    other_is_at_y_m: f64,
) -> (Arc<[TimedFrame]>, Arc<[TimedFrame]>) {
    let ticks = || (1..seconds * 20).map(move |k| start + Span::millis(50) * k);
    let odometry = ticks().map(|taken| TimedFrame {
        arrival: taken,
        frame: Frame::Odometry(OdometryFrame {
            since_ns: (taken - Span::millis(50)).as_nanos(),
            taken_ns: taken.as_nanos(),
            motion: [0.0, 0.0, 0.0, 0.05, 0.0, 0.0],
            rotation_sigma_rad: 0.001,
            translation_sigma_m: 0.002,
        }),
    });
    let poses = ticks().step_by(4).map(|taken| TimedFrame {
        arrival: taken,
        frame: Frame::Relative(RelativeFrame {
            taken_ns: taken.as_nanos(),
            target: name(other),
            value: RelativeValue::Pose {
                sensor_from_target: [0.0, 0.0, 0.0, 0.0, other_is_at_y_m, 0.0],
                rotation_sigma_rad: 0.01,
                translation_sigma_m: 0.01,
            },
        }),
    });
    (odometry.collect(), poses.collect())
}

#[test]
fn two_agents_locate_each_other_and_their_logs_are_repeated_bit_by_bit() {
    let folder = std::env::temp_dir().join(format!("skein-live-{}", std::process::id()));
    let clock = Clock::scaled(Stamp::from_nanos(1_800_000_000_000_000_000), 4.0);
    let fly = |vehicle: &str, other: &str, other_is_at_y_m: f64, connect: Vec<String>| {
        let mut settings = settings("flying", vehicle, clock, connect);
        let (odometry, poses) = flight(clock.start() + Span::secs(4), 120, other, other_is_at_y_m);
        settings.drivers = BTreeMap::from([
            (name("odometry"), DriverSettings::Frames(odometry)),
            (name("tags"), DriverSettings::Frames(poses)),
        ]);
        settings.log = Some(folder.join(format!("{vehicle}.mcap")));
        settings.vehicle.start = Start::Pose(ToldPose::by_hand(Transform::new(
            nalgebra::UnitQuaternion::identity(),
            nalgebra::Vector3::new(0.0, if vehicle == "v1" { 0.0 } else { 1.0 }, 0.0),
        )));
        started(settings)
    };
    let first = fly("v1", "v2", 1.0, vec![]);
    let second = fly("v2", "v1", -1.0, first.locators());
    let tracking = |agent: &Agent| {
        agent
            .latest_estimate()
            .is_some_and(|e| e.document.status == Status::Tracking)
            && agent.latest_health().is_some_and(|h| h.rounds.solved >= 5)
    };
    until("both track", || tracking(&first) && tracking(&second));
    let pose = second.latest_estimate().unwrap().document.pose.unwrap();
    assert!((pose.position_m[1] - 1.0).abs() < 0.05, "{pose:?}");
    first.stop();
    second.stop();
    for vehicle in ["v1", "v2"] {
        let verified =
            skein_agent::verify::verify(&folder.join(format!("{vehicle}.mcap"))).unwrap();
        assert!(verified.ended && verified.inputs > 100, "{verified:?}");
    }
    std::fs::remove_dir_all(folder).unwrap();
}

/// The agent of v2 as a process of its own, which can be killed.
struct Process {
    child: std::process::Child,
    folder: std::path::PathBuf,
}

impl Process {
    fn start(fleet: &str, start: &str, connect: &[String]) -> Self {
        static STARTS: std::sync::atomic::AtomicUsize = std::sync::atomic::AtomicUsize::new(0);
        let nth = STARTS.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
        let folder = std::env::temp_dir().join(format!("skein-live-{}-{nth}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let config = format!(
            "[vehicle]\nfleet = \"{fleet}\"\nname = \"v2\"\n\n[start]\n{start}\n\n\
             [[sensor]]\nname = \"odometry\"\ndriver = \"zenoh\"\n\n\
             [network]\nlisten = [\"tcp/127.0.0.1:0\"]\nconnect = {connect:?}\nmulticast = false\n"
        );
        std::fs::write(folder.join("v2.toml"), config).unwrap();
        let child = std::process::Command::new(env!("CARGO_BIN_EXE_skein"))
            .args(["run", "--config"])
            .arg(folder.join("v2.toml"))
            .stderr(std::process::Stdio::null())
            .spawn()
            .unwrap();
        Self { child, folder }
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        // SIGKILL: no word of farewell.
        let _ = self.child.kill();
        let _ = self.child.wait();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

#[test]
#[expect(clippy::disallowed_methods, reason = "what is promised is real time")]
fn a_killed_vehicle_is_missed_and_comes_back_under_a_new_boot_without_a_prior() {
    const FLEET: &str = "killing";
    const POSE: &str =
        "pose = { position_m = [1.0, 0.0, 0.0], yaw_pitch_roll_deg = [0.0, 0.0, 0.0] }";
    // Given: v1 here and v2 in a process of its own, which know each other; v2 has odometry and tells its prior.
    let clock = Clock::real();
    let first = started(settings(FLEET, "v1", clock, vec![]));
    let world = observer(first.locators());
    let priors = Arc::new(std::sync::Mutex::new(Vec::new()));
    let heard = Arc::clone(&priors);
    world
        .declare_subscriber(skein_proto::keys::select::exchanges_to(
            name(FLEET),
            name("v1"),
        ))
        .callback(move |sample| {
            let packet = sample.payload().to_bytes();
            let (envelope, exchange) =
                codec::decode::<skein_proto::exchange::Exchange>(&packet).unwrap();
            heard.lock().unwrap().push((envelope.boot, exchange.prior));
        })
        .background()
        .wait()
        .unwrap();
    let driving = Arc::new(std::sync::atomic::AtomicBool::new(true));
    let driver = {
        let (world, driving) = (world.clone(), Arc::clone(&driving));
        std::thread::spawn(move || {
            let key = Key::Driver {
                of: name("v2"),
                sensor: name("odometry"),
            }
            .in_fleet(name(FLEET));
            let mut since = clock.now();
            while driving.load(std::sync::atomic::Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(50));
                let taken = clock.now();
                let frame = Frame::Odometry(OdometryFrame {
                    since_ns: since.as_nanos(),
                    taken_ns: taken.as_nanos(),
                    motion: [0.0; 6],
                    rotation_sigma_rad: 0.001,
                    translation_sigma_m: 0.001,
                });
                world.put(&key, frame.encode()).wait().unwrap();
                since = taken;
            }
        })
    };
    let second = Process::start(FLEET, POSE, &first.locators());
    let of_second = || neighbour(&first, "v2");
    until("v1 knows v2 and its clock", || {
        of_second().present && of_second().clock_offset_s.is_some()
    });
    until("v2 tells its prior", || {
        priors
            .lock()
            .unwrap()
            .iter()
            .any(|(_, prior)| prior.is_some())
    });
    let old_boot = of_second().boot.unwrap();

    // When: v2 is killed. Then: v1 reports it.
    drop(second);
    let killed = Instant::now();
    until("v1 misses v2", || !of_second().present);
    assert!(
        killed.elapsed() < Duration::from_secs(4),
        "{:?}",
        killed.elapsed()
    );

    // When: it comes back and does not know where it is.
    priors.lock().unwrap().clear();
    let _again = Process::start(FLEET, "unknown = true", &first.locators());
    let restarted = Instant::now();
    until("v1 knows the new boot of v2", || {
        of_second().present && of_second().boot.is_some_and(|boot| boot != old_boot)
    });
    assert!(
        restarted.elapsed() < Duration::from_secs(2),
        "{:?}",
        restarted.elapsed()
    );
    until("v2 speaks again", || priors.lock().unwrap().len() >= 3);
    let spoken = priors.lock().unwrap().clone();
    assert!(
        spoken.iter().all(|(_, prior)| prior.is_none()),
        "{spoken:?}"
    );
    driving.store(false, std::sync::atomic::Ordering::Relaxed);
    driver.join().unwrap();
}
