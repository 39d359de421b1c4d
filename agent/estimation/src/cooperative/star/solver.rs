//! Minimises a star's cost by eliminating the neighbours one by one.
//!
//! With a kernel the equations are those of the measurements as they count at the present point (iteratively reweighted
//! least squares): their gradient is the robust cost's own, and the steps are tested against that cost.

use nalgebra::{Matrix6, SMatrix, Vector6};

use super::verdict::{Judgement, judgement};
use super::{MAX_NEIGHBOURS, NeighbourIndex, Solution, Star, StarEdge, Tie};
use crate::cooperative::block::{Factor, solve_semidefinite};
use crate::cooperative::edge::{Node, Normal, Sums};
use crate::cooperative::mode::Mode;
use crate::cooperative::optimise::{Degeneracy, Optimiser, Problem, SolveStatus, Step};
use crate::transform::Transform;

/// Memory of the solver, to be kept between steps. It holds room for the largest star from the start, so that no step
/// allocates.
#[derive(Debug, Clone)]
pub struct StarWorkspace {
    centre: Node,
    neighbours: Vec<Spoke>,
}

impl Default for StarWorkspace {
    fn default() -> Self {
        Self::new()
    }
}

impl StarWorkspace {
    /// Room for [`MAX_NEIGHBOURS`].
    #[must_use]
    pub fn new() -> Self {
        Self {
            centre: Transform::identity(),
            neighbours: Vec::with_capacity(MAX_NEIGHBOURS),
        }
    }

    /// What the last solved star holds of a neighbour's pose: good for telling where it is relative to the centre, never
    /// for telling the neighbour where it is.
    #[must_use]
    pub fn neighbour(&self, index: NeighbourIndex) -> Option<Node> {
        self.neighbours
            .get(index.0)
            .map(|spoke| spoke.pose)
            .filter(Node::is_valid)
    }

    /// The solved ends of an edge; nothing when the neighbour is not of the last solved star.
    pub(super) fn ends(&self, tie: Tie) -> Option<(Node, Node)> {
        if let Tie::MeasuredByMe(j) | Tie::MeasuredByNeighbour(j) = tie
            && j.0 >= self.neighbours.len()
        {
            return None;
        }
        Some(tie.ends(self.centre, |j| self.neighbours[j.0].pose))
    }

    fn start(&mut self, star: &Star) {
        self.centre = star.centre.prior;
        self.neighbours.clear();
        self.neighbours
            .extend(star.neighbours.iter().map(|neighbour| Spoke {
                pose: neighbour.anchor.prior,
                trial: neighbour.anchor.prior,
                hessian: Matrix6::zeros(),
                with_centre: Matrix6::zeros(),
                gradient: Vector6::zeros(),
                eliminated: Eliminated::Semidefinite(SMatrix::zeros()),
            }));
    }
}

/// See [`Star::solve`].
pub(super) fn solve(star: &Star, workspace: &mut StarWorkspace, optimiser: &Optimiser) -> Solution {
    let prior = star.centre.prior;
    if star.edges.is_empty() {
        workspace.start(star);
        return Solution {
            world_from_body: prior,
            status: SolveStatus::NothingMeasured,
            unobservable: 0,
            iterations: 0,
            cost_before: 0.0,
            cost_after: 0.0,
        };
    }
    let mut problem = StarProblem::new(star, workspace);
    let outcome = optimiser.minimise(&mut problem, |_| ());
    let pose = problem.centre;
    let mut solution = Solution {
        world_from_body: pose,
        status: outcome.status,
        unobservable: 0,
        iterations: outcome.iterations,
        cost_before: outcome.cost_before,
        cost_after: outcome.cost_after,
    };
    if outcome.status == SolveStatus::NotFinite || !pose.is_valid() {
        solution.world_from_body = prior;
        solution.status = SolveStatus::NotFinite;
        workspace.start(star);
        return solution;
    }
    solution.unobservable = problem.unobservable_at_the_end(optimiser);
    if let (SolveStatus::Converged | SolveStatus::Stalled, Some(degeneracy)) =
        (outcome.status, problem.degeneracy(solution.unobservable))
    {
        solution.status = SolveStatus::Degenerate(degeneracy);
    }
    workspace.centre = pose;
    solution
}

