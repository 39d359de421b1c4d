//! The centralised algorithm (paper section III): minimises the cost of a whole measurement graph, sparse from the
//! start. One unknown of six numbers per node that is not held; the normal equations are factored in 6x6 blocks.

mod cholesky;
mod ordering;

use nalgebra::{Matrix6, Vector6};

use self::cholesky::{Cholesky, Sparse};
use super::edge::Node;
use super::graph::Graph;
use super::optimise::{Degeneracy, Optimiser, Problem, Progress, SolveStatus, Step};

/// The answer of the centralised algorithm; the poses are in the graph.
#[derive(Debug, Clone, PartialEq)]
pub struct BatchSolution {
    /// Why the solver stopped.
    pub status: SolveStatus,
    /// Iterations that were accepted.
    pub iterations: usize,
    /// The cost (paper eq. 3, weighted) at the initial poses.
    pub cost_before: f64,
    /// The cost at the answer.
    pub cost_after: f64,
}

/// Minimises the graph's cost from its present poses and leaves the answer in the graph. `observe` hears of every
/// accepted iteration.
///
/// Directions that nothing observes (no held node, a node without an edge) stay at their initial pose and the status
/// says so. The poses stay finite in every case.
pub fn solve(
    graph: &mut Graph,
    optimiser: &Optimiser,
    observe: impl FnMut(Progress),
) -> BatchSolution {
    if graph.edges().is_empty() {
        return BatchSolution {
            status: SolveStatus::NothingMeasured,
            iterations: 0,
            cost_before: 0.0,
            cost_after: 0.0,
        };
    }
    let mut problem = BatchProblem::new(graph);
    let outcome = optimiser.minimise(&mut problem, observe);
    let nodes = problem.nodes;
    let mut solution = BatchSolution {
        status: outcome.status,
        iterations: outcome.iterations,
        cost_before: outcome.cost_before,
        cost_after: outcome.cost_after,
    };
    if outcome.status == SolveStatus::NotFinite || !nodes.iter().all(Node::is_valid) {
        solution.status = SolveStatus::NotFinite;
        solution.cost_after = solution.cost_before;
        return solution;
    }
    graph.replace_nodes(nodes);
    if let SolveStatus::Converged | SolveStatus::Stalled = solution.status {
        let ends =
            |e: &super::graph::GraphEdge| (graph.nodes()[e.from.get()], graph.nodes()[e.to.get()]);
        let any = |test: &dyn Fn(&super::graph::GraphEdge, &Node, &Node) -> bool| {
            graph.edges().iter().any(|e| {
                let (from, to) = ends(e);
                test(e, &from, &to)
            })
        };
        if any(&|e, from, to| e.edge.is_coincident(from, to)) {
            solution.status = SolveStatus::Degenerate(Degeneracy::CoincidentEnds);
        } else if any(&|e, from, to| e.edge.is_opposite(from, to)) {
            solution.status = SolveStatus::Degenerate(Degeneracy::OppositeOrientation);
        }
    }
    solution
}

/// Where an edge adds its part of the normal equations; a held node has no place.
#[derive(Debug, Clone, Copy)]
struct Place {
    from: Option<usize>,
    to: Option<usize>,
    /// The block of the pair, and whether the measuring node is its row.
    pair: Option<(usize, bool)>,
}

struct BatchProblem<'a> {
    graph: &'a Graph,
    nodes: Vec<Node>,
    trial: Vec<Node>,
    /// The unknown of each node, in the order of elimination.
    unknown_of: Vec<Option<usize>>,
    places: Vec<Place>,
    hessian: Sparse,
    gradient: Vec<Vector6<f64>>,
    step: Vec<Vector6<f64>>,
    cholesky: Option<Cholesky>,
}

impl<'a> BatchProblem<'a> {
    fn new(graph: &'a Graph) -> Self {
        // Number the free nodes as they come, order them for little fill, then number them anew.
        let held = |index: usize| graph.is_held_at(index);
        let mut free = Vec::new();
        let mut number = vec![None; graph.nodes().len()];
        for (index, slot) in number.iter_mut().enumerate() {
            if !held(index) {
                *slot = Some(free.len());
                free.push(index);
            }
        }
        let mut neighbours = vec![Vec::new(); free.len()];
        for e in graph.edges() {
            if let (Some(a), Some(b)) = (number[e.from.get()], number[e.to.get()]) {
                neighbours[a].push(b);
                neighbours[b].push(a);
            }
        }
        for list in &mut neighbours {
            list.sort_unstable();
            list.dedup();
        }
        let order = ordering::minimum_degree(&neighbours);
        let mut unknown_of = vec![None; graph.nodes().len()];
        let mut place_of = vec![0; free.len()];
        for (unknown, &old) in order.iter().enumerate() {
            unknown_of[free[old]] = Some(unknown);
            place_of[old] = unknown;
        }
        let pairs = neighbours
            .iter()
            .enumerate()
            .flat_map(|(a, list)| list.iter().map(move |&b| (a, b)))
            .map(|(a, b)| (place_of[a], place_of[b]));
        let hessian = Sparse::new(free.len(), pairs);
        let places = graph
            .edges()
            .iter()
            .map(|e| {
                let (from, to) = (unknown_of[e.from.get()], unknown_of[e.to.get()]);
                let pair = match (from, to) {
                    (Some(a), Some(b)) => {
                        hessian.find(a.max(b), a.min(b)).map(|block| (block, a > b))
                    }
                    _ => None,
                };
                Place { from, to, pair }
            })
            .collect();
        let unknowns = free.len();
        Self {
            graph,
            nodes: graph.nodes().to_vec(),
            trial: graph.nodes().to_vec(),
            unknown_of,
            places,
            hessian,
            gradient: vec![Vector6::zeros(); unknowns],
            step: vec![Vector6::zeros(); unknowns],
            cholesky: None,
        }
    }

