//! Drones that find each other by distances.

use super::*;

fn flown(name: &str) -> CellResult {
    let cell = CELLS.iter().find(|cell| cell.name == name).unwrap();
    run(cell, 30, 1, || {})
}

#[test]
fn drones_that_climb_find_each_other_and_are_mostly_right() {
    let result = flown("climbing");
    assert!(result.ever > 0.9, "{result:?}");
    assert!(result.told.place > 0.5, "{result:?}");
    assert!(result.position_median_m < 0.7, "{result:?}");
    assert!((0.6..1.4).contains(&result.nees.median), "{result:?}");
    // Wrong today: to one pair in six another place is told at first, which the covariance does not cover.
    assert!((1..=6).contains(&result.wrong_pairs), "{result:?}");
    assert!(result.wrong < 0.1 && result.nees.mean > 2.0, "{result:?}");
}

#[test]
fn whether_the_other_is_above_or_below_is_not_told_while_neither_climbs() {
    let result = flown("each at its height");
    assert!(result.told.place < 0.1, "{result:?}");
    assert!(result.told.ambiguous > 0.8, "{result:?}");
}

#[test]
fn every_round_has_its_row_and_a_pair_that_was_told_nothing_has_no_error() {
    let told = [
        vec![Told::Nothing; ROUNDS],
        vec![
            Told::Place(Off {
                position_m: 4.0,
                yaw_rad: 0.1,
                nees: 2.0,
            });
            ROUNDS
        ],
    ];
    let result = CellResult::of(&CELLS[0], &told, 1);
    assert!((result.told.place - 0.5).abs() < 1e-12);
    assert!((result.position_mse_m2 - 16.0).abs() < 1e-12);
    assert_eq!((result.wrong_pairs, result.first_round), (1, 0.0));
    assert_eq!(report::csv(&[result]).lines().count(), 1 + ROUNDS);
}
