//! How well a vehicle keeps in contact with one neighbour, or with its fixes: by how much more than usual their poses
//! may have drifted apart. It is what the kernel's scale is widened by.

use super::kernel::Kernel;
use crate::odometry::Drift;

/// The widest factor: beyond it the floor of 0.2 m has become 40 m, and nothing is refused that could be used.
pub const WIDEST: f64 = 200.0;

/// What every round without contact adds, whatever odometry says of itself: a driver that states too little noise must
/// not shut its neighbours out for good.
const WIDENING_MIN: f64 = 0.01;

/// The widening of the kernel for one neighbour: a factor from 1 (in contact) to [`WIDEST`] for angles, and one for
/// lengths.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    rotation: f64,
    translation: f64,
}

impl Contact {
    /// In contact: the scale is at its floor.
    pub const FRESH: Self = Self {
        rotation: 1.0,
        translation: 1.0,
    };

    /// Out of contact for longer than counts.
    pub const LOST: Self = Self {
        rotation: WIDEST,
        translation: WIDEST,
    };

    /// Lets `rounds` go by without an accepted measurement, in which the two may have drifted apart so far. What is not a
    /// number widens nothing.
    pub fn widen(&mut self, drift: Drift, rounds: f64, kernel: &Kernel) {
        let least = WIDENING_MIN * rounds;
        let widened = |factor: f64, drift: f64, floor: f64| {
            let by = kernel.widening * drift / floor + least;
            if by > 0.0 {
                (factor + by).min(WIDEST)
            } else {
                factor
            }
        };
        self.rotation = widened(self.rotation, drift.rotation_rad, kernel.rotation_floor_rad);
        self.translation = widened(
            self.translation,
            drift.translation_m,
            kernel.translation_floor_m,
        );
    }

    /// A measurement was accepted: what disagreed has been pulled together.
    pub fn accepted(&mut self, kernel: &Kernel) {
        for factor in [&mut self.rotation, &mut self.translation] {
            let narrowed = *factor * kernel.narrowing;
            // What is not a number is not above one.
            *factor = if narrowed > 1.0 {
                narrowed.min(WIDEST)
            } else {
                1.0
            };
        }
    }

    /// By what the kernel's floor of angles is multiplied.
    #[must_use]
    pub const fn rotation(self) -> f64 {
        self.rotation
    }

    /// By what the kernel's floor of lengths is multiplied.
    #[must_use]
    pub const fn translation(self) -> f64 {
        self.translation
    }
}

impl Default for Contact {
    fn default() -> Self {
        Self::FRESH
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const KERNEL: Kernel = Kernel {
        rotation_floor_rad: 0.1,
        translation_floor_m: 0.2,
        widening: 0.5,
        narrowing: 0.5,
    };

    fn drift(rotation_rad: f64, translation_m: f64) -> Drift {
        Drift {
            rotation_rad,
            translation_m,
        }
    }

    #[test]
    fn drift_widens_each_part_by_itself_and_contact_narrows_both() {
        let mut contact = Contact::FRESH;
        contact.widen(drift(0.2, 2.0), 0.0, &KERNEL);
        assert!((contact.rotation() - 2.0).abs() < 1e-12);
        assert!((contact.translation() - 6.0).abs() < 1e-12);
        contact.accepted(&KERNEL);
        assert!((contact.rotation() - 1.0).abs() < 1e-12);
        assert!((contact.translation() - 3.0).abs() < 1e-12);
        contact.accepted(&KERNEL);
        contact.accepted(&KERNEL);
        assert_eq!(contact, Contact::FRESH);
    }

    #[test]
    fn silence_widens_a_little_even_when_odometry_claims_not_to_drift() {
        let mut contact = Contact::FRESH;
        contact.widen(drift(0.0, 0.0), 100.0, &KERNEL);
        assert!((contact.translation() - 2.0).abs() < 1e-12);
    }

    #[test]
    fn the_factors_stay_between_one_and_their_bound_whatever_is_given() {
        let wild = [f64::NAN, f64::INFINITY, -1e300, 1e300, 0.0];
        let check = |contact: Contact| {
            let bounds = 1.0..=WIDEST;
            assert!(bounds.contains(&contact.rotation()), "{contact:?}");
            assert!(bounds.contains(&contact.translation()), "{contact:?}");
        };
        for number in wild {
            for setting in wild {
                let kernel = Kernel {
                    widening: setting,
                    narrowing: setting,
                    ..KERNEL
                };
                let mut contact = Contact::FRESH;
                contact.widen(drift(number, 1.0), number, &kernel);
                check(contact);
                contact.widen(drift(1.0, number), 1.0, &kernel);
                check(contact);
                contact.accepted(&kernel);
                check(contact);
            }
        }
        let mut contact = Contact::FRESH;
        contact.widen(drift(1e9, 1e9), 1.0, &KERNEL);
        assert_eq!(contact, Contact::LOST);
    }
}
