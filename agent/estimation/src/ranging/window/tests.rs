//! What windows tell of a neighbour, and what they cannot.
use super::*;
use crate::ranging::pose::{turned, wrapped};
use crate::ranging::world::{Motion, Noise, World};
use nalgebra::Vector3;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;
use std::f64::consts::PI;

fn world(seed: u64, noise: Noise) -> World {
    World::new(ChaCha8Rng::seed_from_u64(seed), noise, 2, false)
}

/// Rounds of a pair's world, the window of robot 0.
fn watched(world: &mut World, rounds: usize, mut step: impl FnMut(&mut World, usize)) -> Window {
    let mut window = Window::new();
    for round in 0..rounds {
        if round > 0 {
            step(world, round);
            world.round += 1;
        }
        window.push(&world.range(0, 1)).unwrap();
    }
    window
}

fn wandering(world: &mut World, _: usize) {
    for robot in 0..2 {
        let motion = world.random_motion();
        world.drive(robot, &motion);
    }
}

fn is_at(mode: &Mode, truth: &RelativePose, within_m: f64) -> bool {
    (mode.pose.position_m - truth.position_m).norm() < within_m
        && wrapped(mode.pose.yaw_rad - truth.yaw_rad).abs() < within_m
}

/// The told noise is so small that this is exact, but for windows from which the place follows badly.
fn is_within_sigma(mode: &Mode, truth: &RelativePose) -> bool {
    let off = mode.pose.step_to(truth);
    off.dot(&(mode.information * off)) < 1.0
}

fn forward(length: f64) -> Motion {
    Motion {
        turn_rad: 0.0,
        forward_m: Vector3::new(length, 0.0, 0.0),
    }
}

#[test]
fn the_place_of_a_neighbour_is_among_the_minima_of_every_exact_window() {
    for rounds in 3..=9 {
        for seed in 0..100 {
            let mut world = world(seed, Noise::NONE);
            let window = watched(&mut world, rounds, wandering);
            let modes = window.solve(&WindowSettings::PLANAR, Starts::Exhaustive, None);
            let truth = world.truth(0, 1);
            assert!(
                modes.as_slice().any(|mode| is_within_sigma(mode, &truth)),
                "{rounds} rounds, seed {seed}: {:?} is not {truth:?}",
                modes.best()
            );
        }
    }
}

#[test]
fn in_space_with_levelled_attitudes_four_rounds_hold_it_and_five_leave_no_other() {
    let mut alone = 0;
    for rounds in 4..=6 {
        for seed in 0..60 {
            let rng = ChaCha8Rng::seed_from_u64(seed);
            let mut world = World::new(rng, Noise::NONE, 2, true);
            let window = watched(&mut world, rounds, wandering);
            let modes = window.solve(&WindowSettings::SPATIAL, Starts::Exhaustive, None);
            let truth = world.truth(0, 1);
            let found = |mode: &Mode| is_within_sigma(mode, &truth);
            assert!(modes.as_slice().any(found), "{rounds} rounds, seed {seed}");
            if rounds > 4 {
                assert!(
                    modes.best().is_some_and(found),
                    "{rounds} rounds, seed {seed}"
                );
                alone += usize::from(modes.cost_gap() > 9.0);
            }
        }
    }
    // Of one in twenty another place fits to within the noise that is told of.
    assert!(alone >= 108, "{alone} of 120");
}

#[test]
fn three_ranges_are_never_enough_without_a_prior() {
    for seed in 0..200 {
        let mut world = world(seed, Noise::USUAL);
        let window = watched(&mut world, 3, wandering);
        let modes = window.solve(&WindowSettings::PLANAR, Starts::Exhaustive, None);
        assert_ne!(
            modes.observability(&Criterion::DEFAULT),
            Observability::Observable
        );
        let prior = Prior::new(world.truth(0, 1), 0.1, 0.02, 0.02).unwrap();
        let modes = window.solve(&WindowSettings::PLANAR, Starts::Exhaustive, Some(&prior));
        assert_eq!(
            modes.observability(&Criterion::DEFAULT),
            Observability::Observable
        );
    }
}

