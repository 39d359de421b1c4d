//! Riemannian gradient descent with Armijo's step (paper section III, eq. 8 and 9; Absil, Mahony and Sepulchre,
//! algorithm 1). Provably convergent and slow: hundreds of iterations where Gauss-Newton needs four.

use super::{Outcome, Problem, Progress, SolveStatus};

/// Halvings after which the step is below rounding.
const SHRINKS_MAX: usize = 60;

/// Settings of the descent.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Descent {
    /// Armijo's alpha: the first step tried.
    pub first_step: f64,
    /// Armijo's beta: by what a refused step is multiplied.
    pub shrink: f64,
    /// Armijo's sigma: the part of the expected decrease that must come true.
    pub sufficient_decrease: f64,
    /// Stops when the gradient's norm over `w` and `delta` falls below this. Rounding allows no less than about 2e-7.
    pub gradient_norm_max: f64,
    /// Stops after this many iterations.
    pub iterations_max: usize,
}

impl Descent {
    /// The paper's step rule.
    pub const DEFAULT: Self = Self {
        first_step: 1.0,
        shrink: 0.5,
        sufficient_decrease: 1e-4,
        gradient_norm_max: 1e-6,
        iterations_max: 10_000,
    };

    /// Minimises `problem` from its present point.
    pub fn minimise(
        &self,
        problem: &mut impl Problem,
        mut observe: impl FnMut(Progress),
    ) -> Outcome {
        let cost_before = problem.gradient();
        let mut cost = cost_before;
        observe(Progress {
            iteration: 0,
            cost,
            step_norm: 0.0,
        });
        let outcome = |status, iterations, cost_after| Outcome {
            status,
            iterations,
            cost_before,
            cost_after,
        };
        if !cost.is_finite() {
            return outcome(SolveStatus::NotFinite, 0, cost);
        }
        for iteration in 1..=self.iterations_max {
            let norm = problem.gradient_norm();
            if norm <= self.gradient_norm_max {
                return outcome(SolveStatus::Converged, iteration - 1, cost);
            }
            let Some((step, reached)) = self.armijo(problem, cost, norm) else {
                return outcome(SolveStatus::Stalled, iteration - 1, cost);
            };
            problem.accept();
            cost = reached;
            observe(Progress {
                iteration,
                cost,
                step_norm: step * norm,
            });
            problem.gradient();
        }
        let met = problem.gradient_norm() <= self.gradient_norm_max;
        let status = if met {
            SolveStatus::Converged
        } else {
            SolveStatus::IterationLimit
        };
        outcome(status, self.iterations_max, cost)
    }

    /// The first of alpha, alpha beta, alpha beta^2 ... that lowers the cost enough, with the cost there. Leaves that
    /// point as the trial point.
    fn armijo(
        &self,
        problem: &mut impl Problem,
        cost: f64,
        gradient_norm: f64,
    ) -> Option<(f64, f64)> {
        let mut step = self.first_step;
        for _ in 0..SHRINKS_MAX {
            problem.try_descent(step);
            let reached = problem.trial_cost();
            if cost - reached >= self.sufficient_decrease * step * gradient_norm * gradient_norm {
                return Some((step, reached));
            }
            step *= self.shrink;
        }
        None
    }
}
