//! Every `skein` command of the README works as it stands there.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};

/// The commands of the README that begin with `skein `, without that word.
fn commands() -> Vec<String> {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    let mut inside = false;
    let mut found = Vec::new();
    for line in readme.lines() {
        match line {
            "```sh" => inside = true,
            "```" => inside = false,
            _ if inside => found.extend(line.strip_prefix("skein ").map(str::to_owned)),
            _ => {}
        }
    }
    found
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .unwrap()
        .to_owned()
}

fn skein(arguments: &str, more: &[&str]) -> Output {
    let arguments = arguments.split_whitespace().chain(more.iter().copied());
    Command::new(env!("CARGO_BIN_EXE_skein"))
        .args(arguments)
        .current_dir(root())
        .output()
        .unwrap()
}

/// A daemon of the README's configuration, on a port of its own.
struct Daemon {
    process: Child,
    endpoint: String,
    folder: PathBuf,
}

impl Daemon {
    fn start() -> Self {
        let folder = std::env::temp_dir().join(format!("skein-readme-{}", std::process::id()));
        std::fs::create_dir_all(folder.join("logs")).unwrap();
        let port = std::net::TcpListener::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap()
            .port();
        let endpoint = format!("tcp/127.0.0.1:{port}");
        let example = std::fs::read_to_string(root().join("agent/examples/skein.toml")).unwrap();
        let config = example
            .replace(
                "listen = [\"127.0.0.1:7447\"]",
                &format!("listen = [\"{endpoint}\"]"),
            )
            .replace("multicast = true", "multicast = false");
        let log = folder.join("logs/v1.mcap");
        let config = format!("{config}\n[log]\nfile = \"{}\"\n", log.display());
        std::fs::write(folder.join("skein.toml"), config).unwrap();
        let process = Command::new(env!("CARGO_BIN_EXE_skein"))
            .args(["run", "--config"])
            .arg(folder.join("skein.toml"))
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        Self {
            process,
            endpoint,
            folder,
        }
    }

    /// Stops it as systemd does, and waits for its end.
    fn stop(&mut self) {
        let told = Command::new("kill")
            .args(["-TERM", &self.process.id().to_string()])
            .status()
            .unwrap();
        assert!(told.success());
        assert!(
            self.process.wait().unwrap().success(),
            "a clean stop ends with 0"
        );
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = self.process.kill();
        let _ = std::fs::remove_dir_all(&self.folder);
    }
}

#[test]
fn the_commands_for_a_vehicle_work() {
    let mut daemon = Daemon::start();
    let endpoint = daemon.endpoint.clone();
    let network = [
        "--fleet",
        "skein",
        "--connect",
        endpoint.as_str(),
        "--no-multicast",
    ];
    let mut run = 0;
    for command in commands() {
        let output = match command.split_whitespace().next().unwrap() {
            "get" | "status" => skein(&command, &network),
            "watch" => skein(&command, &[&network[..], &["--for", "2"]].concat()),
            // It looks at the daemon above, which nobody gives odometry: that is the only problem there should be.
            "doctor" => {
                let output = skein(&command, &network);
                let text = String::from_utf8_lossy(&output.stdout);
                assert!(text.contains("no odometry yet"), "skein {command}: {text}");
                assert!(text.contains("1 problems"), "skein {command}: {text}");
                assert_eq!(output.status.code(), Some(5));
                run += 1;
                continue;
            }
            // Started above, on a port of its own; its log is verified below.
            "run" | "verify" => continue,
            _ => skein(&command, &[]),
        };
        let text = String::from_utf8_lossy(&output.stdout);
        let errors = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success(), "skein {command}: {text}\n{errors}");
        assert!(!text.trim().is_empty(), "skein {command} prints something");
        run += 1;
    }
    assert!(run >= 7, "the README has {run} commands to run");
    daemon.stop();
    let log = daemon.folder.join("logs/v1.mcap");
    let verified = skein("verify", &[log.to_str().unwrap()]);
    assert!(
        verified.status.success(),
        "{}",
        String::from_utf8_lossy(&verified.stderr)
    );
}
