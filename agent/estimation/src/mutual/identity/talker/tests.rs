//! How a vehicle is held to go on when it says nothing.

use super::super::flight::{Flight, stamp};
use super::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// Told at 1 s, turning at 0.5 rad/s and accelerating at 2 m/s^2 along x.
fn told() -> Talker {
    let centres = [[0.0, 0.0, 2.0], [3.0, -1.0, 3.0]];
    let mut flight = Flight::new(&centres, 2, 0.05, ChaCha8Rng::seed_from_u64(1));
    let mut set = flight.set(1, 0.9);
    let mut talker = Talker::new(VehicleId(1), &set).expect("it is understood");
    set.taken = stamp(1.0);
    set.inertial.elapsed_s += 0.1;
    set.inertial.position_m += set.inertial.velocity_m_s * 0.1;
    set.inertial.yaw_rad += 0.05;
    set.inertial.velocity_m_s.x += 0.2;
    assert_eq!(talker.hear(&set), Ok(Taken::Newer));
    talker
}

#[test]
fn it_goes_on_turning_and_accelerating_for_a_while() {
    let talker = told();
    let since = |t_s| talker.inertial_at(stamp(t_s)).since(&talker.inertial);
    let soon = since(1.2);
    assert!((soon.yaw_rad - 0.1).abs() < 1e-9, "{soon:?}");
    assert!((soon.velocity_m_s.norm() - 0.4).abs() < 1e-9, "{soon:?}");
    assert!((soon.position_m.norm() - 0.04).abs() < 1e-9, "{soon:?}");
    // Then it flies straight on.
    let late = since(2.0);
    assert!((late.yaw_rad - 0.15).abs() < 1e-9 && (late.velocity_m_s.norm() - 0.6).abs() < 1e-9);
    assert!(
        (late.position_m.norm() - 0.6 * 0.85).abs() < 1e-9,
        "{late:?}"
    );
}

#[test]
fn it_may_do_anything_once_it_is_silent() {
    let talker = told();
    assert_eq!(talker.unheard(stamp(1.2), 0.05), (0.0, 0.0));
    let (velocity, yaw) = talker.unheard(stamp(1.4), 0.05);
    assert!((velocity - 0.15).abs() < 1e-12 && (yaw - 0.005).abs() < 1e-12);
}

#[test]
fn what_was_guessed_is_made_good() {
    let mut talker = told();
    let _ = talker.moved_until(stamp(1.0));
    let guessed = talker.moved_until(stamp(1.1));
    assert!((guessed.yaw_rad - 0.05).abs() < 1e-9);
    let back = talker.moved_until(stamp(1.0));
    assert!((back.yaw_rad + 0.05).abs() < 1e-9);
}

#[test]
fn a_clock_that_drifts_is_followed_and_one_that_is_set_begins_anew() {
    let mut flight = Flight::new(
        &[[0.0, 0.0, 2.0], [3.0, -1.0, 3.0]],
        2,
        0.05,
        ChaCha8Rng::seed_from_u64(2),
    );
    let mut told_at = |t_s: f64, clock_s: f64| {
        let mut set = flight.set(1, t_s);
        set.taken = stamp(clock_s);
        set
    };
    let first = told_at(0.0, 0.0);
    let mut talker = Talker::new(VehicleId(1), &first).expect("it is understood");
    // Half a per cent over a minute: three times what a step may be.
    for second in 1..=60 {
        let t_s = f64::from(second);
        let outcome = talker.hear(&told_at(t_s, 1.005 * t_s));
        assert_eq!(outcome, Ok(Taken::Newer), "after {second} s");
    }
    let mut set_back = talker.clone();
    let ahead = talker.hear(&told_at(60.1, 60.1 * 1.005 + 0.15));
    assert_eq!(ahead, Ok(Taken::Restarted));
    let behind = set_back.hear(&told_at(61.0, 61.0 * 1.005 - 0.15));
    assert_eq!(behind, Ok(Taken::Restarted));
}
