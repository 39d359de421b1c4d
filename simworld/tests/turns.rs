//! A live flight whose vehicles take turns: the world lets none move that may not.
#![cfg(feature = "live")]
#![allow(clippy::unwrap_used)]

use std::process::Command;

/// Three vehicles that go round in 10 s, 0.63 m/s each, and see each other's poses.
const SCENARIO: &str = r#"
name = "turns"
description = "Three vehicles that take turns to move"
duration_s = 20.0
period_s = 0.2
standstill_s = 2.0
seed = 1
schedule = SCHEDULE

[[team.vehicles]]
trajectory.circle = { centre_m = [0, 0, 0], radius_m = 1, period_s = 10 }

[[team.vehicles]]
trajectory.circle = { centre_m = [3, 0, 0], radius_m = 1, period_s = 10 }

[[team.vehicles]]
trajectory.circle = { centre_m = [0, 3, 0], radius_m = 1, period_s = 10 }

[sensor]
kind = "pose"
range_m = 20.0
noise = { rotation_concentration = 10_000, translation_std_m = 0.02 }

[odometry]
rotation_concentration = 250_000
translation_std_m = 0.01
"#;

/// How fast the vehicles moved in the mean of so many seconds, metres a second, all together.
fn speed_m_s(schedule: bool, duration_s: f64) -> f64 {
    let name = format!("skein-turns-{schedule}-{}.toml", std::process::id());
    let file = std::env::temp_dir().join(name);
    std::fs::write(&file, SCENARIO.replace("SCHEDULE", &schedule.to_string())).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_skein-sim"))
        .args(["fly", "--json", "--duration", &duration_s.to_string()])
        .arg(&file)
        .output()
        .unwrap();
    std::fs::remove_file(&file).unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{errors}");
    let result: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let vehicles = result["vehicles"].as_array().unwrap();
    let paths_m = vehicles
        .iter()
        .map(|vehicle| vehicle["path_m"].as_f64().unwrap());
    paths_m.sum::<f64>() / duration_s
}

#[test]
fn over_zenoh_too_a_vehicle_stands_while_it_is_another_s_turn() {
    // A round of turns takes 4 s, and the first whole one may begin as late as that.
    let free_m_s = speed_m_s(false, 4.0);
    let in_turns_m_s = speed_m_s(true, 20.0);
    assert!(in_turns_m_s > 0.0, "nobody's turn comes");
    assert!(
        in_turns_m_s < 0.6 * free_m_s,
        "{in_turns_m_s:.2} of {free_m_s:.2} m/s: one of three at a time"
    );
}
