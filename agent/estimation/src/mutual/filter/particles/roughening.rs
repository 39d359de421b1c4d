//! Spreads copies of particles, so that they are not all the same: every cluster's particles are smoothed by a Gaussian
//! kernel of the cluster's own covariance, and drawn together as much as the kernel widens them (Liu and West 2001).
//!
//! The kernel's coordinates are direction, logarithm of the distance, velocity over distance, and yaw. In those, what a series of
//! directions tells is nearly Gaussian though the distance is not known yet, so that the smoothing forgets nothing.
//! Without it, 2000 particles in seven dimensions die out to a few and do as badly as a quarter of them would.

use super::{Particles, ROWS};
use crate::mutual::direction;
use crate::mutual::filter::noise;
use nalgebra::{SMatrix, SVector, UnitVector3, Vector3};
use rand::Rng;

/// Direction (2), logarithm of the distance, velocity over distance (3), yaw.
const N: usize = 7;
const LOG_DISTANCE: usize = 2;
const VELOCITY: usize = 3;
const YAW: usize = 6;

type Coordinates = SVector<f64, N>;

/// Standard deviations that no cluster falls below: direction and yaw (rad), logarithm of the distance, velocity over
/// distance (1/s). They part copies of a single particle.
const ANGLE_MIN_RAD: f64 = 0.005;
const LOG_DISTANCE_MIN: f64 = 0.01;
const VELOCITY_MIN_1_S: f64 = 0.005;

/// How far beyond the prior a distance may get, as a logarithm: three times.
const BEYOND_PRIOR: f64 = 1.1;

/// The middle of a cluster, around which its particles have coordinates.
struct Chart {
    toward: Vector3<f64>,
    tangents: [Vector3<f64>; 2],
    cos_yaw: f64,
    sin_yaw: f64,
}

/// What the particles of a cluster are moved by.
struct Kernel {
    mean: Coordinates,
    /// How near to the mean a particle stays.
    kept: f64,
    /// What white noise is multiplied by.
    root: SMatrix<f64, N, N>,
}

type State = [f64; ROWS];

impl Chart {
    fn around(mean: &State) -> Option<Self> {
        let toward = UnitVector3::try_new(Vector3::new(mean[0], mean[1], mean[2]), 1e-9)?;
        let yaw = mean[6].hypot(mean[7]);
        (yaw > 1e-9).then(|| Self {
            toward: toward.into_inner(),
            tangents: direction::tangents(&toward),
            cos_yaw: mean[6] / yaw,
            sin_yaw: mean[7] / yaw,
        })
    }

    /// Angles are twice the tangent of their half.
    fn coordinates(&self, state: &State) -> Coordinates {
        let [x, y, z, vx, vy, vz, c, s] = *state;
        let inverse = 1.0 / (x * x + y * y + z * z).sqrt();
        let unit = Vector3::new(x, y, z) * inverse;
        let half = 2.0 / (1.0 + unit.dot(&self.toward));
        let cos = c * self.cos_yaw + s * self.sin_yaw;
        let sin = s * self.cos_yaw - c * self.sin_yaw;
        Coordinates::from([
            unit.dot(&self.tangents[0]) * half,
            unit.dot(&self.tangents[1]) * half,
            -inverse.ln(),
            vx * inverse,
            vy * inverse,
            vz * inverse,
            2.0 * sin / (1.0 + cos),
        ])
    }

    /// Inverse of [`Self::coordinates`].
    fn state(&self, at: &Coordinates) -> State {
        let (a, b) = (at[0], at[1]);
        let q = a * a + b * b;
        let distance = at[LOG_DISTANCE].exp();
        let place = (self.toward * (4.0 - q) + (self.tangents[0] * a + self.tangents[1] * b) * 4.0)
            * (distance / (4.0 + q));
        let q = at[YAW] * at[YAW];
        let (cos, sin) = ((4.0 - q) / (4.0 + q), 4.0 * at[YAW] / (4.0 + q));
        [
            place.x,
            place.y,
            place.z,
            at[VELOCITY] * distance,
            at[VELOCITY + 1] * distance,
            at[VELOCITY + 2] * distance,
            cos * self.cos_yaw - sin * self.sin_yaw,
            sin * self.cos_yaw + cos * self.sin_yaw,
        ]
    }
}

impl Kernel {
    /// Of so many coordinates; `bandwidth` is over the one that suits a Gaussian best.
    fn of(coordinates: impl Iterator<Item = Coordinates> + Clone, bandwidth: f64) -> Option<Self> {
        let count = coordinates.clone().count() as f64;
        let mean = coordinates.clone().sum::<Coordinates>() / count;
        let mut covariance = SMatrix::<f64, N, N>::zeros();
        for one in coordinates {
            let error = one - mean;
            covariance.ger(1.0 / count, &error, &error, 1.0);
        }
        for (i, sigma) in [
            ANGLE_MIN_RAD,
            ANGLE_MIN_RAD,
            LOG_DISTANCE_MIN,
            VELOCITY_MIN_1_S,
            VELOCITY_MIN_1_S,
            VELOCITY_MIN_1_S,
            ANGLE_MIN_RAD,
        ]
        .into_iter()
        .enumerate()
        {
            covariance[(i, i)] += sigma * sigma;
        }
        let d = N as f64;
        let best = (4.0 / (count * (d + 2.0))).powf(1.0 / (d + 4.0));
        let width = (bandwidth * best).clamp(0.0, 0.9);
        Some(Self {
            mean,
            kept: (1.0 - width * width).sqrt(),
            root: covariance.cholesky()?.l() * width,
        })
    }

