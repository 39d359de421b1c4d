//! Levenberg-Marquardt on the ranges of a window (Cornejo & Nagpal, section V: the mean-squared error in place of a zero
//! of eq. 2), weighted by what the ranges' and the odometries' noise make of it.
//!
//! To first order in the odometry errors the residuals `r_j = d_j - |q_j|`, `q_j = p + R v_j - u_j`, `n_j = q_j / |q_j|`,
//! have the covariance `S_jl = sigma_j^2 [j = l] + n_j^T Cov(u_j, u_l) n_l + n_j^T R Cov(v_j, v_l) R^T n_l`. The cost is
//! `r^T S^-1 r + ln det S`; a step takes `S` as it is where it starts.

use super::geometry::Geometry;
use super::modes::Mode;
use super::{
    Dimension, ITERATIONS_MAX, Loss, Prior, RelativePose, Step, WINDOW_MAX, WindowSettings,
};
use crate::ranging::pose::turned;
use nalgebra::{Matrix4, Vector3};

/// What is minimised.
pub(super) struct Model<'a> {
    pub(super) geometry: &'a Geometry,
    pub(super) settings: &'a WindowSettings,
    pub(super) prior: Option<&'a Prior>,
}

/// How the odometry errors of different ranges are taken.
#[derive(Clone, Copy, PartialEq)]
enum Sharing {
    /// As if they had nothing in common: fast, for the way from many starts.
    Apart,
    /// As they are: an error of odometry is in all ranges before it.
    Together,
}

/// The cost around a pose, to second order.
struct Linear {
    cost: f64,
    /// Less half the derivative of the cost.
    gradient: Step,
    /// Half the second derivative, by Gauss and Newton.
    hessian: Matrix4<f64>,
}

/// Ranges against what a pose predicts.
struct Residuals {
    /// `d_j - |q_j|` (m).
    value: [f64; WINDOW_MAX],
    /// How `|q_j|` changes with a step.
    row: [Step; WINDOW_MAX],
    /// `n_j`.
    direction: [Vector3<f64>; WINDOW_MAX],
}

/// A step of which the square over its covariance is less than this ends a descent.
const NEGLIGIBLE: f64 = 1e-5;
/// The same of the first, rough descent.
const NEGLIGIBLE_ROUGHLY: f64 = 1e-3;
/// Such a step that does not improve the cost ends it too: as the covariance of the residuals is held for a step, the
/// last steps may go a little past the minimum.
const STALLED: f64 = 1e-2;
/// Iterations after which starts are compared.
const FIRST_ITERATIONS: usize = 4;
/// Damping at first, and at which a descent is given up.
const DAMPING: (f64, f64) = (1e-3, 1e8);
/// A step turns by no more than this (rad): beyond, the linear model means nothing.
const TURN_MAX_RAD: f64 = 0.8;
/// Least damping of angles, so that one that nothing is known of stays where it is.
const DAMPING_FLOOR: f64 = 1e-3;

