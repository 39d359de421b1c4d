//! Scores of made-up teams with known answers, and two trajectories scored by others before.

use super::*;
use crate::datasets;
use crate::truth::pose_from_euler;
use crate::tum;

fn planar(x: f64, y: f64, yaw_rad: f64) -> Pose {
    pose_from_euler(Vector3::new(x, y, 0.0), yaw_rad, 0.0, 0.0)
}

fn scored(truth: Pose, estimate: Pose) -> Option<Scored> {
    Some(Scored { truth, estimate })
}

#[test]
fn a_team_that_drifted_as_one_has_an_absolute_error_but_no_error_of_shape() {
    let drift = planar(2.0, -1.0, 0.3);
    let truths = [
        planar(0.0, 0.0, 0.1),
        planar(3.0, 0.0, 2.0),
        planar(0.0, 4.0, -3.0),
    ];
    let instant: Vec<_> = truths
        .iter()
        .map(|truth| scored(*truth, drift * truth))
        .collect();
    for space in [Space::Planar, Space::Spatial] {
        let score = score_team(std::slice::from_ref(&instant), space).unwrap();
        assert!(
            score.position_rmse_m > 1.0
                && score.instant_rmse_m < 1e-9
                && score.relative_rmse_m < 1e-9
        );
        assert!(
            (score.heading_rmse_rad - 0.3).abs() < 1e-9
                && (score.orientation_rmse_rad - 0.3).abs() < 1e-9
        );
        assert_eq!(score.n_poses, 3);
    }
}

#[test]
fn two_vehicles_give_what_a_calculation_by_hand_gives() {
    // The second is estimated 1 m too far out on the line between them: 0.5 m each after alignment; relative 1 m
    // each way; absolute 0 and 1.
    let instant = vec![
        scored(planar(0.0, 0.0, 0.0), planar(0.0, 0.0, 0.0)),
        None,
        scored(planar(2.0, 0.0, 0.0), planar(3.0, 0.0, 0.0)),
    ];
    let score = score_team(&[instant], Space::Planar).unwrap();
    assert!((score.position_rmse_m - 0.5_f64.sqrt()).abs() < 1e-12);
    assert!((score.position_mean_m - 0.5).abs() < 1e-12);
    assert!((score.instant_rmse_m - 0.5).abs() < 1e-12);
    assert!((score.relative_rmse_m - 1.0).abs() < 1e-12);
}

#[test]
fn a_wrong_heading_shows_in_the_relative_error_with_its_lever_arm() {
    let instant = vec![
        scored(planar(0.0, 0.0, 0.0), planar(0.0, 0.0, 0.2)),
        scored(planar(2.0, 0.0, 0.0), planar(2.0, 0.0, 0.0)),
    ];
    let score = score_team(&[instant], Space::Planar).unwrap();
    // Only the first one's frame is turned: a chord of 0.2 rad at 2 m in one of the two ordered pairs.
    let chord_m = 2.0 * 2.0 * 0.1_f64.sin();
    assert!((score.relative_rmse_m - chord_m / 2_f64.sqrt()).abs() < 1e-12);
    assert!(score.instant_rmse_m < 1e-12);
}

#[test]
fn headings_are_compared_across_the_seam() {
    let instant = vec![scored(planar(0.0, 0.0, 3.1), planar(0.0, 0.0, -3.1))];
    let score = score_team(&[instant], Space::Planar).unwrap();
    assert!((score.heading_rmse_rad - (std::f64::consts::TAU - 6.2)).abs() < 1e-9);
    assert!(score.instant_rmse_m.is_nan());
}

#[test]
fn nothing_to_score_is_no_score() {
    assert_eq!(score_team(&[vec![None, None]], Space::Planar), None);
    assert_eq!(absolute_trajectory_error(&[], &[], 0.01), None);
}

#[test]
fn real_trajectories_have_the_error_that_another_program_finds() {
    let Some(folder) = datasets::find("evo") else {
        return;
    };
    let read = |name: &str| {
        tum::parse(&std::fs::read_to_string(folder.join(name)).unwrap(), name).unwrap()
    };
    let known = [
        (
            "fr2_desk_groundtruth.txt",
            "fr2_desk_ORB.txt",
            0.00812,
            2174,
        ),
        (
            "freiburg1_xyz-groundtruth.txt",
            "freiburg1_xyz-rgbdslam.txt",
            0.01347,
            785,
        ),
    ];
    for (truth, estimate, rmse_m, n_matches) in known {
        let score = absolute_trajectory_error(&read(truth), &read(estimate), 0.01).unwrap();
        println!("{estimate}: {score:?}");
        assert_eq!(score.n_matches, n_matches, "{estimate}");
        assert!(
            (score.rmse_m - rmse_m).abs() < 6e-6,
            "{estimate}: {score:?}"
        );
    }
}