#[test]
fn two_that_move_along_straight_lines_may_be_mirrored() {
    let mut world = world(3, Noise::USUAL);
    let window = watched(&mut world, 6, |world, _| {
        world.drive(0, &forward(3.0));
        world.drive(1, &forward(2.0));
    });
    let modes = window.solve(&WindowSettings::PLANAR, Starts::Exhaustive, None);
    let seen = modes.observability(&Criterion::DEFAULT);
    let flipped = matches!(
        seen,
        Observability::Ambiguous {
            which: Ambiguity::Flip,
            modes: 2..
        }
    );
    assert!(flipped, "{seen:?}");
}

#[test]
fn one_that_stands_still_or_moves_as_the_other_may_be_anywhere_around() {
    let mut standing = world(4, Noise::USUAL);
    let window = watched(&mut standing, 6, |world, _| {
        let motion = world.random_motion();
        world.drive(1, &motion);
    });
    let displaced = {
        let mut world = world(5, Noise::USUAL);
        world.robots[1].yaw_rad = world.robots[0].yaw_rad + 1.0;
        watched(&mut world, 6, |world, round| {
            let motion = world.random_motion();
            world.drive(0, &motion);
            // The same way through the world, though the heading is another.
            let other = Motion {
                turn_rad: motion.turn_rad,
                forward_m: turned(&motion.forward_m, -1.0),
            };
            world.drive(1, &other);
            assert!(round < 6);
        })
    };
    for window in [window, displaced] {
        let modes = window.solve(&WindowSettings::PLANAR, Starts::Exhaustive, None);
        let seen = modes.observability(&Criterion::DEFAULT);
        let rotation = matches!(
            seen,
            Observability::Ambiguous {
                which: Ambiguity::Rotation,
                ..
            }
        );
        assert!(rotation, "{seen:?}");
    }
}

#[test]
fn two_that_move_alike_each_in_its_own_frame_may_be_exchanged() {
    for seed in 0..10 {
        let mut world = world(seed, Noise::USUAL);
        let window = watched(&mut world, 9, |world, _| {
            let motion = world.random_motion();
            world.drive(0, &motion);
            world.drive(1, &motion);
        });
        let modes = window.solve(&WindowSettings::PLANAR, Starts::Exhaustive, None);
        let truth = world.truth(0, 1);
        assert!(modes.as_slice().any(|mode| is_at(mode, &truth, 3.0)));
        let seen = modes.observability(&Criterion::DEFAULT);
        let exchanged = matches!(
            seen,
            Observability::Ambiguous {
                which: Ambiguity::Exchange | Ambiguity::Rotation,
                ..
            }
        );
        assert!(exchanged, "seed {seed}: {seen:?}");
    }
}

#[test]
fn ranges_round_a_corner_are_outvoted_by_those_in_line_of_sight() {
    let mut found = [0; 2];
    for seed in 0..60 {
        let mut world = world(seed, Noise::USUAL);
        let mut window = Window::new();
        for round in 0..9 {
            if round > 0 {
                world.step();
            }
            let mut range = world.range(0, 1);
            if round == 2 || round == 6 {
                range.range_m += 3.0;
            }
            window.push(&range).unwrap();
        }
        let truth = world.truth(0, 1);
        let settings = [WindowSettings::PLANAR, WindowSettings::PLANAR.robust()];
        for (found, settings) in found.iter_mut().zip(settings) {
            let modes = window.solve(&settings, Starts::Exhaustive, None);
            let near = 1.5 + 0.1 * truth.distance_m();
            *found += usize::from(modes.best().is_some_and(|mode| is_at(mode, &truth, near)));
        }
    }
    assert!(found[1] >= 45 && found[1] > found[0] + 20, "{found:?}");
}

