//! Levelling on real recordings where they are, and on a virtual flight.

use super::simulated::{CASES, run};
use super::*;
use crate::datasets;

fn reaches_its_goal(result: &RecordingResult) {
    let goal = result.goal_rmse_deg.unwrap();
    assert!(result.tilt.rmse_deg <= goal, "{result:?}");
}

#[test]
fn a_hand_held_sensor_is_levelled_as_well_as_the_better_gain_in_every_trial() {
    let Some(folder) = datasets::find("broad") else {
        return;
    };
    let trials = datasets::read_broad(&folder).unwrap();
    assert_eq!(trials.len(), 4);
    for (name, readings) in &trials {
        let result = level(name, readings, &Settings::standard()).unwrap();
        reaches_its_goal(&result);
        let best = result.fixed_gain.iter().map(|fixed| fixed.rmse_deg);
        assert!(
            result.tilt.rmse_deg < best.fold(f64::MAX, f64::min),
            "{result:?}"
        );
    }
}

#[test]
fn a_flying_quadrotor_is_levelled_although_its_gyro_is_biased_by_four_degrees_a_second() {
    let Some(folder) = datasets::find("euroc_v1_01") else {
        return;
    };
    let flight = datasets::read_euroc(&folder).unwrap();
    let mut settings = Settings::standard();
    reaches_its_goal(&level(EUROC, &flight.readings, &settings).unwrap());
    settings.force.bias_m_s2 = flight.force_bias_m_s2;
    reaches_its_goal(&level(EUROC_CALIBRATED, &flight.readings, &settings).unwrap());
}

#[test]
fn a_virtual_quadrotor_is_levelled_with_and_without_a_bias() {
    for case in &CASES[..2] {
        let result = run(case, 1, 11, || {});
        assert!(result.mean_deg < 0.4, "{result:?}");
        assert!((result.gain - 1.0).abs() < 0.03, "{result:?}");
    }
}

#[test]
fn nothing_to_score_is_no_score() {
    assert!(level("", &[], &Settings::standard()).is_none());
}
