//! Who told rounds, this vehicle among them, and the two ends of what each of them measured.

use std::collections::VecDeque;

use skein_estimation::cooperative::team::{Moment, Unused};
use skein_estimation::odometry::Gap;
use skein_estimation::time::Stamp;
use skein_estimation::{Body, Sensor, Transform, VehicleId};
use skein_proto::name::Name;

use super::{ROUND_SHARE_MAX, ROUND_SHARE_MIN, ROUNDS_BACK_MAX, Smoothing, Told, share};
use crate::dead_reckoning::{DeadReckoning, motion};
use crate::gathering::AT_THE_INSTANT;
use crate::heard_rounds::HeardRound;
use crate::neighbours::Boot;
use crate::refused::Refused;

/// Somebody who told rounds.
pub(super) struct Teller<'a> {
    pub(super) name: Option<Name>,
    pub(super) id: VehicleId,
    /// None for this vehicle.
    pub(super) boot: Option<&'a Boot>,
    /// Its rounds of late, in order, with their instants on our clock.
    pub(super) rounds: Vec<(Stamp, &'a HeardRound)>,
    pub(super) body_from_target: Transform<Body, Sensor>,
}

/// Why a measurement has no ends.
pub(super) enum NoEnds {
    /// What is missing may still come; if it does not, this is why.
    NotYet(Refused),
    Never(Refused),
}

impl Smoothing {
    /// Everybody who told rounds of late, this vehicle first.
    pub(super) fn tellers<'a>(
        &self,
        told: &Told<'a>,
        own_rounds: &'a VecDeque<HeardRound>,
    ) -> Vec<Teller<'a>> {
        let since = told.round.instant - self.period * ROUNDS_BACK_MAX;
        let until = told.round.instant + share(self.period, ROUND_SHARE_MAX);
        let own = own_rounds.iter().filter_map(|round| {
            let instant = round.instant.on_its_own_clock();
            (instant <= told.round.instant).then_some((instant, round))
        });
        let mut tellers = vec![Teller {
            name: None,
            id: self.me,
            boot: None,
            rounds: own.collect(),
            body_from_target: told.body_from_target,
        }];
        for (name, neighbour) in told.neighbours.iter() {
            let Some(boot) = neighbour.usable() else {
                continue;
            };
            let mut rounds: Vec<(Stamp, &HeardRound)> = Vec::new();
            for round in boot.rounds.iter() {
                let Some(mine) = boot.clock.to_mine(round.instant) else {
                    continue;
                };
                let is_apart = rounds
                    .last()
                    .is_none_or(|(last, _)| mine - *last >= share(self.period, ROUND_SHARE_MIN));
                if round.growth_known && mine >= since && mine <= until && is_apart {
                    rounds.push((mine, round));
                }
            }
            tellers.push(Teller {
                name: Some(name),
                id: VehicleId(name.hash()),
                boot: Some(boot),
                rounds,
                body_from_target: boot.body_from_target,
            });
        }
        tellers
    }
}

impl Teller<'_> {
    pub(super) const fn moment(&self, instant: Stamp, round: &HeardRound) -> Moment {
        Moment {
            vehicle: self.id,
            instant,
            point: round.point,
        }
    }

    /// `body@moment_from_body@taken`.
    pub(super) fn moved(
        &self,
        moment: &Moment,
        taken: Stamp,
        reckoning: &DeadReckoning,
    ) -> Result<Transform<Body, Body>, NoEnds> {
        if (taken - moment.instant).abs() <= AT_THE_INSTANT {
            return Ok(Transform::identity());
        }
        let at = match self.boot {
            None => reckoning.near(taken),
            Some(boot) => {
                let peer = boot.clock.to_peer(taken);
                boot.odometry_at(peer.ok_or(NoEnds::Never(Refused::ClockUnknown))?)
            }
        };
        match at {
            Ok(at) => motion(&moment.point, &at).ok_or(NoEnds::Never(Refused::NoOdometry)),
            Err(Gap::NotYet) => Err(NoEnds::NotYet(Refused::NoOdometry)),
            Err(Gap::Before | Gap::Interrupted) => Err(NoEnds::Never(Refused::NoOdometry)),
        }
    }
}

impl NoEnds {
    pub(super) const fn of(unused: Unused) -> Self {
        match unused {
            Unused::Unlocated => Self::NotYet(Refused::NoPrior),
            Unused::Interrupted => Self::NotYet(Refused::NoOdometry),
            Unused::TooLate => Self::Never(Refused::TooLate),
            Unused::Counted => Self::Never(Refused::Duplicate),
            Unused::LeftOut | Unused::Full => Self::Never(Refused::Full),
            Unused::Quarantined => Self::Never(Refused::Quarantined),
            Unused::SameVehicle => Self::Never(Refused::NotForMe),
            Unused::Unusable => Self::Never(Refused::NoOdometry),
        }
    }

    /// What is counted of a measurement of which nothing comes.
    pub(super) fn refused(self) -> Refused {
        match self {
            Self::NotYet(why) | Self::Never(why) => why,
        }
    }
}
