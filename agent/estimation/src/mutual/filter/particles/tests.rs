//! The particle filter's own.

use super::*;
use crate::mutual::filter::mixture::{Answer, Tempering};
use crate::mutual::propagation::propagated;
use nalgebra::Matrix3;
use rand::SeedableRng as _;
use rand_chacha::ChaCha8Rng;

fn quiet() -> ParticleSettings {
    ParticleSettings {
        particles: 500,
        noise: MotionNoise {
            velocity_m_s_rs: 0.0,
            yaw_rad_rs: 0.0,
        },
        ..ParticleSettings::PAPER
    }
}

fn ahead() -> Mixture {
    let answer = Answer {
        direction: direction::from_angles(0.2, 1.4),
        yaw_rad: 2.0,
        covariance_rad2: Matrix3::new(0.01, 0.002, 0.0, 0.002, 0.005, 0.001, 0.0, 0.001, 0.02),
        log_likelihood: 0.0,
        own_feature: None,
    };
    Mixture::new(&[answer], &[], &Tempering::CAUTIOUS).unwrap()
}

#[test]
fn without_noise_every_particle_moves_as_the_state_does() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let mut particles = Particles::born(quiet(), &ahead(), &mut rng);
    let before: Vec<_> = (0..500).map(|i| particles.particle(i)).collect();
    let motion = |by: f64| Motion {
        elapsed_s: 0.4,
        yaw_rad: 0.3 * by,
        velocity_m_s: Vector3::new(0.5, -0.2, 0.1) * by,
        position_m: Vector3::new(0.1, 0.2, -0.3) * by,
    };
    particles.predict(&motion(1.0), &motion(-0.7), &mut rng);
    for (i, before) in before.iter().enumerate() {
        let expected = propagated(before, &motion(1.0), &motion(-0.7));
        let moved = particles.particle(i);
        assert!((moved.position_m - expected.position_m).norm() < 1e-12);
        assert!((moved.velocity_m_s - expected.velocity_m_s).norm() < 1e-12);
        assert!(direction::wrapped(moved.yaw_rad - expected.yaw_rad).abs() < 1e-12);
    }
}

#[test]
fn each_ancestor_is_chosen_as_often_as_its_weight_says() {
    let weight = [0.05, 0.5, 0.0, 0.25, 0.2];
    let mut ancestors = [0; 100];
    for start in [0.0, 0.3, 0.999] {
        choose(&weight, &mut ancestors, start);
        for (ancestor, weight) in weight.iter().enumerate() {
            let times = ancestors.iter().filter(|&&a| a == ancestor).count() as f64;
            assert!((times - weight * 100.0).abs() <= 1.0, "{ancestor}: {times}");
        }
    }
}

#[test]
fn particles_are_born_where_the_answer_says_at_any_distance() {
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let settings = ParticleSettings {
        particles: 20_000,
        ..quiet()
    };
    let particles = Particles::born(settings, &ahead(), &mut rng);
    let toward = direction::from_angles(0.2, 1.4);
    let mut covariance = Matrix3::zeros();
    let mut near = 0;
    for i in 0..20_000 {
        let state = particles.particle(i);
        let off = direction::difference(
            &toward,
            &nalgebra::UnitVector3::new_normalize(state.position_m),
        );
        let error = Vector3::new(off.x, off.y, direction::wrapped(state.yaw_rad - 2.0));
        covariance += error * error.transpose() / 20_000.0;
        let middle = (settings.prior.distance_min_m * settings.prior.distance_max_m).sqrt();
        near += usize::from(state.position_m.norm() < middle);
    }
    let wanted = ahead().components()[0].covariance;
    assert!((covariance - wanted).norm() < 0.001, "{covariance}");
    assert!((9_700..10_300).contains(&near), "{near}");
}

#[test]
fn particles_are_never_fewer_or_more_than_stated() {
    let mut rng = ChaCha8Rng::seed_from_u64(3);
    let mut count = |particles| {
        let settings = ParticleSettings {
            particles,
            ..quiet()
        };
        Particles::born(settings, &ahead(), &mut rng).weight.len()
    };
    assert_eq!(count(0), PARTICLES_MIN);
    assert_eq!(count(usize::MAX), PARTICLES_MAX);
}

#[test]
fn resampling_keeps_the_best_particle_as_it_is() {
    let mut rng = ChaCha8Rng::seed_from_u64(4);
    let settings = ParticleSettings {
        resample_below: 1.1,
        ..quiet()
    };
    let mut particles = Particles::born(settings, &ahead(), &mut rng);
    particles.measure(&ahead().components()[0]);
    let nearest = (0..500)
        .min_by(|&a, &b| particles.distance2[a].total_cmp(&particles.distance2[b]))
        .unwrap();
    let expected = particles.particle(nearest);
    particles.update(&ahead(), &mut rng);
    assert_eq!(particles.estimate().best, expected);
}

#[test]
fn a_tenth_goes_to_an_answer_that_none_explains_and_half_stay_however_many_there_are() {
    let mut rng = ChaCha8Rng::seed_from_u64(5);
    let particles = Particles::born(quiet(), &ahead(), &mut rng);
    let elsewhere: Vec<_> = (0..8)
        .map(|i| Answer {
            direction: direction::from_angles(1.5 + 0.4 * f64::from(i), 1.2),
            yaw_rad: -1.0,
            covariance_rad2: Matrix3::identity() * 1e-4,
            log_likelihood: 0.0,
            own_feature: None,
        })
        .collect();
    let mut near = |answers: &[Answer]| {
        let mut particles = particles.clone();
        let measured = Mixture::new(answers, &[], &Tempering::CAUTIOUS).unwrap();
        particles.update(&measured, &mut rng);
        particles.measure(&ahead().components()[0]);
        let stayed = particles.distance2.iter().filter(|d2| **d2 < 30.0).count();
        500 - stayed
    };
    assert_eq!(near(&elsewhere[..1]), 50);
    assert_eq!(near(&elsewhere), 250);
}
