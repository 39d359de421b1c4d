//! How a pair finds each other, and what dies with a track.

use super::*;
use crate::mutual::direction::{azimuth_rad, turned, zenith_rad};
use crate::mutual::identity::flight::Flight;
use nalgebra::UnitVector3;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

const TEAM: [[f64; 3]; 3] = [[0.0, 0.0, 2.0], [3.0, -1.0, 3.0], [1.0, 3.0, 1.5]];

/// What a robot sees of all others, in its gyro frame.
fn sights(flight: &Flight, observer: usize, t_s: f64) -> Vec<Sight> {
    let others = (0..TEAM.len()).filter(|other| *other != observer);
    others
        .map(|other| {
            let level =
                UnitVector3::new_normalize(flight.relative(observer, other, t_s).position_m);
            let gyro = turned(&level, flight.inertial(observer, t_s).yaw_rad);
            Sight {
                azimuth_rad: azimuth_rad(&gyro),
                zenith_rad: zenith_rad(&gyro),
                variance_rad2: 0.05 * 0.05,
            }
        })
        .collect()
}

fn side<'a>(sights: &'a [Sight], before: &'a [Option<usize>]) -> Side<'a> {
    Side {
        sights,
        before,
        crossings: &[],
    }
}

fn total(model: &PairModel) -> f64 {
    model.yaw().iter().sum()
}

#[test]
fn a_pair_that_moves_finds_each_other_and_the_yaw_between_their_gyro_frames() {
    let flight = Flight::new(&TEAM, 3, 0.0, ChaCha8Rng::seed_from_u64(0));
    let mut model = PairModel::new();
    let none = vec![None; 2];
    let same = vec![Some(0), Some(1)];
    for epoch in 0..40 {
        let t_s = 0.25 * f64::from(epoch);
        let before = if epoch == 0 { &none } else { &same };
        let (first, second) = (sights(&flight, 1, t_s), sights(&flight, 2, t_s));
        model.step(
            &side(&first, before),
            &side(&second, before),
            [&[1.0; 2], &[1.0; 2]],
            true,
        );
        assert!((total(&model) - 1.0).abs() < 1e-9);
    }
    // Of robot 1's lanes (0, 2) the second is robot 2; of robot 2's lanes (0, 1) the second is robot 1.
    let [of_first, of_second] = model.lanes(&[1.0; YAW_BINS]);
    assert!(
        of_first[1] > 0.9 && of_second[1] > 0.9,
        "{of_first:?} {of_second:?}"
    );
    let yaw = model.yaw();
    let likeliest = (0..YAW_BINS)
        .max_by(|a, b| yaw[*a].total_cmp(&yaw[*b]))
        .expect("there are bins");
    // At 0 s gyro frames are level frames.
    let truth_rad = flight.relative(1, 2, 0.0).yaw_rad;
    assert!(wrapped(likeliest as f64 * YAW_BIN_RAD - truth_rad).abs() <= YAW_BIN_RAD);
}

#[test]
fn a_track_that_dies_takes_its_identity_along_but_not_the_yaw() {
    let flight = Flight::new(&TEAM, 3, 0.0, ChaCha8Rng::seed_from_u64(0));
    let mut model = PairModel::new();
    let same = vec![Some(0), Some(1)];
    model.take_over(&[None, None], &[None, None]);
    for epoch in 0..40 {
        let t_s = 0.25 * f64::from(epoch);
        let (first, second) = (sights(&flight, 1, t_s), sights(&flight, 2, t_s));
        model.step(
            &side(&first, &same),
            &side(&second, &same),
            [&[1.0; 2], &[1.0; 2]],
            true,
        );
    }
    let yaw = model.yaw();
    model.take_over(&[Some(0)], &[Some(0), Some(1)]);
    assert!(
        model
            .yaw()
            .iter()
            .zip(yaw)
            .all(|(after, before)| (after - before).abs() < 1e-12)
    );
    let [of_first, _] = model.lanes(&[1.0; YAW_BINS]);
    assert!(of_first[0] < 0.1, "{of_first:?}");
}

#[test]
fn sights_that_are_no_numbers_leave_probabilities() {
    let mut model = PairModel::new();
    let broken = [Sight {
        azimuth_rad: f64::NAN,
        zenith_rad: f64::NAN,
        variance_rad2: 1e-3,
    }];
    for _ in 0..3 {
        model.step(
            &side(&broken, &[None]),
            &side(&broken, &[None]),
            [&[1.0], &[1.0]],
            true,
        );
        assert!((total(&model) - 1.0).abs() < 1e-9);
    }
}

/// A pair of vehicles 1 and 2 of the team that has found each other.
fn found() -> (Flight, PairModel) {
    let flight = Flight::new(&TEAM, 3, 0.0, ChaCha8Rng::seed_from_u64(0));
    let mut model = PairModel::new();
    model.take_over(&[None, None], &[None, None]);
    for epoch in 0..40 {
        let t_s = 0.25 * f64::from(epoch);
        see(&flight, &mut model, t_s, &[], [&[1.0; 2], &[1.0; 2]], true);
    }
    (flight, model)
}

