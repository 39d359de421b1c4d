//! The bounds, each by another way.

use super::*;
use crate::experiment::ranging::errors::pair::{Pair, Turns};
use crate::planar_swarm::PlanarPose;
use crate::streams::{Purpose, Streams};
use nalgebra::{Rotation2, Rotation3};
use rand_distr::{Distribution, StandardNormal};

fn way(sample: u64) -> Vec<Places> {
    let streams = Streams::new(5, sample);
    Pair::gone(Turns::Together, 20, SwarmNoise::USUAL, &streams).places()
}

/// The distances that follow from where the other is now, how it is turned, and the motions of both: equation 2 as it
/// stands. Three numbers, then three of every motion (x, y, turn), the own ones first.
fn distances(numbers: &[f64]) -> Vec<f64> {
    let motions = (numbers.len() - 3) / 6;
    let back = |first: usize| {
        let mut place = (Vector2::zeros(), 0.0);
        let mut places = vec![place];
        for motion in numbers[first..][..3 * motions].chunks(3).rev() {
            place.1 -= motion[2];
            place.0 -= Rotation2::new(place.1) * Vector2::new(motion[0], motion[1]);
            places.push(place);
        }
        places.into_iter().rev()
    };
    let now_m = Vector2::new(numbers[0], numbers[1]);
    let both = back(3).zip(back(3 + 3 * motions));
    let apart = both.map(|((u, _), (v, _))| now_m + Rotation2::new(numbers[2]) * v - u);
    apart.map(|apart_m| apart_m.norm()).collect()
}

/// What the distances and both odometries say of all numbers together, of which then only three are asked for.
fn of_all_numbers(window: &[Places], noise: &SwarmNoise) -> Matrix3<f64> {
    let numbers_of = |pose: PlanarPose| [pose.position_m.x, pose.position_m.y, pose.heading_rad];
    let newest = window[window.len() - 1];
    let mut numbers = numbers_of(newest[1].seen_from(&newest[0])).to_vec();
    for robot in [0, 1] {
        for pair in window.windows(2) {
            numbers.extend(numbers_of(pair[1][robot].seen_from(&pair[0][robot])));
        }
    }
    let jacobian = DMatrix::from_fn(window.len(), numbers.len(), |j, number| {
        let moved = |by: f64| {
            let mut numbers = numbers.clone();
            numbers[number] += by;
            distances(&numbers)[j]
        };
        (moved(1e-5) - moved(-1e-5)) / 2e-5
    });
    let mut information = jacobian.transpose() * jacobian / noise.range_sigma_m.powi(2);
    for number in 3..numbers.len() {
        let sigma = if number % 3 == 2 {
            noise.rotation_sigma_rad
        } else {
            noise.translation_sigma_m
        };
        information[(number, number)] += 1.0 / sigma.powi(2);
    }
    let covariance = information.try_inverse().unwrap();
    let own_axes = covariance.fixed_view::<3, 3>(0, 0).try_inverse().unwrap();
    let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), newest[0].heading_rad);
    turn.matrix() * own_axes * turn.matrix().transpose()
}

fn assert_same(one: &Matrix3<f64>, other: &Matrix3<f64>, within: f64) {
    let off = (one - other).norm() / other.norm();
    assert!(off < within, "off by {off}: {one} {other}");
}

#[test]
fn a_window_bounds_as_all_its_unknowns_together_do() {
    let noise = SwarmNoise::USUAL;
    for sample in 0..5 {
        let way = way(sample);
        for ranges in [4, 6, 9] {
            let window = &way[3..3 + ranges];
            assert_same(
                &windowed(window, &noise),
                &of_all_numbers(window, &noise),
                1e-5,
            );
        }
    }
}

#[test]
fn a_filter_that_has_had_all_distances_bounds_as_the_window_of_all_of_them() {
    let noise = SwarmNoise::USUAL;
    for sample in 0..10 {
        let way = way(sample);
        for (start, end) in [(1, 10), (4, 12), (6, 20)] {
            let filtered = recursive(&way[..end], start, &noise)[end - 1].unwrap();
            assert_same(&filtered, &windowed(&way[..end], &noise), 1e-6);
        }
    }
}

