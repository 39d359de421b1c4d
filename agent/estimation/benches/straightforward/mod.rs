//! The particle filter as one would write it down: a list of particles, each with its vectors. It does what the real one
//! does, injection and roughening included, and is what that is measured against.

use nalgebra::{Matrix3, Rotation3, SMatrix, SVector, UnitVector3, Vector3};
use rand::{Rng, RngExt as _};
use rand_distr::{Distribution as _, StandardNormal};
use skein_estimation::mutual::direction;
use skein_estimation::mutual::filter::mixture::{Answer, Tempering};
use skein_estimation::mutual::filter::particles::ParticleSettings;
use skein_estimation::mutual::{Motion, Reduced, propagation};
use std::f64::consts::PI;

const SETTINGS: ParticleSettings = ParticleSettings::PAPER;

#[derive(Clone, Copy)]
struct Particle {
    state: Reduced,
    weight: f64,
}

pub(crate) struct Straightforward {
    particles: Vec<Particle>,
}

fn normal(rng: &mut impl Rng) -> f64 {
    StandardNormal.sample(rng)
}

fn normals(rng: &mut impl Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| normal(rng))
}

fn drawn(answer: &Answer, rng: &mut impl Rng) -> Reduced {
    let sigma = answer.covariance_rad2.m11.sqrt();
    let off = normals(rng) * sigma;
    let prior = &SETTINGS.prior;
    let distance = prior.distance_min_m
        * (prior.distance_max_m / prior.distance_min_m).powf(rng.random::<f64>());
    Reduced {
        position_m: direction::moved(&answer.direction, &off.xy()).into_inner() * distance,
        velocity_m_s: normals(rng) * prior.speed_sigma_m_s,
        yaw_rad: answer.yaw_rad + off.z,
    }
}

/// Smooths by the covariance of all, in the coordinates that the real one uses; all are of one cluster here.
fn smooth(states: &mut [Reduced], rng: &mut impl Rng) {
    let count = states.len() as f64;
    let middle = states
        .iter()
        .map(|state| state.position_m.normalize())
        .sum::<Vector3<f64>>();
    let middle = UnitVector3::new_normalize(middle);
    let turned = |state: &Reduced| Vector3::new(state.yaw_rad.cos(), state.yaw_rad.sin(), 0.0);
    let yaw = states.iter().map(turned).sum::<Vector3<f64>>();
    let yaw_rad = yaw.y.atan2(yaw.x);
    let coordinates: Vec<SVector<f64, 7>> = states
        .iter()
        .map(|state| {
            let distance = state.position_m.norm();
            let off = direction::difference(&middle, &UnitVector3::new_normalize(state.position_m));
            let v = state.velocity_m_s / distance;
            let yaw = direction::wrapped(state.yaw_rad - yaw_rad);
            SVector::<f64, 7>::from([off.x, off.y, 1.0 / distance, v.x, v.y, v.z, yaw])
        })
        .collect();
    let mean = coordinates.iter().sum::<SVector<f64, 7>>() / count;
    let covariance = coordinates
        .iter()
        .map(|one| (one - mean) * (one - mean).transpose() / count)
        .sum::<SMatrix<f64, 7, 7>>()
        + SMatrix::<f64, 7, 7>::identity() * 1e-5;
    let width = SETTINGS.bandwidth * (4.0 / (9.0 * count)).powf(1.0 / 11.0);
    let Some(root) = covariance.cholesky().map(|cholesky| cholesky.l() * width) else {
        return;
    };
    let kept = (1.0 - width * width).sqrt();
    for (state, one) in states.iter_mut().zip(&coordinates) {
        let white = SVector::<f64, 7>::from_fn(|_, _| normal(rng));
        let moved = mean + (one - mean) * kept + root * white;
        let distance = 1.0 / moved[2].max(0.3 * one[2]);
        state.position_m = direction::moved(&middle, &moved.xy()).into_inner() * distance;
        state.velocity_m_s = Vector3::new(moved[3], moved[4], moved[5]) * distance;
        state.yaw_rad = direction::wrapped(yaw_rad + moved[6]);
    }
}

