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
use crate::neighbours::{EXCHANGES_MAX, HeardExchange, Neighbour, Neighbours};
use crate::refused::Refused;
use crate::rounds::Horizon;
use crate::sequence::{Kind, Novelty};
use crate::speaking::SentStamps;
use crate::translate;

/// How far a packet's content may lie before its sending.
const CONTENT_AGE_MAX: Span = Span::secs(10);

/// How far ahead of our time it may lie, by the sender's clock as we know it.
const AHEAD_MAX: Span = Span::secs(1);

/// What listening needs to know of this vehicle.
pub(crate) struct Listener<'a> {
    pub(crate) me: Name,
    pub(crate) boot: u64,
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
            return Err(self.hear_namesake(now, neighbours, key, bytes));
        }
        let neighbour = neighbours.entry(from).ok_or(Refused::Full)?;
        neighbour.counts.bytes += bytes.len() as u64;
        neighbour.counts.rate.count(now);
        let were_duplicates = neighbour.is_duplicated();
        let outcome = match key {
            PacketKey::Exchange { to, .. } if to != self.me => Err(Refused::NotForMe),
            PacketKey::Exchange { .. } => self.hear_exchange(now, from, neighbour, bytes).map(Some),
            PacketKey::Odometry { .. } => {
                self.hear_record(now, from, neighbour, bytes).map(|()| None)
            }
        };
        let are_duplicates = neighbour.is_duplicated();
        let heard = match outcome {
            Ok(round) => {
                let kind = round.map_or(Kind::Odometry, |_| Kind::Exchange);
                neighbour.counts.accepted.count(kind.word());
                round.map(|round| Heard { from, round })
            }
            Err(why) => {
                neighbour.counts.refused.refuse(&why);
                None
            }
        };
        neighbours.alarmed |= are_duplicates && !were_duplicates;
        Ok(heard)
    }

    /// A packet under this vehicle's own name: of the process before this one, or of a duplicate. Nothing of it is
    /// used.
    fn hear_namesake(
        &self,
        now: Stamp,
        neighbours: &mut Neighbours,
        key: PacketKey,
        bytes: &[u8],
    ) -> Refused {
        let opened = match key {
            PacketKey::Exchange { .. } => {
                open::<Exchange>(self.me, bytes).map(|(head, _)| (Kind::Exchange, head))
            }
            PacketKey::Odometry { .. } => {
                open::<RoundRecord>(self.me, bytes).map(|(head, _)| (Kind::Odometry, head))
            }
        };
        let (kind, head) = match opened {
            Ok(opened) => opened,
            Err(why) => return why,
        };
        if head.boot == self.boot {
            return Refused::Duplicate;
        }
        let known = neighbours.namesakes.alive(now).is_some();
        if !neighbours
            .namesakes
            .note(now, head.boot, kind, head.sequence)
        {
            return Refused::OldBoot;
        }
        neighbours.alarmed |= !known;
        Refused::DuplicateId
    }

    fn hear_exchange(
        &self,
        now: Stamp,
        from: Name,
        neighbour: &mut Neighbour,
        bytes: &[u8],
    ) -> Result<i64, Refused> {
        let (envelope, exchange) = open::<Exchange>(from, bytes)?;
        let instant = plausible(envelope.taken_ns, exchange.sent_ns)?;
        let echo = exchange.echo.as_ref();
        let said = Said::new(Kind::Exchange, &envelope, exchange.sent_ns, echo);
        self.admit(now, neighbour, &said)?;
        let boot = neighbour.boot(envelope.boot);
        boot.status = Status::from_code(exchange.status);
        if boot.is_before_step(instant) {
            return Err(Refused::TooLate);
        }
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
        let newest = plausible(envelope.taken_ns, record.sent_ns)?;
        let said = Said::new(Kind::Odometry, &envelope, record.sent_ns, echo.as_ref());
        self.admit(now, neighbour, &said)?;
        let boot = neighbour.boot(envelope.boot);
        boot.status = Status::from_code(record.status);
        boot.period = Some(Span::micros(i64::from(record.period_us)));
        if let Some(mount) = &record.body_from_target {
            boot.body_from_target = translate::transform(mount)?;
        }
        let mine = boot.clock.to_mine(newest).ok_or(Refused::ClockUnknown)?;
        if mine - now > AHEAD_MAX {
            return Err(Refused::FromTheFuture);
        }
        if now - mine > CONTENT_AGE_MAX || boot.is_before_step(newest) {
            return Err(Refused::TooLate);
        }
        for round in &record.rounds {
            let back = Span::micros(i64::from(record.period_us)) * i64::from(round.back);
            let instant = newest.plus(-back);
            if boot.is_before_step(instant) {
                continue;
            }
            boot.track.insert(translate::odometry_point(
                round,
                instant.on_its_own_clock(),
            )?);
        }
        Ok(())
    }

    /// The door: who speaks, is it new, does it prove that its sender is alive, and is that one the vehicle? A packet
    /// that is refused here leaves no trace in what is known of the vehicle, but for its proof of life.
    fn admit(&self, now: Stamp, neighbour: &mut Neighbour, said: &Said) -> Result<(), Refused> {
        // An echo proves that this boot is alive now only if the stamp in it is one of ours, and newer than the last.
        let ours = said.echo.as_ref().filter(|echo| {
            let sent = Stamp::from_nanos(echo.heard_ns);
            let known = neighbour.known_boot(said.boot);
            self.sent.contains(sent) && known.is_none_or(|boot| boot.life.would_prove(sent))
        });
        if ours.is_none() {
            // The times of a packet with such an echo may show that a clock stepped; of any other they must fit.
            let known = neighbour.known_boot(said.boot);
            let mine = known.and_then(|boot| boot.clock.to_mine(said.sent));
            match mine.map_or(Span::ZERO, |mine| now - mine) {
                age if age < -AHEAD_MAX => return Err(Refused::FromTheFuture),
                age if age > CONTENT_AGE_MAX => return Err(Refused::TooLate),
                _ => {}
            }
        }
        let boot = neighbour.boot(said.boot);
        let novelty = boot
            .sequences
            .take(said.kind, said.sequence, ours.is_some());
        match novelty {
            Novelty::Repeated => return Err(Refused::Duplicate),
            Novelty::Astray => return Err(Refused::OutOfSequence),
            Novelty::Late | Novelty::New => {}
        }
        let is_new = novelty == Novelty::New;
        if let Some(echo) = ours.filter(|_| is_new) {
            boot.life.prove(now, Stamp::from_nanos(echo.heard_ns));
        }
        neighbour.judge(now, said.boot)?;
        if is_new {
            let boot = neighbour.boot(said.boot);
            boot.heard_at = Some(now);
            boot.note_for_echo(said.sent, now);
            if let Some(echo) = ours {
                boot.observe(FourStamps {
                    sent: Stamp::from_nanos(echo.heard_ns),
                    heard: PeerStamp::from_nanos(echo.received_ns),
                    echoed: said.sent,
                    received: now,
                });
            }
        }
        neighbour.settle(now, said.boot);
        neighbour.is_in_office(said.boot)
    }
}

/// What a packet of either kind says of itself.
struct Said {
    kind: Kind,
    boot: u64,
    sequence: u32,
    sent: PeerStamp,
    echo: Option<Echo>,
}

impl Said {
    fn new(kind: Kind, envelope: &Envelope, sent_ns: i64, echo: Option<&Echo>) -> Self {
        Self {
            kind,
            boot: envelope.boot,
            sequence: envelope.sequence,
            sent: PeerStamp::from_nanos(sent_ns),
            echo: echo.copied(),
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