impl Model<'_> {
    /// Where the first steps of a descent with simplified weights lead to.
    pub(super) fn set_out(&self, start: &RelativePose) -> Option<Mode> {
        self.descend(start, Sharing::Apart, FIRST_ITERATIONS)
    }

    /// The minimum that a descent with simplified weights ends at.
    pub(super) fn descend_apart(&self, start: &RelativePose) -> Option<Mode> {
        self.descend(start, Sharing::Apart, ITERATIONS_MAX)
    }

    /// The minimum that a descent with full weights ends at.
    pub(super) fn descend_together(&self, start: &RelativePose) -> Option<Mode> {
        self.descend(start, Sharing::Together, ITERATIONS_MAX)
    }

    fn descend(&self, start: &RelativePose, sharing: Sharing, iterations: usize) -> Option<Mode> {
        let negligible = match sharing {
            Sharing::Apart => NEGLIGIBLE_ROUGHLY,
            Sharing::Together => NEGLIGIBLE,
        };
        let mut pose = *start;
        if self.settings.dimension == Dimension::Planar {
            pose.position_m.z = 0.0;
        }
        let mut weights = [1.0; WINDOW_MAX];
        let mut here = self.linear(&pose, sharing, &mut weights)?;
        let mut damping = DAMPING.0;
        for _ in 0..iterations {
            let step = here.step(damping)?;
            let change = step.dot(&(here.hessian * step));
            let candidate = pose.stepped(&step);
            let mut reweighted = weights;
            match self.linear(&candidate, sharing, &mut reweighted) {
                Some(there) if there.cost <= here.cost + negligible => {
                    (pose, here, weights) = (candidate, there, reweighted);
                    damping = (damping * 0.2).max(1e-9);
                    if change < negligible {
                        break;
                    }
                }
                _ if change < STALLED => break,
                _ => {
                    damping = damping.max(1e-4) * 5.0;
                    if damping > DAMPING.1 {
                        break;
                    }
                }
            }
        }
        let sound = here.cost.is_finite() && pose.position_m.iter().all(|one| one.is_finite());
        sound.then_some(Mode {
            pose,
            cost: here.cost,
            weight: 0.0,
            information: here.hessian,
            planar: self.settings.dimension == Dimension::Planar,
        })
    }

    fn residuals(&self, pose: &RelativePose) -> Residuals {
        let geometry = self.geometry;
        let axes = pose.axes();
        let up_counts = self.settings.dimension == Dimension::Spatial;
        let mut residuals = Residuals {
            value: [0.0; WINDOW_MAX],
            row: [Step::zeros(); WINDOW_MAX],
            direction: [Vector3::zeros(); WINDOW_MAX],
        };
        let (sin, cos) = pose.yaw_rad.sin_cos();
        for j in 0..geometry.count {
            let place = &geometry.neighbour[j].place_m;
            let there = Vector3::new(
                cos * place.x - sin * place.y,
                sin * place.x + cos * place.y,
                place.z,
            );
            let between = pose.position_m + there - geometry.own[j].place_m;
            let distance = between.norm().max(f64::MIN_POSITIVE);
            let direction = between / distance;
            residuals.value[j] = geometry.range_m[j] - distance;
            residuals.direction[j] = direction;
            residuals.row[j] = Step::new(
                direction.dot(&axes.direction),
                axes.distance_m * direction.dot(&axes.about),
                if up_counts {
                    axes.distance_m * direction.dot(&axes.up)
                } else {
                    0.0
                },
                direction.y * there.x - direction.x * there.y,
            );
        }
        residuals
    }

    /// The cost around a pose; with a redescending loss, `weights` of the ranges are brought up to date. None when the
    /// covariance of the residuals is none.
    fn linear(
        &self,
        pose: &RelativePose,
        sharing: Sharing,
        weights: &mut [f64; WINDOW_MAX],
    ) -> Option<Linear> {
        let residuals = self.residuals(pose);
        let mut linear = match sharing {
            Sharing::Apart => self.apart(&residuals, weights),
            Sharing::Together => self.together(pose, &residuals, weights)?,
        };
        if self.settings.dimension == Dimension::Planar {
            linear.hessian[(2, 2)] = 1.0;
        }
        if let Some(prior) = self.prior {
            let off = prior.pose.step_to(pose);
            let pull = prior.information * off;
            linear.cost += off.dot(&pull);
            linear.gradient -= pull;
            linear.hessian += prior.information;
        }
        linear.cost.is_finite().then_some(linear)
    }

    fn apart(&self, residuals: &Residuals, weights: &mut [f64; WINDOW_MAX]) -> Linear {
        let mut linear = Linear::nothing();
        for (j, weight) in weights.iter_mut().enumerate().take(self.geometry.count) {
            let residual = residuals.value[j];
            let variance = self.geometry.apart_m2[j];
            let square = residual * residual / variance;
            *weight = self.weight(square);
            linear.cost += self.loss(square) + variance.ln();
            linear.add(&residuals.row[j], residual, *weight / variance);
        }
        linear.complete()
    }

    fn together(
        &self,
        pose: &RelativePose,
        residuals: &Residuals,
        weights: &mut [f64; WINDOW_MAX],
    ) -> Option<Linear> {
        let count = self.geometry.count;
        let odometry = self.odometry_covariance(pose, residuals);
        let factor_with = |weights: &[f64; WINDOW_MAX]| {
            let mut covariance = odometry;
            for j in 0..count {
                covariance[j][j] += self.geometry.variance_m2[j] / weights[j];
            }
            cholesky(covariance, count)
        };
        let mut factor = factor_with(weights)?;
        if self.settings.loss != Loss::Square {
            // Of each residual, what is the range's own: sigma_j^2 / w_j (S^-1 r)_j.
            let mut whole = residuals.value;
            solve(&factor, count, &mut whole);
            for j in 0..count {
                let own = self.geometry.variance_m2[j] / weights[j] * whole[j];
                weights[j] = self.weight(own * own / self.geometry.variance_m2[j]);
            }
            factor = factor_with(weights)?;
        }
        let mut whitened = residuals.value;
        let mut rows = residuals.row;
        let mut linear = Linear::nothing();
        for j in 0..count {
            let scale = 1.0 / factor[j][j];
            for l in 0..j {
                whitened[j] -= factor[j][l] * whitened[l];
                rows[j] -= rows[l] * factor[j][l];
            }
            whitened[j] *= scale;
            rows[j] *= scale;
            linear.cost += whitened[j] * whitened[j] + 2.0 * factor[j][j].ln();
            linear.cost += self.forgone(weights[j]);
            linear.add(&rows[j], whitened[j], 1.0);
        }
        Some(linear.complete())
    }

    /// What the odometry errors add to the covariance of the residuals; its lower triangle.
    fn odometry_covariance(
        &self,
        pose: &RelativePose,
        residuals: &Residuals,
    ) -> [[f64; WINDOW_MAX]; WINDOW_MAX] {
        let geometry = self.geometry;
        let theirs = residuals.direction.map(|one| turned(&one, -pose.yaw_rad));
        let mut covariance = [[0.0; WINDOW_MAX]; WINDOW_MAX];
        // The newest places are the origins: they have no error.
        for later in 0..geometry.count.saturating_sub(1) {
            for j in 0..=later {
                covariance[later][j] = geometry.own[j].covariance_along(
                    &residuals.direction[j],
                    &geometry.own[later],
                    &residuals.direction[later],
                ) + geometry.neighbour[j].covariance_along(
                    &theirs[j],
                    &geometry.neighbour[later],
                    &theirs[later],
                );
            }
        }
        covariance
    }

    /// The weight of a range whose normalised residual has this square.
    fn weight(&self, square: f64) -> f64 {
        match self.settings.loss {
            Loss::Square => 1.0,
            Loss::Redescending { sigmas } => {
                let scale = sigmas * sigmas;
                (scale / (scale + square)).powi(2)
            }
        }
    }

    fn loss(&self, square: f64) -> f64 {
        match self.settings.loss {
            Loss::Square => square,
            Loss::Redescending { sigmas } => {
                let scale = sigmas * sigmas;
                scale * square / (scale + square)
            }
        }
    }

    /// What it costs to give a range such a weight (Black & Rangarajan), less what its variance then adds to `ln det S`.
    fn forgone(&self, weight: f64) -> f64 {
        match self.settings.loss {
            Loss::Square => 0.0,
            Loss::Redescending { sigmas } => (sigmas * (weight.sqrt() - 1.0)).powi(2) + weight.ln(),
        }
    }
}

