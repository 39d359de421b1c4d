//! What every filter of a neighbour must do.

use super::bank::BankSettings;
use super::flight::Flight;
use super::mixture::{Answer, Mixture, Tempering};
use super::particles::ParticleSettings;
use super::*;
use crate::mutual::direction;
use nalgebra::{Matrix3, Vector3};

const BOTH: [FilterSettings; 2] = [
    FilterSettings::Particles(ParticleSettings::PAPER),
    FilterSettings::Bank(BankSettings::QUADROTOR),
];

/// The neighbour is mistaken for something a right angle to the left that heads elsewhere.
fn mistaken(right: &Answer) -> Answer {
    Answer {
        direction: direction::turned(&right.direction, 1.6),
        yaw_rad: right.yaw_rad - 1.5,
        own_feature: Some(1),
        ..*right
    }
}

#[test]
fn directions_and_accelerations_tell_the_distance() {
    for settings in BOTH {
        let mut flight = Flight::new(settings, 1);
        flight.fly(20.0);
        let estimate = flight.estimate();
        let (off, yaw_off) = flight.error(&estimate.dominant);
        assert!(off < 0.1 && yaw_off < 0.03, "{settings:?}: {off} {yaw_off}");
        assert_eq!(estimate.modes, 1);
        assert!(estimate.relative_distance_sigma() < 0.15);
    }
}

#[test]
fn the_distance_is_unknown_before_anyone_moves() {
    for settings in BOTH {
        let mut flight = Flight::new(settings, 2);
        flight.fly(0.2);
        assert!(
            flight.estimate().relative_distance_sigma() > 0.3,
            "{settings:?}"
        );
    }
}

#[test]
fn two_equal_answers_are_two_places_until_one_goes() {
    for settings in BOTH {
        let mut flight = Flight::new(settings, 3);
        for _ in 0..10 {
            flight.step();
            let right = flight.right(0.05);
            flight.measure(&[right, mistaken(&right)]);
        }
        assert_eq!(flight.estimate().modes, 2, "{settings:?}");
        flight.fly(4.0);
        let estimate = flight.estimate();
        assert_eq!(estimate.modes, 1, "{settings:?}");
        assert!(flight.error(&estimate.dominant).1 < 0.1);
    }
}

#[test]
fn a_belief_that_was_wrong_from_the_start_is_given_up() {
    for settings in BOTH {
        let mut flight = Flight::new(settings, 4);
        for _ in 0..20 {
            flight.step();
            let right = flight.right(0.05);
            flight.measure(&[mistaken(&right)]);
        }
        flight.fly(15.0);
        let estimate = flight.estimate();
        let (off, yaw_off) = flight.error(&estimate.dominant);
        assert!(off < 0.25 && yaw_off < 0.1, "{settings:?}: {off} {yaw_off}");
    }
}

#[test]
fn three_wrong_answers_in_a_row_do_not_move_a_belief_and_many_do() {
    for settings in BOTH {
        let mut flight = Flight::new(settings, 5);
        flight.fly(15.0);
        let mut mistake = |times| {
            for _ in 0..times {
                flight.step();
                let right = flight.right(0.05);
                flight.measure(&[mistaken(&right)]);
            }
            let estimate = flight.estimate();
            flight.error(&estimate.dominant)
        };
        let (off, yaw_off) = mistake(3);
        assert!(off < 0.15 && yaw_off < 0.1, "{settings:?}: {off} {yaw_off}");
        // Six tenths of a second of one and the same answer are not chance any more.
        let (_, yaw_off) = mistake(9);
        assert!(yaw_off > 1.0, "{settings:?}: {yaw_off}");
    }
}

#[test]
fn the_feature_that_fits_the_belief_is_the_neighbour() {
    for settings in BOTH {
        let mut flight = Flight::new(settings, 6);
        flight.fly(15.0);
        let right = flight.right(0.05);
        let answers = [mistaken(&right), right];
        let mixture = Mixture::new(&answers, &[], &Tempering::CAUTIOUS).unwrap();
        let mut rng = flight.rng.clone();
        let said = flight.filter.as_mut().unwrap().update(&mixture, &mut rng);
        let probability = |feature| {
            said.own_features
                .iter()
                .find(|(known, _)| *known == feature)
                .map_or(0.0, |(_, probability)| *probability)
        };
        assert!(
            probability(0) > 0.9 && probability(1) < 0.05,
            "{settings:?}: {said:?}"
        );
    }
}

#[test]
fn the_same_seed_makes_the_same_belief() {
    for settings in BOTH {
        let estimate = |seed| {
            let mut flight = Flight::new(settings, seed);
            flight.fly(2.0);
            flight.estimate()
        };
        assert_eq!(estimate(7), estimate(7));
        assert_ne!(estimate(7), estimate(8));
    }
}

#[test]
fn motions_out_of_this_world_do_no_harm() {
    let absurd = |number: f64| Motion {
        elapsed_s: number,
        yaw_rad: number,
        velocity_m_s: Vector3::repeat(number),
        position_m: Vector3::repeat(-number),
    };
    for settings in BOTH {
        for number in [1e3, 1e12, 1e300, -1e9] {
            let mut flight = Flight::new(settings, 9);
            flight.fly(1.0);
            let mut rng = flight.rng.clone();
            if let Some(filter) = &mut flight.filter {
                filter.predict(&absurd(number), &absurd(-number), &mut rng);
            }
            flight.fly(0.5);
            let _ = flight.estimate();
        }
    }
}

#[test]
fn answers_straight_up_are_answers() {
    let up = Answer {
        direction: direction::from_angles(0.0, 0.0),
        yaw_rad: 0.5,
        covariance_rad2: Matrix3::identity() * 0.0025,
        log_likelihood: 0.0,
        own_feature: None,
    };
    let down = Answer {
        direction: direction::from_angles(0.0, std::f64::consts::PI),
        ..up
    };
    for settings in BOTH {
        let mut flight = Flight::new(settings, 10);
        flight.measure(&[up, down]);
        flight.measure(&[up]);
        flight.measure(&[up]);
        let estimate = flight.estimate();
        assert!(
            estimate.dominant.position_m.normalize().z > 0.99,
            "{settings:?}"
        );
    }
}

#[test]
fn the_likeliest_places_are_as_many_as_asked_for() {
    for settings in BOTH {
        let mut flight = Flight::new(settings, 11);
        flight.fly(3.0);
        let best = flight.estimate().best;
        let filter = flight.filter.as_ref().unwrap();
        assert_eq!(filter.likeliest(1), [best]);
        assert!(filter.likeliest(100).len() <= 100);
    }
}
