//! All pairs of a team at once: ranges between any two of them, with the odometry of all. What one pair leaves open, a
//! third robot decides.
//!
//! ```text
//! ranges by pair ─> windows ─> modes ─> formations, robot by robot, the best few kept ─> descent of all poses ─> placed
//! ```

mod formation;
mod search;

use super::bank::Place;
use super::pose::{Dimension, RelativePose};
use super::sample::{LevelOdometry, RangeRefusal, RangeSample};
use super::window::{Criterion, WindowSettings};
use nalgebra::Matrix4;

/// Most robots in a team, the vehicle itself counted.
pub const ROBOTS_MAX: usize = 8;
/// Most ranges of one pair; of more, the newest.
pub const RANGES_PER_PAIR_MAX: usize = super::window::WINDOW_MAX;
/// Most formations that are kept from one robot to the next.
pub const FORMATIONS_MAX: usize = 24;
/// Most formations in the answer.
pub const ANSWERS_MAX: usize = 6;

/// The squared residuals of a formation that fits exceed their number by no more than so many standard deviations.
const FITS_SIGMAS: f64 = 5.0;

/// Ranges heard within a team. Robot 0 is the vehicle itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Team {
    /// Where each robot is now, by its own odometry.
    now: Vec<LevelOdometry>,
    /// By pair, first the robot of the lower number; own is that one's. Oldest first.
    pairs: Vec<Vec<RangeSample>>,
}

/// Why a range of a team was not taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TeamRefusal {
    /// The range itself is at fault.
    #[error(transparent)]
    Range(#[from] RangeRefusal),
    /// No such two robots.
    #[error("there is no pair of robots {from} and {to}")]
    NoSuchPair {
        /// Whose range.
        from: usize,
        /// To whom.
        to: usize,
    },
    /// Its odometry is of another segment than the robot's is now.
    #[error("odometry was interrupted since the range was taken")]
    Interrupted,
}

/// One robot of a formation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Placed {
    /// Where it is, in the level frame of robot 0.
    pub pose: RelativePose,
    /// Covariance of position and yaw (x, y, z in m, yaw in rad).
    pub covariance: Matrix4<f64>,
    /// How much worse the best formation fits in which this robot is elsewhere; infinite when there is none.
    pub cost_gap: f64,
}

impl Placed {
    /// Where the robot is when both, robot 0 and it, have gone on by their odometries from where those had them when the
    /// team was solved. None across an interruption, when numbers fail, and where this is not the only place or not known
    /// well enough.
    #[must_use]
    pub fn carried(
        &self,
        then: [&LevelOdometry; 2],
        now: [&LevelOdometry; 2],
        dimension: Dimension,
        criterion: &Criterion,
    ) -> Option<Place> {
        if self.cost_gap < criterion.cost_gap {
            return None;
        }
        let placed = Place {
            pose: self.pose,
            weight: 1.0,
            covariance: self.covariance,
            angle_sigma_rad: 0.0,
        };
        let place = placed.carried(then, now, dimension)?;
        let is_known = place.position_sigma_m() < criterion.position_sigma_max_m
            && place.angle_sigma_rad < criterion.any_angle_rad;
        is_known.then_some(place)
    }
}

/// Where all are at once.
#[derive(Clone, Debug, PartialEq)]
pub struct Formation {
    /// By robot, from number one on. None where the ranges do not lead.
    pub placed: Vec<Option<Placed>>,
    /// Squared residuals over their covariance, plus the logarithm of its determinant.
    pub cost: f64,
    /// The squared residuals over their covariance alone.
    pub square: f64,
    /// Ranges between robots that are placed.
    pub ranges: usize,
}

impl Formation {
    /// Whether the ranges are what noise alone makes of this formation. If those of the best are not, one of them was not
    /// in line of sight, or what somebody tells is wrong.
    #[must_use]
    pub fn fits(&self) -> bool {
        let ranges = self.ranges as f64;
        self.square <= ranges + FITS_SIGMAS * (2.0 * ranges).sqrt()
    }
}

impl Team {
    /// A team of which only the odometries are known; of more than [`ROBOTS_MAX`], the first.
    #[must_use]
    pub fn new(now: &[LevelOdometry]) -> Self {
        let now = now[..now.len().min(ROBOTS_MAX)].to_vec();
        let pairs = vec![Vec::new(); now.len() * now.len().saturating_sub(1) / 2];
        Self { now, pairs }
    }

    /// Takes a range of a pair, which must be later than the last one of the same pair.
    ///
    /// # Errors
    /// Why not.
    pub fn push(
        &mut self,
        from: usize,
        to: usize,
        sample: &RangeSample,
    ) -> Result<(), TeamRefusal> {
        let count = self.now.len();
        if from == to || from >= count || to >= count {
            return Err(TeamRefusal::NoSuchPair { from, to });
        }
        let sample = if from < to {
            *sample
        } else {
            RangeSample {
                own: sample.neighbour,
                neighbour: sample.own,
                ..*sample
            }
        };
        let (low, high) = (from.min(to), from.max(to));
        let (own, neighbour) = (&self.now[low], &self.now[high]);
        if sample.own.segment != own.segment || sample.neighbour.segment != neighbour.segment {
            return Err(TeamRefusal::Interrupted);
        }
        let pair = &mut self.pairs[pair_index(low, high)];
        sample.check(pair.last())?;
        // The odometry of now must go on from that of then.
        RangeSample {
            taken: sample.taken + crate::Span::from_nanos(1),
            own: *own,
            neighbour: *neighbour,
            ..sample
        }
        .check(Some(&sample))?;
        if pair.len() == RANGES_PER_PAIR_MAX {
            pair.remove(0);
        }
        pair.push(sample);
        Ok(())
    }

    /// The formations that fit best, best first, at most [`ANSWERS_MAX`]; none when no robot has enough ranges.
    /// Its work is bounded: three robots take some milliseconds, eight some hundreds.
    #[must_use]
    pub fn solve(&self, settings: &WindowSettings) -> Vec<Formation> {
        let formations = search::formations(self, settings);
        formation::answers(self, settings, &formations)
    }

    pub(self) fn pair(&self, low: usize, high: usize) -> &[RangeSample] {
        &self.pairs[pair_index(low, high)]
    }
}

/// Of two robots, the lower number first.
fn pair_index(low: usize, high: usize) -> usize {
    high * (high - 1) / 2 + low
}

#[cfg(test)]
mod tests;