#[test]
fn what_is_remembered_never_makes_it_worse() {
    let noise = SwarmNoise::USUAL;
    for sample in 0..20 {
        let way = way(sample);
        let all = recursive(&way, 4, &noise);
        for end in 6..=way.len() {
            let information = all[end - 1].unwrap();
            let places = &way[end - 1];
            let of_window = windowed(&way[end - 6..end], &noise);
            let gained = (information - of_window).symmetric_eigenvalues();
            assert!(gained.min() > -1e-7 * information.norm(), "{gained}");
            let (all, few) = (
                least_squares(&information, places),
                least_squares(&of_window, places),
            );
            assert!(
                all.position_m2 <= few.position_m2 * (1.0 + 1e-6),
                "{all:?} {few:?}"
            );
            assert!(all.orientation_rad2 <= few.orientation_rad2 * (1.0 + 1e-6));
        }
    }
    let recursive = recursive(&way(0), 4, &noise);
    let known: Vec<bool> = recursive.iter().map(Option::is_some).collect();
    assert_eq!(known[..5], [false, false, false, true, true]);
}

#[test]
fn who_stands_still_forgets_nothing() {
    let noise = SwarmNoise::USUAL;
    let way = way(1);
    let known = windowed(&way[..6], &noise);
    assert_same(&moved(&known, &way[5], &way[5], &noise), &known, 1e-12);
    let alone = [way[6][0], way[5][1]];
    let together = moved(&known, &way[5], &way[6], &noise);
    let one = moved(&known, &way[5], &alone, &noise);
    assert!(one.determinant() < known.determinant());
    assert!(together.determinant() < one.determinant());
}

#[test]
fn with_no_information_the_other_is_anywhere_on_the_circle_and_turned_anyhow() {
    let places = way(2)[7];
    let square_m2 = apart_m(&places).norm_squared();
    let range_only = measured(&Matrix3::zeros(), &places, &SwarmNoise::USUAL);
    let least = least_squares(&range_only, &places);
    assert!(
        (least.position_m2 - 2.0 * square_m2 - 0.01).abs() < 1e-6,
        "{least:?}"
    );
    assert!((least.orientation_rad2 - PI * PI / 3.0).abs() < 1e-9);
    assert!(least.tangent_m2 > 1e4 * least.position_m2);
}

#[test]
fn a_little_uncertainty_is_straight_and_a_lot_goes_around() {
    let places = way(3)[7];
    let (along, distance_m) = (line_of_sight(&places), apart_m(&places).norm());
    // Of distance, bearing and orientation apart: 0.2 m, and angles.
    let of = |angle_rad: f64| {
        let sight = Vector3::new(along.x, along.y, 0.0);
        let across = Vector3::new(-along.y, along.x, 0.0) * distance_m;
        let covariance = sight * sight.transpose() * 0.04
            + (across * across.transpose() + Vector3::z() * Vector3::z().transpose())
                * angle_rad.powi(2);
        least_squares(&covariance.try_inverse().unwrap(), &places)
    };
    let small = of(0.01);
    assert!((small.tangent_m2 - 0.04 - 1e-4 * distance_m.powi(2)).abs() < 1e-6);
    assert!((small.position_m2 / small.tangent_m2 - 1.0).abs() < 1e-4);
    assert!((small.orientation_rad2 - 1e-4).abs() < 1e-9);

    // What comes of it when distances, bearings and orientations are drawn.
    let large = of(1.2);
    let mut rng = Streams::new(1, 0).vehicle(0, Purpose::Measurement);
    let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
    let (mut position_m2, mut orientation_rad2) = (0.0, 0.0);
    for _ in 0..100_000 {
        let drawn_m = distance_m + 0.2 * normal();
        let drawn = Rotation2::new(1.2 * normal()) * Vector2::new(drawn_m, 0.0);
        position_m2 += (drawn - Vector2::new(distance_m, 0.0)).norm_squared() / 1e5;
        orientation_rad2 += Rotation2::new(1.2 * normal()).angle().powi(2) / 1e5;
    }
    assert!(
        (large.position_m2 / position_m2 - 1.0).abs() < 0.02,
        "{position_m2} {large:?}"
    );
    assert!(
        (large.orientation_rad2 / orientation_rad2 - 1.0).abs() < 0.02,
        "{large:?}"
    );
    assert!(large.tangent_m2 > 1.3 * large.position_m2);
}