    fn moved(&self, from: &Coordinates, white: &Coordinates) -> Coordinates {
        self.mean + (from - self.mean) * self.kept + self.root * white
    }
}

impl Particles {
    /// Spreads the first so many particles, all equally weighted.
    pub(super) fn roughen(&mut self, kept: usize, rng: &mut impl Rng) {
        let found = self.label();
        for label in 0..found.count() as u8 {
            let (labels, rows) = (&self.labels, &self.rows);
            let members = (0..kept).filter(|&i| labels[i] == label);
            let state = |i: usize| -> State { rows.each_ref().map(|row| row[i]) };
            let mut mean = [0.0; ROWS];
            for i in members.clone() {
                let state = state(i);
                let inverse =
                    1.0 / (state[0] * state[0] + state[1] * state[1] + state[2] * state[2]).sqrt();
                for (sum, number) in mean.iter_mut().zip(state).take(3) {
                    *sum += number * inverse;
                }
                mean[6] += state[6];
                mean[7] += state[7];
            }
            let Some(chart) = Chart::around(&mean) else {
                continue;
            };
            let coordinates = members.clone().map(|i| chart.coordinates(&state(i)));
            let Some(kernel) = Kernel::of(coordinates, self.settings.bandwidth) else {
                continue;
            };
            self.spread(kept, label, &chart, &kernel, rng);
        }
    }

    fn spread(
        &mut self,
        kept: usize,
        label: u8,
        chart: &Chart,
        kernel: &Kernel,
        rng: &mut impl Rng,
    ) {
        let prior = &self.settings.prior;
        let nearest = prior.distance_min_m.ln() - BEYOND_PRIOR;
        let farthest = (prior.distance_max_m.ln() + BEYOND_PRIOR).max(nearest);
        let mut drawn = noise::DRAWN;
        for i in 0..kept {
            if self.labels[i] != label {
                continue;
            }
            if drawn == noise::DRAWN {
                noise::fill(&mut self.noise[..N * noise::DRAWN], rng);
                drawn = 0;
            }
            let white = &self.noise[N * drawn..N * (drawn + 1)];
            let white = Coordinates::from_column_slice(white);
            drawn += 1;
            let state = self.rows.each_ref().map(|row| row[i]);
            let mut moved = kernel.moved(&chart.coordinates(&state), &white);
            moved[LOG_DISTANCE] = moved[LOG_DISTANCE].clamp(nearest, farthest);
            let state = chart.state(&moved);
            for (row, number) in self.rows.iter_mut().zip(state) {
                row[i] = number;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart() -> Chart {
        Chart::around(&[0.5, -0.6, 0.3, 0.0, 0.0, 0.0, 0.2, -0.9]).unwrap()
    }

    #[test]
    fn coordinates_are_a_state() {
        let (yaw_sin, yaw_cos) = (-1.1f64).sin_cos();
        let state = [2.0, -1.5, 1.0, 0.3, -0.2, 0.1, yaw_cos, yaw_sin];
        let back = chart().state(&chart().coordinates(&state));
        for (back, number) in back.iter().zip(state) {
            assert!((back - number).abs() < 1e-12);
        }
    }

    #[test]
    fn smoothing_keeps_mean_and_covariance() {
        let chart = chart();
        let spread = Coordinates::from([0.05, 0.08, 0.2, 0.1, 0.05, 0.07, 0.06]);
        let middle = Coordinates::from([0.0, 0.0, 1.2, 0.05, -0.03, 0.02, 0.0]);
        let mut rng = <rand_chacha::ChaCha8Rng as rand::SeedableRng>::seed_from_u64(1);
        let mut white = vec![0.0; N * 4000];
        noise::fill(&mut white, &mut rng);
        let at: Vec<Coordinates> = white
            .chunks_exact(N)
            .map(|white| middle + spread.component_mul(&Coordinates::from_column_slice(white)))
            .collect();
        let kernel = Kernel::of(at.iter().copied(), 1.0).unwrap();
        noise::fill(&mut white, &mut rng);
        let moved: Vec<Coordinates> = at
            .iter()
            .zip(white.chunks_exact(N))
            .map(|(from, white)| kernel.moved(from, &Coordinates::from_column_slice(white)))
            .collect();
        for i in 0..N {
            let moments = |of: &[Coordinates]| {
                let mean = of.iter().map(|one| one[i]).sum::<f64>() / of.len() as f64;
                let variance = of.iter().map(|one| (one[i] - mean).powi(2)).sum::<f64>();
                (mean, variance / of.len() as f64)
            };
            let (before, after) = (moments(&at), moments(&moved));
            assert!((before.0 - after.0).abs() < 0.1 * spread[i]);
            assert!(
                (after.1 / before.1 - 1.0).abs() < 0.1,
                "{i}: {} {}",
                before.1,
                after.1
            );
        }
        assert!(
            chart
                .state(&moved[0])
                .iter()
                .all(|number| number.is_finite())
        );
    }

    #[test]
    fn copies_of_one_particle_are_parted() {
        let one = chart().coordinates(&[2.0, -1.5, 1.0, 0.3, -0.2, 0.1, 0.4, -0.9]);
        let kernel = Kernel::of([one; 50].into_iter(), 1.0).unwrap();
        let moved = kernel.moved(&one, &Coordinates::repeat(1.0));
        assert!((0..N).all(|i| (moved[i] - one[i]).abs() > 1e-4));
    }
}
