//! The distinct minima of a window, likeliest first.

use super::ambiguity::{Ambiguity, Criterion, Observability};
use super::{RelativePose, Step};
use nalgebra::Matrix4;

/// Most minima that are kept; of more, those of least cost.
pub const MODES_MAX: usize = 8;

/// One place where the neighbour may be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Where.
    pub pose: RelativePose,
    /// How badly it fits: squared residuals over their covariance, plus the logarithm of its determinant.
    pub cost: f64,
    /// Its probability among the modes: their likelihoods times the volumes that they leave open. Weights sum to one.
    pub weight: f64,
    /// Inverse covariance in steps; unit along the height in the plane, where height is no unknown.
    pub(crate) information: Matrix4<f64>,
    pub(crate) planar: bool,
}

/// A standard deviation that an angle of which nothing is known has (rad): that of any angle.
pub(crate) const ANY_ANGLE_RAD: f64 = 1.8;

impl Mode {
    /// Covariance in steps, with nothing less certain than any angle is.
    pub(crate) fn covariance_of_steps(&self) -> Option<Matrix4<f64>> {
        let floor = ANY_ANGLE_RAD.powi(-2);
        let mut information = self.information;
        for i in 1..4 {
            information[(i, i)] += floor;
        }
        information[(0, 0)] += 1e-6;
        let mut covariance = information.cholesky()?.inverse();
        if self.planar {
            covariance[(2, 2)] = 0.0;
        }
        Some(covariance)
    }

    /// Covariance of position and yaw (x, y, z in m, yaw in rad). None when it has none.
    #[must_use]
    pub fn covariance(&self) -> Option<Matrix4<f64>> {
        Some(self.pose.covariance_of(&self.covariance_of_steps()?))
    }

    /// Standard deviation of the position, of all axes together (m); infinite when nothing is known.
    #[must_use]
    pub fn position_sigma_m(&self) -> f64 {
        self.covariance().map_or(f64::INFINITY, |covariance| {
            (covariance[(0, 0)] + covariance[(1, 1)] + covariance[(2, 2)]).sqrt()
        })
    }

    /// The greatest standard deviation of an angle: line of sight or yaw (rad).
    #[must_use]
    pub fn angle_sigma_rad(&self) -> f64 {
        self.covariance_of_steps()
            .map_or(f64::INFINITY, |covariance| {
                let variances = [covariance[(1, 1)], covariance[(2, 2)], covariance[(3, 3)]];
                variances
                    .iter()
                    .fold(0.0, |most: f64, one| most.max(*one))
                    .sqrt()
            })
    }

    /// Whether two are one minimum, reached from two sides: each within a standard deviation of the other.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        let there = self.pose.step_to(&other.pose);
        let near = |information: &Matrix4<f64>, step: &Step| step.dot(&(information * step)) < 1.0;
        near(&self.information, &there) && near(&other.information, &there)
    }

    /// Logarithm of its evidence (Laplace), for any position and any yaw alike before.
    fn log_evidence(&self) -> f64 {
        let volume = self
            .covariance_of_steps()
            .map_or(f64::NEG_INFINITY, |mut covariance| {
                let mut dimensions = 2.0;
                if self.planar {
                    covariance[(2, 2)] = 1.0;
                    dimensions = 1.0;
                }
                0.5 * covariance.determinant().max(f64::MIN_POSITIVE).ln()
                    + dimensions * self.pose.distance_m().max(1e-3).ln()
            });
        volume - 0.5 * self.cost
    }
}

/// Most descents that are ended of those that were begun; of more, those of least cost.
const BEGUN_MAX: usize = 24;

/// Descents that were begun, all at different places. Many starts have joined by then.
#[derive(Clone, Debug, Default)]
pub(super) struct Begun {
    modes: [Option<Mode>; BEGUN_MAX],
    count: usize,
}

impl Begun {
    pub(super) fn modes(&self) -> impl Iterator<Item = &Mode> {
        self.modes.iter().flatten()
    }

    /// Keeps the lower of two at the same place.
    pub(super) fn insert(&mut self, mode: &Mode) {
        let known = &mut self.modes[..self.count];
        let same = known.iter_mut().flatten().find(|one| one.is_same(mode));
        if let Some(same) = same {
            if mode.cost < same.cost {
                *same = *mode;
            }
        } else if self.count < BEGUN_MAX {
            self.modes[self.count] = Some(*mode);
            self.count += 1;
        } else {
            let cost = |one: &Option<Mode>| one.map_or(f64::INFINITY, |one| one.cost);
            let worst = self
                .modes
                .iter_mut()
                .max_by(|a, b| cost(a).total_cmp(&cost(b)));
            if let Some(worst) = worst.filter(|worst| cost(worst) > mode.cost) {
                *worst = Some(*mode);
            }
        }
    }
}

