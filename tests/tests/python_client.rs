//! The Python client, which shares no line with us: it reads what our codec writes and feeds what our drivers take.
#![allow(clippy::unwrap_used)]

use serde_json::{Value, json};
use skein_agent::{Agent, Clock, NetworkSettings, config};
use skein_estimation::time::{Span, Stamp};
use skein_proto::codec::decode;
use skein_proto::exchange::Exchange;
use skein_proto::name::Name;
use skein_proto::status::Status;
use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::Duration;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
const GOLDEN: &str = include_str!("../../proto/tests/golden/messages.hex");
/// How fast both vehicles drive to the east, side by side.
const SPEED_M_S: f64 = 1.0;
/// How far the second is to the north of the first.
const APART_M: f64 = 2.0;
/// Longer than anything here takes on a busy machine.
const PATIENCE: Duration = Duration::from_secs(60);
const STEP: Duration = Duration::from_millis(50);

#[test]
fn golden_exchanges_are_decoded_with_struct_alone() {
    let Some(python) = interpreter(&[".venv/bin/python", "python3"], "struct") else {
        return;
    };
    let lines = GOLDEN.lines().filter(|line| line.starts_with("exchange"));
    let packets: Vec<&str> = lines.map(|line| line.split(": ").nth(1).unwrap()).collect();
    let mut client = client(&python, &["decode"]);
    client.write(&packets.join("\n"));
    let decoded = client.output();
    assert_eq!((decoded.len(), packets.len()), (3, 3));
    for (python, packet) in decoded.iter().zip(packets) {
        assert_same(python, &unhex(packet));
    }
}

