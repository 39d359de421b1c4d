//! The distributed step of one vehicle (paper section IV): the measurement graph of itself and its neighbours, which
//! is a star, solved by eliminating the neighbours one by one.
//!
//! Anchors are the priors as pose edges from node 0 (`R_0 = I`, `t_0 = 0`, held fixed). Only edges that touch the
//! centre take part, so no two neighbours are coupled and the Schur complement costs one 6x6 factor per neighbour.
//! Only the centre's pose is an answer; what the star thinks of the neighbours is dropped.

use nalgebra::{Matrix6, SMatrix, Vector3, Vector6};

use super::block::{Factor, solve_semidefinite};
use super::edge::{Edge, Node, Normal, Sums, Weight};
use super::measurement::{CONTRADICTION_SIGMAS, Measurement, Noise};
use super::mode::{AnchorWeight, Mode, Weighting};
use super::optimise::{Degeneracy, Optimiser, Problem, SolveStatus, Step};
use super::refusal::Refusal;
use crate::so3;
use crate::transform::{Body, Sensor, Transform};

/// Neighbours that one step takes.
pub const MAX_NEIGHBOURS: usize = 16;

/// Measurements and fixes together that one step takes: 16 neighbours, both directions, four each.
pub const MAX_EDGES: usize = 128;

/// Names a neighbour within one star.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NeighbourIndex(usize);

impl NeighbourIndex {
    /// Its place in the order of adding, from 0.
    #[must_use]
    pub const fn get(self) -> usize {
        self.0
    }
}

/// The local measurement graph of one vehicle in one round.
///
/// Can be kept from round to round: [`Star::restart`] empties it without giving its memory back.
#[derive(Debug, Clone)]
pub struct Star {
    centre: Anchor,
    neighbours: Vec<Anchor>,
    edges: Vec<StarEdge>,
    mode: Mode,
}

/// A prior as a pose edge from node 0.
#[derive(Debug, Clone, Copy)]
struct Anchor {
    prior: Node,
    weight: AnchorWeight,
}

#[derive(Debug, Clone, Copy)]
struct StarEdge {
    edge: Edge,
    noise: Noise,
    other: Other,
}

/// The end of an edge that is not the centre.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Other {
    /// The centre measured this neighbour.
    Measured(usize),
    /// This neighbour measured the centre.
    Measuring(usize),
    /// Node 0 measured the centre: an absolute fix.
    Reference,
}

/// The answer of one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solution {
    /// The centre's pose; finite in every case.
    pub world_from_body: Node,
    /// Why the solver stopped and what the pose is worth.
    pub status: SolveStatus,
    /// In how many of its six directions nothing is known of the centre, so that the prior was kept there.
    pub unobservable: u8,
    /// Iterations that were accepted.
    pub iterations: usize,
    /// The cost (paper eq. 3, rad^2 and m^2) at the priors.
    pub cost_before: f64,
    /// The cost at the answer.
    pub cost_after: f64,
}

/// Memory of the solver, to be kept between steps. It holds room for the largest star from the start, so that no step
/// allocates.
#[derive(Debug, Clone)]
pub struct StarWorkspace {
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
}

impl Star {
    /// A star of the centre alone, with the paper's anchor.
    ///
    /// # Errors
    /// [`Refusal::NotFinite`] when the prior is no pose.
    pub fn new(world_from_body: Node) -> Result<Self, Refusal> {
        Self::with_anchor(world_from_body, AnchorWeight::UNIT)
    }

    /// A star of the centre alone, with a stated weight of its prior.
    ///
    /// # Errors
    /// [`Refusal`] when the prior is no pose or the weight is negative or not finite.
    pub fn with_anchor(world_from_body: Node, weight: AnchorWeight) -> Result<Self, Refusal> {
        Ok(Self {
            centre: Anchor::new(world_from_body, weight)?,
            neighbours: Vec::with_capacity(MAX_NEIGHBOURS),
            edges: Vec::with_capacity(MAX_EDGES),
            mode: Mode::Paper,
        })
    }

    /// The same star weighed in another way; the anchors that are there keep their weights.
    #[must_use]
    pub const fn in_mode(mut self, mode: Mode) -> Self {
        self.mode = mode;
        self
    }

