//! The stories of stop and move.

mod pair;

use super::*;
use pair::Pair;
use std::f64::consts::FRAC_PI_2;

const NOISE: Noise = Noise {
    range_sigma_m: 0.1,
    translation_sigma_m: 0.05,
    rotation_sigma_rad: 0.01,
};
const NO_NOISE: Noise = Noise {
    range_sigma_m: 0.0,
    translation_sigma_m: 0.0,
    rotation_sigma_rad: 0.0,
};

fn turtle(x_m: f64, y_m: f64, rotation_rad: f64) -> Turtle {
    Turtle {
        translation_m: Vector2::new(x_m, y_m),
        rotation_rad,
    }
}

#[test]
fn three_four_five_makes_a_right_triangle_with_the_neighbour_on_either_side() {
    // From (0, 0) to (3, 0), turning left by 90 deg; the neighbour at (0, 4) or (0, -4).
    let triangle = Triangle::new(&turtle(3.0, 0.0, FRAC_PI_2), 4.0, 5.0);
    assert!((triangle.before_rad - FRAC_PI_2).abs() < 1e-12);
    assert!((triangle.apex_rad - (3.0_f64 / 5.0).asin()).abs() < 1e-12);
    for flip in [1.0, -1.0] {
        assert!((triangle.bearing_before(flip) - flip * FRAC_PI_2).abs() < 1e-12);
        // From (3, 0), looking along y.
        let seen = 5.0 * ahead(triangle.bearing_after(flip));
        let truth = Vector2::new(4.0 * flip, 3.0);
        assert!((seen - truth).norm() < 1e-12, "{seen}");
    }
}

#[test]
fn distances_that_contradict_the_move_make_a_flat_triangle() {
    for (before_m, after_m) in [(1.0, 9.0), (9.0, 1.0), (0.0, 0.0), (0.0, 3.0), (1.0, 1.0)] {
        let triangle = Triangle::new(&turtle(3.0, 0.0, 0.0), before_m, after_m);
        let angles = [triangle.before_rad, triangle.after_rad, triangle.apex_rad];
        assert!(
            angles.iter().all(|angle| (0.0..=PI).contains(angle)),
            "{triangle:?}"
        );
    }
}

#[test]
fn two_moves_leave_four_hypotheses_and_the_next_distances_one() {
    for seed in 0..50 {
        let mut pair = Pair::new(seed, NO_NOISE);
        let mut trilaterator = Trilaterator::new();
        let range_m = pair.range_m();
        trilaterator.update(&pair::STILL, range_m, None).unwrap();
        let mut hypotheses = Vec::new();
        for _ in 0..20 {
            let (motion, range_m) = pair.round();
            trilaterator.update(&motion, range_m, None).unwrap();
            hypotheses.push(trilaterator.n_hypotheses());
        }
        assert_eq!(hypotheses[..3], [0, 4, 4]);
        assert_eq!(hypotheses[12..], [1; 8]);
        let (off_m, off_rad) = pair.error(&trilaterator.estimate().unwrap());
        assert!(
            off_m < 1e-3 && off_rad < 1e-3,
            "seed {seed}: {off_m} m, {off_rad} rad"
        );
    }
}

#[test]
fn what_the_neighbour_tells_gives_its_orientation_without_waiting_for_its_moves() {
    let mut pair = Pair::new(3, NO_NOISE);
    let mut trilaterator = Trilaterator::new();
    let range_m = pair.range_m();
    trilaterator.update(&pair::STILL, range_m, None).unwrap();
    for _ in 0..20 {
        let (motion, range_m) = pair.round();
        trilaterator.update(&motion, range_m, None).unwrap();
    }
    // Its own orientation is spoilt; an own move and what is told mend it.
    let mut spoilt = trilaterator.estimate().unwrap();
    spoilt.orientation_rad = wrapped(spoilt.orientation_rad + 1.0);
    trilaterator.hypotheses[0].at = spoilt;
    let told_m = pair.seen_by_neighbour();
    let (motion, range_m) = pair.round();
    assert!(!motion.own.is_still());
    trilaterator.update(&motion, range_m, Some(told_m)).unwrap();
    let (_, off_rad) = pair.error(&trilaterator.estimate().unwrap());
    assert!(off_rad < 1e-6, "{off_rad}");
}

