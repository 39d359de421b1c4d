//! Who may depend on whom, asked of Cargo itself: the invariants of absence that ARCHITECTURE.md promises.
#![allow(clippy::unwrap_used)]

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// What speaks to a network or waits for one.
const SHELL_CRATES: [&str; 3] = ["tokio", "zenoh", "skein-agent"];

#[test]
fn our_crates_depend_one_way() {
    let ours = declared(&metadata());
    let crates =
        |names: &[&str]| -> BTreeSet<String> { names.iter().map(ToString::to_string).collect() };
    let all_of = |name: &str| -> BTreeSet<String> {
        let dependencies = ours[name].iter().filter(|dependency| dependency.is_ours());
        dependencies
            .map(|dependency| dependency.name.clone())
            .collect()
    };
    assert_eq!(all_of("skein-proto"), crates(&[]));
    assert_eq!(all_of("skein-estimation"), crates(&[]));
    assert_eq!(
        all_of("skein-vehicle"),
        crates(&["skein-estimation", "skein-proto"])
    );
    assert_eq!(
        all_of("skein-agent"),
        crates(&["skein-estimation", "skein-proto", "skein-vehicle"])
    );
    assert_eq!(
        all_of("skein-simworld"),
        crates(&[
            "skein-agent",
            "skein-estimation",
            "skein-proto",
            "skein-vehicle"
        ])
    );
}

#[test]
fn the_simulator_knows_the_agent_and_its_network_only_on_request() {
    let ours = declared(&metadata());
    for name in SHELL_CRATES {
        let mut found = ours["skein-simworld"]
            .iter()
            .filter(|dependency| dependency.name == name);
        assert!(
            found.all(|dependency| dependency.optional),
            "simworld must name {name} as optional, behind its feature `live`"
        );
    }
    assert_links_none("skein-simworld", &["--no-default-features"], &SHELL_CRATES);
}

#[test]
fn only_the_agent_and_the_tests_name_zenoh_and_tokio() {
    for (name, dependencies) in declared(&metadata()) {
        let names_a_network = dependencies.iter().any(|dependency| {
            !dependency.optional && ["tokio", "zenoh"].contains(&dependency.name.as_str())
        });
        let may = ["skein-agent", "skein-tests"].contains(&name.as_str());
        assert!(may || !names_a_network, "{name} names Zenoh or tokio");
    }
}

#[test]
fn what_is_inside_the_shell_links_no_network() {
    for name in ["skein-proto", "skein-estimation", "skein-vehicle"] {
        assert_links_none(name, &[], &SHELL_CRATES);
    }
}

#[test]
fn the_estimators_link_neither_wire_nor_serialisation() {
    assert_links_none(
        "skein-estimation",
        &[],
        &["serde", "serde_core", "postcard", "skein-proto"],
    );
}

#[test]
fn the_wire_links_no_mathematics() {
    assert_links_none("skein-proto", &[], &["nalgebra", "skein-estimation"]);
}

#[test]
fn there_is_one_nalgebra() {
    let metadata = metadata();
    let packages = metadata["packages"].as_array().unwrap();
    let versions: Vec<&str> = packages
        .iter()
        .filter(|package| package["name"] == "nalgebra")
        .map(|package| package["version"].as_str().unwrap())
        .collect();
    assert_eq!(
        versions.len(),
        1,
        "nalgebra {versions:?}: matrices of two versions are two types"
    );
}

#[test]
fn programs_and_tests_share_one_build_of_zenoh() {
    let features = |edges: &str| -> BTreeSet<String> {
        let tree = cargo(&[
            "tree",
            "--workspace",
            "--edges",
            edges,
            "--prefix",
            "none",
            "--format",
            "{p}|{f}",
        ]);
        tree.lines()
            .map(|line| line.trim_end_matches(" (*)").to_owned())
            .collect()
    };
    let below = cargo(&[
        "tree",
        "--package",
        "zenoh",
        "--edges",
        "normal,build",
        "--prefix",
        "none",
        "--format",
        "{p}",
    ]);
    let below: BTreeSet<&str> = below
        .lines()
        .map(|line| line.trim_end_matches(" (*)"))
        .collect();
    let of_zenoh = |features: &BTreeSet<String>| -> BTreeSet<String> {
        let is_below = |line: &&String| below.contains(line.split('|').next().unwrap());
        features.iter().filter(is_below).cloned().collect()
    };
    let programs = of_zenoh(&features("normal,build"));
    let tests = of_zenoh(&features("normal,build,dev"));
    assert!(
        programs.len() > 100,
        "cargo tree shows {} crates below Zenoh",
        programs.len()
    );
    let differ: Vec<_> = programs.symmetric_difference(&tests).collect();
    assert!(
        differ.is_empty(),
        "other features in tests than in programs, so Zenoh is compiled twice: {differ:#?}"
    );
}

/// A dependency as a manifest declares it; development dependencies are not counted.
struct Declared {
    name: String,
    optional: bool,
}

impl Declared {
    fn is_ours(&self) -> bool {
        self.name.starts_with("skein-")
    }
}

/// What each of our crates declares, by its name.
fn declared(metadata: &Value) -> BTreeMap<String, Vec<Declared>> {
    let packages = metadata["packages"].as_array().unwrap();
    let ours = packages
        .iter()
        .filter(|package| package["source"].is_null());
    let declared = |package: &Value| -> Vec<Declared> {
        let dependencies = package["dependencies"].as_array().unwrap();
        let shipped = dependencies
            .iter()
            .filter(|dependency| dependency["kind"] != "dev");
        shipped
            .map(|dependency| Declared {
                name: dependency["name"].as_str().unwrap().to_owned(),
                optional: dependency["optional"].as_bool().unwrap(),
            })
            .collect()
    };
    ours.map(|package| {
        (
            package["name"].as_str().unwrap().to_owned(),
            declared(package),
        )
    })
    .collect()
}

/// Fails when a crate, with such features, links one of these in whatever way.
fn assert_links_none(name: &str, features: &[&str], forbidden: &[&str]) {
    let mut arguments = vec![
        "tree",
        "--package",
        name,
        "--edges",
        "normal",
        "--prefix",
        "none",
    ];
    arguments.extend(features);
    let tree = cargo(&arguments);
    let linked: BTreeSet<&str> = tree
        .lines()
        .filter_map(|line| line.split(' ').next())
        .collect();
    assert!(
        linked.contains(name),
        "cargo tree did not speak of {name}:\n{tree}"
    );
    for crate_name in forbidden {
        assert!(!linked.contains(crate_name), "{name} links {crate_name}");
    }
}

fn metadata() -> Value {
    let versions = cargo_without_workspace(&["-vV"]);
    let host = versions
        .lines()
        .find_map(|line| line.strip_prefix("host: "))
        .unwrap();
    // Of one platform: crates of the others have never been downloaded.
    let text = cargo(&[
        "metadata",
        "--format-version",
        "1",
        "--filter-platform",
        host,
    ]);
    serde_json::from_str(&text).unwrap()
}

/// Asks Cargo about this workspace, as locked and without the network.
fn cargo(arguments: &[&str]) -> String {
    cargo_without_workspace(&[arguments, &["--locked", "--offline"]].concat())
}

fn cargo_without_workspace(arguments: &[&str]) -> String {
    let program = std::env::var_os("CARGO").unwrap_or("cargo".into());
    let output = Command::new(program)
        .args(arguments)
        .current_dir(ROOT)
        .output()
        .unwrap();
    let complaint = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "cargo {arguments:?}: {complaint}");
    String::from_utf8(output.stdout).unwrap()
}
