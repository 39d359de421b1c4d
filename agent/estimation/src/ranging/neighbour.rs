//! One neighbour as a daemon feeds it: ranges as they come, with both odometries at their times.
//!
//! ```text
//! range ─> check ─> [none yet] window of places far enough apart ─> modes ─> bank
//!                └> bank ─> explained? ─> places ─> status
//!                                └> all refuted: begin anew, and count
//! ```

use super::bank::{Bank, BankSettings, Explained, HYPOTHESES_MAX, Place, moments};
use super::pose::{Dimension, RelativePose};
use super::sample::{LevelOdometry, REFUSALS, RangeRefusal, RangeSample};
use super::window::{
    Ambiguity, Criterion, Modes, Observability, Starts, Window, WindowSettings, resemblance,
};
use nalgebra::Matrix4;

/// So many refuted banks, less one for every [`FORGIVEN_AFTER`] explained ranges, and the neighbour's odometry (or the
/// vehicle's own) is not what its ranges say.
pub const REFUTED_MAX: u32 = 3;
/// So many explained ranges make up for one refuted bank.
pub const FORGIVEN_AFTER: u32 = 30;

/// How a neighbour is followed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NeighbourSettings {
    /// How windows are solved.
    pub window: WindowSettings,
    /// How the bank works.
    pub bank: BankSettings,
    /// Fewest ranges from which a bank starts, at least four; five in space. From four the modes are so broad that the
    /// filters' linearisation tells (NEES 1.25 per dimension, section V's noise); from six hardly (1.06).
    pub start_ranges: usize,
    /// The two have to move so far, both together, from one range of a window to the next (m). Nearer ranges say little
    /// of what is sought and much of their own noise.
    pub apart_m: f64,
    /// When a place counts as known.
    pub criterion: Criterion,
}

impl NeighbourSettings {
    /// In the plane, for ranges that come many times in a metre.
    pub const PLANAR: Self = Self {
        window: WindowSettings::PLANAR,
        bank: BankSettings::PLANAR,
        start_ranges: 6,
        apart_m: 1.0,
        criterion: Criterion::DEFAULT,
    };
    /// In space with levelled attitudes.
    pub const SPATIAL: Self = Self {
        window: WindowSettings::SPATIAL,
        bank: BankSettings::SPATIAL,
        start_ranges: 6,
        ..Self::PLANAR
    };
}

/// What a range did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// It went into a window, or was passed over because nothing had moved: no place is followed yet.
    Gathered,
    /// Places are followed from now on.
    Started,
    /// It fits a place.
    Explained,
    /// It fits none: not in line of sight.
    Unexplained,
    /// It fits none, nor did many before: all places are given up.
    Refuted,
}

/// Where a neighbour is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Estimate {
    /// Whether that is known.
    pub observability: Observability,
    /// The likeliest place, in the vehicle's level frame, with its own covariance. None when nothing is known.
    pub best: Option<Place>,
    /// Mean of all places, and covariance about it (x, y, z in m, yaw in rad).
    pub all: Option<(RelativePose, Matrix4<f64>)>,
    /// All places, likeliest first.
    pub places: [Option<Place>; HYPOTHESES_MAX],
    /// The neighbour's odometry, or the vehicle's own, is not what its ranges say.
    pub is_disagreeing: bool,
}

/// How often what happened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Ranges refused, in the order of [`RangeRefusal::ALL`].
    pub refused: [u64; REFUSALS],
    /// Ranges taken.
    pub taken: u64,
    /// Ranges that fit no place.
    pub unexplained: u64,
    /// Banks refuted by their ranges.
    pub refuted: u64,
    /// Interruptions of odometry.
    pub interrupted: u64,
}

/// A neighbour that is followed by its ranges.
#[derive(Clone, Debug)]
pub struct Neighbour {
    settings: NeighbourSettings,
    window: Window,
    /// What the window said last, while there is no bank.
    modes: Option<Modes>,
    bank: Option<Bank>,
    last: Option<RangeSample>,
    /// The oldest sample that went into the bank, as long as neither end has climbed since.
    level_since: Option<RangeSample>,
    refuted: u32,
    explained: u32,
    counters: Counters,
}

impl Neighbour {
    /// One of which nothing is known.
    #[must_use]
    pub fn new(settings: NeighbourSettings) -> Self {
        Self {
            settings,
            window: Window::new(),
            modes: None,
            bank: None,
            last: None,
            level_since: None,
            refuted: 0,
            explained: 0,
            counters: Counters::default(),
        }
    }

    /// Takes a range.
    ///
    /// # Errors
    /// Why it was refused, which is counted; nothing else changes.
    pub fn handle(&mut self, sample: &RangeSample) -> Result<Taken, RangeRefusal> {
        if let Err(refusal) = sample.check(self.last.as_ref()) {
            self.counters.refused[refusal as usize] += 1;
            return Err(refusal);
        }
        self.counters.taken += 1;
        if self.last.is_some_and(|last| !last.is_continued_by(sample)) {
            self.counters.interrupted += 1;
            self.begin_anew();
        }
        self.last = Some(*sample);
        let far = self.window.push_apart(sample, self.settings.apart_m)?;
        Ok(match &mut self.bank {
            Some(bank) => {
                let explained = bank.update(sample);
                let refuted = bank.is_refuted();
                let is_level = |since: &RangeSample| !sample.has_risen_since(since);
                self.level_since = self.level_since.filter(is_level);
                self.keep_images();
                self.count(explained, refuted)
            }
            None if far => self.start(sample),
            None => Taken::Gathered,
        })
    }