#[test]
fn a_client_in_another_language_reads_decodes_and_drives() {
    let Some(python) = interpreter(&[".venv/bin/python"], "zenoh") else {
        return;
    };
    // Given two agents on this machine, whose only drivers are two processes of the client,
    let clock = Clock::real();
    let first = agent("v1", 0.0, clock, vec![]);
    let second = agent("v2", APART_M, clock, first.locators());
    let connect = first.locators();
    let start = clock.now();
    let connected = |words: &[&str]| {
        let network = [
            "--no-multicast",
            "--listen",
            "tcp/127.0.0.1:0",
            "--wait",
            "30",
            "--connect",
            &connect[0],
        ];
        client(&python, &[words, &network].concat())
    };
    let mut feeds = [("v1", &first), ("v2", &second)].map(|(name, agent)| {
        let mut feed = Feed {
            client: connected(&["drive", name]),
            clock,
            last: start,
        };
        feed.odometry();
        wait_until(|| accepted(agent, "odometry") == 1);
        feed
    });
    let mut listener = connected(&["listen", "--count", "12"]);
    let mut reader = None;
    // when both drive on, the first sees the second, and once it sends a frame that is none,
    feeds[0]
        .client
        .write(r#"{"sensor": "tags", "frame": {"tag": 7}}"#);
    let mut steps = 0;
    wait_until(|| {
        steps += 1;
        feeds.iter_mut().for_each(Feed::odometry);
        feeds[0].sees("v2");
        if steps == 60 {
            reader = Some(connected(&["get", "v1"]));
        }
        let is_read = reader.as_mut().is_some_and(Client::has_ended);
        is_read && listener.has_ended()
    });
    let estimate = reader.unwrap().output().remove(0);
    let exchanges = listener.output();
    // then the estimate that it read is the one of that time: driven to the east, not to the north,
    let at = estimate["taken_ns"].as_i64().unwrap();
    let [x, y, _] = position(&estimate);
    let driven_m = SPEED_M_S * (Stamp::from_nanos(at) - start).as_secs_f64();
    assert!(
        driven_m > 1.0 && (x - driven_m).abs() < 0.05,
        "{driven_m} m in {estimate}"
    );
    assert!(y.abs() < 0.05, "{estimate}");
    assert_eq!(estimate["status"], "tracking");
    let seen = &estimate["neighbours"][0];
    assert!(
        (seen["pose"]["position_m"][1].as_f64().unwrap() - APART_M).abs() < 0.05,
        "{seen}"
    );
    // the exchanges that it overheard hold for it the numbers that they hold for us,
    assert_eq!(exchanges.len(), 12);
    for decoded in &exchanges {
        assert_same(decoded, &unhex(decoded["packet"].as_str().unwrap()));
    }
    let measures = |decoded: &&Value| decoded["exchange"]["measured"][0]["kind"] == "pose";
    assert!(
        exchanges.iter().any(|decoded| measures(&decoded)),
        "none with a measurement: {exchanges:?}"
    );
    // and its frames were taken, but for the one that is none.
    wait_until(|| accepted(&first, "tags") >= 20);
    let health = first.latest_health().unwrap();
    assert!(
        health.sensors["odometry"].accepted >= 20 && health.sensors["odometry"].refused.is_empty()
    );
    assert_eq!(
        health.sensors["tags"].refused["malformed"], 1,
        "{:?}",
        health.sensors["tags"]
    );
}

/// A process of the client that feeds the drivers of one vehicle.
struct Feed {
    client: Client,
    clock: Clock,
    last: Stamp,
}

impl Feed {
    /// The motion since the last call, or over the time before the first.
    fn odometry(&mut self) {
        let now = self.clock.now().max(self.last + Span::millis(1));
        let east_m = SPEED_M_S * (now - self.last).as_secs_f64();
        let frame = json!({"odometry": {
            "since_ns": self.last.as_nanos(), "taken_ns": now.as_nanos(), "motion": [0.0, 0.0, 0.0, east_m, 0.0, 0.0],
            "rotation_sigma_rad": 1e-3, "translation_sigma_m": 1e-3,
        }});
        self.last = now;
        self.client
            .write(&json!({"sensor": "odometry", "frame": frame}).to_string());
    }

    /// A tag on a neighbour, seen now.
    fn sees(&mut self, target: &str) {
        let frame = json!({"relative": {
            "taken_ns": self.last.as_nanos(), "target": target,
            "value": {"pose": {
                "sensor_from_target": [0.0, 0.0, 0.0, 0.0, APART_M, 0.0],
                "rotation_sigma_rad": 1e-2, "translation_sigma_m": 1e-2,
            }},
        }});
        self.client
            .write(&json!({"sensor": "tags", "frame": frame}).to_string());
    }
}

fn agent(name: &str, north_m: f64, clock: Clock, connect: Vec<String>) -> Agent {
    let text = format!(
        r#"
        vehicle.name = "{name}"
        start.pose = {{ position_m = [0.0, {north_m:.1}, 0.0] }}
        [[sensor]]
        name = "odometry"
        driver = "zenoh"
        [[sensor]]
        name = "tags"
        driver = "zenoh"
        "#
    );
    let mut settings = config::parse(&text, name, Path::new("")).unwrap();
    settings.network = NetworkSettings::loopback(connect);
    settings.clock = clock;
    let agent = Agent::start(settings).unwrap();
    assert!(agent.wait_open(PATIENCE), "{name} does not open");
    agent
}

fn accepted(agent: &Agent, sensor: &str) -> u64 {
    agent
        .latest_health()
        .map_or(0, |health| health.sensors[sensor].accepted)
}

fn position(estimate: &Value) -> [f64; 3] {
    [0, 1, 2].map(|axis| estimate["pose"]["position_m"][axis].as_f64().unwrap())
}

fn wait_until(mut holds: impl FnMut() -> bool) {
    for _ in 0..PATIENCE.as_millis() / STEP.as_millis() {
        if holds() {
            return;
        }
        sleep(STEP);
    }
    panic!("not within {PATIENCE:?}");
}

/// The first of these interpreters that can import a module; says so when there is none.
fn interpreter(candidates: &[&str], module: &str) -> Option<String> {
    let runs = |program: &String| {
        let mut import = Command::new(program);
        import
            .args(["-c", &format!("import {module}")])
            .stderr(Stdio::null());
        import.status().is_ok_and(|status| status.success())
    };
    let path = |candidate: &&str| {
        let in_project = candidate.contains('/');
        if in_project {
            format!("{ROOT}/{candidate}")
        } else {
            (*candidate).to_owned()
        }
    };
    let found = candidates.iter().map(path).find(runs);
    if found.is_none() {
        // Not by a macro: the test harness would keep it to itself.
        let advice = "SKIPPED: the Python client, for want of .venv; `.ci/run` makes it\n";
        std::io::stderr().write_all(advice.as_bytes()).unwrap();
    }
    found
}

/// A running process of the client; ends with its test.
struct Client {
    child: Child,
}

fn client(python: &str, arguments: &[&str]) -> Client {
    let program = format!("{ROOT}/deploy/clients/python/skein_client.py");
    let child = Command::new(python)
        .arg(program)
        .args(arguments)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    Client { child }
}

impl Client {
    fn write(&mut self, line: &str) {
        let input = self.child.stdin.as_mut().unwrap();
        writeln!(input, "{line}").unwrap();
    }

    fn has_ended(&mut self) -> bool {
        self.child.try_wait().unwrap().is_some()
    }

    /// What it printed until its end, one JSON value a line.
    fn output(mut self) -> Vec<Value> {
        drop(self.child.stdin.take());
        let mut text = String::new();
        self.child
            .stdout
            .take()
            .unwrap()
            .read_to_string(&mut text)
            .unwrap();
        assert!(self.child.wait().unwrap().success(), "{text}");
        text.lines()
            .map(|line| serde_json::from_str(line).unwrap())
            .collect()
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn unhex(text: &str) -> Vec<u8> {
    let digits = (0..text.len()).step_by(2).map(|at| &text[at..at + 2]);
    digits
        .map(|digits| u8::from_str_radix(digits, 16).unwrap())
        .collect()
}

/// Fails unless Python found in a packet what our codec finds.
fn assert_same(python: &Value, packet: &[u8]) {
    let (envelope, exchange) = decode::<Exchange>(packet).unwrap();
    let mut ours = serde_json::to_value(&exchange).unwrap();
    ours["status"] = serde_json::to_value(Status::from_code(exchange.status)).unwrap();
    ours["measured"] = ours["measured"]
        .as_array()
        .unwrap()
        .iter()
        .map(flat)
        .collect();
    assert_near(&python["exchange"], &ours, "exchange");
    assert_near(
        &python["envelope"],
        &serde_json::to_value(envelope).unwrap(),
        "envelope",
    );
    let name = python["key"]
        .as_str()
        .map(|key| Name::parse(key.split('/').nth(2).unwrap()).unwrap());
    assert!(
        name.is_none_or(|name| name.hash() == envelope.sender),
        "{python}"
    );
}

/// A measurement as Python writes it: its kind beside its numbers.
fn flat(measured: &Value) -> Value {
    let (kind, numbers) = measured["value"]
        .as_object()
        .unwrap()
        .iter()
        .next()
        .unwrap();
    let mut flat = numbers.clone();
    flat["kind"] = kind.to_lowercase().into();
    flat["taken_offset_us"] = measured["taken_offset_us"].clone();
    flat
}

/// Integers and texts are equal; the last bit of a float may go on its way through a decimal text.
fn assert_near(python: &Value, ours: &Value, at: &str) {
    match (python, ours) {
        (Value::Object(one), Value::Object(two)) => {
            let keys = |object: &serde_json::Map<String, Value>| -> Vec<String> {
                object.keys().cloned().collect()
            };
            assert_eq!(keys(one), keys(two), "{at}");
            one.iter()
                .for_each(|(key, value)| assert_near(value, &two[key], &format!("{at}.{key}")));
        }
        (Value::Array(one), Value::Array(two)) => {
            assert_eq!(one.len(), two.len(), "{at}");
            one.iter()
                .zip(two)
                .for_each(|(one, two)| assert_near(one, two, at));
        }
        (Value::Number(one), Value::Number(two)) if one.is_f64() => {
            let (one, two) = (one.as_f64().unwrap(), two.as_f64().unwrap());
            assert!(
                (one - two).abs() <= f64::EPSILON * two.abs(),
                "{at}: {one} and {two}"
            );
        }
        _ => assert_eq!(python, ours, "{at}"),
    }
}