fn see(
    flight: &Flight,
    model: &mut PairModel,
    t_s: f64,
    crossings: &[(usize, usize, f64)],
    exclusive: [&[f64]; 2],
    evidence: bool,
) {
    let same = [Some(0), Some(1)];
    let (first, second) = (sights(flight, 1, t_s), sights(flight, 2, t_s));
    let first = Side {
        crossings,
        ..side(&first, &same)
    };
    model.step(&first, &side(&second, &same), exclusive, evidence);
}

#[test]
fn tracks_that_cross_may_have_been_swapped() {
    let variance_rad2 = 0.01;
    assert!((crossing(0.0, variance_rad2) - CROSSING_MIXED).abs() < 1e-12);
    assert!(crossing(0.09, variance_rad2) < 0.02 * CROSSING_MIXED);
    let (flight, model) = found();
    let of_other = |crossings: &[(usize, usize, f64)]| {
        let mut model = model.clone();
        see(
            &flight,
            &mut model,
            10.0,
            crossings,
            [&[1.0; 2], &[1.0; 2]],
            false,
        );
        model.lanes(&[1.0; YAW_BINS])[0][0]
    };
    assert!(of_other(&[(0, 1, 0.15)]) > of_other(&[]) + 0.1);
}

#[test]
fn a_track_that_is_somebody_else_already_is_less_likely_this_one() {
    let (flight, model) = found();
    let likely = |exclusive: f64| {
        let mut model = model.clone();
        see(
            &flight,
            &mut model,
            10.0,
            &[],
            [&[1.0, exclusive], &[1.0; 2]],
            true,
        );
        model.lanes(&[1.0; YAW_BINS])[0][1]
    };
    assert!(likely(0.05) < likely(1.0) - 0.02);
}

#[test]
fn without_a_sign_identity_fades_and_the_yaw_spreads() {
    let (flight, mut model) = found();
    let likely = |model: &PairModel| model.lanes(&[1.0; YAW_BINS])[0][1];
    let peak = |model: &PairModel| {
        let yaw = model.yaw();
        let best = (0..YAW_BINS).max_by(|a, b| yaw[*a].total_cmp(&yaw[*b]));
        let best = best.expect("there are bins");
        let beside = yaw[(best + 1) % YAW_BINS] + yaw[(best + YAW_BINS - 1) % YAW_BINS];
        beside / yaw[best]
    };
    let (before, narrow) = (likely(&model), peak(&model));
    for _ in 0..40 {
        see(
            &flight,
            &mut model,
            10.0,
            &[],
            [&[1.0; 2], &[1.0; 2]],
            false,
        );
    }
    assert!(before > 0.9 && likely(&model) < 0.65, "{}", likely(&model));
    assert!(peak(&model) > narrow + 0.1, "{narrow} {}", peak(&model));
}

#[test]
fn what_another_says_of_the_yaw_says_which_track_it_is() {
    let (_, model) = found();
    let yaw = model.yaw();
    let elsewhere: YawBelief = yaw.map(|mass| if mass > 1e-2 { 1e-6 } else { 1.0 });
    let [of_first, _] = model.lanes(&elsewhere);
    assert!(of_first[1] < 0.7, "{of_first:?}");
}

#[test]
fn who_looks_up_at_one_that_looks_up_looks_at_somebody_else() {
    let mut model = PairModel::new();
    let up = [Sight {
        azimuth_rad: 0.3,
        zenith_rad: 1.2,
        variance_rad2: 0.05 * 0.05,
    }];
    model.take_over(&[None], &[None]);
    for _ in 0..20 {
        let same = [Some(0)];
        model.step(&side(&up, &same), &side(&up, &same), [&[1.0], &[1.0]], true);
    }
    let [of_first, _] = model.lanes(&[1.0; YAW_BINS]);
    assert!(of_first[0] < 0.7, "{of_first:?}");
}

#[test]
fn who_comes_back_is_rather_what_has_just_come_into_sight() {
    let old = reacquired(&[YOUNG_EPOCHS, YOUNG_EPOCHS - 1]);
    assert!((old[1] - 0.5 * REACQUIRED).abs() < 1e-12);
    assert!((old[0] - REACQUIRED_OLD * old[1]).abs() < 1e-12);
    assert!(reacquired(&[]).is_empty());
    let mut model = PairModel::new();
    model.grow_older([&[None, None], &[]]);
    for _ in 0..300 {
        model.grow_older([&[Some(0), Some(1)], &[]]);
    }
    model.grow_older([&[Some(1), None], &[]]);
    assert_eq!(model.ages[0], [u8::MAX, 0]);
}
