//! What leaves the window goes into the prior: poses that are too old, and vehicles that began anew or make room. By the Schur
//! complement, at the present estimate and with the last weights.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, DVector};

use super::measured_edge::{MeasuredEdge, PoseId};
use super::noise_scales::NoiseScales;
use super::normal::Sums;
use super::prior::{Anchor, Prior, Unknown, subtract_marginal};
use super::settings::{Lag, MEMBERS_MAX};
use super::window::{PRESENT_ROUNDS, Window};
use crate::VehicleId;
use crate::time::{Span, Stamp};

/// After so many rounds in which nobody else was heard, this vehicle keeps its poses: whoever returns is told what it
/// missed, and that needs them.
const DEAF_AFTER_ROUNDS: i64 = 5;
/// Rounds that are kept so at most.
const DEAF_ROUNDS_MAX: i64 = 50;
/// Rounds that the poses are still kept after somebody is heard again.
const RETURN_ROUNDS: i64 = 6;
/// Rounds that the window reaches back at most when this vehicle joins a team that is not large.
const JOINED_ROUNDS_MAX: i64 = 12;

impl Window {
    /// The poses that have left the window go into the prior.
    pub(super) fn marginalise(&mut self, scales: &NoiseScales) {
        self.distance_rounds = self.distance_rounds.saturating_sub(1);
        let Some(newest) = self.newest_round() else {
            return;
        };
        let others = self.poses.iter().filter(|pose| pose.vehicle != self.own);
        let others = others.map(|pose| pose.instant).max();
        let is_deaf = others.is_none_or(|at| newest - at > self.period * DEAF_AFTER_ROUNDS);
        if is_deaf {
            self.held_until = Some(newest + self.period * RETURN_ROUNDS);
        }
        let is_held = self.held_until.is_some_and(|until| newest < until);
        let half = Span::from_nanos(self.period.as_nanos() / 2);
        let usual = newest - self.period * i64::from(self.lag()) - half;
        // What places this vehicle is older than its place in the window.
        let usual = match self.joined.take() {
            Some(joined) if self.members.len() <= Lag::MANY => {
                let most = newest - self.period * JOINED_ROUNDS_MAX;
                usual.min((joined - half).max(most))
            }
            _ => usual,
        };
        let oldest = newest - self.period * DEAF_ROUNDS_MAX;
        let cutoff = match self.cutoff {
            Some(before) if is_held => before.max(oldest),
            _ => usual,
        };
        let cutoff = self.cutoff.map_or(cutoff, |before| before.max(cutoff));
        self.cutoff = Some(cutoff);
        let last: BTreeSet<PoseId> = self
            .members
            .keys()
            .filter_map(|vehicle| self.newest_of(*vehicle).map(|pose| pose.id))
            .collect();
        let gone: Vec<Unknown> = self
            .poses
            .iter()
            .filter(|pose| pose.instant < cutoff && !last.contains(&pose.id))
            .map(|pose| Unknown::Pose(pose.id))
            .collect();
        self.eliminate(&gone, scales);
        if self.members.len() >= MEMBERS_MAX {
            self.evict(newest, scales);
        }
    }

    /// Makes room: the absent vehicle that was heard longest ago goes.
    fn evict(&mut self, now: Stamp, scales: &NoiseScales) {
        let newest = |vehicle: &VehicleId| self.newest_of(*vehicle).map(|pose| pose.instant);
        let oldest = self
            .members
            .keys()
            .filter(|vehicle| **vehicle != self.own)
            .filter_map(|vehicle| Some((newest(vehicle)?, *vehicle)))
            .min();
        if let Some((heard, vehicle)) = oldest
            && now - heard > self.period * PRESENT_ROUNDS
        {
            self.forget(vehicle, scales);
            self.evicted += 1;
        }
    }

    /// A vehicle leaves; what it told of others stays.
    pub(super) fn forget(&mut self, vehicle: VehicleId, scales: &NoiseScales) {
        if !self.members.contains_key(&vehicle) {
            return;
        }
        let own = self.poses.iter().filter(|pose| pose.vehicle == vehicle);
        let mut gone: Vec<Unknown> = own.map(|pose| Unknown::Pose(pose.id)).collect();
        gone.push(Unknown::Biases(vehicle));
        self.eliminate(&gone, scales);
        self.members.remove(&vehicle);
        self.tested.clear();
        if vehicle == self.own {
            self.own_estimate = None;
        }
    }

