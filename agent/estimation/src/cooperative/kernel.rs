//! The redescending kernel of Geman and McClure, the scale it judges by, and the disagreement that it judges.
//!
//! With `s = (r/c)^2` a measurement costs `r^2 / (1 + s)` and counts `1 / (1 + s)^2`, `r` its residual and `c` the
//! scale. Orientation and translation of a pose are judged each by itself.

use super::contact::Contact;

/// The part of a measurement's own noise that its scale covers at least.
const NOISE_SIGMAS: f64 = 3.0;

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
    /// By which part of the floor the scale widens with every round without contact.
    pub widening: f64,
    /// By which factor an accepted contact narrows the scale.
    pub narrowing: f64,
}

impl Kernel {
    /// The best of a study over clean flights, outliers, blackouts and loss.
    pub const DEFAULT: Self = Self {
        rotation_floor_rad: 0.15,
        translation_floor_m: 0.3,
        widening: 0.1,
        narrowing: 0.85,
    };

    /// The scale for a measurement of stated noise (standard deviations in rad and m). Priors and measurement err
    /// independently, so what covers the one and what covers the other add in squares: a coarse sensor is not refused
    /// for its own noise, and a fine one changes nothing.
    #[must_use]
    pub fn scale(&self, contact: Contact, rotation_rad: f64, translation_m: f64) -> Scale {
        let widened =
            |floor: f64, sigma: f64| (floor * contact.factor()).hypot(NOISE_SIGMAS * sigma);
        Scale {
            rotation_rad: widened(self.rotation_floor_rad, rotation_rad),
            translation_m: widened(self.translation_floor_m, translation_m),
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

/// What the kernel leaves of a measurement's two parts; one for a part that it has not.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Shares {
    pub(super) rotation: f64,
    pub(super) translation: f64,
}

impl Shares {
    pub(super) const WHOLE: Self = Self {
        rotation: 1.0,
        translation: 1.0,
    };

    /// Of the part that less is left of.
    pub(super) const fn least(&self) -> f64 {
        self.rotation.min(self.translation)
    }
}

impl Scale {
    pub(super) fn is_valid(&self) -> bool {
        let good = |scale: f64| scale.is_finite() && scale > 0.0;
        good(self.rotation_rad) && good(self.translation_m)
    }

    /// `1 / (1 + s)^2` of either part.
    pub(super) fn shares(&self, disagreement: &Disagreement) -> Shares {
        let share = |apart: Option<f64>, scale: f64| {
            apart.map_or(1.0, |apart| (1.0 + (apart / scale).powi(2)).powi(-2))
        };
        Shares {
            rotation: share(disagreement.rotation_rad, self.rotation_rad),
            translation: share(disagreement.translation_m, self.translation_m),
        }
    }

    /// `r^2 / (1 + s)` of either part, rotation first.
    pub(super) fn costs(&self, disagreement: &Disagreement) -> (f64, f64) {
        let cost = |apart: Option<f64>, scale: f64| {
            apart.map_or(0.0, |apart| apart * apart / (1.0 + (apart / scale).powi(2)))
        };
        (
            cost(disagreement.rotation_rad, self.rotation_rad),
            cost(disagreement.translation_m, self.translation_m),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCALE: Scale = Scale {
        rotation_rad: 0.1,
        translation_m: 0.5,
    };

    #[test]
    fn a_disagreement_of_one_scale_counts_a_quarter_and_of_three_a_hundredth() {
        let apart = Disagreement {
            rotation_rad: Some(0.1),
            translation_m: Some(1.5),
        };
        let shares = SCALE.shares(&apart);
        assert!((shares.rotation - 0.25).abs() < 1e-15);
        assert!((shares.translation - 0.01).abs() < 1e-15);
        // 0.01 / 2 and 2.25 / 10.
        let (rotation, translation) = SCALE.costs(&apart);
        assert!((rotation - 0.005).abs() < 1e-15 && (translation - 0.225).abs() < 1e-15);
    }

    #[test]
    fn what_a_measurement_does_not_say_costs_nothing() {
        let apart = Disagreement {
            rotation_rad: None,
            translation_m: Some(0.0),
        };
        assert_eq!(SCALE.shares(&apart), Shares::WHOLE);
        assert_eq!(SCALE.costs(&apart), (0.0, 0.0));
    }

    #[test]
    fn the_share_is_the_slope_of_the_cost() {
        // d cost / d r = 2 r share.
        for apart in [1e-3, 0.2, 0.5, 1.0, 7.0] {
            let at = |metres: f64| Disagreement {
                rotation_rad: None,
                translation_m: Some(metres),
            };
            let slope =
                (SCALE.costs(&at(apart + 1e-6)).1 - SCALE.costs(&at(apart - 1e-6)).1) / 2e-6;
            let share = SCALE.shares(&at(apart)).translation;
            assert!((slope - 2.0 * apart * share).abs() < 1e-8, "{apart} m");
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
        contact.widen(10.0, &Kernel::DEFAULT);
        let wide = kernel.scale(contact, 0.0, 0.0);
        assert!((wide.translation_m - 0.4 * contact.factor()).abs() < 1e-12);
    }
}
