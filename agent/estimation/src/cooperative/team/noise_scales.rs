//! By how much the stated noise is wrong: four factors, found from what is left over after each round.

/// The factors of odometry and of measurements.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct NoiseScales {
    /// Of everybody's odometry.
    pub odometry: ScalePair,
    /// Of everybody's measurements.
    pub measurement: ScalePair,
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
}

/// One factor: the root of the residuals' squares over what was expected of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NoiseScale {
    squares: f64,
    expected: f64,
    /// Of the round at hand.
    pending: (f64, f64),
}

impl NoiseScale {
    /// What the stated noise counts at the start, in residuals.
    const START: f64 = 30.0;
    const FORGETTING: f64 = 0.99;
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
        self.squares = Self::FORGETTING * self.squares + factor * factor * squares;
        self.expected = Self::FORGETTING * self.expected + expected;
    }
}

impl Default for NoiseScale {
    fn default() -> Self {
        Self {
            squares: Self::START,
            expected: Self::START,
            pending: (0.0, 0.0),
        }
    }
}

impl NoiseScales {
    /// Takes what the round has noted.
    pub(super) fn end_round(&mut self) {
        for pair in [&mut self.odometry, &mut self.measurement] {
            pair.rotation.end_round();
            pair.translation.end_round();
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