/// One neighbour while solving.
#[derive(Debug, Clone, Copy)]
struct Spoke {
    pose: Node,
    trial: Node,
    hessian: Matrix6<f64>,
    /// `H` of the neighbour (rows) with the centre (columns).
    with_centre: Matrix6<f64>,
    gradient: Vector6<f64>,
    eliminated: Eliminated,
}

/// What elimination leaves to find the neighbour's step once the centre's is known.
#[derive(Debug, Clone, Copy)]
#[expect(
    clippy::large_enum_variant,
    reason = "the larger variant is the rule, and boxing would allocate in every step"
)]
enum Eliminated {
    /// Factor `L`, and `L^-1 [H_jc | g_j]`.
    Definite(Factor, SMatrix<f64, 6, 7>),
    /// `H_jj^+ [H_jc | g_j]`, for a neighbour that is not fully determined.
    Semidefinite(SMatrix<f64, 6, 7>),
}

struct StarProblem<'a> {
    star: &'a Star,
    spokes: &'a mut Vec<Spoke>,
    centre: Node,
    trial: Node,
    hessian: Matrix6<f64>,
    gradient: Vector6<f64>,
    unobservable: u8,
    /// Whether the equations leave out what is rejected at the present point.
    without_rejected: bool,
}

impl<'a> StarProblem<'a> {
    fn new(star: &'a Star, workspace: &'a mut StarWorkspace) -> Self {
        workspace.start(star);
        Self {
            star,
            spokes: &mut workspace.neighbours,
            centre: star.centre.prior,
            trial: star.centre.prior,
            hessian: Matrix6::zeros(),
            gradient: Vector6::zeros(),
            unobservable: 0,
            without_rejected: false,
        }
    }

    /// Exchanges the present point and the trial point.
    fn swap(&mut self) {
        std::mem::swap(&mut self.centre, &mut self.trial);
        for spoke in self.spokes.iter_mut() {
            std::mem::swap(&mut spoke.pose, &mut spoke.trial);
        }
    }

    fn ends(&self, tie: Tie) -> (Node, Node) {
        tie.ends(self.centre, |j| self.spokes[j.0].pose)
    }

    fn trial_ends(&self, tie: Tie) -> (Node, Node) {
        tie.ends(self.trial, |j| self.spokes[j.0].trial)
    }

    /// In how many directions the present point is unknown. Without a prior that would be an answer, so it is asked of
    /// what the kernel did not reject: any measurement has a slope, however small, and would seem to determine.
    fn unobservable_at_the_end(&mut self, optimiser: &Optimiser) -> u8 {
        self.without_rejected =
            matches!(self.star.mode, Mode::Star(_)) && !self.star.centre.is_anchored();
        let of_the_last_step = matches!(optimiser, Optimiser::GaussNewton(_));
        if self.without_rejected || !of_the_last_step {
            self.unobservable = 0;
            self.linearise();
            self.try_gauss_newton(0.0);
        }
        self.unobservable
    }

    fn degeneracy(&self, unobservable: u8) -> Option<Degeneracy> {
        if unobservable > 0 {
            return Some(Degeneracy::Unobservable);
        }
        for StarEdge {
            edge, tie, scale, ..
        } in &self.star.edges
        {
            let (from, to) = self.ends(*tie);
            let rejected = scale.is_some_and(|scale| {
                judgement(edge.judged(&scale, &from, &to).share) == Judgement::Rejected
            });
            if rejected {
                continue;
            }
            if edge.is_coincident(&from, &to) {
                return Some(Degeneracy::CoincidentEnds);
            }
            if edge.is_opposite(&from, &to) {
                return Some(Degeneracy::OppositeOrientation);
            }
        }
        None
    }

