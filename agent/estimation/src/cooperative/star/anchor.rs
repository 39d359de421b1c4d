//! A prior as a pose edge from node 0: residuals `phi = Log(Rhat^T R)` and `t - that`, with a weight for either.

use nalgebra::{Matrix6, Vector3, Vector6};

use crate::cooperative::edge::Node;
use crate::cooperative::mode::AnchorWeight;
use crate::cooperative::refusal::Refusal;
use crate::so3;

/// A prior and how much it counts.
#[derive(Debug, Clone, Copy)]
pub(super) struct Anchor {
    pub(super) prior: Node,
    pub(super) weight: AnchorWeight,
}

impl Anchor {
    pub(super) fn new(prior: Node, weight: AnchorWeight) -> Result<Self, Refusal> {
        if !prior.is_valid() {
            return Err(Refusal::NotFinite { what: "the prior" });
        }
        Ok(Self {
            prior,
            weight: weight.check()?,
        })
    }

    /// Whether any of the prior counts.
    pub(super) fn is_anchored(&self) -> bool {
        self.weight != AnchorWeight::NONE
    }

    fn turn(&self, node: &Node) -> Vector3<f64> {
        so3::log(&(self.prior.rotation.inverse() * node.rotation))
    }

    pub(super) fn cost(&self, node: &Node) -> f64 {
        self.weight.rotation * self.turn(node).norm_squared()
            + self.weight.translation * (node.translation - self.prior.translation).norm_squared()
    }

    /// Half the gradient of the cost.
    pub(super) fn gradient(&self, node: &Node) -> Vector6<f64> {
        let turn = self.weight.rotation * self.turn(node);
        let shift = self.weight.translation * (node.translation - self.prior.translation);
        Vector6::new(turn.x, turn.y, turn.z, shift.x, shift.y, shift.z)
    }

    /// Normal equations and cost. Residuals `phi = Log(Rhat^T R)` and `t - that`.
    pub(super) fn linearise(&self, node: &Node) -> (Matrix6<f64>, Vector6<f64>, f64) {
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
