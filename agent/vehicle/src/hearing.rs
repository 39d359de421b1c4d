//! Packets from other vehicles: decoded, laid to a boot and a round, and either kept or refused with a reason.

use skein_estimation::mutual::FeatureSet;
use skein_estimation::time::{Span, Stamp};
use skein_proto::backlog::{Backlog, BacklogRound};
use skein_proto::codec::{Body, decode};
use skein_proto::envelope::Envelope;
use skein_proto::exchange::{Echo, Exchange};
use skein_proto::features;
use skein_proto::name::Name;
use skein_proto::record::{RoundRecord, Schedule};
use skein_proto::relay::Relay;
use skein_proto::status::Status;

use crate::clock::{FourStamps, PeerStamp};
use crate::heard_rounds::{HeardAnchor, HeardRound};
use crate::input::PacketKey;
use crate::mutual;
use crate::neighbours::{EXCHANGES_MAX, HeardExchange, Neighbour, Neighbours};
use crate::refused::Refused;
use crate::relaying::{self, RelayClock};
use crate::rounds::Horizon;
use crate::sequence::{Kind, Novelty};
use crate::speaking::SentStamps;
use crate::translate;

/// How far a packet's content may lie before its sending.
pub(crate) const CONTENT_AGE_MAX: Span = Span::secs(10);

/// How old a feature set may be: by then where its robots were tells nothing of where they are.
const FEATURES_AGE_MAX: Span = Span::secs(1);

/// How far ahead of our time it may lie, by the sender's clock as we know it.
pub(crate) const AHEAD_MAX: Span = Span::secs(1);

/// How far ahead of its arrival a feature set may be taken, beyond what is not known of the sender's clock: a time that is
/// wrong by half a second moves where all robots are held to be, and too little for the estimator to see.
const FEATURES_AHEAD_MAX: Span = Span::millis(20);

/// The word by which packets of a backlog are counted.
const BACKLOG: &str = "backlog";

/// What listening needs to know of this vehicle.
pub(crate) struct Listener<'a> {
    pub(crate) me: Name,
    pub(crate) boot: u64,
    pub(crate) period: Span,
    pub(crate) horizon: Horizon,
    pub(crate) sent: &'a SentStamps,
    /// Whether it can use what others repeat.
    pub(crate) smooths: bool,
}

/// What somebody else has to act upon.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Heard {
    /// An exchange that was kept for one of our rounds.
    Exchange { from: Name, round: i64 },
    /// A feature set, at its time on our clock.
    Features { from: Name, set: Box<FeatureSet> },
    /// Its state in the motion schedule.
    Turn { from: Name, said: Schedule },
}

