//! What `deploy/` starts exists: programs, their options, their configurations, and a world that fits its agents.
#![allow(clippy::unwrap_used)]

use serde_json::Value;
use skein_agent::{NetworkSettings, Settings, config};
use skein_proto::envelope::ENVELOPE_BYTES;
use skein_proto::keys::Key;
use skein_proto::limits::BACKLOG_BYTES_MAX;
use skein_proto::name::Name;
use skein_simworld::scenario::Scenario;
use skein_tests::stories::name;
use skein_vehicle::Start;
use std::collections::BTreeMap;
use std::path::Path;
use zenoh::key_expr::OwnedKeyExpr;

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

/// What the access rules of a secured fleet say of messages on keys, in one direction.
fn rule(access: &Value, id: &str) -> (Vec<OwnedKeyExpr>, Vec<String>) {
    let rules = access["rules"].as_array().unwrap();
    let rule = rules.iter().find(|rule| rule["id"] == id).unwrap();
    let texts = |of: &str| -> Vec<String> {
        let list = rule[of].as_array().unwrap().iter();
        list.map(|text| text.as_str().unwrap().to_owned()).collect()
    };
    let keys = texts("key_exprs").into_iter();
    (
        keys.map(|key| OwnedKeyExpr::new(key).unwrap()).collect(),
        texts("messages"),
    )
}

#[test]
fn the_access_rules_of_a_secured_fleet_let_everything_pass_that_vehicles_say_and_nothing_in_another_s_name()
 {
    let network = NetworkSettings {
        zenoh_config: Some(Path::new(ROOT).join("deploy/secured/zenoh.json5")),
        ..NetworkSettings::default()
    };
    assert!(network.is_secured().unwrap());
    let zenoh = network.zenoh().unwrap();
    let part =
        |key: &str| -> Value { serde_json::from_str(&zenoh.get_json(key).unwrap()).unwrap() };
    let access = part("access_control");
    assert_eq!(access["default_permission"], "deny");
    let (v1, v2) = (name("v1"), name("v2"));
    let said = |of| {
        let keys = [
            Key::Exchange {
                from: of,
                to: name("v3"),
            },
            Key::Odometry { from: of },
            Key::Backlog { of },
            Key::Relay { from: of },
            Key::Estimate { of },
            Key::Health { of },
            Key::Info { of },
            Key::Alive { of, boot: 7 },
        ];
        keys.map(|key| OwnedKeyExpr::new(key.in_fleet(name("skein"))).unwrap())
    };
    let covers = |rule: &[OwnedKeyExpr], key: &OwnedKeyExpr| rule.iter().any(|of| of.includes(key));
    let (own, messages) = rule(&access, "own-v1");
    assert!(said(v1).iter().all(|key| covers(&own, key)));
    assert!(!said(v2).iter().any(|key| covers(&own, key)));
    // Packets, answers to questions (a backlog among them), and the token.
    for message in ["put", "reply", "declare_queryable", "liveliness_token"] {
        assert!(messages.iter().any(|of| of == message), "{message}");
    }
    let (read, messages) = rule(&access, "read");
    assert!(
        said(v1)
            .iter()
            .chain(&said(v2))
            .all(|key| covers(&read, key))
    );
    for message in [
        "declare_subscriber",
        "query",
        "liveliness_query",
        "declare_liveliness_subscriber",
    ] {
        assert!(messages.iter().any(|of| of == message), "{message}");
    }
    // An operator's wishes and drivers' frames come from this vehicle's own machine, or need a rule of their own.
    let verb = Key::Rpc {
        on: v1,
        verb: name("set_pose"),
    }
    .in_fleet(name("skein"));
    assert!(!covers(&read, &OwnedKeyExpr::new(verb).unwrap()));

    // The longest packet of a backlog passes, and all packets of one answer together.
    let size = &part("low_pass_filter")[0]["size_limit"];
    assert!(size.as_u64().unwrap() as usize >= ENVELOPE_BYTES + BACKLOG_BYTES_MAX);
    for item in part("downsampling").as_array().unwrap() {
        let messages = item["messages"].as_array().unwrap();
        assert!(!messages.iter().any(|message| message == "reply"), "{item}");
    }
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
