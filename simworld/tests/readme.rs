//! Every `skein-sim` command of the README works as it stands there, made short where it would take long.
#![cfg(feature = "live")]
#![allow(clippy::unwrap_used)]

use skein_simworld::datasets;
use std::path::{Path, PathBuf};
use std::process::Command;

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .parent()
        .unwrap()
        .to_owned()
}

/// The commands of the README that run `skein-sim`, without the program's name.
fn commands() -> Vec<String> {
    let readme = std::fs::read_to_string(root().join("README.md")).unwrap();
    let mut inside = false;
    let mut found = Vec::new();
    for line in readme.lines() {
        match line {
            "```sh" => inside = true,
            "```" => inside = false,
            _ if inside => {
                let plain = line.strip_prefix("skein-sim ");
                let built = line.strip_prefix("cargo run --release --bin skein-sim -- ");
                found.extend(plain.or(built).map(str::to_owned));
            }
            _ => {}
        }
    }
    found
}

/// Runs one command; `shorter` replaces what would take long.
fn run(command: &str, shorter: &[&str], folder: &Path) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_skein-sim"))
        .args(command.split_whitespace().chain(shorter.iter().copied()))
        .current_dir(folder)
        .output()
        .unwrap();
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(
        output.status.success(),
        "skein-sim {command}: {text}\n{errors}"
    );
    text
}

#[test]
fn the_commands_for_a_test_bed_and_for_research_work() {
    let folder = std::env::temp_dir().join(format!("skein-sim-readme-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let recording = datasets::find("mrclam6");
    let commands = commands();
    assert!(commands.len() >= 6, "{commands:?}");
    for command in commands {
        let words: Vec<&str> = command.split_whitespace().collect();
        match words[0] {
            "fly" if words[1] == "square" => {
                // Too short a flight to know who is who; everybody flies and tells.
                let text = run(&command, &["--duration", "4"], &folder);
                assert!(text.contains("v4"), "{text}");
            }
            "fly" => {
                let text = run(&command, &["--duration", "4"], &folder);
                assert!(text.contains("tracking"), "{text}");
            }
            "experiment" if words[1] == "modes" => {
                let text = run(&command, &["--samples", "2"], &folder);
                assert!(text.contains("asked of mode star"), "{text}");
                assert!(folder.join("out/modes/modes.svg").exists());
            }
            "experiment" if words[1] == "consistency" => {
                let few = ["--samples", "2", "--rounds", "20", "--cell", "pose-3"];
                let text = run(&command, &few, &folder);
                assert!(text.contains("pose-3"), "{text}");
            }
            "experiment" if words[1] == "mutual" => {
                let few = ["--samples", "2", "--case", "square", "--method", "identity"];
                let text = run(&command, &few, &folder);
                assert!(text.contains("identity"), "{text}");
            }
            "experiment" if words[1] == "registration" => {
                let few = ["--samples", "2", "--robots-max", "4"];
                let text = run(&command, &few, &folder);
                assert!(text.contains("poses known"), "{text}");
                assert!(folder.join("out/registration/registration.svg").exists());
            }
            "experiment" if words[1] == "attitude" => {
                let text = run(&command, &["--samples", "2"], &folder);
                assert!(text.contains("deg"), "{text}");
            }
            "experiment" if command.ends_with("--study errors") => {
                let text = run(&command, &["--samples", "2"], &folder);
                assert!(text.contains("over its recursive bound"), "{text}");
                assert!(folder.join("out/ranging/errors.svg").exists());
            }
            "experiment" if words[1] == "ranging" => {
                let few = ["--samples", "2", "--rounds", "50"];
                let text = run(&command.replace(" --samples 10000", ""), &few, &folder);
                assert!(text.contains("out/ranging"), "{text}");
                let tables = std::fs::read_dir(folder.join("out/ranging")).unwrap();
                assert!(tables.count() >= 2, "{command} draws and tabulates");
            }
            "experiment" => {
                let plain = command.replace("--samples 100 ", "");
                let text = run(&plain, &["--samples", "4"], &folder);
                assert!(text.contains("distance"), "{text}");
                assert!(
                    folder
                        .join("out/cooperative/figure-3-team-size.svg")
                        .exists()
                );
            }
            "replay" if words[1] == "attitude" => {
                let folders = [datasets::find("broad"), datasets::find("euroc_v1_01")];
                let [Some(broad), Some(euroc)] = folders else {
                    continue;
                };
                let command = command
                    .replacen("DIR", broad.to_str().unwrap(), 1)
                    .replacen("DIR", euroc.to_str().unwrap(), 1);
                let text = run(&command, &[], &folder);
                assert!(text.contains("deg"), "{text}");
            }
            "replay" if words[1] == "pyfg" => {
                let Some(ranges) = datasets::find("cora_pyfg") else {
                    continue;
                };
                let file = ranges.join("tiers.pyfg");
                let text = run(
                    &command.replace("FILE", file.to_str().unwrap()),
                    &[],
                    &folder,
                );
                assert!(text.contains("C of D"), "{text}");
            }
            "replay" => {
                let Some(recording) = &recording else {
                    continue;
                };
                let command = command.replace("DIR", recording.to_str().unwrap());
                let live = ["--duration", "60"];
                let text = run(&command, &live, &folder);
                assert!(text.contains("team"), "{text}");
            }
            other => panic!("the README has a command that no test runs: skein-sim {other}"),
        }
    }
    let _ = std::fs::remove_dir_all(&folder);
}
