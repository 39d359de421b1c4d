//! One neighbour from the first range on, friendly and hostile.
use super::*;
use crate::ranging::world::{Motion, Noise, World};
use crate::time::Span;
use nalgebra::Vector3;
use rand::{RngExt as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;

fn world(seed: u64) -> World {
    World::new(ChaCha8Rng::seed_from_u64(seed), Noise::USUAL, 2, false)
}

fn followed(world: &mut World, neighbour: &mut Neighbour, rounds: usize) {
    for _ in 0..rounds {
        world.step();
        neighbour.handle(&world.range(0, 1)).unwrap();
    }
}

fn error_m(world: &World, neighbour: &Neighbour) -> f64 {
    let best = neighbour.estimate().best.unwrap();
    (best.pose.position_m - world.truth(0, 1).position_m).norm()
}

#[test]
fn a_neighbour_is_unknown_then_at_one_of_several_places_then_at_one() {
    let (mut ambiguous, mut good) = (0, 0);
    let early = NeighbourSettings {
        start_ranges: 4,
        ..NeighbourSettings::PLANAR
    };
    for seed in 0..20 {
        let mut world = world(seed);
        let mut neighbour = Neighbour::new(early);
        assert_eq!(neighbour.estimate().observability, Observability::Unknown);
        assert!(neighbour.estimate().best.is_none());
        followed(&mut world, &mut neighbour, 4);
        let seen = neighbour.estimate().observability;
        ambiguous += usize::from(matches!(seen, Observability::Ambiguous { .. }));
        followed(&mut world, &mut neighbour, 16);
        good += usize::from(error_m(&world, &neighbour) < 1.5 + 0.05 * world.distance_m(0, 1));
    }
    assert!(ambiguous >= 5 && good >= 18, "{ambiguous} {good}");
}

#[test]
fn ranges_ten_times_a_second_while_both_crawl_find_the_neighbour_as_well() {
    let mut world = world(4);
    world.noise = Noise {
        range_m: 0.1,
        translation_m: 0.002,
        turn_rad: 0.001,
    };
    let mut neighbour = Neighbour::new(NeighbourSettings::PLANAR);
    let mut turns = [0.0; 2];
    for round in 0..900 {
        for (robot, turn) in turns.iter_mut().enumerate() {
            if round % 30 == 0 {
                *turn = world.rng.random_range(-0.06..0.06);
            }
            let motion = Motion {
                turn_rad: *turn,
                forward_m: Vector3::new(0.1, 0.0, 0.0),
            };
            world.drive(robot, &motion);
        }
        world.round += 1;
        neighbour.handle(&world.range(0, 1)).unwrap();
    }
    let error = error_m(&world, &neighbour);
    assert!(error < 1.0, "{error} m at {} m", world.distance_m(0, 1));
    assert_eq!(neighbour.counters().taken, 900);
}

#[test]
fn a_neighbour_that_stands_still_keeps_its_yaw_to_itself() {
    let mut world = world(6);
    let mut neighbour = Neighbour::new(NeighbourSettings::PLANAR);
    for _ in 0..12 {
        let motion = world.random_motion();
        world.drive(0, &motion);
        world.round += 1;
        neighbour.handle(&world.range(0, 1)).unwrap();
    }
    let seen = neighbour.estimate().observability;
    let rotation = matches!(
        seen,
        Observability::Ambiguous {
            which: Ambiguity::Rotation,
            ..
        }
    );
    assert!(rotation, "{seen:?}");
}

#[test]
fn one_range_in_ten_round_a_corner_is_counted_and_costs_little() {
    let (mut good, mut unexplained) = (0, 0);
    for seed in 0..20 {
        let mut world = world(100 + seed);
        let mut neighbour = Neighbour::new(NeighbourSettings::PLANAR);
        for round in 0..40 {
            world.step();
            let mut range = world.range(0, 1);
            if round % 10 == 9 {
                range.range_m += world.rng.random_range(1.0..5.0);
            }
            neighbour.handle(&range).unwrap();
        }
        good += usize::from(error_m(&world, &neighbour) < 1.5 + 0.05 * world.distance_m(0, 1));
        unexplained += neighbour.counters().unexplained;
    }
    assert!(good >= 17 && unexplained >= 40, "{good} {unexplained}");
}

#[test]
fn a_neighbour_that_lies_about_its_odometry_is_found_to_disagree_and_an_honest_one_is_not() {
    let (mut liars, mut honest) = (0, 0);
    for seed in 0..10 {
        for lies in [false, true] {
            let mut world = world(200 + seed);
            let mut neighbour = Neighbour::new(NeighbourSettings::PLANAR);
            for _ in 0..60 {
                world.step();
                let mut range = world.range(0, 1);
                if lies {
                    range.neighbour.position_m *= 3.0;
                }
                neighbour.handle(&range).unwrap();
            }
            let disagrees = usize::from(neighbour.estimate().is_disagreeing);
            if lies {
                liars += disagrees;
            } else {
                honest += disagrees;
            }
        }
    }
    assert!(liars >= 9 && honest == 0, "{liars} {honest}");
}

#[test]
fn clocks_that_jump_back_and_absurd_ranges_are_counted_by_name_and_change_nothing() {
    let mut world = world(1);
    let mut neighbour = Neighbour::new(NeighbourSettings::PLANAR);
    followed(&mut world, &mut neighbour, 12);
    let before = neighbour.estimate();
    let good = world.range(0, 1);
    let back = RangeSample {
        taken: good.taken - Span::secs(5),
        ..good
    };
    let negative = RangeSample {
        range_m: -1.0,
        taken: good.taken + Span::secs(1),
        ..good
    };
    assert_eq!(neighbour.handle(&back), Err(RangeRefusal::NotLater));
    assert_eq!(neighbour.handle(&negative), Err(RangeRefusal::NotPositive));
    assert_eq!(neighbour.estimate(), before);
    for (refusal, count) in RangeRefusal::ALL.iter().zip(neighbour.counters().refused) {
        let expected = matches!(refusal, RangeRefusal::NotLater | RangeRefusal::NotPositive);
        assert_eq!(count, u64::from(expected), "{refusal:?}");
    }
}

#[test]
fn interrupted_odometry_begins_anew_and_is_counted() {
    let mut world = world(1);
    let mut neighbour = Neighbour::new(NeighbourSettings::PLANAR);
    followed(&mut world, &mut neighbour, 12);
    let mut other = world.robots[1].odometry;
    other.segment += 1;
    let asked = neighbour.estimate_at(&world.robots[0].odometry, &other);
    assert!(asked.best.is_none());
    world.robots[1].odometry.segment += 1;
    followed(&mut world, &mut neighbour, 1);
    assert_eq!(neighbour.counters().interrupted, 1);
    assert_eq!(neighbour.estimate().observability, Observability::Unknown);
}

/// Rounds in which a place was told, and those in which it was more than 3 m off.
fn told_and_wrong(
    settings: NeighbourSettings,
    seed: u64,
    rounds: usize,
    motion: impl Fn(&mut World, usize) -> Motion,
) -> (usize, usize) {
    let spatial = settings.window.dimension == Dimension::Spatial;
    let rng = ChaCha8Rng::seed_from_u64(seed);
    let mut world = World::new(rng, Noise::USUAL, 2, spatial);
    let mut neighbour = Neighbour::new(settings);
    let (mut told, mut wrong) = (0, 0);
    for _ in 0..rounds {
        for robot in 0..2 {
            let motion = motion(&mut world, robot);
            world.drive(robot, &motion);
        }
        world.round += 1;
        let _ = neighbour.handle(&world.range(0, 1));
        if neighbour.estimate().observability == Observability::Observable {
            told += 1;
            wrong += usize::from(error_m(&world, &neighbour) > 3.0);
        }
    }
    (told, wrong)
}

/// Both fly circles near each other, and climb so much a round.
fn circling(world: &mut World, climb_m: f64) -> Motion {
    Motion {
        turn_rad: world.rng.random_range(0.2..0.8),
        forward_m: Vector3::new(3.0, 0.0, climb_m * world.rng.random_range(-1.0..1.0)),
    }
}

#[test]
fn whether_it_is_above_or_below_is_not_told_of_two_that_keep_their_heights() {
    let (mut told, mut wrong) = (0, 0);
    for seed in 0..40 {
        let level = |world: &mut World, _: usize| circling(world, 0.0);
        let seen = told_and_wrong(NeighbourSettings::SPATIAL, seed, 40, level);
        told += seen.0;
        wrong += seen.1;
    }
    assert!(wrong <= 16, "{told} {wrong}");
}

#[test]
fn of_two_that_climb_a_place_is_told_and_it_is_the_right_one() {
    let (mut told, mut wrong) = (0, 0);
    for seed in 0..40 {
        let climbing = |world: &mut World, _: usize| circling(world, 2.0);
        let seen = told_and_wrong(NeighbourSettings::SPATIAL, seed, 40, climbing);
        told += seen.0;
        wrong += seen.1;
    }
    assert!(told >= 800 && wrong <= 16, "{told} {wrong}");
}