/// Mean of the squared position error over the last 34 of 40 rounds (m^2): of the paper's way, and of the bank.
fn mse_m2(seed: u64) -> (f64, f64) {
    let mut pair = Pair::new(seed, NOISE);
    let range_m = pair.range_m();
    let mut trilaterator = Trilaterator::new();
    trilaterator.update(&pair::STILL, range_m, None).unwrap();
    let mut bank = Bank::new(range_m, &NOISE).unwrap();
    let (mut plain, mut filtered) = (0.0, 0.0);
    for round in 0..40 {
        let (motion, range_m) = pair.round();
        trilaterator.update(&motion, range_m, None).unwrap();
        bank.update(&motion, Some(range_m), &NOISE).unwrap();
        if round >= 6 {
            plain += pair.error(&trilaterator.estimate().unwrap()).0.powi(2);
            filtered += pair.error(&bank.estimate().unwrap().at).0.powi(2);
        }
    }
    (plain / 34.0, filtered / 34.0)
}

#[test]
fn a_bank_that_uses_every_distance_is_far_better_than_plain_trilateration() {
    let trials = 40;
    let (mut plain, mut filtered) = (0.0, 0.0);
    for seed in 0..trials {
        let (one, other) = mse_m2(seed);
        plain += one / trials as f64;
        filtered += other / trials as f64;
    }
    assert!(filtered < 2.5, "{filtered} m2");
    assert!(plain > 5.0 * filtered, "{plain} m2, {filtered} m2");
}

#[test]
fn the_bank_never_keeps_more_modes_than_it_has_room_for_and_says_how_sure_it_is() {
    let mut pair = Pair::new(1, NOISE);
    let mut bank = Bank::new(pair.range_m(), &NOISE).unwrap();
    assert_eq!(bank.modes().len(), START_MODES);
    assert!(bank.estimate().is_none());
    for round in 0..40 {
        let (motion, range_m) = pair.round();
        bank.update(&motion, Some(range_m), &NOISE).unwrap();
        assert!(bank.modes().len() <= START_MODES);
        assert!(round < 20 || bank.modes().len() <= MODES_MAX);
    }
    assert!(bank.certainty() > 0.99, "{}", bank.certainty());
    let likeliest = bank
        .modes()
        .iter()
        .all(|one| one.log_weight <= bank.modes()[0].log_weight);
    assert!(likeliest);
}

#[test]
fn a_distance_that_went_a_longer_way_is_passed_over() {
    let mut pair = Pair::new(2, NOISE);
    let mut bank = Bank::new(pair.range_m(), &NOISE).unwrap();
    for round in 0..40 {
        let (motion, range_m) = pair.round();
        let detour_m = if round % 5 == 4 { 4.0 } else { 0.0 };
        let told_m = Some(range_m + detour_m);
        bank.update(&motion, told_m, &NOISE).unwrap();
    }
    let (off_m, off_rad) = pair.error(&bank.estimate().unwrap().at);
    assert!(off_m < 1.5 && off_rad < 0.15, "{off_m} m, {off_rad} rad");
}

#[test]
fn what_is_no_number_or_absurd_is_refused_and_changes_nothing() {
    let mut pair = Pair::new(1, NOISE);
    let range_m = pair.range_m();
    let mut trilaterator = Trilaterator::new();
    let mut bank = Bank::new(range_m, &NOISE).unwrap();
    trilaterator.update(&pair::STILL, range_m, None).unwrap();
    for _ in 0..10 {
        let (motion, range_m) = pair.round();
        trilaterator.update(&motion, range_m, None).unwrap();
        bank.update(&motion, Some(range_m), &NOISE).unwrap();
    }
    let before = (trilaterator.estimate(), bank.modes().to_vec());
    for bad_m in [f64::NAN, f64::INFINITY, -1.0, 1e300] {
        assert!(trilaterator.update(&pair::STILL, bad_m, None).is_err());
        assert!(bank.update(&pair::STILL, Some(bad_m), &NOISE).is_err());
        assert!(Bank::new(bad_m, &NOISE).is_err());
    }
    for bad in [
        turtle(f64::NAN, 0.0, 0.0),
        turtle(0.0, 1e200, 0.0),
        turtle(0.0, 0.0, f64::INFINITY),
    ] {
        for motion in [
            PairMotion {
                own: bad,
                ..pair::STILL
            },
            PairMotion {
                theirs: bad,
                ..pair::STILL
            },
        ] {
            assert!(trilaterator.update(&motion, 3.0, None).is_err());
            assert!(bank.update(&motion, Some(3.0), &NOISE).is_err());
        }
    }
    let told = Some(Vector2::new(f64::NAN, 0.0));
    assert!(trilaterator.update(&pair::STILL, 3.0, told).is_err());
    assert_eq!(before, (trilaterator.estimate(), bank.modes().to_vec()));
}
