//! Packets from other vehicles: decoded, laid to a boot and a round, and either kept or refused with a reason.

use skein_estimation::time::{Span, Stamp};
use skein_proto::codec::{Body, decode};
use skein_proto::envelope::Envelope;
use skein_proto::exchange::{Echo, Exchange};
use skein_proto::name::Name;
use skein_proto::record::RoundRecord;
use skein_proto::status::Status;

use crate::clock::{FourStamps, PeerStamp};
use crate::input::PacketKey;
use crate::neighbours::{Boot, EXCHANGES_MAX, HeardExchange, Neighbour, Neighbours};
use crate::refused::Refused;
use crate::rounds::Horizon;
use crate::speaking::SentStamps;
use crate::translate;

/// How far a packet's content may lie before its sending.
const CONTENT_AGE_MAX: Span = Span::secs(10);

/// How far ahead of our time it may lie, by the sender's clock as we know it.
const AHEAD_MAX: Span = Span::secs(1);

/// What listening needs to know of this vehicle.
pub(crate) struct Listener<'a> {
    pub(crate) me: Name,
    pub(crate) period: Span,
    pub(crate) horizon: Horizon,
    pub(crate) sent: &'a SentStamps,
}

/// An exchange that was kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Heard {
    pub(crate) from: Name,
    pub(crate) round: i64,
}

