//! The command line as scripts meet it: exit codes, JSON, what goes to which stream, and how commands end.
#![allow(clippy::unwrap_used)]

use skein_agent::{Agent, Clock, NetworkSettings, Settings, config};
use skein_proto::document::EstimateDocument;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::time::{Duration, Instant};

const PATIENCE: Duration = Duration::from_secs(20);
const EXAMPLE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/examples/skein.toml");

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_skein"));
    command
        .args(arguments)
        .env_remove("RUST_LOG")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// Runs a command to its end: exit code, standard output, standard error.
fn skein(arguments: &[&str]) -> (i32, String, String) {
    let Output {
        status,
        stdout,
        stderr,
    } = command(arguments).output().unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    (status.code().unwrap(), text(stdout), text(stderr))
}

/// A folder of one test, removed at its end.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("skein-{name}-{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn file(&self, name: &str, text: &str) -> String {
        let path = self.0.join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A command that still runs; killed at the end of a test that failed, and when it runs for too long.
struct Running(Child, Option<Sender<()>>);

impl Running {
    fn start(arguments: &[&str]) -> Self {
        let child = command(arguments).spawn().unwrap();
        let pid = child.id().to_string();
        let (ended, watched) = channel();
        // So that a test which waits for a line that never comes fails instead of waiting.
        std::thread::spawn(move || {
            if watched.recv_timeout(PATIENCE) == Err(RecvTimeoutError::Timeout) {
                let _ = Command::new("kill").args(["-KILL", &pid]).status();
            }
        });
        Self(child, Some(ended))
    }

    fn lines(&mut self) -> impl Iterator<Item = String> + use<> {
        let stdout = self.0.stdout.take().unwrap();
        BufReader::new(stdout).lines().map(Result::unwrap)
    }

    fn terminate(&self) {
        let pid = self.0.id().to_string();
        let told = Command::new("kill").args(["-TERM", &pid]).status();
        assert!(told.unwrap().success());
    }