impl Straightforward {
    pub(crate) fn born(answers: &[Answer], rng: &mut impl Rng) -> Self {
        let n = SETTINGS.particles;
        let particle = |i| Particle {
            state: drawn(&answers[i % answers.len()], rng),
            weight: 1.0 / n as f64,
        };
        Self {
            particles: (0..n).map(particle).collect(),
        }
    }

    pub(crate) fn predict(&mut self, own: &Motion, neighbour: &Motion, rng: &mut impl Rng) {
        let root = own.elapsed_s.sqrt();
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), -own.yaw_rad);
        for particle in &mut self.particles {
            let noise = turn * normals(rng) * SETTINGS.noise.velocity_m_s_rs * root;
            particle.state = propagation::propagated(&particle.state, own, neighbour);
            particle.state.position_m += noise * own.elapsed_s / 2.0;
            particle.state.velocity_m_s += noise;
            particle.state.yaw_rad += normal(rng) * SETTINGS.noise.yaw_rad_rs * root;
        }
    }

    pub(crate) fn update(&mut self, answers: &[Answer], rng: &mut impl Rng) {
        let tempering = Tempering::CAUTIOUS;
        let likelihoods: Vec<f64> = answers
            .iter()
            .map(|answer| (answer.log_likelihood * tempering.exponent).exp())
            .collect();
        let sum: f64 = likelihoods.iter().sum();
        let information: Vec<Matrix3<f64>> = answers
            .iter()
            .map(|answer| answer.covariance_rad2.try_inverse().unwrap_or_default())
            .collect();
        let mut explained = vec![0.0; answers.len()];
        for particle in &mut self.particles {
            let toward = UnitVector3::new_normalize(particle.state.position_m);
            let mut density = tempering.floor / (8.0 * PI * PI);
            for (k, answer) in answers.iter().enumerate() {
                let off = direction::difference(&answer.direction, &toward);
                let yaw_off = direction::wrapped(particle.state.yaw_rad - answer.yaw_rad);
                let residual = Vector3::new(off.x, off.y, yaw_off);
                let distance2 = residual.dot(&(information[k] * residual));
                let height = (information[k].determinant() / (2.0 * PI).powi(3)).sqrt();
                density += (1.0 - tempering.floor) * likelihoods[k] / sum
                    * height
                    * (-0.5 * distance2).exp();
                if distance2 < 16.3 {
                    explained[k] += particle.weight;
                }
            }
            particle.weight *= density;
        }
        let sum: f64 = self.particles.iter().map(|p| p.weight).sum();
        for particle in &mut self.particles {
            particle.weight /= sum;
        }
        let n = self.particles.len();
        let injected: Vec<_> = answers
            .iter()
            .zip(&explained)
            .zip(&likelihoods)
            .filter(|((_, explained), likelihood)| {
                **explained < SETTINGS.unexplained_below && **likelihood >= 0.5
            })
            .flat_map(|((answer, _), _)| vec![answer; n / 10])
            .map(|answer| drawn(answer, rng))
            .collect();
        let effective = 1.0 / self.particles.iter().map(|p| p.weight.powi(2)).sum::<f64>();
        if injected.is_empty() && effective > SETTINGS.resample_below * n as f64 {
            return;
        }
        self.resample(&injected, rng);
    }

    fn resample(&mut self, injected: &[Reduced], rng: &mut impl Rng) {
        let n = self.particles.len();
        let kept = n - injected.len();
        let mut resampled = Vec::with_capacity(n);
        let mut at = rng.random::<f64>() / kept as f64;
        let mut passed = 0.0;
        for particle in &self.particles {
            passed += particle.weight;
            while at < passed && resampled.len() < kept {
                resampled.push(particle.state);
                at += 1.0 / kept as f64;
            }
        }
        smooth(&mut resampled, rng);
        resampled.extend_from_slice(injected);
        let weight = 1.0 / resampled.len() as f64;
        self.particles = resampled
            .into_iter()
            .map(|state| Particle { state, weight })
            .collect();
    }
}