    /// Eliminates each neighbour: `S = H_cc - sum H_cj H_jj^-1 H_jc`, `b = g_c - sum H_cj H_jj^-1 g_j`.
    fn reduce(&mut self, added: f64) -> (Matrix6<f64>, Vector6<f64>) {
        let mut reduced = self.hessian;
        let mut right = self.gradient;
        for i in 0..6 {
            reduced[(i, i)] += added;
        }
        for spoke in self.spokes.iter_mut() {
            let mut own = spoke.hessian;
            for i in 0..6 {
                own[(i, i)] += added;
            }
            let mut columns = SMatrix::<f64, 6, 7>::zeros();
            columns
                .fixed_columns_mut::<6>(0)
                .copy_from(&spoke.with_centre);
            columns.set_column(6, &spoke.gradient);
            spoke.eliminated = match Factor::new(&own, &own.diagonal()) {
                Some(factor) => {
                    factor.solve_lower(&mut columns);
                    let half = columns.fixed_columns::<6>(0);
                    reduced -= half.transpose() * half;
                    right -= half.transpose() * columns.column(6);
                    Eliminated::Definite(factor, columns)
                }
                None => {
                    let (solved, _) = solve_semidefinite(&own, &own.diagonal(), &columns);
                    reduced -= spoke.with_centre.transpose() * solved.fixed_columns::<6>(0);
                    right -= spoke.with_centre.transpose() * solved.column(6);
                    Eliminated::Semidefinite(solved)
                }
            };
        }
        (reduced, right)
    }
}

