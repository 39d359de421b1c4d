//! How well a vehicle keeps in contact with one neighbour, or with its fixes: by how much more than usual their poses
//! may have drifted apart. It is the factor by which the kernel's scale is widened.
//!
//! It is kept for each neighbour by itself: a vehicle in contact with its own half of a team that was split would else
//! refuse the other half's correct measurements when they meet again.

use super::kernel::Kernel;

/// The widest factor: the default floor of 0.2 m has then become 40 m.
pub const WIDEST: f64 = 200.0;

/// The widening of the kernel for one neighbour, from 1 (in contact) to [`WIDEST`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    factor: f64,
}

impl Contact {
    /// In contact: the scale is at its floor.
    pub const FRESH: Self = Self { factor: 1.0 };

    /// Out of contact for longer than counts.
    pub const LOST: Self = Self { factor: WIDEST };

    /// Lets `rounds` go by without an accepted measurement. Time that runs back or is not a number widens nothing.
    pub fn widen(&mut self, rounds: f64, kernel: &Kernel) {
        let by = kernel.widening * rounds;
        if by > 0.0 {
            self.factor = (self.factor + by).min(WIDEST);
        }
    }

    /// A measurement was accepted: what disagreed has been pulled together.
    pub fn accepted(&mut self, kernel: &Kernel) {
        let narrowed = self.factor * kernel.narrowing;
        // What is not a number is not above one.
        self.factor = if narrowed > 1.0 {
            narrowed.min(WIDEST)
        } else {
            1.0
        };
    }

    /// By what the floor of the kernel is multiplied.
    #[must_use]
    pub const fn factor(self) -> f64 {
        self.factor
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
        widening: 0.1,
        narrowing: 0.5,
        ..Kernel::DEFAULT
    };

    #[test]
    fn fifty_rounds_of_silence_widen_sixfold_and_contact_narrows_again() {
        let mut contact = Contact::FRESH;
        contact.widen(50.0, &KERNEL);
        assert!((contact.factor() - 6.0).abs() < 1e-12);
        contact.accepted(&KERNEL);
        assert!((contact.factor() - 3.0).abs() < 1e-12);
        for _ in 0..3 {
            contact.accepted(&KERNEL);
        }
        assert_eq!(contact, Contact::FRESH);
    }

    #[test]
    fn silence_round_by_round_is_silence_at_once() {
        let (mut often, mut once) = (Contact::FRESH, Contact::FRESH);
        (0..40).for_each(|_| often.widen(0.25, &KERNEL));
        once.widen(10.0, &KERNEL);
        assert!((often.factor() - once.factor()).abs() < 1e-12);
    }

    #[test]
    fn the_factor_stays_between_one_and_its_bound_whatever_is_given() {
        let wild = [f64::NAN, f64::INFINITY, -1e300, 1e300, 0.0];
        for rounds in wild {
            for setting in wild {
                let kernel = Kernel {
                    widening: setting,
                    narrowing: setting,
                    ..KERNEL
                };
                let mut contact = Contact::FRESH;
                contact.widen(rounds, &kernel);
                assert!((1.0..=WIDEST).contains(&contact.factor()));
                contact.accepted(&kernel);
                assert!((1.0..=WIDEST).contains(&contact.factor()));
            }
        }
        let mut contact = Contact::FRESH;
        contact.widen(1e9, &KERNEL);
        assert_eq!(contact, Contact::LOST);
        contact.widen(1.0, &KERNEL);
        assert_eq!(contact, Contact::LOST);
    }
}
