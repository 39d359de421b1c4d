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
    (world, team, windows)
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
