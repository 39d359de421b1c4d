//! Why an input was not taken. A refusal is a value for the caller to count and show, never a panic.

use super::measurement::Kind;

/// Why a measurement, prior, node or weight was not taken.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// A number is infinite or not a number.
    #[error("{what} is not finite")]
    NotFinite {
        /// Which quantity.
        what: &'static str,
    },
    /// A rotation or a bearing is not of unit length.
    #[error("{what} has length {norm}, not one")]
    NotUnit {
        /// Which quantity.
        what: &'static str,
        /// Its length.
        norm: f64,
    },
    /// A length is below zero.
    #[error("the distance {metres} m is negative")]
    NegativeDistance {
        /// The distance given.
        metres: f64,
    },
    /// A length is beyond anything a vehicle measures.
    #[error("{what} of {metres} m is beyond the limit of {limit_m} m")]
    TooFar {
        /// Which quantity.
        what: &'static str,
        /// The length given.
        metres: f64,
        /// The greatest length taken.
        limit_m: f64,
    },
    /// A standard deviation is zero, negative or not finite.
    #[error("the noise of the {kind} measurement must be a positive finite number")]
    BadNoise {
        /// The kind of measurement.
        kind: Kind,
    },
    /// An information matrix or a weight is not symmetric, not finite or has a negative direction.
    #[error("the weight is not a symmetric positive semidefinite matrix of finite numbers")]
    BadWeight,
    /// A full information matrix belongs to a pose measurement only.
    #[error("a {kind} measurement takes no 6x6 information matrix")]
    WeightOfAnotherKind {
        /// The kind of measurement.
        kind: Kind,
    },
    /// Another measurement of this kind, between the same ends at the same time, excludes this one.
    #[error(
        "contradicts the {kind} already measured on this edge: they differ by {sigmas:.0} standard deviations"
    )]
    Contradicts {
        /// The kind of measurement.
        kind: Kind,
        /// How far apart the two are, in standard deviations of their difference.
        sigmas: f64,
    },
    /// Both ends of an edge are one node.
    #[error("both ends of the measurement are one node")]
    SameNode,
    /// No such neighbour or node.
    #[error("there is no node {index}")]
    UnknownNode {
        /// The index given.
        index: usize,
    },
    /// A limit on nodes or edges is reached.
    #[error("no room for more {what}: the limit is {limit}")]
    Full {
        /// What there are too many of.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
}
