//! What a calibration does to commands and readings, and dead reckoning on the real recording.

use super::*;
use crate::datasets;
use crate::evaluation::{Scored, Space, TeamScore, score_team};
use crate::mrclam::Recording;
use std::f64::consts::FRAC_PI_2;

const SECOND: i64 = 1_000_000_000;

/// Found on another recording of the same robots; an example of a user's file, good for these robots only.
const THESE_ROBOTS: &str = "
    turn_scale = 0.947
    turn_bias_radps = -0.0023
    speed_scale_straight = 1.045
    speed_scale_turning = 0.685
    turning_above_radps = 0.1
    command_lag_s = 0.22
    camera_lag_s = 0.05
    range_bias_m = 0.035

    [noise]
    yaw_rad_per_root_s = 0.010
    yaw_rad_per_root_rad = 0.085
    along_m_per_root_s = 0.0065
    range_m = 0.12
    bearing_rad = 0.015
";

fn command(time_s: i64, forward_mps: f64, turn_radps: f64) -> Command {
    Command {
        time_ns: time_s * SECOND,
        forward_mps,
        turn_radps,
    }
}

#[test]
fn a_command_holds_until_the_next_and_before_the_first_the_robot_stands() {
    // Stands for 2 s, goes 1 m ahead in 2 s, turns left on the spot by a right angle in 1 s, then 0.5 m ahead.
    let commands = [
        command(2, 0.5, 0.0),
        command(4, 0.0, FRAC_PI_2),
        command(5, 0.5, 0.0),
    ];
    let whole = Calibration::default().increment(&commands, 0, 6 * SECOND);
    let end = whole.earlier_from_later;
    assert!(
        (end.translation.vector - Vector3::new(1.0, 0.5, 0.0)).norm() < 1e-12,
        "{end}"
    );
    assert!((whole.yaw_rad - FRAC_PI_2).abs() < 1e-12);
}

#[test]
fn increments_of_any_cut_compose_to_the_same_motion() {
    let commands = [
        command(1, 0.3, 0.2),
        command(3, 0.1, -0.7),
        command(4, 0.4, 0.0),
    ];
    let calibration = Calibration::parse(THESE_ROBOTS).unwrap();
    let whole = calibration.increment(&commands, 0, 7 * SECOND);
    let mut pieces = Pose::identity();
    let mut yaw_variance = 0.0;
    for k in 0..70 {
        let piece = calibration.increment(&commands, k * SECOND / 10, (k + 1) * SECOND / 10);
        pieces *= piece.earlier_from_later;
        yaw_variance += piece.yaw_std_rad.powi(2);
    }
    assert!(
        (pieces.translation.vector - whole.earlier_from_later.translation.vector).norm() < 1e-9
    );
    assert!((yaw_variance.sqrt() - whole.yaw_std_rad).abs() < 1e-12);
}

#[test]
fn a_quarter_circle_to_the_left_ends_ahead_and_to_the_left() {
    let quarter = arc(FRAC_PI_2 * 2.0, FRAC_PI_2);
    assert!((quarter.translation.vector - Vector3::new(2.0, 2.0, 0.0)).norm() < 1e-12);
    // The series and the quotient agree where they meet.
    let (below, above) = (arc(1.0, 0.99e-4), arc(1.0, 1.01e-4));
    assert!((below.translation.vector - above.translation.vector).norm() < 2e-6);
}

#[test]
fn scales_biases_and_lags_act_as_their_names_say() {
    let calibration = Calibration::parse(THESE_ROBOTS).unwrap();
    let straight = calibration.increment(&[command(0, 0.1, 0.0)], 0, 10 * SECOND);
    assert!((straight.yaw_rad + 0.0023 * 9.78).abs() < 1e-9);
    assert!(
        (straight.earlier_from_later.translation.vector.norm() - 1.0 * 1.045 * 0.978).abs() < 1e-4
    );
    let turning = calibration.increment(&[command(0, 0.1, -0.2)], SECOND, 2 * SECOND);
    assert!((turning.yaw_rad - (-0.2 * 0.947 - 0.0023)).abs() < 1e-12);
    let standing = calibration.increment(&[command(0, 0.0, 0.0)], SECOND, 2 * SECOND);
    assert_eq!(standing.earlier_from_later, Pose::identity());
    let reading = RangeBearing {
        time_ns: SECOND,
        subject: Subject::Robot(1),
        range_m: 2.0,
        bearing_rad: 0.3,
    };
    let calibrated = calibration.reading(&reading);
    assert_eq!(calibrated.time_ns, SECOND - SECOND / 20);
    assert!(
        (calibrated.range_m - 1.965).abs() < 1e-12 && (calibrated.range_std_m - 0.12).abs() < 1e-12
    );
}

#[test]
fn a_misspelt_key_is_refused() {
    let error = Calibration::parse("turn_scal = 1.0").unwrap_err();
    assert!(error.to_string().contains("turn_scal"));
}

/// Starts every robot from its truth at 10 s and scores all of them every 0.2 s wherever there is truth.
fn score_dead_reckoning(recording: &Recording, calibration: &Calibration) -> TeamScore {
    let gap_ns_max = SECOND / 2;
    let start_ns = recording.start_ns() + 10 * SECOND;
    let times_ns: Vec<i64> = (0..)
        .map(|k| start_ns + k * SECOND / 5)
        .take_while(|t| *t <= recording.end_ns())
        .collect();
    let tracks: Vec<Vec<Pose>> = recording
        .robots
        .iter()
        .map(|robot| {
            let start = robot.truth.pose_at(start_ns, gap_ns_max).unwrap();
            calibration.dead_reckoning(&robot.commands, &start, start_ns, times_ns.iter().copied())
        })
        .collect();
    let instants: Vec<Vec<Option<Scored>>> = times_ns
        .iter()
        .enumerate()
        .map(|(k, time_ns)| {
            let pair = |(robot, track): (&RobotRecord, &Vec<Pose>)| {
                let truth = robot.truth.pose_at(*time_ns, gap_ns_max)?;
                Some(Scored {
                    truth,
                    estimate: track[k],
                })
            };
            recording.robots.iter().zip(&tracks).map(pair).collect()
        })
        .collect();
    score_team(&instants, Space::Planar).unwrap()
}

#[test]
fn dead_reckoning_on_the_real_recording_is_as_bad_as_is_known() {
    let Some(folder) = datasets::find("mrclam6") else {
        return;
    };
    let recording = datasets::read_mrclam(&folder).unwrap();
    let recorded = score_dead_reckoning(&recording, &Calibration::default());
    let calibrated = score_dead_reckoning(&recording, &Calibration::parse(THESE_ROBOTS).unwrap());
    println!("as recorded {recorded:?}\ncalibrated {calibrated:?}");
    let is_near = |score: &TeamScore, known: [f64; 5]| {
        let found = [
            score.position_rmse_m,
            score.position_mean_m,
            score.heading_rmse_rad,
            score.instant_rmse_m,
            score.relative_rmse_m,
        ];
        found
            .iter()
            .zip(known)
            .all(|(found, known)| (found / known - 1.0).abs() < 0.015)
    };
    assert!(
        is_near(&recorded, [2.85, 2.10, 1.30, 1.74, 3.34]),
        "{recorded:?}"
    );
    assert!(
        is_near(&calibrated, [1.79, 1.42, 0.81, 1.45, 2.65]),
        "{calibrated:?}"
    );
}
