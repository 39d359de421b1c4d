//! The redescending kernel of Geman and McClure, the scale it judges by, and the disagreement that it judges.
//!
//! A measurement of cost `q` (weighted and squared) costs `q / (1 + s)` and counts `1 / (1 + s)^2`, `s = q / Q`, with `Q`
//! its cost at a disagreement of the scale in every part that it has. For a single residual this is `s = (r/c)^2`. The
//! parts of a pose are judged together: what is grossly wrong in one of them is not believed in the other.

use super::contact::Contact;
use super::measurement::Noise;

/// The part of a measurement's own noise that its scale covers at least.
const NOISE_SIGMAS: f64 = 3.0;

/// The least noise of a fix, as a part of what priors err by: it then counts a hundred times as much as one.
const FIX_NOISE_MIN: f64 = 0.1;

/// The settings of the kernel.
///
/// The scale `c` is the floor times the [`Contact`] with the neighbour: it must cover how far the priors may be apart.
/// With a fixed scale the *correct* measurements are refused after a partition, and the error goes on growing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kernel {
    /// The least scale of an angle, in radians.
    pub rotation_floor_rad: f64,
    /// The least scale of a length, in metres.
    pub translation_floor_m: f64,
    /// By how much of the drift that odometry predicts since the last contact the scale widens.
    pub widening: f64,
    /// By which factor an accepted contact narrows the scale.
    pub narrowing: f64,
}

impl Kernel {
    /// Chosen on section V's scenario flown clean and with gross and moderate outliers, blackout, partition, loss, and
    /// some of these together, and on recordings of real robots, whose odometry drifts far slower. Wider floors and
    /// faster widening let outliers in, narrower and slower ones shut good measurements out after a blackout.
    pub const DEFAULT: Self = Self {
        rotation_floor_rad: 0.1,
        translation_floor_m: 0.2,
        widening: 0.5,
        narrowing: 0.85,
    };

    /// The noise of a fix in units of the floors, which are what priors err by: a fix of a centimetre is not to be pulled
    /// off by a neighbour who has none, and one of two metres must not throw a vehicle about.
    pub(super) fn against_priors(&self, noise: &Noise) -> Noise {
        let compared = |sigma: f64, floor: f64| {
            if sigma > 0.0 {
                (sigma / floor).max(FIX_NOISE_MIN)
            } else {
                sigma
            }
        };
        Noise {
            rotation_rad: compared(noise.rotation_rad, self.rotation_floor_rad),
            translation: compared(noise.translation, self.translation_floor_m),
        }
    }

    /// The scale for a measurement of stated noise (standard deviations in rad and m). Priors and measurement err
    /// independently, so what covers the one and what covers the other add in squares: a coarse sensor is not refused
    /// for its own noise, and a fine one changes nothing.
    #[must_use]
    pub fn scale(&self, contact: Contact, rotation_rad: f64, translation_m: f64) -> Scale {
        let covers = |apart: f64, sigma: f64| apart.hypot(NOISE_SIGMAS * sigma);
        Scale {
            rotation_rad: covers(self.rotation_floor_rad * contact.rotation(), rotation_rad),
            translation_m: covers(
                self.translation_floor_m * contact.translation(),
                translation_m,
            ),
        }
    }
}

/// What a measurement is judged by: a disagreement of this size counts a quarter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Scale {
    /// Of angles, in radians.
    pub rotation_rad: f64,
    /// Of lengths, in metres.
    pub translation_m: f64,
}

/// How far a measurement and two poses are apart: the length of its residual.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Disagreement {
    /// In radians; nothing when the residual has no angle.
    pub rotation_rad: Option<f64>,
    /// In metres; nothing when the residual has no length.
    pub translation_m: Option<f64>,
}

impl Scale {
    pub(super) fn is_valid(&self) -> bool {
        let good = |scale: f64| scale.is_finite() && scale > 0.0;
        good(self.rotation_rad) && good(self.translation_m)
    }

    /// The same as a disagreement in the parts that `apart` has.
    pub(super) fn of_the_parts(&self, apart: &Disagreement) -> Disagreement {
        Disagreement {
            rotation_rad: apart.rotation_rad.map(|_| self.rotation_rad),
            translation_m: apart.translation_m.map(|_| self.translation_m),
        }
    }
}

/// What the kernel makes of a measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Judged {
    /// `q / (1 + s)`.
    pub(super) cost: f64,
    /// `1 / (1 + s)^2`: the derivative of the cost in `q`.
    pub(super) share: f64,
}

impl Judged {
    /// Of a measurement that costs `cost` and would cost `at_scale` at a disagreement of its scale.
    pub(super) fn new(cost: f64, at_scale: f64) -> Self {
        let s = cost / at_scale;
        Self {
            cost: cost / (1.0 + s),
            share: (1.0 + s).powi(-2),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::odometry::Drift;

    #[test]
    fn a_disagreement_of_one_scale_counts_a_quarter_and_of_three_a_hundredth() {
        let one = Judged::new(0.09, 0.09);
        assert!((one.share - 0.25).abs() < 1e-15 && (one.cost - 0.045).abs() < 1e-15);
        let three = Judged::new(0.81, 0.09);
        assert!((three.share - 0.01).abs() < 1e-15 && (three.cost - 0.081).abs() < 1e-15);
        assert_eq!(
            Judged::new(0.0, 0.09),
            Judged {
                cost: 0.0,
                share: 1.0
            }
        );
    }

    #[test]
    fn the_share_is_the_slope_of_the_cost_and_the_cost_never_exceeds_its_bound() {
        for cost in [1e-3, 0.05, 0.25, 1.0, 49.0] {
            let at = |cost| Judged::new(cost, 0.25);
            let slope = (at(cost + 1e-6).cost - at(cost - 1e-6).cost) / 2e-6;
            assert!((slope - at(cost).share).abs() < 1e-8, "{cost}");
            assert!(at(cost).cost < 0.25);
        }
    }

    #[test]
    fn a_scale_covers_the_priors_and_the_noise() {
        let kernel = Kernel {
            rotation_floor_rad: 0.3,
            translation_floor_m: 0.4,
            ..Kernel::DEFAULT
        };
        let scale = kernel.scale(Contact::FRESH, 0.0, 0.1);
        assert!((scale.rotation_rad - 0.3).abs() < 1e-15);
        assert!((scale.translation_m - 0.5).abs() < 1e-15);
        let mut contact = Contact::FRESH;
        let drift = Drift {
            rotation_rad: 0.0,
            translation_m: 3.0,
        };
        contact.widen(drift, 0.0, &kernel);
        let wide = kernel.scale(contact, 0.0, 0.0);
        assert!((wide.translation_m - 0.4 * contact.translation()).abs() < 1e-12);
        assert!((wide.rotation_rad - 0.3).abs() < 1e-12);
    }
}
