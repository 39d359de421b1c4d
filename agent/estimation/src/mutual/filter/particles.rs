//! The paper's filter of one neighbour: particles of relative position, velocity and yaw (Cognetti et al., section III-B).
//!
//! Each number of the state is a row of its own over all particles, and yaw is kept as its cosine and sine, so that a step
//! is a few multiplications per particle that the compiler puts side by side. No step allocates.

mod estimate;

mod roughening;

use super::mixture::{Component, Mixture, Responsibilities};
use super::{MotionNoise, Prior, noise};
use crate::mutual::direction;
use crate::mutual::feature_set::Motion;
use nalgebra::{Vector2, Vector3};
use rand::{Rng, RngExt as _};
use rand_distr::{Distribution as _, StandardNormal};

/// Most particles of one filter.
pub const PARTICLES_MAX: usize = 20_000;
/// Fewest: below, a cluster of a few per cent is no cluster.
pub const PARTICLES_MIN: usize = 100;

/// How a particle filter works.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ParticleSettings {
    /// How many, [`PARTICLES_MIN`] to [`PARTICLES_MAX`].
    pub particles: usize,
    /// What is known at first.
    pub prior: Prior,
    /// How far the motions may be wrong.
    pub noise: MotionNoise,
    /// Resample when the effective number of particles is below this part of them.
    pub resample_below: f64,
    /// Width of the kernel that smooths resampled particles, over the one that suits a Gaussian best.
    pub bandwidth: f64,
    /// Which part of the particles is put where an answer is that no particle explains.
    pub injected: f64,
    /// What part of the weight they get there: [`INJECTED_WEIGHT`](super::INJECTED_WEIGHT).
    pub injected_weight: f64,
    /// An answer at least half as likely as the likeliest is unexplained while less than this part of the particles is near.
    pub unexplained_below: f64,
}

impl ParticleSettings {
    /// As many particles as the paper's figures were taken with.
    pub const PAPER: Self = Self {
        particles: 2000,
        prior: Prior::ARENA,
        noise: MotionNoise::QUADROTOR,
        resample_below: 0.5,
        bandwidth: 0.7,
        injected: 0.1,
        injected_weight: super::INJECTED_WEIGHT,
        unexplained_below: 0.02,
    };
}

/// Beyond this Mahalanobis distance, squared, a density counts as zero.
const NEGLIGIBLE: f64 = 60.0;
/// Within this, squared, a particle explains an answer: 99.9 % of those that do.
const EXPLAINED: f64 = 16.3;

/// Rows of the state: position, velocity, cosine and sine of the yaw.
const ROWS: usize = 8;
const COS_YAW: usize = 6;
const SIN_YAW: usize = 7;

type Rows = [Vec<f64>; ROWS];

/// A particle filter of one neighbour.
#[derive(Clone, Debug)]
pub struct Particles {
    settings: ParticleSettings,
    rows: Rows,
    /// Of a sum of one.
    weight: Vec<f64>,
    /// The particle that was heaviest when it was last weighed.
    best: usize,
    spare_rows: Rows,
    likelihood: Vec<f64>,
    distance2: Vec<f64>,
    noise: Vec<f64>,
    ancestor: Vec<usize>,
    labels: Vec<u8>,
}

impl Particles {
    /// Particles around the answers of a first measurement, as many at each as it is likely.
    #[must_use]
    pub fn born(settings: ParticleSettings, first: &Mixture, rng: &mut impl Rng) -> Self {
        let n = settings.particles.clamp(PARTICLES_MIN, PARTICLES_MAX);
        let mut born = Self {
            settings,
            rows: std::array::from_fn(|_| vec![0.0; n]),
            weight: vec![1.0 / n as f64; n],
            best: 0,
            spare_rows: std::array::from_fn(|_| vec![0.0; n]),
            likelihood: vec![0.0; n],
            distance2: vec![0.0; n],
            noise: vec![0.0; ROWS * noise::DRAWN],
            ancestor: vec![0; n],
            labels: vec![0; n],
        };
        let mut next = 0;
        let mut mass = 0.0;
        for component in first.components() {
            mass += component.weight;
            let end = ((mass * n as f64).round() as usize).min(n);
            for i in next..end {
                draw(&mut born.rows, i, component, &settings.prior, rng);
            }
            next = next.max(end);
        }
        born
    }

