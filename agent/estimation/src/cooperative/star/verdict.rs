//! What became of one measurement in a star: accepted or rejected, with the size of its disagreement and the scale that
//! it was judged by.

use super::{StarEdge, StarWorkspace, Tie};
use crate::cooperative::edge::{Edge, Node};
use crate::cooperative::kernel::{Disagreement, Scale};
use crate::cooperative::measurement::Kind;

/// A measurement that counts this much or more was accepted: it disagrees by its scale at most.
pub const ACCEPTED_FROM: f64 = 0.25;

/// A measurement that counts less than this was rejected: it disagrees by 1.5 times its scale or more.
pub const REJECTED_BELOW: f64 = 0.1;

/// What became of one edge.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Verdict {
    /// The neighbour and direction, or a fix.
    pub tie: Tie,
    /// The kind of measurement.
    pub kind: Kind,
    /// What the kernel left of its weight, 0 to 1.
    pub weight: f64,
    /// How far it is from the solution.
    pub disagreement: Disagreement,
    /// What it was judged by; nothing without a kernel, which accepts everything.
    pub scale: Option<Scale>,
}

/// A verdict in one word.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Judgement {
    /// It agrees, and was contact.
    Accepted,
    /// Neither: it still pulls, but says nothing about contact.
    Doubtful,
    /// It counts next to nothing.
    Rejected,
}

impl Verdict {
    /// The judgement at the solution in `workspace`; nothing when that belongs to another star.
    pub(super) fn of(edge: &StarEdge, workspace: &StarWorkspace) -> Option<Self> {
        let (from, to) = workspace.ends(edge.tie)?;
        Some(Self {
            tie: edge.tie,
            kind: edge.edge.measurement().kind(),
            weight: edge
                .scale
                .map_or(1.0, |scale| edge.edge.judged(&scale, &from, &to).share),
            disagreement: edge.edge.disagreement(&from, &to),
            scale: edge.scale,
        })
    }

    /// Accepted, rejected, or neither.
    #[must_use]
    pub const fn judgement(&self) -> Judgement {
        judgement(self.weight)
    }
}

impl Edge {
    /// What a measurement outside any star would be found by a scale, were its nodes these.
    #[must_use]
    pub fn judge(&self, scale: &Scale, from: &Node, to: &Node) -> Judgement {
        judgement(self.judged(scale, from, to).share)
    }
}

/// What is no number was not accepted.
pub(super) const fn judgement(weight: f64) -> Judgement {
    if weight >= ACCEPTED_FROM {
        Judgement::Accepted
    } else if weight >= REJECTED_BELOW {
        Judgement::Doubtful
    } else {
        Judgement::Rejected
    }
}