    fn count(&mut self, explained: Explained, refuted: bool) -> Taken {
        if refuted {
            self.counters.unexplained += 1;
            self.counters.refuted += 1;
            self.refuted = (self.refuted + 1).min(2 * REFUTED_MAX);
            self.explained = 0;
            self.begin_anew();
            return Taken::Refuted;
        }
        if explained == Explained::No {
            self.counters.unexplained += 1;
            return Taken::Unexplained;
        }
        self.explained += 1;
        if self.explained >= FORGIVEN_AFTER {
            self.explained = 0;
            self.refuted = self.refuted.saturating_sub(1);
        }
        Taken::Explained
    }

    /// In space what keeps its height may as well be below as above, until one of the two climbs.
    fn keep_images(&mut self) {
        if self.dimension() == Dimension::Spatial
            && self.level_since.is_some()
            && let Some(bank) = &mut self.bank
        {
            bank.keep_below();
        }
    }

    fn begin_anew(&mut self) {
        self.level_since = None;
        self.bank = None;
        self.modes = None;
        self.window.clear();
    }

    /// Starts a bank if the window says enough: with an angle entirely open there is nothing to linearise about.
    fn start(&mut self, sample: &RangeSample) -> Taken {
        if self.window.len() < self.settings.start_ranges {
            return Taken::Gathered;
        }
        let modes = self
            .window
            .solve(&self.settings.window, Starts::Exhaustive, None);
        let open = modes
            .best()
            .is_none_or(|best| best.angle_sigma_rad() >= self.settings.criterion.any_angle_rad);
        self.modes = Some(modes);
        if !open {
            self.bank = Bank::started(self.settings.bank, &modes, sample);
            let oldest = self.window.samples().next();
            let is_level = |oldest: &&RangeSample| {
                let mut samples = self.window.samples();
                !samples.any(|sample| sample.has_risen_since(oldest))
            };
            self.level_since = oldest.filter(is_level).copied();
            self.keep_images();
        }
        if self.bank.is_some() {
            Taken::Started
        } else {
            Taken::Gathered
        }
    }

    /// Where the neighbour is, at the last range.
    #[must_use]
    pub fn estimate(&self) -> Estimate {
        match &self.bank {
            Some(bank) => self.estimate_of(bank.places()),
            None => self.estimate_of(std::iter::empty()),
        }
    }

    /// Where the neighbour is when both have got so far by their odometry, which must be of the segments of the last
    /// range; otherwise nothing is known.
    #[must_use]
    pub fn estimate_at(&self, own: &LevelOdometry, neighbour: &LevelOdometry) -> Estimate {
        let later = self.last.map(|last| RangeSample {
            own: *own,
            neighbour: *neighbour,
            ..last
        });
        match (&self.bank, self.last, later) {
            (Some(bank), Some(last), Some(later)) if last.is_continued_by(&later) => {
                self.estimate_of(bank.places_at(own, neighbour))
            }
            _ => self.estimate_of(std::iter::empty()),
        }
    }

    fn estimate_of(&self, found: impl Iterator<Item = Place> + Clone) -> Estimate {
        let mut places = [None; HYPOTHESES_MAX];
        for (place, one) in places.iter_mut().zip(found.clone()) {
            *place = Some(one);
        }
        Estimate {
            observability: self.observability(&places),
            best: places[0],
            all: moments(found),
            places,
            is_disagreeing: self.refuted >= REFUTED_MAX,
        }
    }

    fn observability(&self, places: &[Option<Place>; HYPOTHESES_MAX]) -> Observability {
        let criterion = &self.settings.criterion;
        let Some(best) = places[0] else {
            return self.modes.map_or(Observability::Unknown, |modes| {
                modes.observability(criterion)
            });
        };
        // A gap of costs is twice that of the logarithms of weights.
        let alike = best.weight * (-0.5 * criterion.cost_gap).exp();
        let modes = places
            .iter()
            .flatten()
            .filter(|one| one.weight > alike)
            .count();
        let spread = best.position_sigma_m() >= criterion.position_sigma_max_m;
        if best.angle_sigma_rad >= criterion.any_angle_rad {
            return Observability::Ambiguous {
                which: Ambiguity::Rotation,
                modes,
            };
        }
        if modes > 1 {
            let which = places[1].map_or(Ambiguity::Several, |other| {
                resemblance(&self.window, &best.pose, &other.pose)
            });
            return Observability::Ambiguous { which, modes };
        }
        if spread {
            Observability::Imprecise
        } else {
            Observability::Observable
        }
    }

    /// The last ranges that were far enough apart, followed or not.
    #[must_use]
    pub const fn window(&self) -> &Window {
        &self.window
    }

    /// How often what happened.
    #[must_use]
    pub const fn counters(&self) -> &Counters {
        &self.counters
    }

    /// In the plane or in space.
    #[must_use]
    pub const fn dimension(&self) -> Dimension {
        self.settings.window.dimension
    }
}

#[cfg(test)]
mod tests;
