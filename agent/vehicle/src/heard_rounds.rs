//! The raw rounds that one boot of a neighbour told, by its own instants, and where it was told to be. No estimate of it,
//! and nothing of ours: whoever smooths the whole team begins here.

use std::collections::BTreeMap;

use skein_estimation::odometry::{Growth, OdometryPoint};
use skein_estimation::time::Span;
use skein_proto::anchor::Anchor;
use skein_proto::fixed::Fixed;
use skein_proto::record::{Addressed, Round};

use crate::clock::PeerStamp;
use crate::refused::Refused;
use crate::told_pose::ToldPose;
use crate::translate;

/// Rounds kept of one boot: 50 s of them at the default period.
pub(crate) const HEARD_ROUNDS_MAX: usize = 256;
/// Instants closer than this are one: a record says its period to the microsecond, so that of a period which is no whole
/// number of them the repeated rounds come out a little off.
const SAME_INSTANT: Span = Span::micros(10);

/// One round, as its vehicle told it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct HeardRound {
    /// On the neighbour's clock.
    pub(crate) instant: PeerStamp,
    /// Its odometry at that instant, on its clock.
    pub(crate) point: OdometryPoint,
    /// Whether it said how far its odometry may be off; if not, the growth of `point` is zero.
    pub(crate) growth_known: bool,
    /// What it measured of others, this vehicle among them.
    pub(crate) measured: Vec<Addressed>,
    /// What it knows of itself in the world.
    pub(crate) fixes: Vec<Fixed>,
    /// Whether somebody else repeated it: such a round is not repeated again.
    pub(crate) relayed: bool,
}

/// Where a neighbour was told to be, tied to its odometry.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct HeardAnchor {
    /// Its odometry at that time, on its clock.
    pub(crate) point: OdometryPoint,
    /// As in [`HeardRound`].
    pub(crate) growth_known: bool,
    pub(crate) told: ToldPose,
}

/// The newest rounds of one boot, and its newest anchor.
#[derive(Clone, Debug, Default)]
pub(crate) struct HeardRounds {
    rounds: BTreeMap<PeerStamp, HeardRound>,
    anchor: Option<HeardAnchor>,
}

impl HeardRound {
    pub(crate) fn new(
        instant: PeerStamp,
        round: &Round,
        fixes: Vec<Fixed>,
    ) -> Result<Self, Refused> {
        Ok(Self {
            instant,
            point: translate::odometry_point(round, instant.on_its_own_clock())?,
            growth_known: translate::growth(&round.growth).is_some(),
            measured: round.measured.clone(),
            fixes,
            relayed: false,
        })
    }

    /// As its teller said it.
    pub(crate) fn to_wire(&self) -> Round {
        Round {
            back: 0,
            segment: self.point.segment,
            odometry_from_body: self.point.odometry_from_body.to_numbers(),
            growth: growth_to_wire(&self.point.growth, self.growth_known),
            measured: self.measured.clone(),
        }
    }
}

/// A growth as its teller said it.
fn growth_to_wire(growth: &Growth, is_known: bool) -> skein_proto::growth::Growth {
    if is_known {
        translate::growth_to_wire(growth)
    } else {
        skein_proto::growth::Growth::Unknown
    }
}

impl HeardAnchor {
    pub(crate) fn new(anchor: &Anchor) -> Result<Self, Refused> {
        let growth = translate::growth(&anchor.growth);
        Ok(Self {
            point: OdometryPoint {
                taken: PeerStamp::from_nanos(anchor.taken_ns).on_its_own_clock(),
                segment: anchor.segment,
                odometry_from_body: translate::transform(&anchor.odometry_from_body)?,
                growth: growth.unwrap_or_else(Growth::zero),
            },
            growth_known: growth.is_some(),
            told: ToldPose {
                world_from_body: translate::transform(&anchor.world_from_body)?,
                rotation_sigma_rad: f64::from(anchor.rotation_sigma_rad),
                translation_sigma_m: f64::from(anchor.translation_sigma_m),
            },
        })
    }
}

impl HeardAnchor {
    /// As its teller said it.
    pub(crate) fn to_wire(self) -> Anchor {
        Anchor {
            growth: growth_to_wire(&self.point.growth, self.growth_known),
            ..crate::anchor::Anchor::of(self.point, self.told).to_wire()
        }
    }
}

