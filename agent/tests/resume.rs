//! A vehicle that dies without a word, resumes from its checkpoint and is placed by its neighbours, as real processes over
//! real Zenoh; and an operator who tells a vehicle where it is.
#![allow(clippy::unwrap_used)]

mod team;

use skein_agent::{Agent, Clock, NetworkSettings};
use skein_proto::codec;
use skein_proto::document::{ErrorDocument, EstimateDocument};
use skein_proto::exchange::Exchange;
use skein_proto::frame::Frame;
use skein_proto::keys::{Key, boot_text, select};
use skein_proto::name::Name;
use skein_proto::status::Status;
use skein_vehicle::Start;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex};
use std::time::Duration;
use team::{Flight, Since, name, neighbour, nth_name, settings, started, status, until, within};
use zenoh::Wait;

const TEAM: usize = 3;
/// The vehicle that is killed, in a process of its own.
const THIRD: usize = 2;

fn observer(connect: Vec<String>) -> zenoh::Session {
    zenoh::open(NetworkSettings::loopback(connect).zenoh().unwrap())
        .wait()
        .unwrap()
}

/// v3 as its user runs it.
struct Process(Child);

impl Process {
    fn start(config: &Path) -> Self {
        let child = Command::new(env!("CARGO_BIN_EXE_skein"))
            .args(["run", "--config"])
            .arg(config)
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Self(child)
    }