    /// Empties the star for another round, keeping its memory and mode.
    ///
    /// # Errors
    /// As [`Star::with_anchor`]; the star is then unchanged.
    pub fn restart(&mut self, world_from_body: Node, weight: AnchorWeight) -> Result<(), Refusal> {
        self.centre = Anchor::new(world_from_body, weight)?;
        self.neighbours.clear();
        self.edges.clear();
        Ok(())
    }

    /// How measurements are weighed.
    #[must_use]
    pub const fn mode(&self) -> Mode {
        self.mode
    }

    /// The number of neighbours.
    #[must_use]
    pub const fn neighbours(&self) -> usize {
        self.neighbours.len()
    }

    /// The number of measurements and fixes.
    #[must_use]
    pub const fn edges(&self) -> usize {
        self.edges.len()
    }

    /// Adds a neighbour by its prior of this round, with the paper's anchor.
    ///
    /// # Errors
    /// [`Refusal`] when the prior is no pose or there are [`MAX_NEIGHBOURS`] already.
    pub fn add_neighbour(&mut self, world_from_body: Node) -> Result<NeighbourIndex, Refusal> {
        self.add_neighbour_with_anchor(world_from_body, AnchorWeight::UNIT)
    }

    /// Adds a neighbour with a stated weight of its prior.
    ///
    /// # Errors
    /// As [`Star::add_neighbour`], or when the weight is negative or not finite.
    pub fn add_neighbour_with_anchor(
        &mut self,
        world_from_body: Node,
        weight: AnchorWeight,
    ) -> Result<NeighbourIndex, Refusal> {
        if self.neighbours.len() == MAX_NEIGHBOURS {
            return Err(Refusal::Full {
                what: "neighbours",
                limit: MAX_NEIGHBOURS,
            });
        }
        self.neighbours.push(Anchor::new(world_from_body, weight)?);
        Ok(NeighbourIndex(self.neighbours.len() - 1))
    }

    /// Adds what the centre measured of a neighbour. An end is `body_from_sensor` of that vehicle, the motion between
    /// its round instant and the measurement included.
    ///
    /// # Errors
    /// [`Refusal`] for an unknown neighbour, unusable noise or offsets, a measurement that contradicts one already
    /// here, or when there are [`MAX_EDGES`] already.
    pub fn measured_by_me(
        &mut self,
        neighbour: NeighbourIndex,
        measurement: Measurement,
        noise: Noise,
        own_end: Transform<Body, Sensor>,
        their_end: Transform<Body, Sensor>,
    ) -> Result<(), Refusal> {
        self.add(
            Other::Measured(neighbour.0),
            measurement,
            noise,
            own_end,
            their_end,
        )
    }

    /// Adds what a neighbour measured of the centre.
    ///
    /// # Errors
    /// As [`Star::measured_by_me`].
    pub fn measured_by_neighbour(
        &mut self,
        neighbour: NeighbourIndex,
        measurement: Measurement,
        noise: Noise,
        own_end: Transform<Body, Sensor>,
        their_end: Transform<Body, Sensor>,
    ) -> Result<(), Refusal> {
        self.add(
            Other::Measuring(neighbour.0),
            measurement,
            noise,
            their_end,
            own_end,
        )
    }

    /// Adds an absolute fix of the centre: what node 0, the world's origin, measures of it. A position fix is the
    /// antenna's position in the world with the lever arm as `own_end`.
    ///
    /// # Errors
    /// As [`Star::measured_by_me`].
    pub fn fix(
        &mut self,
        measurement: Measurement,
        noise: Noise,
        own_end: Transform<Body, Sensor>,
    ) -> Result<(), Refusal> {
        self.add(
            Other::Reference,
            measurement,
            noise,
            Transform::identity(),
            own_end,
        )
    }

