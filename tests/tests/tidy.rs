//! House rules that no compiler checks: every file says what it is, nobody reads a clock inside, no text names what is
//! not there.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/..");

/// Where time is an argument: the wire, the estimators, the vehicle, and the simulator's library.
const TIMELESS: [&str; 4] = [
    "proto/src",
    "agent/estimation/src",
    "agent/vehicle/src",
    "simworld/src",
];
/// The simulator's programs fly live and may wait.
const TIMELESS_BUT: &str = "simworld/src/bin";

#[test]
fn every_source_file_says_what_it_is() {
    let mute = sources()
        .into_iter()
        .filter(|(_, text)| !text.starts_with("//! "));
    let paths: Vec<String> = mute.map(|(path, _)| path).collect();
    assert!(
        paths.is_empty(),
        "these open without a `//!` sentence: {paths:#?}"
    );
}

#[test]
fn no_file_is_named_for_nothing() {
    for (path, _) in sources() {
        let stem = Path::new(&path).file_stem().unwrap().to_str().unwrap();
        let vague = ["util", "utils", "common", "helper", "helpers", "misc"].contains(&stem);
        assert!(!vague, "{path}: name it for what it holds");
    }
}

#[test]
fn no_test_is_switched_off_and_nothing_is_left_to_do() {
    // Written in two halves, so that this file does not find itself.
    let forbidden = [("#[", "ignore"), ("to", "do!("), ("unimple", "mented!(")];
    for (path, text) in sources() {
        for (one, two) in forbidden {
            let word = [one, two].concat();
            assert!(
                !text.contains(&word),
                "{path}: {word} is no way to leave something"
            );
        }
    }
}

#[test]
fn nobody_inside_reads_a_clock() {
    for (path, text) in sources() {
        let is_timeless = TIMELESS.iter().any(|folder| path.starts_with(folder))
            && !path.starts_with(TIMELESS_BUT);
        let reads = [
            "SystemTime::now",
            "Instant::now",
            "UNIX_EPOCH",
            "thread::sleep",
        ];
        let found = reads
            .iter()
            .find(|word| is_timeless && text.contains(**word));
        assert!(
            found.is_none(),
            "{path}: {found:?}, but here time is an argument"
        );
    }
}

#[test]
fn truth_and_sensors_use_a_second_opinion_on_geometry() {
    let simulated =
        ["truth", "trajectory", "sensor"].map(|module| format!("simworld/src/{module}"));
    let mut files = 0;
    for (path, text) in sources() {
        if simulated.iter().any(|module| path.starts_with(module)) {
            files += 1;
            assert!(
                !text.contains("skein_estimation"),
                "{path}: a sign error of the estimators must not be repeated here"
            );
        }
    }
    assert!(
        files > 10,
        "the simulator's modules have moved: this test looks at {files} files"
    );
}

#[test]
fn scenarios_that_the_readme_flies_are_there() {
    let readme = std::fs::read_to_string(Path::new(ROOT).join("README.md")).unwrap_or_default();
    let words: Vec<&str> = readme.split_whitespace().collect();
    let flown = words
        .windows(2)
        .filter(|pair| pair[0] == "fly")
        .map(|pair| pair[1]);
    let name = |word: &str| word.trim_matches(['`', '.', ',', ';', ':']).to_owned();
    let is_a_name = |word: &str| {
        word.contains('-')
            && !word.starts_with('-')
            && word.chars().all(|c| c.is_ascii_lowercase() || c == '-')
    };
    for scenario in flown.map(name).filter(|word| is_a_name(word)) {
        let file = Path::new(ROOT).join(format!("simworld/scenarios/{scenario}.toml"));
        assert!(
            file.is_file(),
            "README.md flies {scenario}, which is not built in"
        );
    }
}

#[test]
fn files_that_the_documents_name_are_there() {
    let documents = ["ARCHITECTURE.md", "README.md", "ZENOH_API.md"];
    for document in documents {
        let text = std::fs::read_to_string(Path::new(ROOT).join(document)).unwrap_or_default();
        for path in text
            .split('`')
            .skip(1)
            .step_by(2)
            .filter(|quoted| is_a_path(quoted))
        {
            assert!(
                Path::new(ROOT).join(path).exists(),
                "{document} names {path}, which is not there"
            );
        }
    }
}

/// Whether a text in backticks is a path from the root of the project.
fn is_a_path(quoted: &str) -> bool {
    let roots = [".ci/", "agent/", "deploy/", "proto/", "simworld/", "tests/"];
    roots.iter().any(|root| quoted.starts_with(root))
        && !quoted.contains(|c: char| " *{<".contains(c))
}

/// All Rust files of the project: paths from its root, with their texts.
fn sources() -> Vec<(String, String)> {
    let mut folders = vec![PathBuf::from(ROOT)];
    let mut files = Vec::new();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_str().unwrap();
            let is_ours = !name.starts_with('.') && name != "target";
            if path.is_dir() && is_ours {
                folders.push(path);
            } else if name.ends_with(".rs") {
                let from_root = path
                    .strip_prefix(ROOT)
                    .unwrap()
                    .to_str()
                    .unwrap()
                    .to_owned();
                files.push((from_root, std::fs::read_to_string(&path).unwrap()));
            }
        }
    }
    assert!(files.len() > 50, "only {} source files found", files.len());
    files.sort();
    files
}