impl HeardRounds {
    /// Keeps a round. The first word on an instant stands: a round that is known changes nothing. Where there is no room
    /// the oldest makes some. Returns whether it was kept.
    pub(crate) fn insert(&mut self, round: HeardRound) -> bool {
        if self.knows(round.instant) {
            return false;
        }
        let instant = round.instant;
        self.rounds.insert(instant, round);
        if self.rounds.len() > HEARD_ROUNDS_MAX {
            self.rounds.pop_first();
        }
        self.rounds.contains_key(&instant)
    }

    /// Whether the round of an instant is kept.
    pub(crate) fn knows(&self, instant: PeerStamp) -> bool {
        let around = instant.plus(-SAME_INSTANT)..=instant.plus(SAME_INSTANT);
        self.rounds.range(around).next().is_some()
    }

    /// The newest one.
    pub(crate) fn newest(&self) -> Option<&HeardRound> {
        self.rounds.last_key_value().map(|(_, round)| round)
    }

    /// In order of their instants.
    pub(crate) fn iter(&self) -> impl DoubleEndedIterator<Item = &HeardRound> {
        self.rounds.values()
    }

    /// Takes where the vehicle was told to be; what it was told later counts.
    pub(crate) fn tell(&mut self, anchor: HeardAnchor) {
        if self
            .anchor
            .is_none_or(|known| known.point.taken < anchor.point.taken)
        {
            self.anchor = Some(anchor);
        }
    }

    /// Where it was told to be last.
    pub(crate) const fn anchor(&self) -> Option<&HeardAnchor> {
        self.anchor.as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skein_estimation::Transform;
    use skein_estimation::time::Stamp;

    fn instant(micros: i64) -> PeerStamp {
        PeerStamp::from_nanos(micros * 1_000)
    }

    /// A round in which odometry says so many metres.
    fn round(micros: i64, metres: f64) -> HeardRound {
        HeardRound {
            instant: instant(micros),
            point: point(micros, metres),
            growth_known: true,
            measured: Vec::new(),
            fixes: Vec::new(),
            relayed: false,
        }
    }

    fn point(micros: i64, metres: f64) -> OdometryPoint {
        let mut odometry_from_body = Transform::identity();
        odometry_from_body.translation.x = metres;
        OdometryPoint {
            taken: Stamp::default() + Span::micros(micros),
            segment: 0,
            odometry_from_body,
            growth: Growth::zero(),
        }
    }

    #[test]
    fn the_first_word_on_an_instant_stands_however_its_period_was_rounded() {
        let mut heard = HeardRounds::default();
        assert!(heard.insert(round(400_000, 2.0)));
        assert!(heard.insert(round(200_000, 1.0)));
        assert!(!heard.insert(round(200_000, 99.0)));
        assert!(!heard.insert(round(400_003, 99.0)));
        let kept: Vec<&HeardRound> = heard.iter().collect();
        assert_eq!(kept, [&round(200_000, 1.0), &round(400_000, 2.0)]);
    }

    #[test]
    fn the_oldest_make_room() {
        let mut heard = HeardRounds::default();
        for nth in 1..=HEARD_ROUNDS_MAX as i64 + 10 {
            assert!(heard.insert(round(nth * 200_000, 0.0)));
        }
        assert_eq!(heard.iter().count(), HEARD_ROUNDS_MAX);
        assert_eq!(heard.iter().next().unwrap().instant, instant(11 * 200_000));
        assert!(
            !heard.insert(round(200_000, 0.0)),
            "older than all that is kept"
        );
        assert_eq!(heard.iter().count(), HEARD_ROUNDS_MAX);
    }

    #[test]
    fn an_anchor_gives_way_to_a_later_one_only() {
        let anchor = |micros, metres| HeardAnchor {
            point: point(micros, metres),
            growth_known: true,
            told: ToldPose::exact(Transform::identity()),
        };
        let mut heard = HeardRounds::default();
        heard.tell(anchor(5, 1.0));
        heard.tell(anchor(5, 2.0));
        heard.tell(anchor(4, 3.0));
        assert_eq!(heard.anchor(), Some(&anchor(5, 1.0)));
        heard.tell(anchor(6, 4.0));
        assert_eq!(heard.anchor(), Some(&anchor(6, 4.0)));
    }
}