    /// Marginalises unknowns at the present estimate with the last weights. What came in since the last round and touches
    /// them came too late.
    fn eliminate(&mut self, gone: &[Unknown], scales: &NoiseScales) {
        if gone.is_empty() {
            return;
        }
        let is_gone = |id: PoseId| gone.contains(&Unknown::Pose(id));
        let touches = |edge: &MeasuredEdge| is_gone(edge.to) || edge.from.is_some_and(is_gone);
        let pairs: Vec<(usize, usize)> = self
            .stretches()
            .into_iter()
            .filter(|(a, b)| {
                let biases = Unknown::Biases(self.poses[*a].vehicle);
                is_gone(self.poses[*a].id) || is_gone(self.poses[*b].id) || gone.contains(&biases)
            })
            .collect();
        let mut order = gone.to_vec();
        let mut note = |unknown: Unknown| {
            if !order.contains(&unknown) {
                order.push(unknown);
            }
        };
        for anchor in &self.prior.anchors {
            note(anchor.unknown());
        }
        for (a, b) in &pairs {
            note(Unknown::Pose(self.poses[*a].id));
            note(Unknown::Pose(self.poses[*b].id));
            note(Unknown::Biases(self.poses[*a].vehicle));
        }
        for edge in self
            .edges
            .iter()
            .filter(|edge| touches(edge) && !edge.is_new)
        {
            note(Unknown::Pose(edge.to));
            edge.from.iter().for_each(|from| note(Unknown::Pose(*from)));
        }
        let mut offsets = BTreeMap::new();
        let mut size = 0;
        for unknown in &order {
            offsets.insert(*unknown, size);
            size += unknown.dimension();
        }
        let lost_unknowns = gone.len();
        let lost: usize = gone.iter().map(|unknown| unknown.dimension()).sum();
        let mut sums = Dense {
            hessian: DMatrix::zeros(size, size),
            gradient: DVector::zeros(size),
        };
        let offset = |unknown: Unknown| offsets[&unknown];
        sums.prior(self, offset);
        for pair in pairs {
            sums.stretch(self, pair, scales, offset);
        }
        for edge in self
            .edges
            .iter()
            .filter(|edge| touches(edge) && !edge.is_new)
        {
            // Anew: the frame and the noise scales have moved since the last round.
            sums.edge(edge, &self.linearise(edge, scales), offset);
        }
        self.edges.retain(|edge| !touches(edge));
        self.tested.retain(|edge| !touches(edge));
        self.poses.retain(|pose| !is_gone(pose.id));
        self.reindex();
        let Dense { hessian, gradient } = sums.full();
        let kept = size - lost;
        let across = hessian.view((lost, 0), (kept, lost)).into_owned();
        let mut lambda = hessian.view((lost, lost), (kept, kept)).into_owned();
        let mut beta = gradient.rows(lost, kept).into_owned();
        let inner = hessian.view((0, 0), (lost, lost)).into_owned();
        let gone = gradient.rows(0, lost).into_owned();
        if let Some(inner) = inner.clone().cholesky() {
            beta -= &across * inner.solve(&gone);
            subtract_marginal(&mut lambda, &inner, &across);
        } else if let Some(inner) = pseudo_inverse(inner) {
            beta -= &across * (&inner * gone);
            lambda -= &across * inner * across.transpose();
        }
        let anchors = order[lost_unknowns..].iter().map(|unknown| match *unknown {
            Unknown::Pose(id) => Anchor::Pose(id, self.poses[self.index(id)].world_from_body),
            Unknown::Biases(vehicle) => {
                Anchor::Biases(vehicle, self.members[&vehicle].biases.value)
            }
        });
        self.prior = Prior {
            anchors: anchors.collect(),
            lambda,
            beta,
        };
        self.prior.symmetrise();
    }
}

/// The inverse in the directions that something determines: the others tell nothing of the rest, as a sum of squares
/// that a direction does not meet has no part across it. None of what are no numbers.
fn pseudo_inverse(matrix: DMatrix<f64>) -> Option<DMatrix<f64>> {
    if !matrix.iter().all(|number| number.is_finite()) {
        return None;
    }
    let least = matrix.amax() * matrix.nrows() as f64 * f64::EPSILON;
    let eigen = matrix.symmetric_eigen();
    let inverse = eigen
        .eigenvalues
        .map(|value| if value > least { 1.0 / value } else { 0.0 });
    Some(&eigen.eigenvectors * DMatrix::from_diagonal(&inverse) * eigen.eigenvectors.transpose())
}

/// Dense sums, for what is marginalised.
struct Dense {
    hessian: DMatrix<f64>,
    gradient: DVector<f64>,
}

impl Sums for Dense {
    fn add(&mut self, row: usize, column: usize, value: f64) {
        self.hessian[(row, column)] += value;
    }

    fn add_gradient(&mut self, row: usize, value: f64) {
        self.gradient[row] += value;
    }
}

impl Dense {
    /// The upper half is the lower one.
    fn full(mut self) -> Self {
        self.hessian.fill_upper_triangle_with_lower_triangle();
        self
    }
}
