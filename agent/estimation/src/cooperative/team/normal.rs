//! The normal equations of a window, in order of time so that they are narrow, and the covariances by their factor.

use std::collections::BTreeMap;

use nalgebra::{Matrix6, SMatrix, SVector, Vector4, Vector6};

use super::left_over;
use super::measured_edge::{Linear, MeasuredEdge};
use super::noise_scales::NoiseScales;
use super::prior::{Anchor, Unknown};
use super::skyline::{Factor, Skyline};
use super::stretch::{self, BIASES};
use super::window::Window;
use crate::{Transform, VehicleId, World, se3};

/// A largest step below which a round has converged, radians or metres.
pub(super) const STEP_NEGLIGIBLE: f64 = 1e-9;

/// A direction that nothing determines, or numbers that are none.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct NotDetermined;

/// The equations and their factor.
#[derive(Clone, Debug, Default)]
pub(super) struct Normal {
    matrix: Skyline,
    gradient: Vec<f64>,
    factor: Factor,
    first: Vec<usize>,
    /// Every vehicle's poses that follow each other, as indices.
    stretches: Vec<(usize, usize)>,
    /// Where the biases' rows begin; those of a pose do at six times its index.
    biases: BTreeMap<VehicleId, usize>,
    /// Right sides of covariances, six at a time.
    columns: Vec<[f64; 6]>,
}

/// What is left over of one stretch of odometry, of unit variance: squares and what was expected of them.
#[derive(Clone, Copy, Debug)]
pub(super) struct OdometryLeft {
    pub(super) vehicle: VehicleId,
    pub(super) rotation: (f64, f64),
    pub(super) translation: (f64, f64),
}

/// Where factors add their part: the lower half of a matrix, and a gradient.
pub(super) trait Sums {
    fn add(&mut self, row: usize, column: usize, value: f64);
    /// The same for entries of a row that follow each other.
    fn add_row(&mut self, row: usize, column: usize, values: &[f64]) {
        for (at, value) in values.iter().enumerate() {
            self.add(row, column + at, *value);
        }
    }
    fn add_gradient(&mut self, row: usize, value: f64);

    /// A block, or its transpose where that lies in the lower half; of a block on the diagonal the lower half.
    fn add_block<const R: usize, const C: usize>(
        &mut self,
        row: usize,
        column: usize,
        block: &SMatrix<f64, R, C>,
    ) {
        if row >= column {
            for (r, values) in block.transpose().data.0.iter().enumerate() {
                let wanted = if row == column { r + 1 } else { C };
                self.add_row(row + r, column, &values[..wanted]);
            }
        } else {
            for (c, values) in block.data.0.iter().enumerate() {
                self.add_row(column + c, row, values);
            }
        }
    }

    fn add_part<const R: usize>(&mut self, row: usize, part: &SVector<f64, R>) {
        for r in 0..R {
            self.add_gradient(row + r, part[r]);
        }
    }

    /// The prior: gradient `Lambda e + beta`, Hessian `Lambda`.
    fn prior(&mut self, window: &Window, offset: impl Fn(Unknown) -> usize) {
        let prior = &window.prior;
        let mut error = nalgebra::DVector::zeros(prior.dimension());
        let mut rows = Vec::with_capacity(prior.dimension());
        for anchor in &prior.anchors {
            let unknown = anchor.unknown();
            let from = rows.len();
            match anchor {
                Anchor::Pose(id, pose) => {
                    let now = window.poses[window.index(*id)].world_from_body;
                    let apart: Transform<World, World> = now * pose.inverse();
                    error.rows_mut(from, 6).copy_from(&se3::log(&apart));
                }
                Anchor::Biases(id, biases) => {
                    let now = window.members[id].biases.value;
                    error.rows_mut(from, BIASES).copy_from(&(now - biases));
                }
            }
            let begin = offset(unknown);
            rows.extend(begin..begin + unknown.dimension());
        }
        let gradient = &prior.lambda * &error + &prior.beta;
        for (r, row) in rows.iter().enumerate() {
            self.add_gradient(*row, gradient[r]);
            for (c, column) in rows.iter().enumerate().take(r + 1) {
                let (low, high) = (row.min(column), row.max(column));
                self.add(*high, *low, prior.lambda[(r, c)]);
            }
        }
    }

