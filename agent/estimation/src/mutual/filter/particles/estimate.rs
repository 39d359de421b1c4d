//! What the particles say: best, mean and dominant cluster, samples.

use super::{COS_YAW, Particles, ROWS, SIN_YAW, choose};
use crate::mutual::filter::Estimate;
use crate::mutual::filter::clusters::{self, Found, Points};
use crate::mutual::located::Reduced;
use nalgebra::{SMatrix, SVector, Vector3};

impl Particles {
    /// Best particle, mean and dominant cluster.
    pub fn estimate(&mut self) -> Estimate {
        let found = self.label();
        let (label, mass) = found.dominant().unwrap_or((clusters::NOWHERE, 1.0));
        let (dominant, covariance) = self.moments(|of| of == label);
        Estimate {
            best: self.particle(self.best),
            mean: self.moments(|_| true).0,
            dominant,
            covariance,
            dominant_mass: mass.min(1.0),
            modes: found.count().max(1),
        }
    }

    /// Labels every particle with its cluster. The spare rows are written over.
    pub(super) fn label(&mut self) -> Found {
        let n = self.weight.len();
        let [x, y, z, ..] = self.rows.each_ref().map(|row| &row[..n]);
        let [dx, dy, dz, ..] = self.spare_rows.each_mut().map(|row| &mut row[..n]);
        for i in 0..n {
            let inverse = 1.0 / (x[i] * x[i] + y[i] * y[i] + z[i] * z[i]).sqrt();
            (dx[i], dy[i], dz[i]) = (x[i] * inverse, y[i] * inverse, z[i] * inverse);
        }
        let points = Points {
            direction: [dx, dy, dz],
            cos_yaw: &self.rows[COS_YAW],
            sin_yaw: &self.rows[SIN_YAW],
            weight: &self.weight,
        };
        clusters::find(&points, &mut self.labels)
    }

    /// Mean and covariance of the particles with such labels. The mean is of directions, logarithms of distances and
    /// velocities over distances: a few that are far away do not draw it with them.
    fn moments(&self, of: impl Fn(u8) -> bool) -> (Reduced, SMatrix<f64, 7, 7>) {
        let labelled = || (0..self.weight.len()).filter(|&i| of(self.labels[i]));
        let state = |i: usize| SVector::<f64, ROWS>::from_fn(|row, _| self.rows[row][i]);
        let mut mass = 0.0;
        let mut log_distance = 0.0;
        let mut sum = SVector::<f64, ROWS>::zeros();
        for i in labelled() {
            let mut state = state(i);
            let distance = state.fixed_rows::<3>(0).norm();
            state.fixed_rows_mut::<6>(0).unscale_mut(distance);
            mass += self.weight[i];
            log_distance += self.weight[i] * distance.ln();
            sum += state * self.weight[i];
        }
        let distance = (log_distance / mass).exp();
        let toward = sum.fixed_rows::<3>(0).normalize();
        let yaw_rad = sum[SIN_YAW].atan2(sum[COS_YAW]);
        let mean = Reduced {
            position_m: toward * distance,
            velocity_m_s: sum.fixed_rows::<3>(3) * (distance / mass),
            yaw_rad,
        };
        let (sin, cos) = yaw_rad.sin_cos();
        let mut covariance = SMatrix::<f64, 7, 7>::zeros();
        for i in labelled() {
            let state = state(i);
            let position = state.fixed_rows::<3>(0) - mean.position_m;
            let velocity = state.fixed_rows::<3>(3) - mean.velocity_m_s;
            let mut error = SVector::<f64, 7>::zeros();
            error.fixed_rows_mut::<3>(0).copy_from(&position);
            error.fixed_rows_mut::<3>(3).copy_from(&velocity);
            error[6] = (state[SIN_YAW] * cos - state[COS_YAW] * sin)
                .atan2(state[COS_YAW] * cos + state[SIN_YAW] * sin);
            covariance.ger(self.weight[i] / mass, &error, &error, 1.0);
        }
        (mean, covariance)
    }

    pub(super) fn particle(&self, i: usize) -> Reduced {
        let [x, y, z, vx, vy, vz, cos, sin] = self.rows.each_ref().map(|row| row[i]);
        Reduced {
            position_m: Vector3::new(x, y, z),
            velocity_m_s: Vector3::new(vx, vy, vz),
            yaw_rad: sin.atan2(cos),
        }
    }

    /// Places drawn from the belief in proportion to their weights: all equally likely.
    #[must_use]
    pub fn sampled(&self, count: usize) -> Vec<Reduced> {
        let mut chosen = vec![0; count];
        choose(&self.weight, &mut chosen, 0.5);
        chosen.into_iter().map(|i| self.particle(i)).collect()
    }

    /// The heaviest particles, heaviest first, at most `count`.
    #[must_use]
    pub fn likeliest(&self, count: usize) -> Vec<Reduced> {
        let mut order: Vec<_> = (0..self.weight.len()).collect();
        order.sort_by(|&a, &b| {
            (b == self.best)
                .cmp(&(a == self.best))
                .then(self.weight[b].total_cmp(&self.weight[a]))
        });
        order.truncate(count);
        order.into_iter().map(|i| self.particle(i)).collect()
    }
}
