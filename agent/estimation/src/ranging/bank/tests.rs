//! What a bank makes of a long stream of ranges.
use super::*;
use crate::ranging::window::{Starts, Window, WindowSettings};
use crate::ranging::world::{Noise, World};
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

/// A bank from the first ranges of a pair, all its minima kept.
fn started(world: &mut World, ranges: usize, settings: BankSettings) -> Bank {
    let window_settings = WindowSettings {
        dimension: settings.dimension,
        ..WindowSettings::PLANAR
    };
    let mut window = Window::new();
    for round in 0..ranges {
        if round > 0 {
            world.step();
        }
        window.push(&world.range(0, 1)).unwrap();
    }
    let modes = window.solve(&window_settings, Starts::Exhaustive, None);
    Bank::started(settings, &modes, window.newest().unwrap()).unwrap()
}

#[test]
fn what_four_ranges_leave_open_the_ranges_after_them_decide() {
    // Squared errors of the last 14 of 20 rounds over their covariance: three numbers each.
    let (mut squares, mut errors) = (Vec::new(), Vec::new());
    for seed in 0..60 {
        let rng = ChaCha8Rng::seed_from_u64(seed);
        let mut world = World::new(rng, Noise::USUAL, 2, false);
        let mut bank = started(&mut world, 4, BankSettings::PLANAR);
        for round in 4..20 {
            world.step();
            bank.update(&world.range(0, 1));
            let truth = world.truth(0, 1);
            let best = bank.places().next().unwrap();
            if round >= 6 {
                errors.push((best.pose.position_m - truth.position_m).norm());
                let hypothesis = bank.hypotheses[0].unwrap();
                let off = hypothesis.pose.step_to(&truth);
                let information = hypothesis.covariance.try_inverse().unwrap();
                squares.push(off.dot(&(information * off)));
            }
        }
    }
    errors.sort_by(f64::total_cmp);
    squares.sort_by(f64::total_cmp);
    let (error, square) = (errors[errors.len() / 2], squares[squares.len() / 2]);
    assert!(error < 1.0, "median error {error} m");
    // The median of chi-square with three degrees of freedom is 2.37.
    assert!((1.9..3.0).contains(&square), "median square {square}");
}

#[test]
fn in_space_a_bank_follows_too() {
    let mut errors = Vec::new();
    for seed in 0..20 {
        let rng = ChaCha8Rng::seed_from_u64(seed);
        let mut world = World::new(rng, Noise::USUAL, 2, true);
        let mut bank = started(&mut world, 5, BankSettings::SPATIAL);
        for _ in 5..20 {
            world.step();
            bank.update(&world.range(0, 1));
        }
        let best = bank.places().next().unwrap();
        errors.push((best.pose.position_m - world.truth(0, 1).position_m).norm());
    }
    errors.sort_by(f64::total_cmp);
    assert!(errors[10] < 1.5, "median error {} m", errors[10]);
}

#[test]
fn places_move_as_odometry_says_between_ranges() {
    let rng = ChaCha8Rng::seed_from_u64(3);
    let mut world = World::new(rng, Noise::USUAL, 2, false);
    let mut bank = started(&mut world, 9, BankSettings::PLANAR);
    world.step();
    let sample = world.range(0, 1);
    let moved = bank
        .places_at(&sample.own, &sample.neighbour)
        .next()
        .unwrap();
    let before = bank.places().next().unwrap();
    bank.update(&sample);
    let after = bank.places().next().unwrap();
    let off = (moved.pose.position_m - after.pose.position_m).norm();
    assert!(off < 1.0, "{off}");
    assert!((before.pose.position_m - after.pose.position_m).norm() > off);
    assert!(moved.position_sigma_m() >= after.position_sigma_m());
}

#[test]
fn a_range_round_a_corner_moves_nothing_and_many_refute_the_bank() {
    let rng = ChaCha8Rng::seed_from_u64(8);
    let mut world = World::new(rng, Noise::USUAL, 2, false);
    let mut bank = started(&mut world, 9, BankSettings::PLANAR);
    for _ in 0..6 {
        world.step();
        bank.update(&world.range(0, 1));
    }
    world.step();
    let mut wrong = world.range(0, 1);
    let moved = bank.places_at(&wrong.own, &wrong.neighbour).next().unwrap();
    wrong.range_m += 4.0;
    assert_eq!(bank.update(&wrong), Explained::No);
    let after = bank.places().next().unwrap();
    assert!((moved.pose.position_m - after.pose.position_m).norm() < 1e-9);
    assert!(!bank.is_refuted());
    for _ in 0..40 {
        world.step();
        let mut wrong = world.range(0, 1);
        wrong.range_m = 500.0 * (1.0 + f64::from(u8::from(world.round % 2 == 0)));
        bank.update(&wrong);
    }
    assert!(bank.is_refuted());
}

#[test]
fn weights_are_probabilities_and_moments_are_those_of_the_mixture() {
    let rng = ChaCha8Rng::seed_from_u64(11);
    let mut world = World::new(rng, Noise::USUAL, 2, false);
    let bank = started(&mut world, 4, BankSettings::PLANAR);
    let sum: f64 = bank.places().map(|place| place.weight).sum();
    assert!((sum - 1.0).abs() < 1e-9);

    let place = |x: f64, weight: f64| Place {
        pose: RelativePose::new(Vector3::new(x, 0.0, 0.0), 0.0),
        weight,
        covariance: Matrix4::identity(),
        angle_sigma_rad: 1.0,
    };
    let (mean, covariance) = moments([place(0.0, 0.75), place(4.0, 0.25)].into_iter()).unwrap();
    assert!((mean.position_m.x - 1.0).abs() < 1e-12);
    // 1 + 0.75 * 1 + 0.25 * 9.
    assert!((covariance[(0, 0)] - 4.0).abs() < 1e-12);
    assert!(moments(std::iter::empty()).is_none());
}
