//! How far what is measured between this vehicle and one neighbour (or by its fixes) is trusted: the contact that widens
//! and narrows the kernel, and the quarantine of a neighbour that goes on disagreeing while others agree.
//!
//! A partition and a liar look alike from one link: both disagree. What tells them apart is the others: a neighbour is
//! only put into quarantine while more of the others agree with this vehicle than disagree.

use skein_estimation::cooperative::{Contact, Disagreement, Kernel};
use skein_estimation::odometry::{Growth, OdometryPoint};
use skein_estimation::time::{Span, Stamp};

/// Rounds in a row in which everything was rejected, after which a neighbour is doubted.
pub(crate) const DOUBTED_AFTER: u32 = 10;
/// Rounds in a row in which a neighbour in quarantine must agree to leave it.
const READMITTED_AFTER: u32 = 5;
/// Others in good contact without whom nobody is put into quarantine.
const WITNESSES_MIN: usize = 2;
/// How long an accepted measurement makes a good contact.
const GOOD_FOR: Span = Span::secs(2);
/// In quarantine the scale widens so much slower: whoever is right in the end comes back, a liar does not soon.
const QUARANTINE_WIDENING: f64 = 0.1;

/// The trust in one neighbour, or in this vehicle's fixes.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Trust {
    contact: Contact,
    /// When the contact was that.
    at: Option<Mark>,
    accepted_at: Option<Stamp>,
    /// Rounds in a row in which everything was rejected.
    rejected: u32,
    quarantine: Option<Quarantine>,
    /// The last disagreement that was rejected.
    pub(crate) last_rejected: Option<Disagreement>,
}

/// An instant, and how far odometry may have drifted until then.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mark {
    pub(crate) instant: Stamp,
    pub(crate) growth: Growth,
}

impl Mark {
    pub(crate) const fn of(point: &OdometryPoint) -> Self {
        Self {
            instant: point.taken,
            growth: point.growth,
        }
    }
}

/// A neighbour's time out of use.
#[derive(Clone, Copy, Debug)]
struct Quarantine {
    agreeing: u32,
}

/// What one round said of one neighbour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Outcome {
    /// Something agreed.
    Agreed,
    /// Everything disagreed; this is the size of the least.
    Disagreed(Disagreement),
    /// Neither.
    Unclear,
}

impl Trust {
    /// The contact at a point of this vehicle's odometry, widened by what both may have drifted since the last accepted
    /// measurement; the neighbour is taken to drift like this vehicle. The first measurement of all is judged as after
    /// silence since `since`, when this vehicle began to have a pose.
    pub(crate) fn contact(
        &self,
        point: &OdometryPoint,
        period: Span,
        since: &Mark,
        kernel: &Kernel,
    ) -> Contact {
        let mut contact = self.contact;
        let mark = self.at.as_ref().unwrap_or(since);
        let silent = point.taken - mark.instant - period;
        if silent <= Span::ZERO {
            return contact;
        }
        let position = &point.odometry_from_body.translation;
        let mut drift = point.growth.drift_since(&mark.growth, position).of_a_pair();
        let mut rounds = silent.as_secs_f64() / period.as_secs_f64();
        if self.is_quarantined() {
            drift = drift.scaled(QUARANTINE_WIDENING);
            rounds *= QUARANTINE_WIDENING;
        }
        contact.widen(drift, rounds, kernel);
        contact
    }

    /// Takes what a round at a point of odometry said, which was judged by `contact`.
    pub(crate) fn judge(
        &mut self,
        mark: Mark,
        contact: Contact,
        outcome: Outcome,
        kernel: &Kernel,
    ) {
        match outcome {
            Outcome::Agreed => {
                self.contact = contact;
                self.contact.accepted(kernel);
                self.at = Some(mark);
                self.accepted_at = Some(mark.instant);
                self.rejected = 0;
                if let Some(quarantine) = &mut self.quarantine {
                    quarantine.agreeing += 1;
                }
            }
            Outcome::Disagreed(disagreement) => {
                self.rejected = self.rejected.saturating_add(1);
                self.last_rejected = Some(disagreement);
                if let Some(quarantine) = &mut self.quarantine {
                    quarantine.agreeing = 0;
                }
            }
            Outcome::Unclear => {}
        }
        if self
            .quarantine
            .is_some_and(|quarantine| quarantine.agreeing >= READMITTED_AFTER)
        {
            self.quarantine = None;
        }
    }

