//! The two optimisers, written once for the star and the whole graph: the paper's descent and Gauss-Newton. Both know
//! only what [`Problem`] offers.

pub mod descent;
pub mod gauss_newton;

pub use descent::Descent;
pub use gauss_newton::GaussNewton;

/// A cost over a product of SO(3) x R^3 that holds its present point and one trial point.
pub trait Problem {
    /// The cost at the present point, with the gradient made ready there.
    fn gradient(&mut self) -> f64;
    /// The norm of that gradient, over `w` and `delta` of all nodes (the metric in which distance is angle).
    fn gradient_norm(&self) -> f64;
    /// The cost at the present point, with gradient and normal equations made ready there.
    fn linearise(&mut self) -> f64;
    /// Puts the trial point `step` along minus the gradient (paper eq. 9).
    fn try_descent(&mut self, step: f64);
    /// Puts the trial point at the solution of the normal equations with `damping` times their mean diagonal added.
    /// Nothing when they are singular and cannot be solved in this problem's way.
    fn try_gauss_newton(&mut self, damping: f64) -> Option<Step>;
    /// The cost at the trial point.
    fn trial_cost(&mut self) -> f64;
    /// As [`Problem::linearise`] at the trial point, and the trial point becomes the present one; `undo` goes back.
    fn advance(&mut self) -> f64;
    /// Goes back to the point before [`Problem::advance`]; its equations must be made again.
    fn undo(&mut self);
    /// Makes the trial point the present point.
    fn accept(&mut self);
}

/// What the normal equations say of their solution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// The norm over `w` (rad) and `delta` (m) of all nodes.
    pub norm: f64,
    /// By how much the quadratic model expects the cost to fall.
    pub predicted_decrease: f64,
}

/// Which optimiser, with its settings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Optimiser {
    /// Gauss-Newton with a step test and Levenberg's damping when a step is refused: the default.
    GaussNewton(GaussNewton),
    /// Riemannian descent with Armijo's step: the paper's.
    Descent(Descent),
}

impl Default for Optimiser {
    fn default() -> Self {
        Self::gauss_newton()
    }
}

impl Optimiser {
    /// Gauss-Newton with its default settings.
    #[must_use]
    pub const fn gauss_newton() -> Self {
        Self::GaussNewton(GaussNewton::DEFAULT)
    }

    /// The paper's descent with its default settings.
    #[must_use]
    pub const fn descent() -> Self {
        Self::Descent(Descent::DEFAULT)
    }

    /// The same optimiser with another iteration limit.
    #[must_use]
    pub const fn with_iterations_max(self, iterations_max: usize) -> Self {
        match self {
            Self::GaussNewton(settings) => Self::GaussNewton(GaussNewton {
                iterations_max,
                ..settings
            }),
            Self::Descent(settings) => Self::Descent(Descent {
                iterations_max,
                ..settings
            }),
        }
    }

    /// Minimises, telling `observe` of every accepted iteration.
    pub fn minimise(&self, problem: &mut impl Problem, observe: impl FnMut(Progress)) -> Outcome {
        match self {
            Self::GaussNewton(settings) => settings.minimise(problem, observe),
            Self::Descent(settings) => settings.minimise(problem, observe),
        }
    }
}

/// One accepted iteration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Progress {
    /// Counted from 1; 0 is the start.
    pub iteration: usize,
    /// The cost reached.
    pub cost: f64,
    /// The norm of the step that reached it; zero at the start.
    pub step_norm: f64,
}

/// How a minimisation ended.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    /// Why it stopped.
    pub status: SolveStatus,
    /// Accepted iterations.
    pub iterations: usize,
    /// The cost at the start.
    pub cost_before: f64,
    /// The cost at the end, never above the one before.
    pub cost_after: f64,
}

/// Why a solver stopped, and what its answer is worth. The pose that comes with it is finite in every case.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SolveStatus {
    /// The stopping rule was met.
    Converged,
    /// Nothing was measured: the priors are the answer.
    NothingMeasured,
    /// The iteration limit came first; the best point found is the answer.
    IterationLimit,
    /// No step lowers the cost any more although the stopping rule is not met: the floor of rounding, or a kink.
    Stalled,
    /// The stopping rule was met, but the geometry leaves something undetermined.
    Degenerate(Degeneracy),
    /// The cost at the start is not a finite number: the prior is the answer.
    NotFinite,
}

impl SolveStatus {
    /// True when the pose is a minimum of the cost, as far as the geometry determines one.
    #[must_use]
    pub const fn is_settled(&self) -> bool {
        matches!(
            self,
            Self::Converged | Self::Stalled | Self::Degenerate(_) | Self::NothingMeasured
        )
    }
}

/// What a geometry leaves undetermined.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Degeneracy {
    /// Some directions are not observed; the prior is kept in them.
    Unobservable,
    /// A bearing or distance was used between ends that coincide: it has no direction and pulled nowhere.
    CoincidentEnds,
    /// A measured and a predicted orientation are half a turn apart: which way round is chosen by rounding.
    OppositeOrientation,
}