    /// Puts the trial point `scale` times `steps` away.
    fn move_trial(&mut self, along_gradient: Option<f64>) {
        for (index, unknown) in self.unknown_of.iter().enumerate() {
            if let Some(unknown) = *unknown {
                let by = match along_gradient {
                    Some(step) => -step * self.gradient[unknown],
                    None => self.step[unknown],
                };
                let (w, delta) = (
                    by.fixed_rows::<3>(0).into_owned(),
                    by.fixed_rows::<3>(3).into_owned(),
                );
                self.trial[index] = self.nodes[index].retract(&w, &delta);
            }
        }
    }
}

impl Problem for BatchProblem<'_> {
    fn gradient(&mut self) -> f64 {
        self.gradient.fill(Vector6::zeros());
        let mut cost = 0.0;
        for (e, place) in self.graph.edges().iter().zip(&self.places) {
            let (from, to) = (&self.nodes[e.from.get()], &self.nodes[e.to.get()]);
            cost += e.edge.cost(from, to);
            let by = e.edge.gradient(from, to);
            if let Some(from) = place.from {
                self.gradient[from] += 0.5 * by.from;
            }
            if let Some(to) = place.to {
                self.gradient[to] += 0.5 * by.to;
            }
        }
        0.5 * cost
    }

    fn gradient_norm(&self) -> f64 {
        self.gradient
            .iter()
            .map(|part| part.norm_squared())
            .sum::<f64>()
            .sqrt()
    }

    fn linearise(&mut self) -> f64 {
        self.gradient.fill(Vector6::zeros());
        self.hessian.clear();
        let mut cost = 0.0;
        for (e, place) in self.graph.edges().iter().zip(&self.places) {
            let (normal, part) = e
                .edge
                .linearise(&self.nodes[e.from.get()], &self.nodes[e.to.get()]);
            cost += part;
            if let Some(from) = place.from {
                *self.hessian.diagonal_mut(from) += normal.from_from;
                self.gradient[from] += normal.from;
            }
            if let Some(to) = place.to {
                *self.hessian.diagonal_mut(to) += normal.to_to;
                self.gradient[to] += normal.to;
            }
            if let Some((block, from_is_row)) = place.pair {
                let with = if from_is_row {
                    normal.from_to
                } else {
                    normal.from_to.transpose()
                };
                *self.hessian.block_mut(block) += with;
            }
        }
        0.5 * cost
    }

    fn try_descent(&mut self, step: f64) {
        self.move_trial(Some(step));
    }

    fn try_gauss_newton(&mut self, damping: f64) -> Option<Step> {
        let trace: f64 = (0..self.gradient.len())
            .map(|k| self.hessian.diagonal(k).trace())
            .sum();
        let added = damping * trace / (6.0 * self.gradient.len().max(1) as f64);
        let cholesky = self
            .cholesky
            .get_or_insert_with(|| Cholesky::analyse(&self.hessian));
        if !cholesky.factor(&self.hessian, added) {
            return None;
        }
        for (step, gradient) in self.step.iter_mut().zip(&self.gradient) {
            *step = -gradient;
        }
        cholesky.solve(&mut self.step);
        let (mut along_gradient, mut squared) = (0.0, 0.0);
        for (step, gradient) in self.step.iter().zip(&self.gradient) {
            along_gradient += gradient.dot(step);
            squared += step.norm_squared();
        }
        self.move_trial(None);
        // The model falls by -g.s - s.H s / 2, and (H + added I) s = -g.
        Some(Step {
            norm: squared.sqrt(),
            predicted_decrease: 0.5 * (added * squared - along_gradient),
        })
    }

    fn trial_cost(&mut self) -> f64 {
        self.graph.cost_at(&self.trial)
    }

    fn advance(&mut self) -> f64 {
        std::mem::swap(&mut self.nodes, &mut self.trial);
        self.linearise()
    }

    fn undo(&mut self) {
        std::mem::swap(&mut self.nodes, &mut self.trial);
    }

    fn accept(&mut self) {
        self.nodes.copy_from_slice(&self.trial);
    }
}

/// A block of the normal equations.
type Block = Matrix6<f64>;

#[cfg(test)]
mod tests;