    /// The odometry between two poses, by index.
    fn stretch(
        &mut self,
        window: &Window,
        pair: (usize, usize),
        scales: &NoiseScales,
        offset: impl Fn(Unknown) -> usize,
    ) {
        let Some(linear) = window.linearise_stretch(pair, scales) else {
            return;
        };
        let stretch::Linear {
            residual,
            twist,
            bias,
        } = linear;
        let (earlier, later) = (&window.poses[pair.0], &window.poses[pair.1]);
        let earlier_at = offset(Unknown::Pose(earlier.id));
        let later_at = offset(Unknown::Pose(later.id));
        let bias_at = offset(Unknown::Biases(earlier.vehicle));
        let square = twist.transpose() * twist;
        let part: Vector6<f64> = twist.transpose() * residual;
        let across = bias.transpose() * twist;
        self.add_block(earlier_at, earlier_at, &square);
        self.add_block(later_at, later_at, &square);
        self.add_block(later_at, earlier_at, &(-square));
        self.add_block(bias_at, bias_at, &(bias.transpose() * bias));
        self.add_block(bias_at, later_at, &across);
        self.add_block(bias_at, earlier_at, &(-across));
        self.add_part(earlier_at, &(-part));
        self.add_part(later_at, &part);
        self.add_part(bias_at, &(bias.transpose() * residual));
    }

    /// A measurement by its weight.
    fn edge(&mut self, edge: &MeasuredEdge, linear: &Linear, offset: impl Fn(Unknown) -> usize) {
        if edge.weight <= 0.0 {
            return;
        }
        let square: Matrix6<f64> = linear.twist.transpose() * linear.twist * edge.weight;
        let part: Vector6<f64> = linear.twist.transpose() * linear.residual * edge.weight;
        let to = offset(Unknown::Pose(edge.to));
        self.add_block(to, to, &square);
        self.add_part(to, &part);
        if let Some(from) = edge.from {
            let from = offset(Unknown::Pose(from));
            self.add_block(from, from, &square);
            self.add_block(to, from, &(-square));
            self.add_part(from, &(-part));
        }
    }
}

/// The sparse sums.
struct Sparse<'a> {
    matrix: &'a mut Skyline,
    gradient: &'a mut [f64],
}

impl Sums for Sparse<'_> {
    fn add(&mut self, row: usize, column: usize, value: f64) {
        self.matrix.add(row, column, value);
    }

    fn add_row(&mut self, row: usize, column: usize, values: &[f64]) {
        self.matrix.add_row(row, column, values);
    }

    fn add_gradient(&mut self, row: usize, value: f64) {
        self.gradient[row] += value;
    }
}

impl Normal {
    /// Puts the window's equations together, of its measurements those that `is_used`.
    pub(super) fn assemble(
        &mut self,
        window: &Window,
        scales: &NoiseScales,
        is_used: impl Fn(&MeasuredEdge) -> bool,
    ) {
        self.matrix.reset(&self.first);
        self.gradient.clear();
        self.gradient.resize(self.first.len(), 0.0);
        let biases = &self.biases;
        let offset = |unknown: Unknown| offset(window, biases, unknown);
        let mut sums = Sparse {
            matrix: &mut self.matrix,
            gradient: &mut self.gradient,
        };
        sums.prior(window, offset);
        for pair in &self.stretches {
            sums.stretch(window, *pair, scales, offset);
        }
        for edge in window.edges.iter().filter(|edge| is_used(edge)) {
            sums.edge(edge, &edge.linear, offset);
        }
    }

    /// Says where each unknown's rows are and where they begin to have something: once a round.
    pub(super) fn lay_out(&mut self, window: &Window) {
        self.stretches = window.stretches();
        self.biases.clear();
        let mut size = 6 * window.poses.len();
        for vehicle in window.members.keys() {
            self.biases.insert(*vehicle, size);
            size += BIASES;
        }
        self.first.clear();
        for row in 0..size {
            let within = row.min(6 * window.poses.len());
            self.first.push(if row < 6 * window.poses.len() {
                within - within % 6
            } else {
                row - (row - 6 * window.poses.len()) % BIASES
            });
        }
        let biases = &self.biases;
        let first = &mut self.first;
        let mut reach = |unknown: Unknown, from: usize| {
            let begin = offset(window, biases, unknown);
            for row in &mut first[begin..begin + unknown.dimension()] {
                *row = from.min(*row);
            }
        };
        let anchors = window.prior.anchors.iter();
        let offsets = anchors.map(|anchor| offset(window, biases, anchor.unknown()));
        if let Some(least) = offsets.min() {
            for anchor in &window.prior.anchors {
                reach(anchor.unknown(), least);
            }
        }
        for (a, b) in &self.stretches {
            let least = 6 * a.min(b);
            reach(Unknown::Pose(window.poses[*a].id), least);
            reach(Unknown::Pose(window.poses[*b].id), least);
            reach(Unknown::Biases(window.poses[*a].vehicle), least);
        }
        for edge in &window.edges {
            let to = window.index(edge.to);
            let from = edge.from.map_or(to, |from| window.index(from));
            let least = 6 * to.min(from);
            reach(Unknown::Pose(edge.to), least);
            edge.from
                .iter()
                .for_each(|from| reach(Unknown::Pose(*from), least));
        }
    }

    pub(super) fn factor(&mut self) -> Result<(), NotDetermined> {
        self.factor.of(&mut self.matrix).map_err(|_| NotDetermined)
    }

