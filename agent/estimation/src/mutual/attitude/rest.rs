//! Whether a vehicle rests: its readings, smoothed over the noise, stay where they were.
//!
//! It looks at changes only, not at the readings themselves: a large bias of the rate is no motion. So a steady turn or a
//! steady acceleration looks like rest; whoever learns from a rest asks besides whether what it would learn can be.

use super::settings::RestSettings;
use super::strapdown::Reading;
use nalgebra::Vector3;

/// Over how long the noise is smoothed away (s).
const SMOOTHED_S: f64 = 0.25;
/// Over how long a reading is remembered (s).
const REMEMBERED_S: f64 = 1.0;

/// Watches the readings of one vehicle.
#[derive(Clone, Debug)]
pub(super) struct Rest {
    smoothed: Reading,
    remembered: Reading,
    /// For how long readings have come (s).
    age_s: f64,
    /// For how long nothing has changed (s).
    still_s: f64,
    /// What was not told yet of that time (s), and how far the vehicle turned in it by its gyro (rad).
    untold_s: f64,
    untold_rad: Vector3<f64>,
}

/// What a rest tells of the rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rested {
    /// Its mean since this was told last, or since the rest began (rad/s).
    pub(super) mean_rate_rad_s: Vector3<f64>,
    /// Over how long (s).
    pub(super) elapsed_s: f64,
}

impl Rest {
    pub(super) fn from(reading: &Reading) -> Self {
        Self {
            smoothed: *reading,
            remembered: *reading,
            age_s: 0.0,
            still_s: 0.0,
            untold_s: 0.0,
            untold_rad: Vector3::zeros(),
        }
    }

    /// Takes one reading, `elapsed_s` after the one before.
    pub(super) fn update(&mut self, settings: &RestSettings, reading: &Reading, elapsed_s: f64) {
        self.age_s += elapsed_s;
        // At first both are plain means: the first reading is no better than those after it.
        follow(
            &mut self.smoothed,
            reading,
            elapsed_s / SMOOTHED_S.min(self.age_s),
        );
        follow(
            &mut self.remembered,
            reading,
            elapsed_s / REMEMBERED_S.min(self.age_s),
        );
        let rate_change = (self.smoothed.rate_rad_s - self.remembered.rate_rad_s).norm();
        let force_change = (self.smoothed.force_m_s2 - self.remembered.force_m_s2).norm();
        if rate_change < settings.rate_change_max_rad_s
            && force_change < settings.force_change_max_m_s2
        {
            self.still_s += elapsed_s;
            self.untold_s += elapsed_s;
            self.untold_rad += reading.rate_rad_s * elapsed_s;
        } else {
            *self = Self {
                still_s: 0.0,
                untold_s: 0.0,
                untold_rad: Vector3::zeros(),
                ..*self
            };
        }
    }

    /// What there is to tell; nothing while the vehicle moves or may have just begun to rest.
    pub(super) fn told(&mut self, settings: &RestSettings) -> Option<Rested> {
        // At the beginning both means are of the same readings, and nothing can be seen to change.
        let may_tell = self.age_s >= REMEMBERED_S + 2.0 * SMOOTHED_S;
        if !may_tell || self.still_s < settings.confirmed_s || self.untold_s <= 0.0 {
            return None;
        }
        let rested = Rested {
            mean_rate_rad_s: self.untold_rad / self.untold_s,
            elapsed_s: self.untold_s,
        };
        self.untold_s = 0.0;
        self.untold_rad = Vector3::zeros();
        Some(rested)
    }
}

fn follow(smoothed: &mut Reading, reading: &Reading, part: f64) {
    let part = part.min(1.0);
    smoothed.rate_rad_s += (reading.rate_rad_s - smoothed.rate_rad_s) * part;
    smoothed.force_m_s2 += (reading.force_m_s2 - smoothed.force_m_s2) * part;
}