    fn add(
        &mut self,
        other: Other,
        measurement: Measurement,
        noise: Noise,
        from_offset: Transform<Body, Sensor>,
        to_offset: Transform<Body, Sensor>,
    ) -> Result<(), Refusal> {
        if let Other::Measured(index) | Other::Measuring(index) = other
            && index >= self.neighbours.len()
        {
            return Err(Refusal::UnknownNode { index });
        }
        if self.edges.len() == MAX_EDGES {
            return Err(Refusal::Full {
                what: "measurements",
                limit: MAX_EDGES,
            });
        }
        noise.check(measurement.kind())?;
        let weight = match self.mode {
            Mode::Paper => Weight::Unit,
            Mode::Star(robust) => match robust.weighting {
                Weighting::Unit => Weight::Unit,
                Weighting::Noise => Weight::Noise(noise),
            },
        };
        let edge = Edge::with_offsets(measurement, weight, from_offset, to_offset)?;
        for present in self.edges.iter().filter(|present| present.other == other) {
            let sigmas = edge.sigmas_apart(&noise, &present.edge, &present.noise);
            if sigmas > CONTRADICTION_SIGMAS {
                return Err(Refusal::Contradicts {
                    kind: measurement.kind(),
                    sigmas,
                });
            }
        }
        self.edges.push(StarEdge { edge, noise, other });
        Ok(())
    }

    /// Minimises the star's cost from the priors. Deterministic, never panics, and allocates nothing.
    pub fn solve(&self, workspace: &mut StarWorkspace, optimiser: &Optimiser) -> Solution {
        let prior = self.centre.prior;
        if self.edges.is_empty() {
            return Solution {
                world_from_body: prior,
                status: SolveStatus::NothingMeasured,
                unobservable: 0,
                iterations: 0,
                cost_before: 0.0,
                cost_after: 0.0,
            };
        }
        let mut problem = StarProblem::new(self, workspace);
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
            return solution;
        }
        solution.unobservable = match optimiser {
            Optimiser::GaussNewton(_) => problem.unobservable,
            Optimiser::Descent(_) => {
                problem.linearise();
                problem.try_gauss_newton(0.0);
                problem.unobservable
            }
        };
        if let (SolveStatus::Converged | SolveStatus::Stalled, Some(degeneracy)) =
            (outcome.status, problem.degeneracy(solution.unobservable))
        {
            solution.status = SolveStatus::Degenerate(degeneracy);
        }
        solution
    }
}

impl Anchor {
    fn new(prior: Node, weight: AnchorWeight) -> Result<Self, Refusal> {
        if !prior.is_valid() {
            return Err(Refusal::NotFinite { what: "the prior" });
        }
        Ok(Self {
            prior,
            weight: weight.check()?,
        })
    }

    fn turn(&self, node: &Node) -> Vector3<f64> {
        so3::log(&(self.prior.rotation.inverse() * node.rotation))
    }

    fn cost(&self, node: &Node) -> f64 {
        self.weight.rotation * self.turn(node).norm_squared()
            + self.weight.translation * (node.translation - self.prior.translation).norm_squared()
    }

    /// Half the gradient of the cost.
    fn gradient(&self, node: &Node) -> Vector6<f64> {
        let turn = self.weight.rotation * self.turn(node);
        let shift = self.weight.translation * (node.translation - self.prior.translation);
        Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
    }

    /// Normal equations and cost. Residuals `phi = Log(Rhat^T R)` and `t - that`.
    fn linearise(&self, node: &Node) -> (Matrix6<f64>, Vector6<f64>, f64) {
        let turn = self.turn(node);
        let shift = node.translation - self.prior.translation;
        let mut hessian = Matrix6::from_diagonal_element(self.weight.translation);
        let turns = so3::right_jacobian_inverse_gram(&turn) * self.weight.rotation;
        hessian.fixed_view_mut::<3, 3>(0, 0).copy_from(&turns);
        let (w, delta) = (self.weight.rotation * turn, self.weight.translation * shift);
        (
            hessian,
            Vector6::new(w.x, w.y, w.z, delta.x, delta.y, delta.z),
            turn.dot(&w) + shift.dot(&delta),
        )
    }
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
}

impl<'a> StarProblem<'a> {
    fn new(star: &'a Star, workspace: &'a mut StarWorkspace) -> Self {
        let spokes = &mut workspace.neighbours;
        spokes.clear();
        spokes.extend(star.neighbours.iter().map(|anchor| Spoke {
            pose: anchor.prior,
            trial: anchor.prior,
            hessian: Matrix6::zeros(),
            with_centre: Matrix6::zeros(),
            gradient: Vector6::zeros(),
            eliminated: Eliminated::Semidefinite(SMatrix::zeros()),
        }));
        Self {
            star,
            spokes,
            centre: star.centre.prior,
            trial: star.centre.prior,
            hessian: Matrix6::zeros(),
            gradient: Vector6::zeros(),
            unobservable: 0,
        }
    }