    /// Takes the Gauss-Newton step; gives its largest component.
    pub(super) fn step(&mut self, window: &mut Window) -> f64 {
        for value in &mut self.gradient {
            *value = -*value;
        }
        self.factor.solve(&mut self.gradient);
        let largest = self
            .gradient
            .iter()
            .fold(0.0, |largest: f64, value| largest.max(value.abs()));
        if !self.gradient.iter().all(|value| value.is_finite()) {
            return f64::NAN;
        }
        for (at, pose) in window.poses.iter_mut().enumerate() {
            let twist = Vector6::from_column_slice(&self.gradient[6 * at..6 * at + 6]);
            let moved: Transform<World, World> = se3::exp(&twist);
            pose.world_from_body = moved * pose.world_from_body;
            pose.world_from_body.rotation.renormalize();
        }
        for (vehicle, member) in &mut window.members {
            let at = self.biases[vehicle];
            member.biases.value += Vector4::from_column_slice(&self.gradient[at..at + BIASES]);
        }
        largest
    }

    /// `J P J^T` of a measurement that depends on `xi_to - xi_from` by `twist`.
    pub(super) fn covariance_of(
        &mut self,
        window: &Window,
        edge: &MeasuredEdge,
        twist: &Matrix6<f64>,
    ) -> Matrix6<f64> {
        let from = edge.from.map(|from| window.index(from));
        self.covariance_between(from, window.index(edge.to), twist)
    }

    /// The same between two poses by index.
    pub(super) fn covariance_between(
        &mut self,
        from: Option<usize>,
        to: usize,
        twist: &Matrix6<f64>,
    ) -> Matrix6<f64> {
        self.spread(from, to, twist, None)
    }

    /// `L^-1` of each row of a Jacobian, then all their products.
    fn spread(
        &mut self,
        from: Option<usize>,
        to: usize,
        twist: &Matrix6<f64>,
        biases: Option<(usize, &SMatrix<f64, 6, BIASES>)>,
    ) -> Matrix6<f64> {
        let begin = 6 * from.map_or(to, |from| from.min(to));
        self.columns.clear();
        self.columns.resize(self.first.len(), [0.0; 6]);
        for row in 0..6 {
            for axis in 0..6 {
                self.columns[6 * to + axis][row] += twist[(row, axis)];
                if let Some(from) = from {
                    self.columns[6 * from + axis][row] -= twist[(row, axis)];
                }
            }
            if let Some((at, jacobian)) = biases {
                for axis in 0..BIASES {
                    self.columns[at + axis][row] += jacobian[(row, axis)];
                }
            }
        }
        self.factor.forward_all(&mut self.columns, begin);
        let mut product = [[0.0; 6]; 6];
        for solved in &self.columns[begin..] {
            for (sums, left) in product.iter_mut().zip(solved) {
                for (sum, right) in sums.iter_mut().zip(solved) {
                    *sum += left * right;
                }
            }
        }
        Matrix6::from(product)
    }

    /// The variances of everybody's biases.
    pub(super) fn bias_variances(&self) -> BTreeMap<VehicleId, Vector4<f64>> {
        let mut variances = BTreeMap::new();
        for (vehicle, begin) in &self.biases {
            let mut columns = vec![[0.0; BIASES]; self.first.len()];
            for axis in 0..BIASES {
                columns[begin + axis][axis] = 1.0;
            }
            self.factor.forward_all(&mut columns, *begin);
            let mut variance = Vector4::zeros();
            for solved in &columns[*begin..] {
                for axis in 0..BIASES {
                    variance[axis] += solved[axis] * solved[axis];
                }
            }
            variances.insert(*vehicle, variance);
        }
        variances
    }

    /// What is left over of everybody's odometry of this round.
    pub(super) fn judge_odometry(
        &mut self,
        window: &Window,
        scales: &NoiseScales,
    ) -> Vec<OdometryLeft> {
        let mut judged = Vec::new();
        for at in 0..self.stretches.len() {
            let pair = self.stretches[at];
            if !window.poses[pair.1].is_new {
                continue;
            }
            let Some(linear) = window.linearise_stretch(pair, scales) else {
                continue;
            };
            let vehicle = window.poses[pair.1].vehicle;
            let biases = Some((self.biases[&vehicle], &linear.bias));
            let spread = self.spread(Some(pair.0), pair.1, &linear.twist, biases);
            let half = |first: usize| left_over(&linear.residual, &spread, first, 3.0, 1.0);
            judged.push(OdometryLeft {
                vehicle,
                rotation: half(0),
                translation: half(3),
            });
        }
        judged
    }
}

/// Where an unknown's rows begin.
fn offset(window: &Window, biases: &BTreeMap<VehicleId, usize>, unknown: Unknown) -> usize {
    match unknown {
        Unknown::Pose(id) => 6 * window.index(id),
        Unknown::Biases(vehicle) => biases[&vehicle],
    }
}
