//! Rounds for those who are out of their tellers' reach: which ones this vehicle repeats, and what is made of those that
//! others repeat. One hop: what came from a relay is never repeated again.
//!
//! Two vehicles that do not hear each other exchange no echoes, so a relay says beside each round what it knows of the
//! teller's clock; with what is known of the relay's own clock that tells the teller's, and the errors add up. Nor can a
//! relay prove that a teller is alive: it is taken at its word, as it is for nothing else, and only while its teller
//! itself is not heard.

use std::collections::BTreeMap;

use skein_estimation::time::{Span, Stamp};
use skein_proto::name::Name;
use skein_proto::relay::RelayedRound;
use skein_proto::status::Status;

use crate::clock::{PeerClock, PeerStamp};
use crate::heard_rounds::{HeardAnchor, HeardRound};
use crate::hearing::{AHEAD_MAX, CONTENT_AGE_MAX};
use crate::neighbours::{Boot, Neighbour, Neighbours};
use crate::refused::Refused;
use crate::translate;

/// Rounds of others that are repeated in one round; beyond, they take turns.
const RELAYED_PER_ROUND_MAX: usize = 8;
/// Rounds of one vehicle that are repeated in one round: instants of two vehicles drift past each other.
const OF_ONE_MAX: usize = 2;
/// In one of so many rounds of a vehicle its anchor is repeated, too.
const ANCHOR_EVERY: u64 = 5;
/// Of its periods, for which a vehicle that was heard itself is not listened to through others: as many as packets may be
/// lost before something is missing, as records repeat the rounds before.
const HEARD_FOR_PERIODS: i64 = 3;

/// What this vehicle has repeated.
#[derive(Clone, Debug, Default)]
pub(crate) struct Relaying {
    said: BTreeMap<Name, Said>,
    /// Who comes first next.
    turn: usize,
}

/// The newest round of a boot that was repeated, and how many of it so far.
#[derive(Clone, Copy, Debug)]
struct Said {
    boot: u64,
    newest: PeerStamp,
    rounds: u64,
}

impl Relaying {
    /// What others told since the last round, to be repeated.
    pub(crate) fn rounds(&mut self, now: Stamp, neighbours: &Neighbours) -> Vec<RelayedRound> {
        self.said.retain(|name, _| neighbours.get(*name).is_some());
        let heard: Vec<(Name, &Boot)> = neighbours
            .iter()
            .filter(|(_, neighbour)| !neighbour.is_duplicated())
            .filter_map(|(name, neighbour)| Some((name, neighbour.usable()?)))
            .filter(|(_, boot)| is_heard(boot, now))
            .collect();
        let mut relayed = Vec::new();
        let first = self.turn;
        for nth in 0..heard.len() {
            let (name, boot) = heard[(first + nth) % heard.len()];
            self.turn = (first + nth + 1) % heard.len();
            let room = RELAYED_PER_ROUND_MAX - relayed.len();
            relayed.extend(self.rounds_of(now, name, boot, room.min(OF_ONE_MAX)));
            if relayed.len() == RELAYED_PER_ROUND_MAX {
                break;
            }
        }
        relayed
    }

    fn rounds_of(&mut self, now: Stamp, of: Name, boot: &Boot, most: usize) -> Vec<RelayedRound> {
        let (Some(offset), Some(error)) = (boot.clock.offset(), boot.clock.error_bound(now)) else {
            return Vec::new();
        };
        let said = self.said.get(&of).copied();
        let said = said.filter(|said| said.boot == boot.id && !boot.is_before_step(said.newest));
        let is_new = |round: &&HeardRound| {
            !round.relayed && said.is_none_or(|said| said.newest < round.instant)
        };
        let mut newest: Vec<&HeardRound> =
            boot.rounds.iter().rev().filter(is_new).take(most).collect();
        newest.reverse();
        let said_before = said.map_or(0, |said| said.rounds);
        let mut relayed = Vec::new();
        for (said_already, round) in (said_before..).zip(newest) {
            let anchor = boot.rounds.anchor();
            let anchor = anchor.filter(|_| said_already.is_multiple_of(ANCHOR_EVERY));
            self.said.insert(
                of,
                Said {
                    boot: boot.id,
                    newest: round.instant,
                    rounds: said_already + 1,
                },
            );
            relayed.push(RelayedRound {
                of,
                boot: boot.id,
                taken_ns: round.instant.on_its_own_clock().as_nanos(),
                clock_offset_ns: offset.as_nanos(),
                clock_error_ns: error.as_nanos(),
                period_us: boot
                    .period
                    .and_then(|period| u32::try_from(period.as_micros_rounded()).ok())
                    .unwrap_or_default(),
                status: boot.status.unwrap_or(Status::Unplaced).code(),
                body_from_target: Some(boot.body_from_target.to_numbers()),
                round: round.to_wire(),
                fixes: round.fixes.clone(),
                anchor: anchor.map(|anchor| anchor.to_wire()),
            });
        }
        relayed
    }
}