    /// Moves every particle as both vehicles moved, each with noise of its own.
    pub fn predict(&mut self, own: &Motion, neighbour: &Motion, rng: &mut impl Rng) {
        let elapsed = own.elapsed_s.max(0.0);
        let root = elapsed.sqrt();
        let velocity_noise = self.settings.noise.velocity_m_s_rs * root;
        let yaw_noise = self.settings.noise.yaw_rad_rs * root;
        let (own_sin, own_cos) = own.yaw_rad.sin_cos();
        let (turn_sin, turn_cos) = (neighbour.yaw_rad - own.yaw_rad).sin_cos();
        let (own_p, own_v) = (own.position_m, own.velocity_m_s);
        let (p, v) = (neighbour.position_m, neighbour.velocity_m_s);
        let n = self.weight.len();
        for start in (0..n).step_by(noise::DRAWN) {
            let len = noise::DRAWN.min(n - start);
            noise::fill(&mut self.noise[..4 * len], rng);
            let (noise_x, rest) = self.noise[..4 * len].split_at(len);
            let (noise_y, rest) = rest.split_at(len);
            let (noise_z, noise_yaw) = rest.split_at(len);
            let [x, y, z, vx, vy, vz, cos, sin] =
                self.rows.each_mut().map(|row| &mut row[start..start + len]);
            for i in 0..len {
                let (c, s) = (cos[i], sin[i]);
                let nx = velocity_noise * noise_x[i];
                let ny = velocity_noise * noise_y[i];
                let nz = velocity_noise * noise_z[i];
                // In the level frame of before (paper eq. 18 and 19, corrected).
                let half = 0.5 * elapsed;
                let px = x[i] + vx[i] * elapsed + c * p.x - s * p.y - own_p.x + half * nx;
                let py = y[i] + vy[i] * elapsed + s * p.x + c * p.y - own_p.y + half * ny;
                let wx = vx[i] + c * v.x - s * v.y - own_v.x + nx;
                let wy = vy[i] + s * v.x + c * v.y - own_v.y + ny;
                z[i] += vz[i] * elapsed + p.z - own_p.z + half * nz;
                vz[i] += v.z - own_v.z + nz;
                // In the level frame of after.
                x[i] = own_cos * px + own_sin * py;
                y[i] = own_cos * py - own_sin * px;
                vx[i] = own_cos * wx + own_sin * wy;
                vy[i] = own_cos * wy - own_sin * wx;
                // Paper eq. 22; the noise's angle is small.
                let d = yaw_noise * noise_yaw[i];
                let (turned_c, turned_s) =
                    (c * turn_cos - s * turn_sin, s * turn_cos + c * turn_sin);
                let (c, s) = (turned_c - d * turned_s, turned_s + d * turned_c);
                let unit = 1.5 - 0.5 * (c * c + s * s);
                cos[i] = c * unit;
                sin[i] = s * unit;
            }
        }
    }

    /// Weighs the particles by the answers (paper eq. 23), resamples them when few carry the weight, and puts some where a
    /// likely answer is that none explains.
    pub fn update(&mut self, measured: &Mixture, rng: &mut impl Rng) -> Responsibilities {
        let components = measured.components();
        let mut explained = [0.0; super::mixture::COMPONENTS_MAX];
        let mut responsible = [0.0; super::mixture::COMPONENTS_MAX];
        let share = 1.0 / self.weight.len() as f64;
        self.likelihood.fill(measured.floor_density());
        for (k, component) in components.iter().enumerate() {
            self.measure(component);
            for ((&weight, likelihood), &distance2) in self
                .weight
                .iter()
                .zip(&mut self.likelihood)
                .zip(&self.distance2)
            {
                if distance2 < NEGLIGIBLE {
                    let density = (component.log_summit - 0.5 * distance2).exp();
                    *likelihood += density;
                    responsible[k] += weight * density;
                    explained[k] += if distance2 < EXPLAINED { share } else { 0.0 };
                }
            }
        }
        let sum = self.weigh();
        for responsible in &mut responsible {
            *responsible /= sum;
        }
        let unexplained_below = self.settings.unexplained_below;
        let unexplained = components
            .iter()
            .zip(explained)
            .filter(|(component, explained)| {
                component.weight >= 0.5 * components[0].weight && *explained < unexplained_below
            })
            .map(|(component, _)| component);
        self.renew(unexplained, rng);
        measured.by_feature(&responsible[..components.len()])
    }

    /// Squared Mahalanobis distance of every particle from an answer.
    ///
    /// Angles are measured as twice the tangent of their half: equal to third order, and farther beyond.
    fn measure(&mut self, to: &Component) {
        let toward = to.direction.into_inner();
        let [across, up] = to.tangents;
        let w = &to.whitening;
        let (w00, w10, w11) = (w.m11, w.m21, w.m22);
        let (w20, w21, w22) = (w.m31, w.m32, w.m33);
        let n = self.distance2.len();
        let [x, y, z, _, _, _, cos, sin] = self.rows.each_ref().map(|row| &row[..n]);
        for i in 0..n {
            let (px, py, pz) = (x[i], y[i], z[i]);
            let inverse = 1.0 / (px * px + py * py + pz * pz).sqrt();
            let along = (px * toward.x + py * toward.y + pz * toward.z) * inverse;
            let half = 2.0 * inverse / (1.0 + along);
            let a = (px * across.x + py * across.y + pz * across.z) * half;
            let b = (px * up.x + py * up.y + pz * up.z) * half;
            let yaw_cos = cos[i] * to.cos_yaw + sin[i] * to.sin_yaw;
            let yaw_sin = sin[i] * to.cos_yaw - cos[i] * to.sin_yaw;
            let c = 2.0 * yaw_sin / (1.0 + yaw_cos);
            let first = w00 * a;
            let second = w10 * a + w11 * b;
            let third = w20 * a + w21 * b + w22 * c;
            self.distance2[i] = first * first + second * second + third * third;
        }
    }