    /// Waits for its end, which must come soon.
    #[expect(clippy::disallowed_methods, reason = "a real process is watched")]
    fn code(&mut self) -> i32 {
        let since = Instant::now();
        loop {
            if let Some(status) = self.0.try_wait().unwrap() {
                self.1 = None;
                return status.code().expect("it ended by itself");
            }
            assert!(since.elapsed() < PATIENCE, "it has not ended");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.1 = None;
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// An agent without a driver of its own, as its configuration says it.
fn agent(fleet: &str) -> Agent {
    let text = format!(
        "[vehicle]\nfleet = \"{fleet}\"\nname = \"v1\"\n\n[[sensor]]\nname = \"odometry\"\ndriver = \"zenoh\"\n"
    );
    let settings = Settings {
        network: NetworkSettings::loopback(vec![]),
        clock: Clock::real(),
        ..config::parse(&text, "v1.toml", Path::new("")).unwrap()
    };
    let agent = Agent::start(settings).unwrap();
    assert!(agent.wait_open(PATIENCE), "no session");
    agent
}

/// `skein watch` of a fleet whose one agent is there.
fn watch(fleet: &str, agent: &Agent, more: &[&str]) -> Running {
    let endpoint = agent.locators().swap_remove(0);
    let network = [
        "watch",
        "--fleet",
        fleet,
        "--connect",
        &endpoint,
        "--no-multicast",
    ];
    Running::start(&[&network[..], more].concat())
}

#[test]
fn without_a_command_it_shows_what_it_can_do() {
    let (code, _, help) = skein(&[]);
    assert_eq!(code, 2, "nothing was done");
    let (asked, page, _) = skein(&["--help"]);
    assert_eq!(asked, 0);
    for text in [help, page] {
        for expected in ["check-config", "watch", "doctor", "Exit codes:", "RUST_LOG"] {
            assert!(text.contains(expected), "{expected}: {text}");
        }
    }
}

#[test]
fn every_command_explains_itself_with_an_example() {
    for command in [
        "run",
        "get",
        "watch",
        "status",
        "check-config",
        "doctor",
        "solve",
        "verify",
    ] {
        let (code, page, _) = skein(&[command, "--help"]);
        assert_eq!(code, 0);
        assert!(page.contains(&format!("  skein {command}")), "{page}");
    }
}

#[test]
fn wrong_usage_ends_with_2_and_a_suggestion() {
    for arguments in [
        &["--colour"][..],
        &["wach"],
        &["get", "V 1"],
        &["watch", "--for", "soon"],
        &["check-config"],
    ] {
        let (code, _, errors) = skein(arguments);
        assert_eq!(code, 2, "{arguments:?}: {errors}");
    }
    assert!(skein(&["wach"]).2.contains("watch"));
}

#[test]
fn failures_end_with_1_and_say_what_to_do() {
    let folder = Folder::new("failing");
    let broken = folder.file("broken.toml", "[vehicle]\nname = \"V1\"\n");
    let no_log = folder.file("no.mcap", "nothing");
    for arguments in [
        &["run", "--config", "gone.toml"][..],
        &["run", "--config", &broken],
        &["check-config", &broken],
        &["check-config", "gone.toml"],
        &["verify", &no_log],
        &["solve", "gone.graph"],
    ] {
        let (code, out, errors) = skein(arguments);
        assert_eq!(code, 1, "{arguments:?}: {errors}");
        assert!(out.is_empty() && !errors.is_empty(), "{arguments:?}: {out}");
    }
    let (_, _, errors) = skein(&["run", "--config", &broken]);
    assert!(errors.contains("broken.toml:2") && errors.contains("a-z, 0-9 and _"));
}

#[test]
fn nobody_there_ends_with_3_and_advice() {
    let network = ["--no-multicast", "--listen", "tcp/127.0.0.1:0", "--fleet"];
    for command in [
        &["get", "--wait", "0.2"][..],
        &["status", "v1", "--wait", "0.2"],
        &["watch", "--for", "0.2"],
    ] {
        let (code, out, errors) = skein(&[command, &network, &["nobody"]].concat());
        assert_eq!(code, 3, "{command:?}: {errors}");
        assert!(out.is_empty(), "{out}");
        assert!(errors.contains("Is `skein run` running there?"), "{errors}");
    }
}

#[test]
fn a_checked_configuration_is_summed_up_for_people_and_programs() {
    let (code, page, _) = skein(&["check-config", EXAMPLE]);
    assert_eq!(code, 0);
    assert!(page.contains("v1 of fleet skein"), "{page}");
    let (code, json, _) = skein(&["check-config", EXAMPLE, "--json"]);
    let summary: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(code, 0);
    assert_eq!(summary["sensors"]["tags"]["driver"], "zenoh");
}

#[test]
fn a_mistake_is_an_object_with_its_place_and_what_was_meant() {
    let folder = Folder::new("mistaken");
    let file = folder.file(
        "typo.toml",
        "[vehicle]\nname = \"v1\"\n\n[cooperative]\n  period = 0.2\n",
    );
    let (code, json, _) = skein(&["check-config", &file, "--json"]);
    let mistake: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!(code, 1);
    assert_eq!(mistake["file"], *file);
    assert_eq!(
        (&mistake["line"], &mistake["column"]),
        (&5.into(), &3.into())
    );
    assert_eq!(mistake["key"], "cooperative.period");
    assert!(mistake["message"].as_str().unwrap().contains("no key"));
    let help = mistake["help"].as_str().unwrap();
    assert!(help.contains("did you mean `period_s`?"), "{help}");
}

#[test]
fn watching_prints_estimates_as_published_and_ends_when_told() {
    let agent = agent("watched");
    let mut watching = watch("watched", &agent, &["v1", "--json"]);
    for line in watching.lines().take(2) {
        let estimate: EstimateDocument = serde_json::from_str(&line).unwrap();
        assert_eq!(estimate.vehicle.as_str(), "v1");
    }
    watching.terminate();
    assert_eq!(watching.code(), 0);
}

#[test]
fn watching_shows_vehicles_come_and_go() {
    let agent = agent("passing");
    let mut watching = watch("passing", &agent, &[]);
    let mut lines = watching.lines();
    let mut until = |words: &str| {
        let found = lines.find(|line| line.contains(words));
        assert!(found.is_some_and(|line| line.starts_with("v1 ")), "{words}");
    };
    until("appeared");
    until("no odometry yet");
    agent.stop();
    until("vanished");
    watching.terminate();
    assert_eq!(watching.code(), 0);
}

#[test]
fn watching_ends_when_nobody_reads_and_when_its_time_is_up() {
    let agent = agent("unread");
    let mut watching = watch("unread", &agent, &["--every", "0"]);
    drop(watching.0.stdout.take());
    assert_eq!(watching.code(), 0, "a closed pipe is no failure");
    let mut watching = watch("unread", &agent, &["--for", "2.5"]);
    assert_eq!(watching.code(), 0);
    let mut shown = String::new();
    let mut out = watching.0.stdout.take().unwrap();
    out.read_to_string(&mut shown).unwrap();
    assert!(shown.contains("unplaced"), "{shown}");
}

#[test]
fn the_doctor_says_what_is_wrong_with_a_machine_and_what_is_not() {
    let folder = Folder::new("doctor");
    let taken = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let file = folder.file(
        "v1.toml",
        &format!(
            "[vehicle]\nfleet = \"ill\"\nname = \"v1\"\n\n[log]\nfile = \"v1.toml/v1.mcap\"\n\n\
             [network]\nlisten = [\"tcp/127.0.0.1:{port}\"]\nmulticast = false\n"
        ),
    );
    let listen = ["--listen", "tcp/127.0.0.1:0", "--wait", "0.2"];
    let doctor = ["doctor", "--config", &file, "--json"];
    let (code, json, _) = skein(&[&doctor[..], &listen].concat());
    let report: serde_json::Value = serde_json::from_str(&json).unwrap();
    assert_eq!((code, &report["problems"]), (5, &2.into()), "{report:#}");
    let level = |check: &str| {
        let mut checks = report["checks"].as_array().unwrap().iter();
        let found = checks.find(|found| found["check"].as_str().unwrap().starts_with(check));
        found.map(|found| found["level"].as_str().unwrap().to_owned())
    };
    assert_eq!(level("configuration").as_deref(), Some("ok"));
    assert_eq!(level("log folder").as_deref(), Some("problem"));
    assert_eq!(level("listens on").as_deref(), Some("problem"));
    assert_eq!(level("fleet").as_deref(), Some("warning"));

    let healthy = folder.file(
        "well.toml",
        "[vehicle]\nfleet = \"ill\"\nname = \"v1\"\n\n[network]\nmulticast = false\n",
    );
    let (code, page, _) = skein(&[&["doctor", "--config", &healthy][..], &listen].concat());
    assert_eq!(code, 0, "warnings alone are no failure: {page}");
    assert!(page.contains("0 problems, 1 warnings"), "{page}");
}

#[test]
fn the_doctor_tells_the_running_vehicle_from_a_stranger_on_its_port() {
    let folder = Folder::new("running");
    let agent = agent("running");
    let endpoint = agent.locators().swap_remove(0);
    let file = folder.file(
        "v1.toml",
        &format!(
            "[vehicle]\nfleet = \"running\"\nname = \"v1\"\n\n[network]\nlisten = [\"{endpoint}\"]\nmulticast = false\n"
        ),
    );
    let (code, page, errors) = skein(&["doctor", "--config", &file]);
    assert!(page.contains("taken, and v1 runs"), "{page}{errors}");
    assert!(page.contains("v1 estimate: unplaced"), "{page}");
    assert!(
        page.contains("no odometry yet"),
        "the reason is told: {page}"
    );
    assert!(page.contains("wire 1."), "{page}");
    assert_eq!(
        code, 5,
        "a vehicle without an estimate is a problem: {page}"
    );
}

#[test]
fn a_run_logs_what_changed_as_json_and_nothing_twice() {
    let folder = Folder::new("logging");
    let file = folder.file(
        "v1.toml",
        "[vehicle]\nfleet = \"logging\"\nname = \"v1\"\n\n[[sensor]]\nname = \"odometry\"\ndriver = \"zenoh\"\n\n\
         [network]\nlisten = [\"tcp/127.0.0.1:0\"]\nmulticast = false\n",
    );
    let mut running = Running::start(&["run", "--config", &file, "--log-format", "json"]);
    let stderr = running.0.stderr.take().unwrap();
    let mut lines = BufReader::new(stderr).lines().map(Result::unwrap);
    let mut logged = Vec::new();
    let message = |line: &str| -> String {
        let line: serde_json::Value = serde_json::from_str(line).unwrap();
        line["fields"]["message"].as_str().unwrap().to_owned()
    };
    // Given: a vehicle that has started and opened its session.
    while !logged
        .iter()
        .any(|message: &String| message.contains("session is open"))
    {
        logged.push(message(&lines.next().unwrap()));
    }
    // When: three healths pass in which nothing changes, and it is told to stop.
    std::thread::sleep(Duration::from_secs(3));
    running.terminate();
    assert_eq!(running.code(), 0);
    logged.extend(lines.map(|line| message(&line)));
    // Then: each change has one line.
    for expected in [
        "starting",
        "the driver has started",
        "the estimate's status",
        "stopping",
    ] {
        let count = logged.iter().filter(|message| *message == expected).count();
        assert_eq!(count, 1, "{expected}: {logged:#?}");
    }
    assert_eq!(logged.len(), 5, "{logged:#?}");
}