impl Listener<'_> {
    /// Takes one packet. An exchange that was kept for one of our rounds is told; refusals are counted with the sender
    /// when it can be known, and given back when it cannot.
    pub(crate) fn hear(
        &self,
        now: Stamp,
        neighbours: &mut Neighbours,
        key: PacketKey,
        bytes: &[u8],
    ) -> Result<Option<Heard>, Refused> {
        let from = key.from();
        if from == self.me {
            // Our own name in another process: the liveliness tokens tell of it; its packets are not ours to use.
            return Err(Refused::Duplicate);
        }
        let neighbour = neighbours.entry(from).ok_or(Refused::Full)?;
        neighbour.counts.bytes += bytes.len() as u64;
        neighbour.counts.rate.count(now);
        let outcome = match key {
            PacketKey::Exchange { to, .. } if to != self.me => Err(Refused::NotForMe),
            PacketKey::Exchange { .. } => self.hear_exchange(now, from, neighbour, bytes).map(Some),
            PacketKey::Odometry { .. } => {
                self.hear_record(now, from, neighbour, bytes).map(|()| None)
            }
        };
        match outcome {
            Ok(round) => {
                neighbour.counts.accepted.count(if round.is_some() {
                    "exchange"
                } else {
                    "odometry"
                });
                Ok(round.map(|round| Heard { from, round }))
            }
            Err(why) => {
                neighbour.counts.refused.refuse(&why);
                Ok(None)
            }
        }
    }

    fn hear_exchange(
        &self,
        now: Stamp,
        from: Name,
        neighbour: &mut Neighbour,
        bytes: &[u8],
    ) -> Result<i64, Refused> {
        let (envelope, exchange) = open::<Exchange>(from, bytes)?;
        let boot = neighbour.boot(envelope.boot);
        self.note(
            now,
            boot,
            "exchange",
            &envelope,
            exchange.sent_ns,
            exchange.echo.as_ref(),
        );
        if !neighbour.is_current(envelope.boot) {
            return Err(Refused::OldBoot);
        }
        let boot = neighbour.boot(envelope.boot);
        boot.status = Status::from_code(exchange.status);
        let instant = plausible(envelope.taken_ns, exchange.sent_ns)?;
        let round = boot
            .round_of(instant, self.period)
            .ok_or(Refused::ClockUnknown)?;
        // Also when it comes too late for its round: the next one will not.
        if !exchange.measured.is_empty() {
            neighbour.measured_me_at = Some(now);
        }
        self.horizon.admits(round)?;
        let boot = neighbour.boot(envelope.boot);
        if boot.exchanges.contains_key(&round) {
            return Err(Refused::Duplicate);
        }
        if boot.exchanges.len() >= EXCHANGES_MAX {
            return Err(Refused::Full);
        }
        let prior = exchange
            .prior
            .as_ref()
            .map(translate::transform)
            .transpose()?;
        boot.exchanges.insert(
            round,
            HeardExchange {
                instant,
                prior,
                measured: exchange.measured,
            },
        );
        Ok(round)
    }

    fn hear_record(
        &self,
        now: Stamp,
        from: Name,
        neighbour: &mut Neighbour,
        bytes: &[u8],
    ) -> Result<(), Refused> {
        let (envelope, record) = open::<RoundRecord>(from, bytes)?;
        let me = self.me.hash();
        let echo = record.echoes.iter().find(|echo| echo.to == me);
        let echo = echo.map(|echo| Echo {
            heard_ns: echo.heard_ns,
            received_ns: echo.received_ns,
        });
        let boot = neighbour.boot(envelope.boot);
        self.note(
            now,
            boot,
            "odometry",
            &envelope,
            record.sent_ns,
            echo.as_ref(),
        );
        if !neighbour.is_current(envelope.boot) {
            return Err(Refused::OldBoot);
        }
        let boot = neighbour.boot(envelope.boot);
        boot.status = Status::from_code(record.status);
        boot.period = Some(Span::micros(i64::from(record.period_us)));
        if let Some(mount) = &record.body_from_target {
            boot.body_from_target = translate::transform(mount)?;
        }
        let newest = plausible(envelope.taken_ns, record.sent_ns)?;
        let mine = boot.clock.to_mine(newest).ok_or(Refused::ClockUnknown)?;
        if mine - now > AHEAD_MAX {
            return Err(Refused::FromTheFuture);
        }
        if now - mine > CONTENT_AGE_MAX {
            return Err(Refused::TooLate);
        }
        for round in &record.rounds {
            let back = Span::micros(i64::from(record.period_us)) * i64::from(round.back);
            let instant = newest.plus(-back);
            boot.track.insert(translate::odometry_point(
                round,
                instant.on_its_own_clock(),
            )?);
        }
        Ok(())
    }

    /// Notes that a boot was heard, and the echo that a packet brings. A repeated or replayed packet (its sequence does
    /// not rise) says nothing of the present.
    fn note(
        &self,
        now: Stamp,
        boot: &mut Boot,
        kind: &'static str,
        envelope: &Envelope,
        sent_ns: i64,
        echo: Option<&Echo>,
    ) {
        if boot
            .sequences
            .get(kind)
            .is_some_and(|last| envelope.sequence <= *last)
        {
            return;
        }
        boot.sequences.insert(kind, envelope.sequence);
        boot.heard_at = Some(now);
        boot.to_echo = Some(Echo {
            heard_ns: sent_ns,
            received_ns: now.as_nanos(),
        });
        let Some(echo) = echo else { return };
        let sent = Stamp::from_nanos(echo.heard_ns);
        // An echo proves that this boot is alive now only if the stamp in it is one of ours.
        if !self.sent.contains(sent) {
            return;
        }
        let stamps = FourStamps {
            sent,
            heard: PeerStamp::from_nanos(echo.received_ns),
            echoed: PeerStamp::from_nanos(sent_ns),
            received: now,
        };
        if boot.clock.observe(stamps) {
            boot.echoed_at = Some(now);
        }
    }
}

/// Decodes a packet and checks that its sender's hash is that of the name in the key.
fn open<B: Body>(from: Name, bytes: &[u8]) -> Result<(Envelope, B), Refused> {
    let (envelope, body) = decode::<B>(bytes)?;
    if envelope.sender == from.hash() {
        Ok((envelope, body))
    } else {
        Err(Refused::WrongHash)
    }
}

/// The instant that a packet speaks of, if it can have been so when it was sent.
fn plausible(taken_ns: i64, sent_ns: i64) -> Result<PeerStamp, Refused> {
    let (taken, sent) = (
        PeerStamp::from_nanos(taken_ns),
        PeerStamp::from_nanos(sent_ns),
    );
    match sent.since(taken) {
        age if age < Span::ZERO => Err(Refused::FromTheFuture),
        age if age > CONTENT_AGE_MAX => Err(Refused::TooLate),
        _ => Ok(taken),
    }
}
