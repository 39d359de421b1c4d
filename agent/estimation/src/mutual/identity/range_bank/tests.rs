//! What the bank makes of motions and sights.

use super::super::flight::{Flight, PERIOD_S};
use super::*;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

/// How many times as far as it is a neighbour is held to be after 12 s.
fn distance_ratio(centre_m: [f64; 3], softened: f64) -> f64 {
    let centres = [[0.0, 0.0, 2.0], centre_m];
    let mut flight = Flight::new(&centres, 2, 0.03, ChaCha8Rng::seed_from_u64(3));
    let start = flight.relative(0, 1, 0.0);
    let toward = UnitVector3::new_normalize(start.position_m);
    let mut bank = RangeBank::new(&toward, start.yaw_rad);
    for step in 0..240 {
        let (from_s, to_s) = (f64::from(step) * PERIOD_S, f64::from(step + 1) * PERIOD_S);
        let moved = |robot| {
            flight
                .inertial(robot, to_s)
                .since(&flight.inertial(robot, from_s))
        };
        bank.predict(PERIOD_S, &moved(0), &moved(1), (0.0, 0.0));
        for observer in 0..2 {
            let feature = flight.set(observer, to_s).features[0];
            let sight = PairSight {
                by_neighbour: observer == 1,
                direction: feature.direction,
                age_s: 0.0,
                variance_rad2: feature.sigma_rad.powi(2),
            };
            bank.update(&sight, softened);
        }
    }
    bank.state().position_m.norm() / flight.relative(0, 1, 12.0).position_m.norm()
}

#[test]
fn motion_tells_the_near_from_the_far() {
    for centre_m in [[1.8, -0.4, 2.6], [6.5, -2.0, 3.0]] {
        let ratio = distance_ratio(centre_m, 1.0);
        assert!((0.75..1.33).contains(&ratio), "{centre_m:?}: {ratio}");
    }
}

#[test]
fn who_is_doubted_teaches_less() {
    let (sure, doubted) = (
        distance_ratio([6.5, -2.0, 3.0], 1.0),
        distance_ratio([6.5, -2.0, 3.0], 1e6),
    );
    assert!(
        (doubted - 1.0).abs() > (sure - 1.0).abs(),
        "{sure} {doubted}"
    );
}
