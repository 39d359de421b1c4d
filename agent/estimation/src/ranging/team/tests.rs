//! What a team knows together that no pair of it knows.
use super::*;
use crate::ranging::window::{Starts, Window};
use crate::ranging::world::{Noise, World};
use crate::time::Span;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

/// All ranges of all pairs over some rounds, and robot 0's window of every other.
fn heard(seed: u64, robots: usize, rounds: usize) -> (World, Team, Vec<Window>) {
    let rng = ChaCha8Rng::seed_from_u64(seed);
    let mut world = World::new(rng, Noise::USUAL, robots, false);
    let (team, windows) = hear(&mut world, rounds);
    (world, team, windows)
}

/// The same of a world that is there.
fn hear(world: &mut World, rounds: usize) -> (Team, Vec<Window>) {
    let robots = world.robots.len();
    let mut ranges = Vec::new();
    for round in 0..rounds {
        if round > 0 {
            world.step();
        }
        for high in 1..robots {
            for low in 0..high {
                // Either end may have measured.
                let (from, to) = if (low + high) % 2 == 0 {
                    (low, high)
                } else {
                    (high, low)
                };
                ranges.push((from, to, world.range(from, to)));
            }
        }
    }
    let now: Vec<_> = world.robots.iter().map(|robot| robot.odometry).collect();
    let mut team = Team::new(&now);
    let mut windows = vec![Window::new(); robots - 1];
    for (from, to, range) in &ranges {
        team.push(*from, *to, range).unwrap();
        let swapped = RangeSample {
            own: range.neighbour,
            neighbour: range.own,
            ..*range
        };
        if *from == 0 {
            windows[to - 1].push(range).unwrap();
        } else if *to == 0 {
            windows[from - 1].push(&swapped).unwrap();
        }
    }
    (team, windows)
}

#[test]
fn six_that_share_four_rounds_of_ranges_know_far_better_where_they_are_than_each_pair_does() {
    let (mut joint, mut pairwise, mut squares) = (Vec::new(), Vec::new(), Vec::new());
    for seed in 0..12 {
        let (world, team, windows) = heard(seed, 6, 4);
        let formations = team.solve(&WindowSettings::PLANAR);
        let best = formations.first().unwrap();
        for robot in 1..6 {
            let truth = world.truth(0, robot);
            let placed = best.placed[robot - 1].unwrap();
            let off = placed.pose.position_m - truth.position_m;
            joint.push(off.norm());
            let plane = placed.covariance.fixed_view::<2, 2>(0, 0).into_owned();
            squares.push(off.xy().dot(&(plane.try_inverse().unwrap() * off.xy())));
            let modes = windows[robot - 1].solve(&WindowSettings::PLANAR, Starts::Exhaustive, None);
            let alone = modes.best().unwrap().pose.position_m - truth.position_m;
            pairwise.push(alone.norm());
        }
    }
    let median = |values: &mut Vec<f64>| {
        values.sort_by(f64::total_cmp);
        values[values.len() / 2]
    };
    let (joint, pairwise) = (median(&mut joint), median(&mut pairwise));
    assert!(
        joint < 0.4 && joint < 0.4 * pairwise,
        "{joint} m, {pairwise} m"
    );
    // Of chi-square with two degrees of freedom the median is 1.39.
    let square = median(&mut squares);
    assert!((0.9..2.2).contains(&square), "{square}");
}

#[test]
fn a_robot_that_only_a_third_one_hears_is_placed_through_it() {
    let (world, full, _) = heard(3, 3, 7);
    let mut team = Team::new(&full.now);
    for (low, high) in [(0, 1), (1, 2)] {
        for sample in full.pair(low, high) {
            team.push(low, high, sample).unwrap();
        }
    }
    let formations = team.solve(&WindowSettings::PLANAR);
    let placed = formations[0].placed[1].unwrap();
    let off = (placed.pose.position_m - world.truth(0, 2).position_m).norm();
    assert!(off < 3.0, "{off}");
}

