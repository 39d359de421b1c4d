//! What `deploy/` starts exists: programs, their options, their configurations, and a world that fits its agents.
#![allow(clippy::unwrap_used)]

use skein_agent::{Settings, config};
use skein_proto::name::Name;
use skein_simworld::scenario::Scenario;
use skein_vehicle::Start;
use std::collections::BTreeMap;
use std::path::Path;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
/// Where configurations lie, on a vehicle and in a container.
const INSTALLED: &str = "/etc/skein/";

#[test]
fn the_unit_starts_a_program_with_options_and_a_configuration_that_exist() {
    let unit = text("deploy/systemd/skein.service");
    let command = unit
        .lines()
        .find_map(|line| line.strip_prefix("ExecStart="))
        .unwrap();
    let words: Vec<&str> = command.split(' ').collect();
    assert_is_understood(&words);
    let installed = words
        .iter()
        .find_map(|word| word.strip_prefix(INSTALLED))
        .unwrap();
    settings(&format!("deploy/systemd/{installed}"));
}

#[test]
fn every_service_starts_a_program_with_options_and_mounted_files_that_exist() {
    let services = services();
    assert_eq!(
        services.keys().collect::<Vec<_>>(),
        ["v1", "v2", "v3", "world"]
    );
    for (name, service) in &services {
        let words: Vec<&str> = service.command.iter().map(String::as_str).collect();
        assert_is_understood(&words);
        for file in words.iter().filter_map(|word| word.strip_prefix(INSTALLED)) {
            let mount = format!("./{file}:{INSTALLED}{file}:ro");
            assert!(
                service.volumes.contains(&mount),
                "{name} reads {file}, which is not mounted"
            );
            text(&format!("deploy/compose/{file}"));
        }
    }
}

#[test]
fn the_agents_of_the_test_bed_fit_its_world() {
    let world = Scenario::parse(&text("deploy/compose/world.toml"), "world.toml").unwrap();
    let services = services();
    let fly = &services["world"].command;
    let value_of = |option: &str| -> Vec<&str> {
        let pairs = fly.windows(2).filter(|pair| pair[0] == option);
        pairs.map(|pair| pair[1].as_str()).collect()
    };
    for vehicle in world.team.vehicles() {
        let name = vehicle.name.as_str();
        let agent = settings(&format!("deploy/compose/{name}.toml"));
        assert_eq!(agent.vehicle.vehicle.as_str(), name);
        assert_eq!(value_of("--fleet"), [agent.fleet.as_str()], "{name}");
        assert!(agent.faults.is_some(), "{name} must obey the world's radio");
        let sensors: Vec<&str> = agent.drivers.keys().map(Name::as_str).collect();
        assert_eq!(sensors, ["odometry", "relative"], "{name}");
        assert_eq!(agent.network.listen, [format!("{name}:7447")]);
        assert_eq!(
            agent.network.connect,
            value_of("--connect"),
            "everybody dials everybody"
        );
        let Start::Pose(start) = agent.vehicle.start else {
            panic!("{name} has no start pose");
        };
        let truth = vehicle.trajectory.pose_at(0.0);
        let start = start.world_from_body;
        let apart_m = (start.translation - truth.translation.vector).norm();
        let turned_rad = start.rotation.angle_to(&truth.rotation);
        assert!(
            apart_m < 1e-9 && turned_rad < 1e-9,
            "{name} starts elsewhere than its world says"
        );
    }
    assert_eq!(world.team.len() + 1, services.len());
}

#[test]
fn the_example_configuration_can_be_used() {
    settings("agent/examples/skein.toml");
}

#[test]
fn both_ways_to_an_image_pack_the_same_programs() {
    for way in ["deploy/compose/Dockerfile", "deploy/compose/build-image.sh"] {
        let text = text(way);
        let packed = ["target/release/skein ", "target/release/skein-sim"];
        assert!(packed.iter().all(|program| text.contains(program)), "{way}");
    }
}

#[test]
fn continuous_integration_runs_the_tests_that_the_readme_runs() {
    let readme = std::fs::read_to_string(Path::new(ROOT).join("README.md")).unwrap_or_default();
    let run = text(".ci/run");
    let ours = "cargo test --release --workspace --locked";
    assert!(run.lines().any(|line| line == ours));
    let told = readme
        .lines()
        .map(str::trim)
        .filter(|line| line.starts_with("cargo test --release --workspace"));
    for command in told {
        assert!(command.starts_with(ours), "README.md says {command}");
    }
}

/// One service of the compose file.
#[derive(Default)]
struct Service {
    command: Vec<String>,
    volumes: Vec<String>,
}

/// The services of the compose file, which writes each list on one line, as JSON.
fn services() -> BTreeMap<String, Service> {
    let file = text("deploy/compose/docker-compose.yml");
    let part = file
        .split("\nservices:\n")
        .nth(1)
        .unwrap()
        .split("\nnetworks:\n")
        .next()
        .unwrap();
    let mut services: BTreeMap<String, Service> = BTreeMap::new();
    let mut name = String::new();
    for line in part.lines().filter(|line| !line.is_empty()) {
        let (key, value) = line.split_once(':').unwrap();
        let list = || -> Vec<String> { serde_json::from_str(value).unwrap() };
        match key {
            "    command" => services.entry(name.clone()).or_default().command = list(),
            "    volumes" => services.entry(name.clone()).or_default().volumes = list(),
            _ if !key.starts_with("   ") => name = key.trim().to_owned(),
            _ => {}
        }
    }
    services
}

/// Fails unless the program has such a command, and the command such options: each command is a file, and each of its
/// options a field.
fn assert_is_understood(words: &[&str]) {
    let [program, command, arguments @ ..] = words else {
        panic!("no command in {words:?}");
    };
    let (manifest, commands) = match program.rsplit('/').next().unwrap() {
        "skein" => ("agent/Cargo.toml", "agent/src/command"),
        "skein-sim" => ("simworld/Cargo.toml", "simworld/src/bin/skein-sim"),
        other => panic!("there is no program {other}"),
    };
    let binary = format!(
        "[[bin]]\nname = {:?}\n",
        program.rsplit('/').next().unwrap()
    );
    assert!(
        text(manifest).contains(&binary),
        "{manifest} has no {program}"
    );
    let source = text(&format!("{commands}/{command}.rs"));
    for option in arguments.iter().filter_map(|word| word.strip_prefix("--")) {
        let field = format!("    {}: ", option.replace('-', "_"));
        assert!(
            source.lines().any(|line| line.starts_with(&field)),
            "{program} {command} has no option --{option}"
        );
    }
}

/// A configuration as the agent reads it.
fn settings(path: &str) -> Settings {
    config::load(&Path::new(ROOT).join(path)).unwrap_or_else(|error| panic!("{path}: {error}"))
}

fn text(path: &str) -> String {
    std::fs::read_to_string(Path::new(ROOT).join(path))
        .unwrap_or_else(|error| panic!("{path}: {error}"))
}