impl Linear {
    fn nothing() -> Self {
        Self {
            cost: 0.0,
            gradient: Step::zeros(),
            hessian: Matrix4::zeros(),
        }
    }

    /// Adds a residual to the gradient and the lower triangle.
    fn add(&mut self, row: &Step, residual: f64, weight: f64) {
        for i in 0..4 {
            let weighted = row[i] * weight;
            self.gradient[i] += weighted * residual;
            for k in 0..=i {
                self.hessian[(i, k)] += weighted * row[k];
            }
        }
    }

    fn complete(mut self) -> Self {
        for i in 0..4 {
            for k in 0..i {
                self.hessian[(k, i)] = self.hessian[(i, k)];
            }
        }
        self
    }

    /// The step of Levenberg and Marquardt, its turns bounded.
    fn step(&self, damping: f64) -> Option<Step> {
        let mut damped = self.hessian;
        for i in 0..4 {
            damped[(i, i)] += damping * self.hessian[(i, i)].max(DAMPING_FLOOR) + 1e-12;
        }
        let step = damped.cholesky()?.solve(&self.gradient);
        let turn = step.y.hypot(step.z).max(step.w.abs());
        let scale = if turn > TURN_MAX_RAD {
            TURN_MAX_RAD / turn
        } else {
            1.0
        };
        step.iter().all(|one| one.is_finite()).then(|| step * scale)
    }
}

/// The lower factor of a positive definite matrix of which the lower triangle is given.
fn cholesky(
    mut matrix: [[f64; WINDOW_MAX]; WINDOW_MAX],
    size: usize,
) -> Option<[[f64; WINDOW_MAX]; WINDOW_MAX]> {
    for i in 0..size {
        for k in 0..=i {
            let known: f64 = (0..k).map(|l| matrix[i][l] * matrix[k][l]).sum();
            let sum = matrix[i][k] - known;
            if i > k {
                matrix[i][k] = sum / matrix[k][k];
            } else if sum > 0.0 && sum.is_finite() {
                matrix[i][i] = sum.sqrt();
            } else {
                return None;
            }
        }
    }
    Some(matrix)
}

/// Solves with both factors, in place.
fn solve(factor: &[[f64; WINDOW_MAX]; WINDOW_MAX], size: usize, vector: &mut [f64; WINDOW_MAX]) {
    for i in 0..size {
        for k in 0..i {
            vector[i] -= factor[i][k] * vector[k];
        }
        vector[i] /= factor[i][i];
    }
    for i in (0..size).rev() {
        for k in i + 1..size {
            vector[i] -= factor[k][i] * vector[k];
        }
        vector[i] /= factor[i][i];
    }
}
