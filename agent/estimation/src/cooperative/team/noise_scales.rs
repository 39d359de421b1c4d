//! By how much the stated noise is wrong: four factors, found from what is left over after each round, and how much less
//! than expected there is of innovations.

/// The factors of odometry and of measurements.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct NoiseScales {
    /// Of everybody's odometry.
    pub odometry: ScalePair,
    /// Of everybody's measurements.
    pub measurement: ScalePair,
    pub(super) innovations: Innovations,
}

/// A factor of rotation noise and one of translation noise.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ScalePair {
    pub(super) rotation: NoiseScale,
    pub(super) translation: NoiseScale,
}

impl ScalePair {
    /// How many times the stated standard deviation of angles.
    #[must_use]
    pub fn rotation(&self) -> f64 {
        self.rotation.factor()
    }

    /// How many times the stated standard deviation of lengths.
    #[must_use]
    pub fn translation(&self) -> f64 {
        self.translation.factor()
    }

    /// That of a single vehicle, which forgets sooner.
    pub(super) fn of_one() -> Self {
        let scale = NoiseScale {
            forgetting: NoiseScale::FORGETTING_OF_ONE,
            ..NoiseScale::default()
        };
        Self {
            rotation: scale,
            translation: scale,
        }
    }

    /// Takes what the round has noted.
    pub(super) fn end_round(&mut self) {
        self.rotation.end_round();
        self.translation.end_round();
    }
}

/// How large innovations are beside what was expected of them, axis by axis of whoever measures: angles, then lengths.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Innovations {
    rows: [Innovation; 6],
}

/// Squares of an axis over their expected variance, and how many, with forgetting.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Innovation {
    squares: f64,
    count: f64,
    /// Of the round at hand.
    pending: (f64, f64),
}

impl Innovations {
    /// Innovations without which an axis says nothing.
    const COUNT_MIN: f64 = 10.0;
    /// Errors that go together in time leave innovations that are smaller than they are: so much is added to what is
    /// seen, before a covariance is told smaller than the stated noise makes it.
    const CAUTION: f64 = 1.25;
    /// The least share of a variance that is told.
    const LEAST: f64 = 0.01;

    /// A square over its expected variance on one axis, and for how many degrees of freedom it stands.
    pub(super) fn note(&mut self, row: usize, square: f64, degrees_of_freedom: f64) {
        if square.is_finite() && degrees_of_freedom > 0.0 {
            let pending = &mut self.rows[row].pending;
            pending.0 += square * degrees_of_freedom;
            pending.1 += degrees_of_freedom;
        }
    }

    fn end_round(&mut self) {
        for row in &mut self.rows {
            let (squares, count) = std::mem::take(&mut row.pending);
            if count > 0.0 {
                row.squares = NoiseScale::FORGETTING * row.squares + squares;
                row.count = NoiseScale::FORGETTING * row.count + count;
            }
        }
    }

    /// The share of variances that is told: one, unless innovations are smaller than expected on every axis.
    fn told(&self) -> f64 {
        let heard = self.rows.iter().filter(|row| row.count > Self::COUNT_MIN);
        let share =
            |row: &Innovation| (NoiseScale::START + row.squares) / (NoiseScale::START + row.count);
        let largest = heard.map(share).max_by(f64::total_cmp).unwrap_or(1.0);
        (Self::CAUTION * largest).clamp(Self::LEAST, 1.0)
    }
}

/// One factor: the root of the residuals' squares over what was expected of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NoiseScale {
    squares: f64,
    expected: f64,
    forgetting: f64,
    /// Of the round at hand.
    pending: (f64, f64),
}

impl NoiseScale {
    /// What the stated noise counts at the start, in residuals.
    const START: f64 = 30.0;
    const FORGETTING: f64 = 0.99;
    const FORGETTING_OF_ONE: f64 = 0.98;
    /// Nobody is more precise than it says. Errors that go together in time leave residuals that look as if it were: of
    /// real robots, to believe that doubles the error.
    const LEAST: f64 = 1.0;
    const MOST: f64 = 10.0;

    fn factor(&self) -> f64 {
        (self.squares / self.expected)
            .sqrt()
            .clamp(Self::LEAST, Self::MOST)
    }

    /// Residuals of unit variance by the present factor: the sum of their squares, and what it should be.
    pub(super) fn note(&mut self, squares: f64, expected: f64) {
        if squares.is_finite() && expected.is_finite() && expected > 0.0 {
            self.pending.0 += squares;
            self.pending.1 += expected;
        }
    }

    fn end_round(&mut self) {
        let (squares, expected) = std::mem::take(&mut self.pending);
        if expected <= 0.0 {
            return;
        }
        let factor = self.factor();
        self.squares = self.forgetting * self.squares + factor * factor * squares;
        self.expected = self.forgetting * self.expected + expected;
    }
}

impl Default for NoiseScale {
    fn default() -> Self {
        Self {
            squares: Self::START,
            expected: Self::START,
            forgetting: Self::FORGETTING,
            pending: (0.0, 0.0),
        }
    }
}

impl NoiseScales {
    /// The share of the variances of an estimate that is told of it, not above one. As only the ratios of noises decide
    /// where an estimate is, noise that all is stated too large changes nothing but what the estimate says of itself: there
    /// it is taken back, and not in the weights, where errors that go together in time would do harm.
    #[must_use]
    pub fn told_share(&self) -> f64 {
        self.innovations.told()
    }

    /// Takes what the round has noted.
    pub(super) fn end_round(&mut self) {
        self.innovations.end_round();
        for pair in [&mut self.odometry, &mut self.measurement] {
            pair.end_round();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn residuals_twice_as_large_as_stated_double_the_factor() {
        let mut scales = NoiseScales::default();
        for _ in 0..1000 {
            let stated = scales.measurement.translation();
            let residual = 2.0 / stated;
            scales
                .measurement
                .translation
                .note(3.0 * residual * residual, 3.0);
            scales.end_round();
        }
        assert!((scales.measurement.translation() - 2.0).abs() < 1e-3);
        assert!(
            (scales.measurement.rotation() - 1.0).abs() < 1e-12,
            "of its own"
        );
    }

    #[test]
    fn less_is_told_when_innovations_are_small_on_every_axis_that_is_measured() {
        let mut scales = NoiseScales::default();
        let mut note = |first: f64, second: f64| {
            for _ in 0..1000 {
                scales.innovations.note(0, first, 3.0);
                scales.innovations.note(4, second, 3.0);
                scales.innovations.note(5, f64::NAN, 3.0);
                scales.end_round();
            }
            scales.told_share()
        };
        assert_eq!(note(0.25, 1.0), 1.0, "one axis is as it should be");
        assert_eq!(note(0.8, 0.8), 1.0, "hardly small");
        assert_eq!(
            note(4.0, 4.0),
            1.0,
            "never more: that is what the factors are for"
        );
        let quarter = note(0.25, 0.2);
        assert!((quarter - 0.40).abs() < 0.01, "{quarter}");
    }

    #[test]
    fn nothing_drives_a_factor_out_of_its_range() {
        let mut scale = NoiseScale::default();
        for _ in 0..1000 {
            scale.note(1e30, 1.0);
            scale.end_round();
            scale.note(f64::NAN, 1.0);
            scale.end_round();
        }
        assert!(scale.factor() <= NoiseScale::MOST);
    }
}
