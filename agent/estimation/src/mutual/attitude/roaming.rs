//! How far a vehicle comes and goes, learnt from where its reckoning says it is: the noise of "it is still where it was".
//!
//! A vehicle that goes farther than believed must not be held back by it, so the belief widens fast and narrows slowly.

use super::settings::RoamingSettings;
use nalgebra::Vector2;

/// The belief.
#[derive(Clone, Debug)]
pub(super) struct Roaming {
    /// Variance of each axis of the place (m^2).
    variance_m2: f64,
}

impl Roaming {
    pub(super) fn new(settings: &RoamingSettings) -> Self {
        Self {
            variance_m2: settings.first_m.powi(2),
        }
    }

    /// Takes the reckoned place and gives the spectral density of the place (m^2/Hz).
    pub(super) fn density(
        &mut self,
        settings: &RoamingSettings,
        place_m: &Vector2<f64>,
        elapsed_s: f64,
    ) -> f64 {
        let seen_m2 = 0.5 * place_m.norm_squared();
        let in_s = if seen_m2 > self.variance_m2 {
            settings.widened_in_s
        } else {
            settings.narrowed_in_s
        };
        self.variance_m2 += (seen_m2 - self.variance_m2) * (elapsed_s / in_s).min(1.0);
        self.variance_m2 = self
            .variance_m2
            .clamp(settings.least_m.powi(2), settings.most_m.powi(2));
        2.0 * settings.back_in_s * self.variance_m2
    }
}
