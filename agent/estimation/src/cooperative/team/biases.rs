//! The biases of one vehicle's odometry: what they are taken for, and when that is narrowed or widened.

use nalgebra::Vector4;

use super::settings::{BiasNoise, BiasRange};

/// Rounds after which a bias that has room is expected to stay within what is then known of it.
const SETTLING_ROUNDS: u32 = 50;

/// Three of the gyroscope (rad/s) and one of the odometer's scale, as they are added to what odometry says.
#[derive(Clone, Debug)]
pub(super) struct Biases {
    pub(super) value: Vector4<f64>,
    gyro: Expected,
    scale: Expected,
    /// Bearings and orientations alone would only take the scale for what it is not.
    has_met_a_length: bool,
}

/// Where a bias is expected.
#[derive(Clone, Debug)]
struct Expected {
    centre: Vector4<f64>,
    /// None while it has room.
    variance: Option<f64>,
    /// Rounds since it was given room.
    rounds: u32,
}

/// What becomes of one kind of bias.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Fate {
    /// It stays as it is.
    #[default]
    Unchanged,
    /// It gets room.
    Room,
    /// It is held at none.
    Held,
}

/// What becomes of the two kinds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Fates {
    pub(super) gyro: Fate,
    pub(super) scale: Fate,
}

impl Biases {
    pub(super) fn new(noise: &BiasNoise) -> Self {
        Self {
            value: Vector4::zeros(),
            gyro: Expected::at_start(&noise.gyro),
            scale: Expected::at_start(&noise.scale),
            has_met_a_length: false,
        }
    }

    /// What follows from a round of so many seconds, after which the biases have these variances.
    pub(super) fn judge(
        &mut self,
        variances: &Vector4<f64>,
        noise: &BiasNoise,
        seconds: f64,
    ) -> Fates {
        let value = self.value;
        let judge = |expected: &mut Expected, range: &BiasRange, rows| {
            expected.judge(&value, variances, rows, range, noise, seconds)
        };
        Fates {
            gyro: judge(&mut self.gyro, &noise.gyro, 0..3),
            scale: judge(&mut self.scale, &noise.scale, 3..4),
        }
    }
}

impl Biases {
    /// Something measured lengths: the scale gets room, once. True when it is now.
    pub(super) fn meet_a_length(&mut self) -> bool {
        let first = !self.has_met_a_length;
        if first {
            self.has_met_a_length = true;
            self.scale.variance = None;
            self.scale.rounds = 0;
        }
        first
    }
}

impl Expected {
    fn at_start(range: &BiasRange) -> Self {
        let is_narrow = range.start <= range.held;
        Self {
            centre: Vector4::zeros(),
            variance: is_narrow.then_some(range.start * range.start),
            rounds: 0,
        }
    }

    fn judge(
        &mut self,
        value: &Vector4<f64>,
        variances: &Vector4<f64>,
        rows: std::ops::Range<usize>,
        range: &BiasRange,
        noise: &BiasNoise,
        seconds: f64,
    ) -> Fate {
        let rows = || rows.clone();
        if let Some(variance) = &mut self.variance {
            *variance += range.walk * range.walk * seconds;
            let beyond = noise.room_beyond * noise.room_beyond * *variance;
            let apart = value - self.centre;
            if rows().any(|row| apart[row] * apart[row] > beyond) {
                self.variance = None;
                self.rounds = 0;
                return Fate::Room;
            }
            return Fate::Unchanged;
        }
        self.rounds += 1;
        // The likelihood of none over that of anything within the room: a narrow estimate near none speaks for none.
        let is_none = |row: usize| {
            let sigmas = value[row] * value[row] / variances[row];
            range.room / variances[row].sqrt() * (-0.5 * sigmas).exp() > noise.none_beyond
        };
        if rows().all(is_none) {
            self.centre = Vector4::zeros();
            self.variance = Some(range.held * range.held);
            return Fate::Held;
        }
        if self.rounds > SETTLING_ROUNDS {
            let widest = rows()
                .map(|row| variances[row])
                .fold(range.held * range.held, f64::max);
            self.centre = *value;
            self.variance = Some(widest);
        }
        Fate::Unchanged
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cooperative::team::Settings;

    const NOISE: BiasNoise = Settings::DEFAULT.bias;

    fn judge(biases: &mut Biases, sigma: f64) -> Fates {
        let variances = Vector4::repeat(sigma * sigma);
        biases.judge(&variances, &NOISE, 0.2)
    }

    #[test]
    fn a_scale_is_held_at_none_as_soon_as_the_measurements_show_none() {
        let mut biases = Biases::new(&NOISE);
        assert!(biases.meet_a_length() && !biases.meet_a_length());
        biases.value[3] = 0.001;
        assert_eq!(
            judge(&mut biases, 0.011).scale,
            Fate::Unchanged,
            "who knows?"
        );
        biases.value[3] = 0.02;
        assert_eq!(
            judge(&mut biases, 0.005).scale,
            Fate::Unchanged,
            "four sigmas are something"
        );
        biases.value[3] = 0.001;
        assert_eq!(judge(&mut biases, 0.005).scale, Fate::Held);
        assert_eq!(
            judge(&mut biases, 0.0003).scale,
            Fate::Room,
            "it has left its range"
        );
    }

    #[test]
    fn a_bias_that_leaves_its_range_gets_room_once_and_is_watched_again_when_it_has_settled() {
        let mut biases = Biases::new(&NOISE);
        biases.value[0] = 2.9 * NOISE.gyro.start;
        assert_eq!(judge(&mut biases, 1e-4).gyro, Fate::Unchanged);
        biases.value[0] = 0.02;
        assert_eq!(judge(&mut biases, 1e-4).gyro, Fate::Room);
        for _ in 0..=SETTLING_ROUNDS + 1 {
            assert_eq!(judge(&mut biases, 1e-4).gyro, Fate::Unchanged);
        }
        biases.value[0] = 0.0;
        assert_eq!(judge(&mut biases, 1e-4).gyro, Fate::Room, "it has changed");
    }
}