impl Listener<'_> {
    /// Takes one packet. An exchange that was kept for one of our rounds and a feature set are told; refusals are counted
    /// with the sender when it can be known, and given back when it cannot.
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
        let mut repeated = None;
        let outcome = match key {
            PacketKey::Exchange { to, .. } if to != self.me => Err(Refused::NotForMe),
            PacketKey::Exchange { .. } => self
                .hear_exchange(now, from, neighbour, bytes)
                .map(|round| (Kind::Exchange.word(), Some(Heard::Exchange { from, round }))),
            PacketKey::Odometry { .. } => {
                let said = self.hear_record(now, from, neighbour, bytes);
                let turn = |said| Heard::Turn { from, said };
                said.map(|said| (Kind::Odometry.word(), said.map(turn)))
            }
            PacketKey::Features { .. } => {
                let set = self.hear_features(now, from, neighbour, bytes);
                set.map(|set| (Kind::Features.word(), Some(Heard::Features { from, set })))
            }
            PacketKey::Backlog { .. } => {
                hear_backlog(now, from, neighbour, bytes).map(|()| (BACKLOG, None))
            }
            PacketKey::Relay { .. } => self.hear_relay(now, from, neighbour, bytes).map(|relay| {
                repeated = Some(relay);
                (Kind::Relay.word(), None)
            }),
        };
        let are_duplicates = neighbour.is_duplicated();
        let heard = match outcome {
            Ok((word, heard)) => {
                neighbour.counts.accepted.count(word);
                heard
            }
            Err(why) => {
                neighbour.counts.refused.refuse(&why);
                None
            }
        };
        neighbours.alarmed |= are_duplicates && !were_duplicates;
        if let Some((clock, relay)) = repeated {
            for relayed in &relay.rounds {
                relaying::take(now, self.me, clock, neighbours, relayed)?;
            }
        }
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
            PacketKey::Features { .. } => {
                open::<features::FeatureSet>(self.me, bytes).map(|(head, _)| (Kind::Features, head))
            }
            PacketKey::Relay { .. } => {
                open::<Relay>(self.me, bytes).map(|(head, _)| (Kind::Relay, head))
            }
            // Nobody asks itself.
            PacketKey::Backlog { .. } => return Refused::Unasked,
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
    ) -> Result<Option<Schedule>, Refused> {
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
        let known = boot.rounds.newest().map(|round| round.instant);
        let period = Span::micros(i64::from(record.period_us));
        let oldest = record.rounds.iter().map(|round| round.back).max();
        if let (Some(known), Some(back)) = (known, oldest) {
            let oldest = newest.plus(-(period * i64::from(back)));
            boot.asking.note(known, oldest, period);
        }
        for round in &record.rounds {
            let instant = newest.plus(-(period * i64::from(round.back)));
            if boot.is_before_step(instant) {
                continue;
            }
            let point = translate::odometry_point(round, instant.on_its_own_clock())?;
            boot.track.insert(point);
            if !boot.rounds.knows(instant) {
                let fixes = record.fixes.iter().filter(|fix| fix.back == round.back);
                let fixes = fixes.map(|fix| fix.fix).collect();
                boot.rounds.insert(HeardRound::new(instant, round, fixes)?);
            }
        }
        if let Some(anchor) = &record.anchor {
            let taken = PeerStamp::from_nanos(anchor.taken_ns);
            if taken.since(newest) > AHEAD_MAX {
                return Err(Refused::FromTheFuture);
            }
            if !boot.is_before_step(taken) {
                boot.rounds.tell(HeardAnchor::new(anchor)?);
            }
        }
        Ok(record.schedule)
    }

    fn hear_features(
        &self,
        now: Stamp,
        from: Name,
        neighbour: &mut Neighbour,
        bytes: &[u8],
    ) -> Result<Box<FeatureSet>, Refused> {
        let (envelope, set) = open::<features::FeatureSet>(from, bytes)?;
        let taken = plausible(envelope.taken_ns, set.sent_ns)?;
        let said = Said::new(Kind::Features, &envelope, set.sent_ns, None);
        self.admit(now, neighbour, &said)?;
        let boot = neighbour.boot(envelope.boot);
        let mine = boot.clock.to_mine(taken).ok_or(Refused::ClockUnknown)?;
        let unknown = boot.clock.error_bound(now).unwrap_or(Span::ZERO);
        if mine - now > unknown + FEATURES_AHEAD_MAX {
            return Err(Refused::FromTheFuture);
        }
        if now - mine > FEATURES_AGE_MAX || boot.is_before_step(taken) {
            return Err(Refused::TooLate);
        }
        Ok(Box::new(mutual::from_wire(&set, mine)))
    }

    /// Takes what somebody repeats, with what is known of his clock.
    fn hear_relay(
        &self,
        now: Stamp,
        from: Name,
        neighbour: &mut Neighbour,
        bytes: &[u8],
    ) -> Result<(RelayClock, Relay), Refused> {
        let (envelope, relay) = open::<Relay>(from, bytes)?;
        if !self.smooths {
            return Err(Refused::NoPipeline);
        }
        plausible(envelope.taken_ns, relay.sent_ns)?;
        let said = Said::new(Kind::Relay, &envelope, relay.sent_ns, None);
        self.admit(now, neighbour, &said)?;
        let clock = RelayClock::of(&neighbour.boot(envelope.boot).clock, now)?;
        Ok((clock, relay))
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

/// Takes rounds that were asked for: of the boot in office, in time, and of the instants that are missing. What is known
/// already changes nothing.
fn hear_backlog(
    now: Stamp,
    from: Name,
    neighbour: &mut Neighbour,
    bytes: &[u8],
) -> Result<(), Refused> {
    let (envelope, backlog) = open::<Backlog>(from, bytes)?;
    if neighbour.is_duplicated() {
        return Err(Refused::DuplicateId);
    }
    neighbour.is_in_office(envelope.boot)?;
    let boot = neighbour.boot(envelope.boot);
    if !boot.asking.expects(now) {
        return Err(Refused::Unasked);
    }
    let (mut taken, mut unasked) = (0, 0);
    for BacklogRound {
        taken_ns,
        round,
        fixes,
    } in backlog.rounds
    {
        let instant = PeerStamp::from_nanos(taken_ns);
        if boot.rounds.knows(instant) {
            continue;
        }
        if !boot.asking.misses(instant) || boot.is_before_step(instant) {
            unasked += 1;
            continue;
        }
        let heard = HeardRound::new(instant, &round, fixes)?;
        boot.track.insert(heard.point);
        taken += u64::from(boot.rounds.insert(heard));
    }
    if backlog.remaining == 0 {
        boot.asking.close();
    }
    neighbour.counts.accepted.add("backlog_rounds", taken);
    let refused = &mut neighbour.counts.refused;
    refused.add(Refused::Unasked.word(), unasked);
    Ok(())
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::ECHOES_MIN;
    use crate::rounds::Rounds;
    use skein_proto::anchor::Anchor;
    use skein_proto::codec;
    use skein_proto::fixed::Fixed;
    use skein_proto::growth::Growth;
    use skein_proto::record::{Round, RoundFix};

    const PERIOD: Span = Span::millis(200);
    /// A variance that no other number of a packet is.
    const VARIANCE: f64 = 0.123_456_789;
    const FIX: Fixed = Fixed::Position {
        position_m: [1.0, 2.0, 3.0],
        point_m: [0.0; 3],
        sigma_m: 0.5,
    };

    fn name(text: &str) -> Name {
        Name::parse(text).unwrap()
    }

    fn at(millis: i64) -> Stamp {
        Stamp::default() + Span::millis(millis)
    }

    /// A vehicle that hears v2, whose clock it knows: it is the same.
    struct Hearer {
        neighbours: Neighbours,
        sent: SentStamps,
    }

    impl Hearer {
        fn new() -> Self {
            let mut neighbours = Neighbours::default();
            let boot = neighbours.entry(name("v2")).unwrap().boot(7);
            for _ in 0..ECHOES_MIN {
                boot.observe(FourStamps {
                    sent: at(0),
                    heard: PeerStamp::from_nanos(0),
                    echoed: PeerStamp::from_nanos(0),
                    received: at(0),
                });
            }
            Self {
                neighbours,
                sent: SentStamps::default(),
            }
        }

        fn hear(&mut self, now: Stamp, bytes: &[u8]) {
            let key = PacketKey::Odometry { from: name("v2") };
            assert_eq!(self.hear_under(key, now, bytes), Ok(None));
        }

        fn hear_under(
            &mut self,
            key: PacketKey,
            now: Stamp,
            bytes: &[u8],
        ) -> Result<Option<Heard>, Refused> {
            let rounds = Rounds::new(now, PERIOD, PERIOD);
            let listener = Listener {
                me: name("v1"),
                boot: 1,
                period: PERIOD,
                horizon: rounds.horizon(now),
                sent: &self.sent,
                smooths: true,
            };
            listener.hear(now, &mut self.neighbours, key, bytes)
        }

        fn neighbour(&self) -> &Neighbour {
            self.neighbours.get(name("v2")).unwrap()
        }

        fn rounds(&self) -> Vec<HeardRound> {
            let usable = self.neighbour().usable().unwrap();
            usable.rounds.iter().cloned().collect()
        }
    }

    fn round(back: u8, metres: f64, growth: Growth) -> Round {
        Round {
            back,
            segment: 0,
            odometry_from_body: [0.0, 0.0, 0.0, metres, 0.0, 0.0],
            growth,
            measured: vec![],
        }
    }

    fn isotropic() -> Growth {
        Growth::Isotropic([VARIANCE, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5])
    }

    /// The record of the round that ends at `millis`.
    fn record(millis: i64, rounds: Vec<Round>) -> RoundRecord {
        RoundRecord {
            sent_ns: at(millis).as_nanos(),
            period_us: 200_000,
            status: Status::Tracking.code(),
            body_from_target: None,
            schedule: None,
            echoes: vec![],
            rounds,
            anchor: None,
            fixes: vec![],
        }
    }

    fn packet(sequence: u32, record: &RoundRecord) -> Vec<u8> {
        codec::encode(envelope(sequence, record.sent_ns), record).unwrap()
    }

    fn envelope(sequence: u32, taken_ns: i64) -> Envelope {
        Envelope {
            major: 0,
            minor: 0,
            body_bytes: 0,
            sequence,
            boot: 7,
            sender: name("v2").hash(),
            taken_ns,
        }
    }

    #[test]
    fn what_a_camera_sees_after_it_was_heard_is_refused() {
        let mut hearer = Hearer::new();
        let mut heard = |sequence, taken_ms: i64| {
            let set = features::FeatureSet {
                sent_ns: at(taken_ms).as_nanos(),
                roll_rad: 0.0,
                pitch_rad: 0.0,
                yaw_rate_rad_s: 0.0,
                acceleration_m_s2: [0.0, 0.0, 9.81],
                integrals: features::Integrals {
                    elapsed_s: 2.0,
                    yaw_rad: 0.0,
                    velocity_m_s: [0.0; 3],
                    position_m: [0.0; 3],
                },
                features: vec![],
                tracks: vec![],
            };
            let bytes = codec::encode(envelope(sequence, set.sent_ns), &set).unwrap();
            let key = PacketKey::Features { from: name("v2") };
            matches!(hearer.hear_under(key, at(2_000), &bytes), Ok(Some(_)))
        };
        assert!(heard(1, 1_950));
        assert!(heard(2, 2_010));
        assert!(!heard(3, 2_100), "taken a tenth of a second after it came");
        let refused = &hearer.neighbour().counts.refused;
        assert_eq!(refused.to_document()["from_the_future"], 1);
    }

    #[test]
    fn raw_rounds_are_kept_as_they_were_told_and_a_repeat_changes_nothing() {
        let mut hearer = Hearer::new();
        let mut first = record(
            400,
            vec![round(0, 2.0, isotropic()), round(1, 1.0, Growth::Unknown)],
        );
        first.fixes = vec![RoundFix { back: 1, fix: FIX }];
        hearer.hear(at(400), &packet(1, &first));
        let heard = hearer.rounds();
        let seen = |round: &HeardRound| {
            let point = &round.point;
            let x = point.odometry_from_body.translation.x;
            (point.taken, x, round.growth_known, round.fixes.clone())
        };
        assert_eq!(
            heard.iter().map(seen).collect::<Vec<_>>(),
            [
                (at(200), 1.0, false, vec![FIX]),
                (at(400), 2.0, true, vec![])
            ]
        );
        let growths = heard.iter().map(|round| round.point.growth.rotation);
        assert_eq!(growths.collect::<Vec<_>>(), [0.0, VARIANCE]);

        let other = Growth::Full([1.0; 21]);
        let mut again = record(600, vec![round(0, 3.0, other), round(1, 99.0, other)]);
        again.fixes = vec![RoundFix { back: 1, fix: FIX }];
        hearer.hear(at(600), &packet(2, &again));
        let more = hearer.rounds();
        assert_eq!(more[..2], heard);
        assert_eq!((more.len(), more[2].growth_known), (3, false));
        assert_eq!(
            more[2].point.growth,
            skein_estimation::odometry::Growth::zero()
        );
    }

    #[test]
    fn an_anchor_of_the_future_is_refused_and_the_newest_one_of_the_past_is_kept() {
        let mut hearer = Hearer::new();
        let mut hear = |sequence, taken_ms: i64| {
            let mut record = record(2_000, vec![]);
            record.anchor = Some(Anchor {
                taken_ns: at(taken_ms).as_nanos(),
                segment: 0,
                odometry_from_body: [0.0; 6],
                growth: isotropic(),
                world_from_body: [0.0, 0.0, 0.0, 5.0, 0.0, 0.0],
                rotation_sigma_rad: 0.1,
                translation_sigma_m: 0.1,
            });
            hearer.hear(at(2_000), &packet(sequence, &record));
            let anchor = hearer.neighbour().usable().unwrap().rounds.anchor();
            anchor.map(|anchor| anchor.point.taken)
        };
        assert_eq!(hear(1, 3_001), None);
        assert_eq!(hear(2, 1_500), Some(at(1_500)));
        assert_eq!(hear(3, 1_400), Some(at(1_500)));
        assert_eq!(hear(4, 9_000), Some(at(1_500)));
        let refused = &hearer.neighbour().counts.refused;
        assert_eq!(refused.to_document()["from_the_future"], 2);
    }

    #[test]
    fn a_growth_that_cannot_be_is_refused_with_its_whole_record() {
        let mut hearer = Hearer::new();
        let bytes = packet(1, &record(400, vec![round(0, 2.0, isotropic())]));
        let honest = VARIANCE.to_le_bytes();
        let found = bytes.windows(8).position(|window| window == honest);
        let variance_at = found.unwrap();
        for impossible in [-VARIANCE, 1e25, f64::NAN, f64::INFINITY] {
            let mut bytes = bytes.clone();
            bytes[variance_at..variance_at + 8].copy_from_slice(&impossible.to_le_bytes());
            hearer.hear(at(400), &bytes);
        }
        assert!(
            hearer.neighbour().usable().is_none(),
            "not even listened to"
        );
        let refused = hearer.neighbour().counts.refused.to_document();
        assert_eq!((refused["out_of_range"], refused["not_finite"]), (2, 2));
        hearer.hear(at(400), &bytes);
        assert_eq!(hearer.rounds().len(), 1);
    }

    #[test]
    fn raw_rounds_are_forgotten_when_a_clock_steps() {
        let mut hearer = Hearer::new();
        hearer.hear(
            at(400),
            &packet(1, &record(400, vec![round(0, 2.0, isotropic())])),
        );
        assert_eq!(hearer.rounds().len(), 1);
        let boot = hearer.neighbours.entry(name("v2")).unwrap().boot(7);
        for millis in [500, 600] {
            let ahead = PeerStamp::from_nanos(at(millis + 5_000).as_nanos());
            boot.observe(FourStamps {
                sent: at(millis),
                heard: ahead,
                echoed: ahead,
                received: at(millis),
            });
        }
        assert_eq!(boot.clock.steps(), 1);
        assert_eq!(boot.rounds.iter().count(), 0);
    }
}