#[test]
fn hostile_ranges_are_refused_by_name_and_leave_the_window_as_it_was() {
    let mut world = world(1, Noise::USUAL);
    let good = world.range(0, 1);
    let mut window = Window::new();
    window.push(&good).unwrap();
    let later = RangeSample {
        taken: good.taken + crate::Span::secs(1),
        ..good
    };
    let earlier = RangeSample {
        taken: good.taken - crate::Span::secs(1),
        ..good
    };
    let range = |range_m| RangeSample { range_m, ..later };
    let sigma = |sigma_m| RangeSample { sigma_m, ..later };
    let mut lost = later;
    lost.own.position_m.x = f64::NAN;
    let mut shrinking = later;
    shrinking.neighbour.growth.rotation -= 1.0;
    for (sample, why) in [
        (range(f64::NAN), RangeRefusal::NotFinite),
        (range(f64::INFINITY), RangeRefusal::NotFinite),
        (range(0.0), RangeRefusal::NotPositive),
        (range(-1.0), RangeRefusal::NotPositive),
        (range(1e9), RangeRefusal::TooFar),
        (sigma(0.0), RangeRefusal::BadSigma),
        (sigma(f64::NAN), RangeRefusal::BadSigma),
        (sigma(1e6), RangeRefusal::BadSigma),
        (lost, RangeRefusal::BadOwnOdometry),
        (shrinking, RangeRefusal::BadNeighbourOdometry),
        (earlier, RangeRefusal::NotLater),
    ] {
        assert_eq!(window.push(&sample), Err(why));
        assert_eq!(window.len(), 1);
    }
}

#[test]
fn a_window_begins_anew_when_odometry_was_interrupted_and_forgets_its_oldest_when_full() {
    let mut world = world(2, Noise::USUAL);
    let mut window = watched(&mut world, WINDOW_MAX, wandering);
    assert_eq!(window.len(), WINDOW_MAX);
    world.step();
    window.push(&world.range(0, 1)).unwrap();
    assert_eq!(window.len(), WINDOW_MAX);
    world.step();
    world.robots[1].odometry.segment += 1;
    window.push(&world.range(0, 1)).unwrap();
    assert_eq!(window.len(), 1);
}

#[test]
fn whatever_ranges_and_odometries_say_a_window_answers() {
    // Ranges that contradict each other, standing robots, the same place, straight up, absurd growth.
    for seed in 0..200_u64 {
        let mut world = World::new(
            ChaCha8Rng::seed_from_u64(seed),
            Noise::USUAL,
            2,
            seed % 2 == 0,
        );
        let mut window = Window::new();
        for round in 0..6 {
            if seed % 3 != 0 {
                world.step();
            } else {
                world.round += 1;
            }
            let mut sample = world.range(0, 1);
            match seed % 5 {
                0 => sample.range_m = if round % 2 == 0 { 1e-300 } else { 1000.0 },
                1 => sample.own.position_m *= 1e4,
                2 => sample.neighbour.growth.lever *= 1e9,
                3 => sample.sigma_m = 1e-300,
                _ => sample.neighbour.yaw_rad *= 1e300,
            }
            let _ = window.push(&sample);
        }
        for settings in [
            WindowSettings::PLANAR,
            WindowSettings::SPATIAL,
            WindowSettings::PLANAR.robust(),
        ] {
            let modes = window.solve(&settings, Starts::Exhaustive, None);
            for mode in modes.as_slice() {
                assert!(mode.cost.is_finite() && mode.pose.yaw_rad.abs() <= PI);
            }
            let _ = modes.observability(&Criterion::DEFAULT);
        }
    }
}

#[test]
fn the_covariance_is_that_of_the_errors() {
    // Long windows, where the minimum is the right one: squared errors over their covariance, three numbers each.
    let mut squares = Vec::new();
    for seed in 0..400 {
        let mut world = world(seed, Noise::USUAL);
        let window = watched(&mut world, 9, wandering);
        let truth = world.truth(0, 1);
        let modes = window.solve(&WindowSettings::PLANAR, Starts::Exhaustive, None);
        let mode = modes.best().unwrap();
        if modes.observability(&Criterion::DEFAULT) == Observability::Observable {
            let off = mode.pose.step_to(&truth);
            squares.push(off.dot(&(mode.information * off)));
        }
    }
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    // The median, too: a minimum that is the wrong one would spoil the mean alone. Of chi-square with 3 it is 2.37.
    squares.sort_by(f64::total_cmp);
    let median = squares[squares.len() / 2];
    assert!(squares.len() > 100, "{}", squares.len());
    assert!((2.0..2.8).contains(&median), "{median} {mean}");
}
