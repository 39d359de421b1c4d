//! A few ranges with the odometry of both ends: what they say of where the neighbour is now (Cornejo & Nagpal,
//! Algorithm 1 with noise).
//!
//! ```text
//! samples ─> geometry ─> starts: closed forms, scan, grid ─> descent, ranges apart ─> distinct minima
//!                                              ─> descent, odometry errors shared ─> modes ─> observable?
//! ```
//! With `u_j`, `v_j` where the two were at range `j`, each in its own newest frame, the neighbour at `p` with yaw `psi`
//! has `d_j = |p + R(psi) v_j - u_j|` (paper eq. 2).

mod ambiguity;
mod descent;
mod geometry;
mod modes;
mod starts;

#[cfg(test)]
mod tests;

pub use ambiguity::{Ambiguity, Criterion, Observability};
pub use modes::{MODES_MAX, Mode, Modes};

use modes::Begun;

use super::pose::{Dimension, RelativePose, Step};
use super::sample::{RangeRefusal, RangeSample};
use descent::Model;
use geometry::Geometry;
use nalgebra::Matrix4;

/// Fewest ranges in a window that is solved.
pub const WINDOW_MIN: usize = 3;
/// Most ranges in a window.
pub const WINDOW_MAX: usize = 9;
/// Most iterations of one descent.
pub const ITERATIONS_MAX: usize = 40;
/// Most bearings, and most yaws, of a [`Starts::Grid`].
pub const GRID_SIDE_MAX: usize = 18;

/// What is known of a neighbour besides ranges: a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prior {
    /// Its mean, at the time of the newest range.
    pub(crate) pose: RelativePose,
    /// Its inverse covariance in steps.
    pub(crate) information: Matrix4<f64>,
}

impl Prior {
    /// From standard deviations: of the distance (m), of the line of sight (rad) and of the yaw (rad). None unless they
    /// are positive and all is finite.
    #[must_use]
    pub fn new(pose: RelativePose, distance_m: f64, across_rad: f64, yaw_rad: f64) -> Option<Self> {
        let sigmas = [distance_m, across_rad, across_rad, yaw_rad];
        let sound = sigmas.iter().all(|sigma| sigma.is_finite() && *sigma > 0.0)
            && pose.position_m.iter().all(|number| number.is_finite())
            && pose.yaw_rad.is_finite();
        sound.then(|| Self {
            pose,
            information: Matrix4::from_diagonal(&Step::from(sigmas.map(|s| 1.0 / (s * s)))),
        })
    }
}

/// How a range that does not fit counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loss {
    /// In full: its square.
    Square,
    /// Hardly at all (Geman-McClure): not every range is in line of sight.
    Redescending {
        /// At so many standard deviations a range has a quarter of its weight.
        sigmas: f64,
    },
}

/// Where descents begin.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Starts<'a> {
    /// Everywhere that matters: closed forms from triples (in space quadruples) of ranges, a scan over the yaw, a grid.
    Exhaustive,
    /// At these poses, at most [`MODES_MAX`] of them: where the neighbour is believed to be.
    Tracked(&'a [RelativePose]),
    /// At a regular grid of so many bearings and so many yaws, at most [`GRID_SIDE_MAX`] each, at the newest range (in
    /// space at three elevations each). Every start is followed to its end, by itself and with full weights from the
    /// first step on: slow, and what [`Starts::Exhaustive`] is measured against.
    Grid(usize),
}

/// How a window is solved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WindowSettings {
    /// In the plane or in space.
    pub dimension: Dimension,
    /// What counts for outliers.
    pub loss: Loss,
    /// The smallest standard deviation that a range is taken to have (m).
    pub sigma_floor_m: f64,
}

impl WindowSettings {
    /// In the plane, all ranges in line of sight.
    pub const PLANAR: Self = Self {
        dimension: Dimension::Planar,
        loss: Loss::Square,
        sigma_floor_m: 0.0,
    };
    /// In space with levelled attitudes, all ranges in line of sight.
    pub const SPATIAL: Self = Self {
        dimension: Dimension::Spatial,
        ..Self::PLANAR
    };
    /// Some ranges are not in line of sight.
    #[must_use]
    pub const fn robust(self) -> Self {
        Self {
            loss: Loss::Redescending { sigmas: 3.0 },
            ..self
        }
    }
}