    /// Exchanges the present point and the trial point.
    fn swap(&mut self) {
        std::mem::swap(&mut self.centre, &mut self.trial);
        for spoke in self.spokes.iter_mut() {
            std::mem::swap(&mut spoke.pose, &mut spoke.trial);
        }
    }

    fn ends(&self, other: Other) -> (Node, Node) {
        match other {
            Other::Measured(j) => (self.centre, self.spokes[j].pose),
            Other::Measuring(j) => (self.spokes[j].pose, self.centre),
            Other::Reference => (Transform::identity(), self.centre),
        }
    }

    fn degeneracy(&self, unobservable: u8) -> Option<Degeneracy> {
        if unobservable > 0 {
            return Some(Degeneracy::Unobservable);
        }
        for StarEdge { edge, other, .. } in &self.star.edges {
            let (from, to) = self.ends(*other);
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
        self.gradient = self.star.centre.gradient(&self.centre);
        let mut cost = self.star.centre.cost(&self.centre);
        for (spoke, anchor) in self.spokes.iter_mut().zip(&self.star.neighbours) {
            spoke.gradient = anchor.gradient(&spoke.pose);
            cost += anchor.cost(&spoke.pose);
        }
        for StarEdge { edge, other, .. } in &self.star.edges {
            let (from, to) = self.ends(*other);
            let by = edge.gradient(&from, &to);
            cost += edge.cost(&from, &to);
            match *other {
                Other::Measured(j) => {
                    self.gradient += 0.5 * by.from;
                    self.spokes[j].gradient += 0.5 * by.to;
                }
                Other::Measuring(j) => {
                    self.gradient += 0.5 * by.to;
                    self.spokes[j].gradient += 0.5 * by.from;
                }
                Other::Reference => self.gradient += 0.5 * by.to,
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
        for (spoke, anchor) in self.spokes.iter_mut().zip(&self.star.neighbours) {
            let part;
            (spoke.hessian, spoke.gradient, part) = anchor.linearise(&spoke.pose);
            spoke.with_centre = Matrix6::zeros();
            cost += part;
        }
        for StarEdge { edge, other, .. } in &self.star.edges {
            let (from, to) = self.ends(*other);
            cost += match *other {
                Other::Measured(j) => {
                    let spoke = &mut self.spokes[j];
                    edge.add_linearised(
                        &from,
                        &to,
                        &mut Sums {
                            from_from: &mut self.hessian,
                            to_to: &mut spoke.hessian,
                            pair: &mut spoke.with_centre,
                            pair_is_to_from: true,
                            from: &mut self.gradient,
                            to: &mut spoke.gradient,
                        },
                    )
                }
                Other::Measuring(j) => {
                    let spoke = &mut self.spokes[j];
                    edge.add_linearised(
                        &from,
                        &to,
                        &mut Sums {
                            from_from: &mut spoke.hessian,
                            to_to: &mut self.hessian,
                            pair: &mut spoke.with_centre,
                            pair_is_to_from: false,
                            from: &mut spoke.gradient,
                            to: &mut self.gradient,
                        },
                    )
                }
                Other::Reference => {
                    let mut dropped = Normal::zero();
                    let sums = Sums {
                        to_to: &mut self.hessian,
                        to: &mut self.gradient,
                        ..dropped.sums()
                    };
                    edge.add_linearised(&from, &to, &mut { sums })
                }
            };
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
        for (spoke, anchor) in self.spokes.iter().zip(&self.star.neighbours) {
            cost += anchor.cost(&spoke.trial);
        }
        for StarEdge { edge, other, .. } in &self.star.edges {
            cost += match *other {
                Other::Measured(j) => edge.cost(&self.trial, &self.spokes[j].trial),
                Other::Measuring(j) => edge.cost(&self.spokes[j].trial, &self.trial),
                Other::Reference => edge.cost(&Transform::identity(), &self.trial),
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
mod tests;