/// The distinct minima of a window.
#[derive(Clone, Copy, Debug)]
pub struct Modes {
    modes: [Option<Mode>; MODES_MAX],
    count: usize,
    /// Ranges that they are of.
    ranges: usize,
    /// Whether more than ranges was known.
    with_prior: bool,
    pub(super) ambiguity: Ambiguity,
}

impl Modes {
    pub(super) const fn none(ranges: usize, with_prior: bool) -> Self {
        Self {
            modes: [None; MODES_MAX],
            count: 0,
            ranges,
            with_prior,
            ambiguity: Ambiguity::Several,
        }
    }

    /// All, least cost first.
    pub fn as_slice(&self) -> impl ExactSizeIterator<Item = &Mode> + Clone {
        // Those before the count are there.
        self.modes[..self.count].iter().map(|mode| match mode {
            Some(mode) => mode,
            None => unreachable!("there are as many modes as are counted"),
        })
    }

    /// How many.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.count
    }

    /// Whether there is none: too few ranges, or hostile ones.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The one of least cost.
    #[must_use]
    pub fn best(&self) -> Option<&Mode> {
        self.modes[..self.count].first()?.as_ref()
    }

    /// How much worse the best other one fits; infinite when there is no other.
    #[must_use]
    pub fn cost_gap(&self) -> f64 {
        let mut costs = self.as_slice().map(|mode| mode.cost);
        match (costs.next(), costs.next()) {
            (Some(best), Some(second)) => second - best,
            _ => f64::INFINITY,
        }
    }

    /// Whether the neighbour's place is known from this window, and when not, what it may be confused with.
    #[must_use]
    pub fn observability(&self, criterion: &Criterion) -> Observability {
        let Some(best) = self.best() else {
            return Observability::Unknown;
        };
        let near = self.as_slice();
        let modes = near
            .filter(|mode| mode.cost - best.cost < criterion.cost_gap)
            .count();
        let spread = best.position_sigma_m() * self.caution() >= criterion.position_sigma_max_m;
        let by_accident = self.ambiguity == Ambiguity::Rotation && !self.with_prior;
        if by_accident || best.angle_sigma_rad() >= criterion.any_angle_rad {
            return Observability::Ambiguous {
                which: Ambiguity::Rotation,
                modes,
            };
        }
        if modes > 1 {
            return Observability::Ambiguous {
                which: self.ambiguity,
                modes,
            };
        }
        // As many ranges as unknowns fit exactly, in up to eight ways of which noise hides some.
        match (self.caution().is_finite(), spread) {
            (false, _) => Observability::Ambiguous {
                which: Ambiguity::Several,
                modes,
            },
            (true, true) => Observability::Imprecise,
            (true, false) => Observability::Observable,
        }
    }

    /// How much smaller a standard deviation must be while few ranges are redundant: a single one cannot tell a place
    /// from one some standard deviations away to which the curve of the cost leads. Without it one accepted window of
    /// four in 140 is wrong by more than 3 m, with it one in 200.
    fn caution(&self) -> f64 {
        let unknown = if self.best().is_some_and(|best| best.planar) {
            3
        } else {
            4
        };
        match self.ranges.saturating_sub(unknown) {
            _ if self.with_prior => 1.0,
            0 => f64::INFINITY,
            redundant => 1.0 + 0.5 / redundant as f64,
        }
    }

    /// Puts a mode where its cost belongs, unless it is there already.
    pub(super) fn insert(&mut self, mode: &Mode) {
        let same = self.as_slice().position(|known| known.is_same(mode));
        if let Some(same) = same {
            if self.modes[same].is_some_and(|known| known.cost <= mode.cost) {
                return;
            }
            self.modes[same..self.count].rotate_left(1);
            self.count -= 1;
        }
        let at = self
            .as_slice()
            .take_while(|known| known.cost <= mode.cost)
            .count();
        if at == MODES_MAX {
            return;
        }
        self.count = (self.count + 1).min(MODES_MAX);
        self.modes[at..self.count].rotate_right(1);
        self.modes[at] = Some(*mode);
    }

    /// Gives every mode its probability.
    pub(super) fn weigh(&mut self) {
        let evidence =
            |mode: &Option<Mode>| mode.as_ref().map_or(f64::NEG_INFINITY, Mode::log_evidence);
        let most = self.modes[..self.count]
            .iter()
            .map(evidence)
            .fold(f64::NEG_INFINITY, f64::max);
        let of_all: f64 = self.modes[..self.count]
            .iter()
            .map(|mode| (evidence(mode) - most).exp())
            .sum();
        for mode in &mut self.modes[..self.count] {
            let share = (evidence(mode) - most).exp() / of_all;
            if let Some(mode) = mode {
                mode.weight = if share.is_finite() { share } else { 0.0 };
            }
        }
    }
}