    /// Begins the quarantine of a doubted neighbour if enough others agree with this vehicle: `good` in good contact
    /// against `doubted` that are not. True when it begins now.
    pub(crate) fn quarantine(&mut self, mark: Mark, good: usize, doubted: usize) -> bool {
        let begins =
            !self.is_quarantined() && self.is_doubted() && good >= WITNESSES_MIN && good > doubted;
        if begins {
            self.quarantine = Some(Quarantine { agreeing: 0 });
            // What it was judged by so far followed its own disagreement.
            self.contact = Contact::FRESH;
            self.at = Some(mark);
        }
        begins
    }

    pub(crate) const fn is_quarantined(&self) -> bool {
        self.quarantine.is_some()
    }

    pub(crate) const fn is_doubted(&self) -> bool {
        self.rejected >= DOUBTED_AFTER
    }

    /// Whether something agreed lately.
    pub(crate) fn is_good(&self, now: Stamp) -> bool {
        !self.is_quarantined() && self.accepted_at.is_some_and(|at| now - at <= GOOD_FOR)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector3;
    use skein_estimation::Transform;

    const PERIOD: Span = Span::millis(200);
    const FAR: Outcome = Outcome::Disagreed(Disagreement {
        rotation_rad: None,
        translation_m: Some(9.0),
    });

    fn round(k: i64) -> Stamp {
        Stamp::default() + PERIOD * k
    }

    /// Standing still, of odometry that may turn by 0.02 rad per axis and round.
    fn point(k: i64) -> OdometryPoint {
        let mut growth = Growth::zero();
        for _ in 0..k {
            growth = growth.after(&Vector3::zeros(), 0.02, 0.001);
        }
        OdometryPoint {
            taken: round(k),
            segment: 0,
            odometry_from_body: Transform::identity(),
            growth,
        }
    }

    fn contact(trust: &Trust, k: i64) -> Contact {
        trust.contact(&point(k), PERIOD, &Mark::of(&point(0)), &Kernel::DEFAULT)
    }

    fn factor(trust: &Trust, k: i64) -> f64 {
        contact(trust, k).rotation()
    }

    fn judge(trust: &mut Trust, k: i64, outcome: Outcome) {
        let contact = contact(trust, k);
        trust.judge(Mark::of(&point(k)), contact, outcome, &Kernel::DEFAULT);
    }

    #[test]
    fn every_round_of_silence_widens_and_every_contact_narrows() {
        let mut trust = Trust::default();
        judge(&mut trust, 1, Outcome::Agreed);
        assert!(
            (factor(&trust, 2) - 1.0).abs() < 1e-12,
            "no round was missed"
        );
        // 51 turns of 0.02 rad about three axes, of two vehicles, and fifty rounds.
        let turned = 0.02 * (3.0 * 51.0 * 2.0_f64).sqrt() / Kernel::DEFAULT.rotation_floor_rad;
        let expected = 1.0 + Kernel::DEFAULT.widening * turned + 50.0 * 0.01;
        assert!((factor(&trust, 52) - expected).abs() < 1e-9, "{expected}");
        judge(&mut trust, 52, FAR);
        assert!(
            factor(&trust, 53) > factor(&trust, 52),
            "rejected is no contact"
        );
        let before = factor(&trust, 53);
        judge(&mut trust, 53, Outcome::Agreed);
        assert!((factor(&trust, 54) - before * Kernel::DEFAULT.narrowing).abs() < 1e-9);
    }

    #[test]
    fn a_neighbour_that_goes_on_disagreeing_is_quarantined_by_its_witnesses_and_comes_back_when_it_agrees()
     {
        let mut trust = Trust::default();
        for k in 1..=10 {
            assert!(!trust.quarantine(Mark::of(&point(k)), 3, 1), "round {k}");
            judge(&mut trust, k, FAR);
        }
        assert!(
            !trust.clone().quarantine(Mark::of(&point(10)), 1, 0),
            "one witness is none"
        );
        assert!(
            !trust.clone().quarantine(Mark::of(&point(10)), 2, 2),
            "half against half"
        );
        assert!(trust.quarantine(Mark::of(&point(10)), 3, 1));
        assert!(trust.is_quarantined() && !trust.quarantine(Mark::of(&point(11)), 3, 1));
        let others = Trust {
            at: Some(Mark::of(&point(10))),
            ..Trust::default()
        };
        assert!(factor(&trust, 61) - 1.0 < 0.11 * (factor(&others, 61) - 1.0));
        for k in 61..65 {
            judge(&mut trust, k, Outcome::Agreed);
        }
        judge(&mut trust, 65, FAR);
        for k in 66..71 {
            assert!(trust.is_quarantined(), "round {k}: five in a row");
            judge(&mut trust, k, Outcome::Agreed);
        }
        assert!(!trust.is_quarantined() && trust.is_good(round(71)));
    }
}
