//! How two robots have moved in a round, each in its own words, and what that does to where the one has the other.

use super::{Relative, wrapped};
use nalgebra::{Rotation2, Vector2};

/// No robot of a swarm hears another from so far (m).
const FAR_M: f64 = 1e5;

/// One robot's odometry of a round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Turtle {
    /// In its frame before the round (x ahead, y to the left), metres.
    pub translation_m: Vector2<f64>,
    /// Counter-clockwise, radians.
    pub rotation_rad: f64,
}

/// Both robots' odometry of a round.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PairMotion {
    /// Of the robot that estimates.
    pub own: Turtle,
    /// Of the neighbour.
    pub theirs: Turtle,
}

/// Standard deviations of what is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Noise {
    /// Of a distance, metres. Less than 5 cm counts as 5 cm.
    pub range_sigma_m: f64,
    /// Of a translation of a robot that has moved, per axis, metres.
    pub translation_sigma_m: f64,
    /// Of its rotation, radians.
    pub rotation_sigma_rad: f64,
}

/// Why a round was not taken.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum Refusal {
    /// A number is infinite or not a number.
    #[error("{what} is not finite")]
    NotFinite {
        /// Which quantity.
        what: &'static str,
    },
    /// A distance is below zero.
    #[error("the distance {metres} m is negative")]
    NegativeDistance {
        /// The distance given.
        metres: f64,
    },
    /// A length is beyond anything a robot measures.
    #[error("{what} of {metres} m is absurd")]
    TooFar {
        /// Which quantity.
        what: &'static str,
        /// The length given.
        metres: f64,
    },
}

impl Turtle {
    /// It has stood still.
    pub const STILL: Self = Self {
        translation_m: Vector2::new(0.0, 0.0),
        rotation_rad: 0.0,
    };

    /// Whether it has moved or turned at all.
    #[must_use]
    pub fn is_still(&self) -> bool {
        *self == Self::STILL
    }
}

impl PairMotion {
    /// Where the neighbour is after the motion if it was there before: `p' = R(-w)(p + R(phi) t_b - t_a)`.
    #[must_use]
    pub fn carried(&self, at: &Relative) -> Relative {
        let moved_m = at.position_m
            + Rotation2::new(at.orientation_rad) * self.theirs.translation_m
            - self.own.translation_m;
        let turned_rad = self.theirs.rotation_rad - self.own.rotation_rad;
        Relative {
            position_m: Rotation2::new(-self.own.rotation_rad) * moved_m,
            orientation_rad: wrapped(at.orientation_rad + turned_rad),
        }
    }

    pub(super) fn translation_m(&self) -> f64 {
        (self.own.translation_m.norm()).max(self.theirs.translation_m.norm())
    }

    pub(super) fn check(&self) -> Result<(), Refusal> {
        for one in [&self.own, &self.theirs] {
            check_length("a translation", one.translation_m.norm())?;
            if !one.rotation_rad.is_finite() {
                let what = "a rotation";
                return Err(Refusal::NotFinite { what });
            }
        }
        Ok(())
    }
}

pub(super) fn check_length(what: &'static str, metres: f64) -> Result<(), Refusal> {
    if !metres.is_finite() {
        Err(Refusal::NotFinite { what })
    } else if metres > FAR_M {
        Err(Refusal::TooFar { what, metres })
    } else {
        Ok(())
    }
}

pub(super) fn check_range(range_m: f64) -> Result<(), Refusal> {
    if range_m < 0.0 {
        return Err(Refusal::NegativeDistance { metres: range_m });
    }
    check_length("a distance", range_m)
}