    /// Multiplies likelihoods into weights; gives their sum before it is made one.
    fn weigh(&mut self) -> f64 {
        let mut sum = 0.0;
        let mut heaviest = (f64::NEG_INFINITY, 0);
        for (i, (weight, &likelihood)) in self.weight.iter_mut().zip(&self.likelihood).enumerate() {
            *weight *= likelihood;
            sum += *weight;
            if *weight > heaviest.0 {
                heaviest = (*weight, i);
            }
        }
        self.best = heaviest.1;
        if sum.is_finite() && sum > f64::MIN_POSITIVE {
            let inverse = 1.0 / sum;
            for weight in &mut self.weight {
                *weight *= inverse;
            }
            sum
        } else {
            // Only without a floor: the measurement says nothing then.
            let n = self.weight.len() as f64;
            self.weight.fill(1.0 / n);
            1.0
        }
    }

    fn effective(&self) -> f64 {
        1.0 / self
            .weight
            .iter()
            .map(|weight| weight * weight)
            .sum::<f64>()
    }

    /// Resamples when it is time to, or when particles are needed elsewhere.
    fn renew<'a>(&mut self, unexplained: impl Iterator<Item = &'a Component>, rng: &mut impl Rng) {
        let n = self.weight.len();
        let share = (self.settings.injected.clamp(0.0, 0.5) * n as f64) as usize;
        let mut kept = n;
        let mut injected_weight = 0.0;
        for component in unexplained {
            // At least half of the particles stay, whatever is unexplained.
            if kept < share + n / 2 {
                break;
            }
            kept -= share;
            injected_weight += self.settings.injected_weight.clamp(0.0, 0.1);
            for i in kept..kept + share {
                draw(
                    &mut self.spare_rows,
                    i,
                    component,
                    &self.settings.prior,
                    rng,
                );
            }
        }
        if kept == n && self.effective() > self.settings.resample_below * n as f64 {
            return;
        }
        choose(&self.weight, &mut self.ancestor[..kept], rng.random());
        for (spare, row) in self.spare_rows.iter_mut().zip(&self.rows) {
            for (copy, &ancestor) in spare[..kept].iter_mut().zip(&self.ancestor) {
                *copy = row[ancestor];
            }
        }
        let best = self.rows.each_ref().map(|row| row[self.best]);
        std::mem::swap(&mut self.rows, &mut self.spare_rows);
        self.weight.fill(1.0 / n as f64);
        self.roughen(kept, rng);
        let (kept_part, injected_part) = self.weight.split_at_mut(kept);
        kept_part.fill((1.0 - injected_weight) / kept as f64);
        injected_part.fill(injected_weight / injected_part.len().max(1) as f64);
        // The best stays what it is, and is not lost: its weight is at least the mean.
        let before = self.best;
        self.best = self.ancestor[..kept].partition_point(|&ancestor| ancestor < before);
        self.best = self.best.min(kept - 1);
        for (row, number) in self.rows.iter_mut().zip(best) {
            row[self.best] = number;
        }
    }
}

/// Draws the particle at such an index from an answer and the prior.
fn draw(rows: &mut Rows, i: usize, from: &Component, prior: &Prior, rng: &mut impl Rng) {
    let mut normal = || -> f64 { StandardNormal.sample(rng) };
    let white = Vector3::new(normal(), normal(), normal());
    let speed = Vector3::new(normal(), normal(), normal()) * prior.speed_sigma_m_s;
    let factor = from.covariance_root * white;
    let step = Vector2::new(factor.x, factor.y);
    let distance = prior.distance_min_m
        * (prior.distance_max_m / prior.distance_min_m).powf(rng.random::<f64>());
    let position = direction::moved(&from.direction, &step).into_inner() * distance;
    let (sin, cos) = (from.yaw_rad + factor.z).sin_cos();
    let state = [
        position.x, position.y, position.z, speed.x, speed.y, speed.z, cos, sin,
    ];
    for (row, number) in rows.iter_mut().zip(state) {
        row[i] = number;
    }
}

/// Chooses ancestors in proportion to their weights (of a sum of one), one at every equal step of the mass after a random
/// start in 0..1: so each is chosen as often as its weight says, or once more or less.
pub(super) fn choose(weight: &[f64], ancestors: &mut [usize], start: f64) {
    let step = 1.0 / ancestors.len() as f64;
    let mut at = start * step;
    let mut ancestor = 0;
    let mut passed = weight.first().copied().unwrap_or(0.0);
    for chosen in ancestors {
        while passed < at && ancestor + 1 < weight.len() {
            ancestor += 1;
            passed += weight[ancestor];
        }
        *chosen = ancestor;
        at += step;
    }
}

#[cfg(test)]
mod tests;