#[test]
fn robots_that_no_range_leads_to_stay_unplaced_and_foreign_ranges_are_refused() {
    let (_, full, _) = heard(5, 4, 4);
    let mut team = Team::new(&full.now);
    assert!(team.solve(&WindowSettings::PLANAR).is_empty());
    for sample in full.pair(0, 1) {
        team.push(0, 1, sample).unwrap();
    }
    let formations = team.solve(&WindowSettings::PLANAR);
    assert!(formations[0].placed[0].is_some() && formations[0].placed[2].is_none());

    let sample = full.pair(0, 1)[0];
    let (from, to) = (1, 9);
    let refused = Err(TeamRefusal::NoSuchPair { from, to });
    assert_eq!(team.push(from, to, &sample), refused);
    let not_later = Err(TeamRefusal::Range(RangeRefusal::NotLater));
    assert_eq!(team.push(0, 1, &sample), not_later);
    let mut interrupted = sample;
    interrupted.taken = sample.taken + Span::secs(100);
    interrupted.own.segment += 1;
    assert_eq!(team.push(0, 1, &interrupted), Err(TeamRefusal::Interrupted));
    let crowd = vec![full.now[0]; 3 * ROBOTS_MAX];
    assert_eq!(Team::new(&crowd).now.len(), ROBOTS_MAX);
}

#[test]
fn a_robot_that_was_placed_is_carried_on_by_both_odometries_until_one_is_interrupted() {
    let mut squares = Vec::new();
    for seed in 0..20 {
        let (mut world, team, _) = heard(seed, 4, 5);
        let placed = team.solve(&WindowSettings::PLANAR)[0].placed[2].unwrap();
        world.step();
        let now = [0, 3].map(|robot: usize| world.robots[robot].odometry);
        let carried = |placed: &Placed, now: &[LevelOdometry; 2]| {
            let then = [&team.now[0], &team.now[3]];
            let criterion = &Criterion::DEFAULT;
            placed.carried(then, [&now[0], &now[1]], Dimension::Planar, criterion)
        };
        let place = carried(&placed, &now).unwrap();
        let off = (place.pose.position_m - world.truth(0, 3).position_m).xy();
        let plane = place.covariance.fixed_view::<2, 2>(0, 0).into_owned();
        squares.push(off.dot(&(plane.try_inverse().unwrap() * off)));
        assert!(place.position_sigma_m() > placed.covariance[(0, 0)].sqrt());

        let doubtful = Placed {
            cost_gap: 8.9,
            ..placed
        };
        assert_eq!(carried(&doubtful, &now), None);
        for end in 0..2 {
            let mut interrupted = now;
            interrupted[end].segment += 1;
            assert_eq!(carried(&placed, &interrupted), None);
        }
    }
    // The mean of chi-square with two degrees of freedom is 2, of twenty to within 0.45.
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    assert!((0.8..3.4).contains(&mean), "{mean}");
}

#[test]
fn a_range_that_is_not_in_line_of_sight_shows_in_the_fit() {
    for seed in 0..10 {
        let (_, full, _) = heard(seed, 4, 6);
        assert!(full.solve(&WindowSettings::PLANAR)[0].fits());
        let mut team = full.clone();
        team.pairs[2][3].range_m += 4.0;
        assert!(
            !team.solve(&WindowSettings::PLANAR)[0].fits(),
            "seed {seed}"
        );
    }
}

#[test]
fn in_space_robots_that_keep_their_heights_may_as_well_be_upside_down() {
    for (climbs, known) in [(false, 0), (true, 3)] {
        let rng = ChaCha8Rng::seed_from_u64(3);
        let mut world = World::new(rng, Noise::USUAL, 4, true);
        world.spatial = climbs;
        let (team, _) = hear(&mut world, 9);
        let best = team.solve(&WindowSettings::SPATIAL).remove(0);
        let sole = |placed: &&Option<Placed>| placed.is_some_and(|placed| placed.cost_gap >= 9.0);
        assert_eq!(best.placed.iter().filter(sole).count(), known, "{best:?}");
    }
}