impl Problem for StarProblem<'_> {
    fn gradient(&mut self) -> f64 {
        if matches!(self.star.mode, Mode::Star(_)) {
            return self.linearise();
        }
        self.gradient = self.star.centre.gradient(&self.centre);
        let mut cost = self.star.centre.cost(&self.centre);
        for (spoke, neighbour) in self.spokes.iter_mut().zip(&self.star.neighbours) {
            spoke.gradient = neighbour.anchor.gradient(&spoke.pose);
            cost += neighbour.anchor.cost(&spoke.pose);
        }
        for StarEdge { edge, tie, .. } in &self.star.edges {
            let (from, to) = self.ends(*tie);
            let by = edge.gradient(&from, &to);
            cost += edge.cost(&from, &to);
            match *tie {
                Tie::MeasuredByMe(j) => {
                    self.gradient += 0.5 * by.from;
                    self.spokes[j.0].gradient += 0.5 * by.to;
                }
                Tie::MeasuredByNeighbour(j) => {
                    self.gradient += 0.5 * by.to;
                    self.spokes[j.0].gradient += 0.5 * by.from;
                }
                Tie::Fix => self.gradient += 0.5 * by.to,
            }
        }
        0.5 * cost
    }

    fn gradient_norm(&self) -> f64 {
        let spokes: f64 = self
            .spokes
            .iter()
            .map(|spoke| spoke.gradient.norm_squared())
            .sum();
        (self.gradient.norm_squared() + spokes).sqrt()
    }

    fn linearise(&mut self) -> f64 {
        let mut cost;
        (self.hessian, self.gradient, cost) = self.star.centre.linearise(&self.centre);
        for (spoke, neighbour) in self.spokes.iter_mut().zip(&self.star.neighbours) {
            let part;
            (spoke.hessian, spoke.gradient, part) = neighbour.anchor.linearise(&spoke.pose);
            spoke.with_centre = Matrix6::zeros();
            cost += part;
        }
        let mut dropped = Normal::zero();
        for StarEdge {
            edge, tie, scale, ..
        } in &self.star.edges
        {
            let (from, to) = self.ends(*tie);
            let robust = scale.map(|scale| edge.judged(&scale, &from, &to));
            let share = robust.map_or(1.0, |judged| judged.share);
            if self.without_rejected && judgement(share) == Judgement::Rejected {
                continue;
            }
            let mut sums = match *tie {
                Tie::MeasuredByMe(j) => {
                    let spoke = &mut self.spokes[j.0];
                    Sums {
                        from_from: &mut self.hessian,
                        to_to: &mut spoke.hessian,
                        pair: &mut spoke.with_centre,
                        pair_is_to_from: true,
                        from: &mut self.gradient,
                        to: &mut spoke.gradient,
                    }
                }
                Tie::MeasuredByNeighbour(j) => {
                    let spoke = &mut self.spokes[j.0];
                    Sums {
                        from_from: &mut spoke.hessian,
                        to_to: &mut self.hessian,
                        pair: &mut spoke.with_centre,
                        pair_is_to_from: false,
                        from: &mut spoke.gradient,
                        to: &mut self.gradient,
                    }
                }
                Tie::Fix => Sums {
                    to_to: &mut self.hessian,
                    to: &mut self.gradient,
                    ..dropped.sums()
                },
            };
            let quadratic = edge.add_share_linearised(&from, &to, share, &mut sums);
            cost += robust.map_or(quadratic, |judged| judged.cost);
        }
        0.5 * cost
    }

    fn try_descent(&mut self, step: f64) {
        self.trial = moved(&self.centre, &(-step * self.gradient));
        for spoke in self.spokes.iter_mut() {
            spoke.trial = moved(&spoke.pose, &(-step * spoke.gradient));
        }
    }

    /// Singular equations are solved for the smallest step, so the prior stays where nothing is known.
    fn try_gauss_newton(&mut self, damping: f64) -> Option<Step> {
        let nodes = 1.0 + self.spokes.len() as f64;
        let trace = self.hessian.trace()
            + self
                .spokes
                .iter()
                .map(|spoke| spoke.hessian.trace())
                .sum::<f64>();
        let added = damping * trace / (6.0 * nodes);
        let diagonal = self.hessian.diagonal().add_scalar(added);
        let (reduced, right) = self.reduce(added);
        let mut centre = -right;
        if let Some(factor) = Factor::new(&reduced, &diagonal) {
            factor.solve_lower(&mut centre);
            factor.solve_upper(&mut centre);
        } else {
            let unknown;
            (centre, unknown) = solve_semidefinite(&reduced, &diagonal, &centre);
            if damping == 0.0 {
                self.unobservable = unknown;
            }
        }
        self.trial = moved(&self.centre, &centre);
        let mut along_gradient = self.gradient.dot(&centre);
        let mut squared = centre.norm_squared();
        for spoke in self.spokes.iter_mut() {
            let step = match &spoke.eliminated {
                Eliminated::Definite(factor, columns) => {
                    let mut step = -(columns.fixed_columns::<6>(0) * centre + columns.column(6));
                    factor.solve_upper(&mut step);
                    step
                }
                Eliminated::Semidefinite(solved) => {
                    -(solved.fixed_columns::<6>(0) * centre + solved.column(6))
                }
            };
            spoke.trial = moved(&spoke.pose, &step);
            along_gradient += spoke.gradient.dot(&step);
            squared += step.norm_squared();
        }
        // The model falls by -g.s - s.H s / 2, and (H + added I) s = -g.
        Some(Step {
            norm: squared.sqrt(),
            predicted_decrease: 0.5 * (added * squared - along_gradient),
        })
    }

    fn trial_cost(&mut self) -> f64 {
        let mut cost = self.star.centre.cost(&self.trial);
        for (spoke, neighbour) in self.spokes.iter().zip(&self.star.neighbours) {
            cost += neighbour.anchor.cost(&spoke.trial);
        }
        for StarEdge {
            edge, tie, scale, ..
        } in &self.star.edges
        {
            let (from, to) = self.trial_ends(*tie);
            cost += match scale {
                Some(scale) => edge.judged(scale, &from, &to).cost,
                None => edge.cost(&from, &to),
            };
        }
        0.5 * cost
    }

    fn advance(&mut self) -> f64 {
        self.swap();
        self.linearise()
    }

    fn undo(&mut self) {
        self.swap();
    }

    fn accept(&mut self) {
        self.centre = self.trial;
        for spoke in self.spokes.iter_mut() {
            spoke.pose = spoke.trial;
        }
    }
}

fn moved(node: &Node, step: &Vector6<f64>) -> Node {
    node.retract(
        &step.fixed_rows::<3>(0).into_owned(),
        &step.fixed_rows::<3>(3).into_owned(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cooperative::star::tests::robust;

    #[test]
    fn along_the_gradient_the_robust_cost_falls_by_its_square() {
        let star = robust::crowd(7, 1.0);
        let mut workspace = StarWorkspace::new();
        let mut problem = StarProblem::new(&star, &mut workspace);
        let at_prior = problem.linearise();
        assert_eq!(problem.gradient(), at_prior);
        let norm = problem.gradient_norm();
        let step = 1e-6;
        problem.try_descent(-step);
        let up = problem.trial_cost();
        problem.try_descent(step);
        let slope = (up - problem.trial_cost()) / (2.0 * step);
        assert!(norm > 0.01, "the priors are no minimum");
        assert!(
            (slope - norm * norm).abs() < 1e-6 * norm * norm,
            "{slope}, {}",
            norm * norm
        );
    }
}
