//! The worlds of section V, looked at.

use super::*;

fn swarm(settings: SwarmSettings) -> PlanarSwarm {
    PlanarSwarm::new(settings, &Streams::new(1, 0))
}

#[test]
fn odometry_without_noise_takes_a_robot_from_where_it_was_to_where_it_is() {
    let mut swarm = swarm(SwarmSettings::section_v(3, SwarmNoise::NONE));
    let before = swarm.pose(1);
    swarm.step(|_| Drive::Random);
    let motion = swarm.odometry(1);
    let (sin, cos) = before.heading_rad.sin_cos();
    let t = motion.translation_m;
    let reached = before.position_m + Vector2::new(cos * t.x - sin * t.y, sin * t.x + cos * t.y);
    assert!((reached - swarm.pose(1).position_m).norm() < 1e-12);
    // It drives along its new heading: the odometry's direction is the turn.
    assert!((t.y.atan2(t.x) - motion.rotation_rad).abs() < 1e-12);
    assert!(motion.rotation_rad.abs() <= FRAC_PI_4);
}

#[test]
fn who_stands_still_has_not_moved_and_does_not_change_how_others_move() {
    let settings = SwarmSettings::section_v(2, SwarmNoise::USUAL);
    let (mut both, mut one) = (swarm(settings), swarm(settings));
    both.step(|_| Drive::Random);
    one.step(|robot| {
        if robot == 0 {
            Drive::Stay
        } else {
            Drive::Random
        }
    });
    assert_eq!(one.odometry(0).translation_m, Vector2::zeros());
    assert_eq!(one.pose(1), both.pose(1));
    both.step(|_| Drive::Random);
    one.step(|_| Drive::Random);
    assert_eq!(one.pose(1), both.pose(1));
}

#[test]
fn walls_keep_robots_in_and_moves_straight() {
    let mut swarm = swarm(SwarmSettings {
        has_walls: true,
        ..SwarmSettings::section_v(10, SwarmNoise::NONE)
    });
    for _ in 0..500 {
        swarm.step(|_| Drive::Random);
        for robot in 0..10 {
            let at_m = swarm.pose(robot).position_m;
            assert!(at_m.min() >= 0.0 && at_m.max() <= 10.0, "{at_m}");
            let motion = swarm.odometry(robot);
            let t = motion.translation_m;
            assert!(wrapped_rad(t.y.atan2(t.x) - motion.rotation_rad).abs() < 1e-9);
        }
    }
}

#[test]
fn the_radio_reaches_so_many_on_average_and_nobody_beyond_is_measured() {
    let settings = SwarmSettings::section_v(400, SwarmNoise::NONE).with_mean_degree(8.0);
    let mut swarm = swarm(settings);
    let mut links = 0;
    for a in 0..400 {
        for b in 0..400 {
            assert_eq!(swarm.range_m(a, b).is_some(), swarm.are_linked(a, b));
            links += usize::from(swarm.are_linked(a, b));
        }
    }
    // Less than 8 near the edges.
    let mean = links as f64 / 400.0;
    assert!((6.5..8.0).contains(&mean), "{mean}");
}

#[test]
fn distances_are_as_noisy_as_asked_and_so_many_take_a_longer_way() {
    let mut swarm = swarm(SwarmSettings::section_v(
        2,
        SwarmNoise {
            outliers: 0.1,
            ..SwarmNoise::USUAL
        },
    ));
    let truth_m = swarm.relative(0, 1).position_m.norm();
    let errors = (0..10_000).filter_map(|_| Some(swarm.range_m(0, 1)? - truth_m));
    let (near, far): (Vec<f64>, Vec<f64>) = errors.partition(|error_m| *error_m < 0.6);
    let variance = near.iter().map(|error_m| error_m.powi(2)).sum::<f64>() / near.len() as f64;
    assert!((variance.sqrt() - 0.1).abs() < 0.005, "{}", variance.sqrt());
    assert!((900..1100).contains(&far.len()), "{}", far.len());
}
