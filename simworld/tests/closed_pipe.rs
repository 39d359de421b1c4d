//! A reader that has had enough, as `head` has, ends `skein-sim` without a complaint.
#![allow(clippy::unwrap_used)]

use std::process::{Command, Stdio};

#[test]
fn results_that_nobody_reads_are_no_failure() {
    let folder = std::env::temp_dir().join(format!("skein-sim-unread-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    for experiment in [
        "experiment modes --samples 2",
        "experiment modes --samples 2 --json",
        "experiment cooperative --samples 2 --solver-only",
        "experiment cooperative --samples 2 --solver-only --json",
    ] {
        let mut running = Command::new(env!("CARGO_BIN_EXE_skein-sim"))
            .args(experiment.split_whitespace())
            .current_dir(&folder)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        // Nobody reads from here on, long before the first flight has landed.
        drop(running.stdout.take());
        let ended = running.wait_with_output().unwrap();
        let errors = String::from_utf8_lossy(&ended.stderr);
        assert!(
            ended.status.success() && errors.is_empty(),
            "skein-sim {experiment}: {}: {errors}",
            ended.status
        );
    }
    std::fs::remove_dir_all(&folder).unwrap();
}
