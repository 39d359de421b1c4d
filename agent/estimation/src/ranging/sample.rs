//! One range with the odometry of both ends at its time, and what makes it unusable.

use super::pose::{RelativePose, wrapped};
use crate::odometry::Growth;
use crate::time::Stamp;
use nalgebra::Vector3;

/// The greatest range that is believed (m). Ultra-wideband radios reach a few hundred metres.
pub const RANGE_MAX_M: f64 = 1_000.0;
/// The smallest standard deviation of a range that is believed (m); a smaller one is taken for this.
pub const RANGE_SIGMA_MIN_M: f64 = 1e-3;
/// The greatest standard deviation of a range that still says something (m).
pub const RANGE_SIGMA_MAX_M: f64 = 100.0;
/// The farthest from where its odometry began that a vehicle is believed to be (m).
pub const ODOMETRY_MAX_M: f64 = 1e6;

/// A climb of so many standard deviations is one. Three would come about by noise alone in long level flight.
const RISEN_SIGMAS: f64 = 4.0;

/// Cumulative odometry of a vehicle, levelled by gravity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelOdometry {
    /// Rises when odometry was interrupted; across two segments nothing is known.
    pub segment: u8,
    /// Where the vehicle is, in its odometry frame, z up (m).
    pub position_m: Vector3<f64>,
    /// Its heading in the odometry frame (rad).
    pub yaw_rad: f64,
    /// Covariance gathered since odometry began. Of the rotations only those about the vertical count.
    pub growth: Growth,
}

/// A range between a vehicle and one neighbour, with where the odometry of both says they were at its time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RangeSample {
    /// When the range was taken, on the vehicle's own clock.
    pub taken: Stamp,
    /// The range (m).
    pub range_m: f64,
    /// Its standard deviation (m).
    pub sigma_m: f64,
    /// The vehicle's own odometry.
    pub own: LevelOdometry,
    /// The neighbour's odometry.
    pub neighbour: LevelOdometry,
}

/// Why a range was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, thiserror::Error)]
pub enum RangeRefusal {
    /// The range is infinite or not a number.
    #[error("the range is not finite")]
    NotFinite,
    /// The range is zero or below.
    #[error("the range is not positive")]
    NotPositive,
    /// The range is beyond [`RANGE_MAX_M`].
    #[error("the range is beyond the limit of {RANGE_MAX_M} m")]
    TooFar,
    /// The standard deviation is not positive and finite, or beyond [`RANGE_SIGMA_MAX_M`].
    #[error("the standard deviation of the range is absurd")]
    BadSigma,
    /// A number of the odometry is infinite, not a number or absurd, or covariance shrinks.
    #[error("the odometry of the vehicle is absurd")]
    BadOwnOdometry,
    /// The same of the neighbour's.
    #[error("the odometry of the neighbour is absurd")]
    BadNeighbourOdometry,
    /// The range is earlier than the one before. Two of one instant are two: one of each end.
    #[error("time goes back")]
    NotLater,
}

/// How many reasons for refusal there are.
pub const REFUSALS: usize = 7;

impl RangeRefusal {
    /// All, in the order of their numbers.
    pub const ALL: [Self; REFUSALS] = [
        Self::NotFinite,
        Self::NotPositive,
        Self::TooFar,
        Self::BadSigma,
        Self::BadOwnOdometry,
        Self::BadNeighbourOdometry,
        Self::NotLater,
    ];
}

impl RangeSample {
    /// Whether it can be used, given the sample before it of the same two vehicles.
    ///
    /// # Errors
    /// The first [`RangeRefusal`] that applies.
    pub fn check(&self, before: Option<&Self>) -> Result<(), RangeRefusal> {
        if !self.range_m.is_finite() {
            return Err(RangeRefusal::NotFinite);
        }
        if self.range_m <= 0.0 {
            return Err(RangeRefusal::NotPositive);
        }
        if self.range_m > RANGE_MAX_M {
            return Err(RangeRefusal::TooFar);
        }
        if !(self.sigma_m > 0.0 && self.sigma_m <= RANGE_SIGMA_MAX_M) {
            return Err(RangeRefusal::BadSigma);
        }
        if before.is_some_and(|before| self.taken < before.taken) {
            return Err(RangeRefusal::NotLater);
        }
        if !self.own.is_sound(before.map(|one| &one.own)) {
            return Err(RangeRefusal::BadOwnOdometry);
        }
        if !self.neighbour.is_sound(before.map(|one| &one.neighbour)) {
            return Err(RangeRefusal::BadNeighbourOdometry);
        }
        Ok(())
    }

    /// Whether odometry of either end was interrupted between two samples.
    #[must_use]
    pub fn is_continued_by(&self, later: &Self) -> bool {
        self.own.segment == later.own.segment && self.neighbour.segment == later.neighbour.segment
    }

    /// The variance of the range (m^2), with a floor on its standard deviation (m).
    pub(crate) fn variance_m2(&self, floor_m: f64) -> f64 {
        self.sigma_m.max(floor_m).max(RANGE_SIGMA_MIN_M).powi(2)
    }

    /// How far the two vehicles moved since another sample, both together (m).
    pub(crate) fn moved_since_m(&self, earlier: &Self) -> f64 {
        (self.own.position_m - earlier.own.position_m).norm()
            + (self.neighbour.position_m - earlier.neighbour.position_m).norm()
    }

    /// Whether the two have climbed or sunk against each other since another sample by more than the noise of their
    /// odometries makes of it.
    pub(crate) fn has_risen_since(&self, earlier: &Self) -> bool {
        let rise = |now: &LevelOdometry, then: &LevelOdometry| now.position_m.z - then.position_m.z;
        let rise_m = rise(&self.neighbour, &earlier.neighbour) - rise(&self.own, &earlier.own);
        let gathered = |now: &LevelOdometry, then: &LevelOdometry| {
            now.growth.since(&then.growth).translation.max(0.0)
        };
        let variance_m2 =
            gathered(&self.own, &earlier.own) + gathered(&self.neighbour, &earlier.neighbour);
        rise_m.powi(2) > RISEN_SIGMAS.powi(2) * variance_m2
    }
}

impl LevelOdometry {
    fn is_sound(&self, before: Option<&Self>) -> bool {
        let numbers = self.growth.to_numbers();
        let finite = self
            .position_m
            .iter()
            .chain(&numbers)
            .all(|one| one.is_finite())
            && self.yaw_rad.is_finite();
        let near = self.position_m.amax() <= ODOMETRY_MAX_M;
        finite
            && near
            && before.is_none_or(|before| !self.goes_on_from(before) || self.grew(before))
    }

    fn goes_on_from(&self, before: &Self) -> bool {
        self.segment == before.segment
    }

    fn grew(&self, before: &Self) -> bool {
        // What crosses the network as floats may shrink by their rounding.
        let slack = 1e-6;
        let grown = self.growth.since(&before.growth).about(&self.position_m);
        let scale = 1.0 + self.growth.lever_square.amax();
        grown.rotation >= -slack
            && grown.translation >= -slack
            && (0..3).all(|i| grown.lever_square[(i, i)] >= -slack * scale)
    }

    /// Another pose of the same odometry, seen from this one.
    pub(crate) fn sees(&self, other: &Self) -> RelativePose {
        let difference = other.position_m - self.position_m;
        RelativePose::new(
            super::pose::turned(&difference, -self.yaw_rad),
            wrapped(other.yaw_rad - self.yaw_rad),
        )
    }
}