/// Why two places both fit, as far as the motions in a window say.
pub(crate) fn resemblance(window: &Window, best: &RelativePose, other: &RelativePose) -> Ambiguity {
    let geometry = Geometry::of(window.samples(), &WindowSettings::SPATIAL);
    ambiguity::of_places(&geometry, best, other)
}

/// The last few ranges to one neighbour.
#[derive(Clone, Debug, Default)]
pub struct Window {
    /// Oldest first.
    samples: [Option<RangeSample>; WINDOW_MAX],
    length: usize,
}

impl Window {
    /// No ranges.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// How many ranges it holds.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.length
    }

    /// Whether it holds none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// The samples, oldest first.
    pub fn samples(&self) -> impl DoubleEndedIterator<Item = &RangeSample> + Clone {
        self.samples[..self.length].iter().flatten()
    }

    /// The newest sample.
    #[must_use]
    pub fn newest(&self) -> Option<&RangeSample> {
        self.samples().next_back()
    }

    /// Forgets everything.
    pub const fn clear(&mut self) {
        self.length = 0;
    }

    /// Adds a range; of more than [`WINDOW_MAX`] the oldest goes. After an interruption of odometry it begins anew.
    ///
    /// # Errors
    /// Why the range was refused; the window is as it was.
    pub fn push(&mut self, sample: &RangeSample) -> Result<(), RangeRefusal> {
        let newest = self.newest().copied();
        sample.check(newest.as_ref())?;
        if newest.is_some_and(|newest| !newest.is_continued_by(sample)) {
            self.clear();
        }
        if self.length == WINDOW_MAX {
            self.samples.rotate_left(1);
            self.length -= 1;
        }
        self.samples[self.length] = Some(*sample);
        self.length += 1;
        Ok(())
    }

    /// Adds a range unless the two have moved less than so far (m), both together, since the newest. Returns whether it was
    /// added.
    ///
    /// # Errors
    /// Why the range was refused; the window is as it was.
    pub fn push_apart(&mut self, sample: &RangeSample, apart_m: f64) -> Result<bool, RangeRefusal> {
        let newest = self.newest();
        let is_apart = newest.is_none_or(|newest| newest.moved_since_m(sample) >= apart_m);
        if is_apart {
            self.push(sample)?;
        }
        Ok(is_apart)
    }

    /// Keeps only the newest so many.
    pub fn keep_newest(&mut self, count: usize) {
        let surplus = self.length.saturating_sub(count);
        self.samples.rotate_left(surplus);
        self.length -= surplus;
    }

    /// All distinct minima that the starts lead to, likeliest first; none when there are fewer than [`WINDOW_MIN`]
    /// ranges. Its work is bounded whatever the ranges are.
    #[must_use]
    pub fn solve(
        &self,
        settings: &WindowSettings,
        starts: Starts<'_>,
        prior: Option<&Prior>,
    ) -> Modes {
        let mut modes = Modes::none(self.length, prior.is_some());
        if self.length < WINDOW_MIN {
            return modes;
        }
        let geometry = Geometry::of(self.samples(), settings);
        let model = Model {
            geometry: &geometry,
            settings,
            prior,
        };
        let mut begun = Begun::default();
        let mut apart = Modes::none(self.length, prior.is_some());
        let mut set_out = |start: &RelativePose| {
            if let Some(mode) = model.set_out(start) {
                begun.insert(&mode);
            }
        };
        if let Some(prior) = prior {
            set_out(&prior.pose);
        }
        match starts {
            Starts::Exhaustive => starts::exhaustive(&geometry, settings, &mut set_out),
            Starts::Grid(side) => {
                let side = side.min(GRID_SIDE_MAX);
                starts::grid(&geometry, settings, side, &mut |start| {
                    if let Some(mode) = model.descend_apart(start) {
                        apart.insert(&mode);
                    }
                    if let Some(mode) = model.descend_together(start) {
                        modes.insert(&mode);
                    }
                });
            }
            Starts::Tracked(poses) => poses.iter().take(MODES_MAX).for_each(&mut set_out),
        }
        for mode in begun.modes() {
            if let Some(mode) = model.descend_apart(&mode.pose) {
                apart.insert(&mode);
            }
        }
        for rough in apart.as_slice() {
            if let Some(mode) = model.descend_together(&rough.pose) {
                modes.insert(&mode);
            }
        }
        modes.ambiguity = ambiguity::between(&geometry, &modes);
        modes.weigh();
        modes
    }
}