/// Whether a boot itself was heard lately.
fn is_heard(boot: &Boot, now: Stamp) -> bool {
    let heard = boot.heard_at.zip(boot.period);
    heard.is_some_and(|(at, period)| now - at <= period * HEARD_FOR_PERIODS)
}

/// What is known of the clock of whoever repeats rounds.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RelayClock {
    /// The relay's clock minus ours.
    offset: Span,
    error: Span,
}

impl RelayClock {
    pub(crate) fn of(clock: &PeerClock, now: Stamp) -> Result<Self, Refused> {
        let known = clock.offset().zip(clock.error_bound(now));
        let (offset, error) = known.ok_or(Refused::ClockUnknown)?;
        Ok(Self { offset, error })
    }
}

/// Takes a round that a relay repeated as if its teller had said it, but for the echoes that are not to be had.
pub(crate) fn take(
    now: Stamp,
    me: Name,
    relay: RelayClock,
    neighbours: &mut Neighbours,
    relayed: &RelayedRound,
) -> Result<(), Refused> {
    // Everybody's rounds come back to him.
    if relayed.of == me {
        return Ok(());
    }
    let neighbour = neighbours.entry(relayed.of).ok_or(Refused::Full)?;
    match insert(now, relay, neighbour, relayed) {
        Ok(taken) => {
            let accepted = &mut neighbour.counts.accepted;
            accepted.add("relayed_rounds", u64::from(taken));
        }
        Err(why) => neighbour.counts.refused.refuse(&why),
    }
    Ok(())
}

/// Whether it was new. A vehicle that is heard itself is not listened to through others.
fn insert(
    now: Stamp,
    relay: RelayClock,
    neighbour: &mut Neighbour,
    relayed: &RelayedRound,
) -> Result<bool, Refused> {
    if neighbour.is_duplicated() {
        return Err(Refused::DuplicateId);
    }
    if neighbour.current().is_some_and(|boot| is_heard(boot, now)) {
        return Ok(false);
    }
    neighbour.boot(relayed.boot);
    neighbour.settle_relayed(now, relayed.boot);
    neighbour.is_in_office(relayed.boot)?;
    let instant = PeerStamp::from_nanos(relayed.taken_ns);
    let offset = relay.offset + Span::from_nanos(relayed.clock_offset_ns);
    let error = relay.error + Span::from_nanos(relayed.clock_error_ns);
    let boot = neighbour.boot(relayed.boot);
    if boot.rounds.knows(instant) {
        return Ok(false);
    }
    boot.tell_clock(now, instant, offset, error);
    let mine = boot.clock.to_mine(instant).ok_or(Refused::ClockUnknown)?;
    if mine - now > AHEAD_MAX {
        return Err(Refused::FromTheFuture);
    }
    if now - mine > CONTENT_AGE_MAX || boot.is_before_step(instant) {
        return Err(Refused::TooLate);
    }
    let heard = HeardRound::new(instant, &relayed.round, relayed.fixes.clone())?;
    if let Some(mount) = &relayed.body_from_target {
        boot.body_from_target = translate::transform(mount)?;
    }
    if let Some(anchor) = &relayed.anchor {
        let taken = PeerStamp::from_nanos(anchor.taken_ns);
        if taken.since(instant) > AHEAD_MAX {
            return Err(Refused::FromTheFuture);
        }
        if !boot.is_before_step(taken) {
            boot.rounds.tell(HeardAnchor::new(anchor)?);
        }
    }
    boot.status = Status::from_code(relayed.status);
    boot.period = Some(Span::micros(i64::from(relayed.period_us)));
    boot.track.insert(heard.point);
    boot.relayed_at = Some(now);
    Ok(boot.rounds.insert(HeardRound {
        relayed: true,
        ..heard
    }))
}