    /// SIGKILL, and waits until there is nothing left of it.
    fn kill(mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn configuration(fleet: &str, folder: &Path, connect: &[String]) -> PathBuf {
    let sensor = |name| format!("[[sensor]]\nname = \"{name}\"\ndriver = \"zenoh\"\n\n");
    let text = format!(
        "[vehicle]\nfleet = \"{fleet}\"\nname = \"v3\"\n\n[start]\n\
         pose = {{ position_m = [0.0, 2.0, 0.0], yaw_pitch_roll_deg = [0.0, 0.0, 0.0] }}\n\
         checkpoint = \"state/v3.checkpoint\"\n\n{}{}\
         [network]\nlisten = [\"tcp/127.0.0.1:0\"]\nconnect = {connect:?}\nmulticast = false\n",
        sensor("odometry"),
        sensor("tags"),
    );
    let file = folder.join("v3.toml");
    std::fs::write(&file, text).unwrap();
    file
}

/// What is heard of v3: its estimates, and the boot and prior of its exchanges to v1, each with when it came.
#[derive(Default)]
struct Heard {
    estimates: Vec<(Since, EstimateDocument)>,
    exchanges: Vec<(Since, u64, bool)>,
}

fn listen(world: &zenoh::Session, fleet: Name) -> Arc<Mutex<Heard>> {
    let heard = Arc::<Mutex<Heard>>::default();
    let estimates = Arc::clone(&heard);
    let of = nth_name(THIRD);
    world
        .declare_subscriber(Key::Estimate { of }.in_fleet(fleet))
        .callback(move |sample| {
            let document = serde_json::from_slice(&sample.payload().to_bytes()).unwrap();
            let mut heard = estimates.lock().unwrap();
            heard.estimates.push((Since::now(), document));
        })
        .background()
        .wait()
        .unwrap();
    let exchanges = Arc::clone(&heard);
    world
        .declare_subscriber(select::exchanges_to(fleet, nth_name(0)))
        .callback(move |sample| {
            let Ok((_, Key::Exchange { from, .. })) = Key::parse(sample.key_expr().as_str()) else {
                panic!("{}", sample.key_expr());
            };
            let packet = sample.payload().to_bytes();
            let (envelope, exchange) = codec::decode::<Exchange>(&packet).unwrap();
            if from == of {
                let mut heard = exchanges.lock().unwrap();
                heard
                    .exchanges
                    .push((Since::now(), envelope.boot, exchange.prior.is_some()));
            }
        })
        .background()
        .wait()
        .unwrap();
    heard
}

#[test]
fn a_killed_process_resumes_within_a_second_misleads_nobody_and_is_placed_within_three() {
    // Given: v1 and v2 here and v3 in a process of its own, all tracking; v3 has written a checkpoint.
    let fleet = name("resuming");
    let folder = std::env::temp_dir().join(format!("skein-resume-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let clock = Clock::real();
    let first = started(settings("resuming", 0, NetworkSettings::loopback(vec![])));
    let second = started(settings(
        "resuming",
        1,
        NetworkSettings::loopback(first.locators()),
    ));
    let agents = [first, second];
    let world = observer(agents[0].locators());
    let heard = listen(&world, fleet);
    let config = configuration("resuming", &folder, &agents[0].locators());
    let process = Process::start(&config);
    let mut flights: Vec<Flight> = (0..THIRD)
        .map(|nth| Flight::in_process(nth, TEAM, clock, &agents[nth]))
        .collect();
    let session = world.clone();
    flights.push(Flight::of(THIRD, TEAM, clock, move |sensor, frame| {
        let of = nth_name(THIRD);
        let sensor = name(sensor);
        let key = Key::Driver { of, sensor }.in_fleet(fleet);
        session.put(key, Frame::encode(frame)).wait().unwrap();
    }));
    let newest = || heard.lock().unwrap().estimates.last().cloned();
    let third_is = |wanted| newest().is_some_and(|(_, document)| document.status == wanted);
    let tracking = |agent: &Agent| status(agent) == Some(Status::Tracking);
    until("everybody is tracking", || {
        agents.iter().all(tracking) && third_is(Status::Tracking)
    });
    let checkpoint = folder.join("state/v3.checkpoint");
    until("v3 has written its checkpoint", || checkpoint.is_file());
    std::thread::sleep(Duration::from_millis(1_500));

    // When: it is killed with SIGKILL and started again at once.
    let old_boot = newest().unwrap().1.boot;
    process.kill();
    *heard.lock().unwrap() = Heard::default();
    let restarted = Since::now();
    let taken_ns = |agent: &Agent| agent.latest_estimate().unwrap().document.taken_ns;
    let before = [taken_ns(&agents[0]), taken_ns(&agents[1])];
    let process = Process::start(&config);

    // Then: it says that it is resuming, and is placed again. The others go on all the while.
    let mut slowest = Duration::ZERO;
    let mut last = [Since::now(); THIRD];
    let mut stamps = before;
    within(Duration::from_secs(6), "v3 is placed again", || {
        for (nth, agent) in agents.iter().enumerate() {
            let estimate = agent.latest_estimate().unwrap();
            assert_eq!(estimate.document.status, Status::Tracking, "v{}", nth + 1);
            if estimate.document.taken_ns > stamps[nth] {
                stamps[nth] = estimate.document.taken_ns;
                last[nth] = Since::now();
            }
            slowest = slowest.max(last[nth].elapsed());
        }
        third_is(Status::Tracking)
    });
    until("v1 hears priors of v3 again", || {
        heard.lock().unwrap().exchanges.iter().any(|e| e.2)
    });
    let heard = std::mem::take(&mut *heard.lock().unwrap());
    // All of it by the clock of who listens, from before the new process was started.
    let (resumed_at, resumed) = heard.estimates.first().unwrap();
    let (tracking_at, _) = heard
        .estimates
        .iter()
        .find(|(_, document)| document.status == Status::Tracking)
        .unwrap();
    let after = |at: &Since| at.after(restarted);
    let silent = heard.exchanges.iter().filter(|e| !e.2).count();
    eprintln!(
        "resuming {:.2?} after the restart, placed after {:.2?}; {silent} exchanges without a prior; the others' \
         estimates at most {slowest:.2?} apart",
        after(resumed_at),
        after(tracking_at),
    );
    assert_ne!(resumed.boot, old_boot);
    assert_eq!(resumed.status, Status::Resuming, "{resumed:?}");
    assert!(resumed.pose.is_some() && resumed.why.is_some());
    assert!(after(resumed_at) < Duration::from_secs(1));
    assert!(after(tracking_at) < Duration::from_secs(3));
    // A prior is first told after it was placed; exchanges before that carry none.
    let placed_before = |at: &Since| after(at) > after(tracking_at) - Duration::from_millis(100);
    for (at, boot, has_prior) in &heard.exchanges {
        assert!(
            boot_text(*boot) == resumed.boot && (!has_prior || placed_before(at)),
            "{has_prior} at {:?}",
            after(at)
        );
    }
    assert!(silent >= 2, "{silent}");
    assert!(slowest < Duration::from_millis(500), "{slowest:?}");
    for (nth, agent) in agents.iter().enumerate() {
        assert!(taken_ns(agent) > before[nth]);
        assert!(neighbour(agent, "v3").present);
    }
    drop(flights);
    drop(process);
    world.close().wait().unwrap();
    std::fs::remove_dir_all(folder).unwrap();
}

/// What an operator sends, and the answer if there is one.
fn call(
    session: &zenoh::Session,
    key: &str,
    payload: &str,
) -> Option<Result<serde_json::Value, ErrorDocument>> {
    let replies = session
        .get(key)
        .payload(payload)
        .timeout(Duration::from_secs(1))
        .wait()
        .unwrap();
    let reply = replies.into_iter().next()?;
    Some(match reply.result() {
        Ok(sample) => Ok(serde_json::from_slice(&sample.payload().to_bytes()).unwrap()),
        Err(error) => Err(serde_json::from_slice(&error.payload().to_bytes()).unwrap()),
    })
}

/// A vehicle that flies alone and does not know where.
fn lost(fleet: &str, rpc: bool) -> (Agent, Flight, zenoh::Session) {
    let mut settings = settings(fleet, 0, NetworkSettings::loopback(vec![]));
    settings.vehicle.start = Start::Unknown;
    settings.rpc = rpc;
    let clock = settings.clock;
    let agent = started(settings);
    let flight = Flight::in_process(0, 1, clock, &agent);
    let session = observer(agent.locators());
    // Who gets an answer to this is known to the vehicle, and knows it.
    until("the vehicle answers", || {
        let key = Key::Info { of: nth_name(0) }.in_fleet(name(fleet));
        call(&session, &key, "").is_some()
    });
    until("it says that it has no pose", || {
        status(&agent) == Some(Status::Unplaced)
    });
    (agent, flight, session)
}

fn rpc(fleet: &str, verb: &str) -> String {
    let (on, verb) = (nth_name(0), name(verb));
    Key::Rpc { on, verb }.in_fleet(name(fleet))
}

const THERE: &str = r#"{"position_m": [10.0, 20.0, 3.0], "yaw_pitch_roll_deg": [90.0, 0.0, 0.0]}"#;

#[test]
fn nobody_tells_a_vehicle_where_it_is_unless_its_configuration_allows_it() {
    let (agent, _flight, session) = lost("refusing", false);
    for _ in 0..3 {
        assert_eq!(call(&session, &rpc("refusing", "set_pose"), THERE), None);
    }
    std::thread::sleep(Duration::from_millis(500));
    assert_eq!(status(&agent), Some(Status::Unplaced));
    session.close().wait().unwrap();
}

#[test]
fn an_operator_s_pose_is_checked_answered_and_flown_on_from() {
    let (agent, _flight, session) = lost("obeying", true);
    let set_pose = rpc("obeying", "set_pose");
    let nonsense = [
        (set_pose.as_str(), "", "malformed"),
        (&set_pose, "over there", "malformed"),
        (&set_pose, r#"{"position_m": [1.0, 2.0]}"#, "malformed"),
        (
            &set_pose,
            r#"{"position_m": [1e9, 2.0, 3.0]}"#,
            "out_of_range",
        ),
        (
            &set_pose,
            r#"{"position_m": [1, 2, 3], "quaternion_wxyz": [2, 0, 0, 0]}"#,
            "not_unit",
        ),
        (&rpc("obeying", "self_destruct"), THERE, "unknown_verb"),
    ];
    for (key, payload, code) in nonsense {
        let error = call(&session, key, payload).unwrap().unwrap_err();
        assert_eq!(error.code, code, "{payload}: {}", error.message);
        assert!(!error.message.is_empty());
    }
    assert_eq!(status(&agent), Some(Status::Unplaced));

    let answer = call(&session, &set_pose, THERE).unwrap().unwrap();
    assert_eq!(answer, serde_json::json!({"accepted": true}));
    let took = within(Duration::from_secs(1), "the pose holds", || {
        status(&agent) == Some(Status::Alone)
    });
    eprintln!("an operator's pose holds {took:.2?} after the answer");
    // It looks north and flies ahead at 1 m/s.
    let pose = agent.latest_estimate().unwrap().document.pose.unwrap();
    let [x, y, z] = pose.position_m;
    assert!(
        (x - 10.0).abs() < 0.01 && (z - 3.0).abs() < 0.01,
        "{pose:?}"
    );
    assert!((19.99..22.0).contains(&y), "{pose:?}");
    assert!((pose.yaw_pitch_roll_deg[0] - 90.0).abs() < 0.1, "{pose:?}");
    until("it flies on from there", || {
        agent
            .latest_estimate()
            .is_some_and(|e| e.document.pose.is_some_and(|p| p.position_m[1] > y + 1.0))
    });
    session.close().wait().unwrap();
}
