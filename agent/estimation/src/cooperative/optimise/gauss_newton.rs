//! Gauss-Newton with a step test: the full step while it lowers the cost, Levenberg's damping when it does not. On the
//! paper's cost it needs three or four iterations.

use super::{Degeneracy, Outcome, Problem, Progress, SolveStatus};

/// The damping after a first refusal, and the one below which it is dropped altogether.
const DAMPING_FIRST: f64 = 1e-4;
const DAMPING_DROPPED_BELOW: f64 = 1e-7;
/// With more damping than this the step is a descent step below rounding.
const DAMPING_MAX: f64 = 1e12;
/// A short step under more damping than this says nothing of how near the minimum is.
const DAMPING_TELLING_MAX: f64 = 1e-2;
/// The part of the predicted decrease that must come true for a step to be taken.
const ACCEPT_PART_MIN: f64 = 1e-4;
/// Part of the cost that is its rounding, summed over hundreds of edges.
const ROUNDING: f64 = 1e-12;

/// Settings of Gauss-Newton.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaussNewton {
    /// Stops when a step's norm over `w` (rad) and `delta` (m) of all nodes is below this; that step is still taken.
    pub step_norm_max: f64,
    /// Stops when a step is expected to lower the cost by less than this part of it.
    pub decrease_part_max: f64,
    /// Stops after this many accepted iterations.
    pub iterations_max: usize,
}

impl GaussNewton {
    /// Stops where the next step would no longer change a pose that is sent as numbers.
    pub const DEFAULT: Self = Self {
        step_norm_max: 1e-7,
        decrease_part_max: 1e-13,
        iterations_max: 50,
    };

    /// Minimises `problem` from its present point.
    pub fn minimise(
        &self,
        problem: &mut impl Problem,
        mut observe: impl FnMut(Progress),
    ) -> Outcome {
        let cost_before = problem.linearise();
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
        let mut damping = 0.0;
        let mut singular = false;
        let settled = |singular: bool, damping: f64| {
            if singular {
                SolveStatus::Degenerate(Degeneracy::Unobservable)
            } else if damping > DAMPING_TELLING_MAX {
                SolveStatus::Stalled
            } else {
                SolveStatus::Converged
            }
        };
        let mut iterations = 0;
        while iterations < self.iterations_max {
            let Some(step) = problem.try_gauss_newton(damping) else {
                // Nothing is known along some direction: a little damping keeps that direction where it is.
                singular = true;
                damping = raised(damping);
                if damping > DAMPING_MAX {
                    return outcome(settled(true, damping), iterations, cost);
                }
                continue;
            };
            if step.norm <= self.step_norm_max
                || step.predicted_decrease <= self.decrease_part_max * cost
            {
                // The last step is lost in the cost's rounding: it is taken unless it does harm beyond that, so that
                // rounding does not decide whether it is.
                let reached = problem.trial_cost();
                if reached <= cost * (1.0 + ROUNDING) {
                    problem.accept();
                    iterations += 1;
                    cost = cost.min(reached);
                    observe(Progress {
                        iteration: iterations,
                        cost,
                        step_norm: step.norm,
                    });
                }
                return outcome(settled(singular, damping), iterations, cost);
            }
            // Nearly every step is taken, so the equations for the next one are made in the same pass as the cost.
            let reached = problem.advance();
            if cost - reached >= ACCEPT_PART_MIN * step.predicted_decrease {
                iterations += 1;
                cost = reached;
                observe(Progress {
                    iteration: iterations,
                    cost,
                    step_norm: step.norm,
                });
                damping = if damping * 0.1 < DAMPING_DROPPED_BELOW {
                    0.0
                } else {
                    damping * 0.1
                };
                continue;
            }
            problem.undo();
            problem.linearise();
            damping = raised(damping);
            if damping > DAMPING_MAX {
                return outcome(SolveStatus::Stalled, iterations, cost);
            }
        }
        outcome(SolveStatus::IterationLimit, iterations, cost)
    }
}

fn raised(damping: f64) -> f64 {
    if damping < DAMPING_FIRST {
        DAMPING_FIRST
    } else {
        damping * 10.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cooperative::optimise::Step;

    /// `sqrt(1 + x^2)`: beyond |x| = 1 its full Newton step goes further away than it came from.
    struct Valley {
        x: f64,
        trial: f64,
    }

    fn cost(x: f64) -> f64 {
        x.hypot(1.0)
    }

    impl Valley {
        fn slope(&self) -> f64 {
            self.x / cost(self.x)
        }
    }

    impl Problem for Valley {
        fn gradient(&mut self) -> f64 {
            cost(self.x)
        }

        fn gradient_norm(&self) -> f64 {
            self.slope().abs()
        }

        fn linearise(&mut self) -> f64 {
            cost(self.x)
        }

        fn try_descent(&mut self, step: f64) {
            self.trial = self.x - step * self.slope();
        }

        fn try_gauss_newton(&mut self, damping: f64) -> Option<Step> {
            let curvature = cost(self.x).powi(-3);
            let step = -self.slope() / (curvature * (1.0 + damping));
            self.trial = self.x + step;
            let predicted_decrease = -self.slope() * step - 0.5 * curvature * step * step;
            Some(Step {
                norm: step.abs(),
                predicted_decrease,
            })
        }

        fn trial_cost(&mut self) -> f64 {
            cost(self.trial)
        }

        fn advance(&mut self) -> f64 {
            std::mem::swap(&mut self.x, &mut self.trial);
            cost(self.x)
        }

        fn undo(&mut self) {
            std::mem::swap(&mut self.x, &mut self.trial);
        }

        fn accept(&mut self) {
            self.x = self.trial;
        }
    }

    #[test]
    fn a_step_that_goes_too_far_is_taken_back_and_damped() {
        let mut valley = Valley { x: 3.0, trial: 3.0 };
        let mut costs = Vec::new();
        let outcome =
            GaussNewton::DEFAULT.minimise(&mut valley, |progress| costs.push(progress.cost));
        assert_eq!(outcome.status, SolveStatus::Converged);
        assert!(costs.windows(2).all(|pair| pair[1] <= pair[0]), "{costs:?}");
        assert!(valley.x.abs() < 1e-6, "{}", valley.x);
        assert!((outcome.cost_before - 10.0_f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn descent_walks_down_the_same_valley() {
        let mut valley = Valley { x: 3.0, trial: 3.0 };
        let outcome = crate::cooperative::Descent::DEFAULT.minimise(&mut valley, |_| ());
        assert_eq!(outcome.status, SolveStatus::Converged);
        assert!(valley.x.abs() <= 1.1e-6);
    }
}
