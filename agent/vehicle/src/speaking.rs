//! What this vehicle says: the exchange to each partner, the round record and the feature set to everybody, and when it
//! said so.

use std::collections::VecDeque;

use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Sensor, Transform, World};
use skein_proto::backlog::BacklogRound;
use skein_proto::codec::{self, Body as _};
use skein_proto::envelope::Envelope;
use skein_proto::estimate::Estimate;
use skein_proto::exchange::Exchange;
use skein_proto::features::FeatureSet;
use skein_proto::fixed::Fixed;
use skein_proto::limits::{
    ECHOES_PER_RECORD_MAX, FIXES_PER_RECORD_MAX, MEASURED_PER_ROUND_MAX, RELAYED_PER_PACKET_MAX,
    ROUNDS_PER_RECORD_MAX,
};
use skein_proto::name::Name;
use skein_proto::record::{self, Addressed, PeerEcho, RoundFix, RoundRecord, Schedule};
use skein_proto::relay::{Relay, RelayedRound};
use skein_proto::status::Status;

use crate::anchor::Anchor;
use crate::backlog::Backlog;
use crate::counters::Counters;
use crate::input::PacketKey;
use crate::neighbours::Neighbours;
use crate::rounds::Round;
use crate::translate;

/// Neighbours that are told something in one round, nearest first.
pub(crate) const PARTNERS_MAX: usize = 16;
/// How often neighbours who measure nothing of us are told our prior.
const GREETING_EVERY: Span = Span::secs(1);
/// In so many rounds at first the record carries a new anchor.
const ANCHOR_AT_FIRST_ROUNDS: u64 = 10;
/// In one of so many it does so later.
const ANCHOR_EVERY_ROUNDS: u64 = 5;
/// Stamps of sent packets that an echo may name.
const SENT_STAMPS_MAX: usize = 1024;
/// How long an echo may take.
const SENT_STAMPS_SPAN: Span = Span::secs(5);

/// When packets were sent lately: an echo of anything else proves nothing.
#[derive(Clone, Debug, Default)]
pub(crate) struct SentStamps(VecDeque<Stamp>);

impl SentStamps {
    fn add(&mut self, sent: Stamp) {
        if self.0.back() != Some(&sent) {
            self.0.push_back(sent);
        }
        while self.0.len() > SENT_STAMPS_MAX
            || self
                .0
                .front()
                .is_some_and(|first| sent - *first > SENT_STAMPS_SPAN)
        {
            self.0.pop_front();
        }
    }

    pub(crate) fn contains(&self, stamp: Stamp) -> bool {
        self.0.binary_search(&stamp).is_ok()
    }
}

/// One of this vehicle's last rounds, as it is said to everybody.
#[derive(Clone, Debug)]
struct SaidRound {
    index: i64,
    round: record::Round,
    fixes: Vec<Fixed>,
}

/// This vehicle's voice.
#[derive(Clone, Debug)]
pub(crate) struct Speech {
    me: Name,
    boot: u64,
    period: Span,
    repeats: usize,
    body_from_target: Option<[f64; 6]>,
    hash: u64,
    exchanges: u32,
    features: u32,
    records: u32,
    estimates: u32,
    echo_turn: usize,
    rounds: VecDeque<SaidRound>,
    /// The anchor that was last told of, by its time, and in how many rounds so far.
    anchor: Option<(Stamp, u64)>,
    backlog: Backlog,
    backlogs: u32,
    relays: u32,
    pub(crate) sent: SentStamps,
    /// What was left out because a bound was reached.
    pub(crate) cut: Counters,
}

impl Speech {
    pub(crate) fn new(
        me: Name,
        boot: u64,
        period: Span,
        repeats: usize,
        body_from_target: &Transform<Body, Sensor>,
    ) -> Self {
        let target =
            (*body_from_target != Transform::identity()).then(|| body_from_target.to_numbers());
        Self {
            me,
            boot,
            period,
            repeats: repeats.min(ROUNDS_PER_RECORD_MAX - 1),
            body_from_target: target,
            hash: me.hash(),
            exchanges: 0,
            features: 0,
            records: 0,
            estimates: 0,
            echo_turn: 0,
            rounds: VecDeque::new(),
            anchor: None,
            backlog: Backlog::default(),
            backlogs: 0,
            relays: 0,
            sent: SentStamps::default(),
            cut: Counters::default(),
        }
    }

    /// Whom to send an exchange when a round opens: partners, those who were heard for this round already, and now and
    /// then everybody present.
    pub(crate) fn partners(
        &mut self,
        now: Stamp,
        round: i64,
        neighbours: &Neighbours,
        timeout: Span,
    ) -> Vec<Name> {
        let mut partners: Vec<(f64, Name)> = neighbours
            .present(now, timeout)
            .filter(|(_, neighbour)| {
                let greet = neighbour
                    .spoken_to_at
                    .is_none_or(|at| now - at >= GREETING_EVERY);
                let heard = neighbour
                    .usable()
                    .is_some_and(|boot| boot.exchanges.contains_key(&round));
                greet || heard || neighbour.is_partner(now)
            })
            .map(|(name, neighbour)| (neighbour.distance_m(), name))
            .collect();
        partners.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        self.cut.add(
            "partners",
            partners.len().saturating_sub(PARTNERS_MAX) as u64,
        );
        partners.truncate(PARTNERS_MAX);
        partners.into_iter().map(|(_, name)| name).collect()
    }

    /// The exchange of one round to one neighbour: the round's prior and what was measured of it.
    pub(crate) fn exchange(
        &mut self,
        now: Stamp,
        to: Name,
        round: &Round,
        prior: Option<&Transform<World, Body>>,
        status: Status,
        neighbours: &Neighbours,
    ) -> Option<(PacketKey, Vec<u8>)> {
        let exchange = Exchange {
            sent_ns: now.as_nanos(),
            status: status.code(),
            echo: neighbours.get(to).and_then(|neighbour| neighbour.to_echo()),
            prior: prior.map(Transform::to_numbers),
            measured: round.measured.get(&to).cloned().unwrap_or_default(),
        };
        self.exchanges = self.exchanges.wrapping_add(1);
        let packet = codec::encode(self.envelope(self.exchanges, round.instant), &exchange);
        let bytes = self.sendable(now, packet)?;
        Some((PacketKey::Exchange { from: self.me, to }, bytes))
    }

    /// The record of one round to everybody, with as many of the rounds before it as fit.
    pub(crate) fn record(
        &mut self,
        now: Stamp,
        round: &Round,
        status: Status,
        schedule: Option<Schedule>,
        neighbours: &Neighbours,
        anchor: Option<&Anchor>,
    ) -> Option<(PacketKey, Vec<u8>)> {
        self.remember(round, neighbours);
        let anchor = anchor.filter(|anchor| self.is_due(anchor));
        let mut record = RoundRecord {
            sent_ns: now.as_nanos(),
            period_us: u32::try_from(self.period.as_micros_rounded()).unwrap_or(u32::MAX),
            status: status.code(),
            body_from_target: self.body_from_target,
            schedule,
            echoes: self.echoes(now, neighbours),
            rounds: Vec::new(),
            anchor: anchor.copied().map(Anchor::to_wire),
            fixes: Vec::new(),
        };
        for known in self.rounds.iter().rev().take(self.repeats + 1) {
            let Ok(back) = u8::try_from(round.index - known.index) else {
                break;
            };
            record.rounds.push(record::Round {
                back,
                ..known.round.clone()
            });
            let fixes = known.fixes.iter();
            record
                .fixes
                .extend(fixes.map(|fix| RoundFix { back, fix: *fix }));
        }
        let too_many = record.fixes.len().saturating_sub(FIXES_PER_RECORD_MAX);
        self.cut.add("fixes", too_many as u64);
        record.fixes.truncate(FIXES_PER_RECORD_MAX);
        while codec::body_bytes(&record) > RoundRecord::BYTES_MAX {
            // Repeated rounds go first, with their fixes, then the measurements of the farthest.
            if record.rounds.len() > 1
                && let Some(repeated) = record.rounds.pop()
            {
                record.fixes.retain(|fix| fix.back != repeated.back);
                self.cut.count("repeated_rounds");
            } else if record
                .rounds
                .first_mut()
                .and_then(|newest| newest.measured.pop())
                .is_some()
            {
                self.cut.count("measurements");
            } else {
                break;
            }
        }
        self.records = self.records.wrapping_add(1);
        let packet = codec::encode(self.envelope(self.records, round.instant), &record);
        let bytes = self.sendable(now, packet)?;
        Some((PacketKey::Odometry { from: self.me }, bytes))
    }

    /// An anonymous feature set to everybody.
    pub(crate) fn features(
        &mut self,
        now: Stamp,
        taken: Stamp,
        set: &FeatureSet,
    ) -> Option<(PacketKey, Vec<u8>)> {
        self.features = self.features.wrapping_add(1);
        let packet = codec::encode(self.envelope(self.features, taken), set);
        let bytes = self.sendable(now, packet)?;
        Some((PacketKey::Features { from: self.me }, bytes))
    }

    /// The packets that repeat others' rounds, in the round of an instant: as many in one as fit.
    pub(crate) fn relay(
        &mut self,
        now: Stamp,
        instant: Stamp,
        rounds: Vec<RelayedRound>,
    ) -> Vec<(PacketKey, Vec<u8>)> {
        let mut relays: Vec<Relay> = Vec::new();
        for mut round in rounds {
            // A round with so many measurements that it does not fit even alone is told without the farthest.
            while !fits(&relay(now, vec![round.clone()])) && round.round.measured.pop().is_some() {
                self.cut.count("measurements");
            }
            match relays.last_mut() {
                Some(last) => {
                    last.rounds.push(round);
                    if !fits(last)
                        && let Some(round) = last.rounds.pop()
                    {
                        relays.push(relay(now, vec![round]));
                    }
                }
                None => relays.push(relay(now, vec![round])),
            }
        }
        let packets = relays.iter().filter_map(|relay| {
            self.relays = self.relays.wrapping_add(1);
            let packet = codec::encode(self.envelope(self.relays, instant), relay);
            let bytes = self.sendable(now, packet)?;
            Some((PacketKey::Relay { from: self.me }, bytes))
        });
        packets.collect()
    }

    /// The packets of an answer: this vehicle's rounds after an instant. None when too many are asking.
    pub(crate) fn answer(&mut self, now: Stamp, since_ns: i64) -> Option<Vec<Vec<u8>>> {
        if !self.backlog.may_answer(now) {
            return None;
        }
        let answer = self.backlog.since(since_ns);
        self.cut.add("backlog_rounds", answer.cut);
        let packets = answer.packets.iter().filter_map(|backlog| {
            let newest_ns = backlog.rounds.last().map_or(since_ns, |last| last.taken_ns);
            self.backlogs = self.backlogs.wrapping_add(1);
            let envelope = self.envelope(self.backlogs, Stamp::from_nanos(newest_ns));
            self.counted(codec::encode(envelope, backlog))
        });
        Some(packets.collect())
    }

    /// The estimate in bytes.
    pub(crate) fn estimate(&mut self, taken: Stamp, estimate: &Estimate) -> Option<Vec<u8>> {
        self.estimates = self.estimates.wrapping_add(1);
        let packet = codec::encode(self.envelope(self.estimates, taken), estimate);
        self.counted(packet)
    }

    fn remember(&mut self, round: &Round, neighbours: &Neighbours) {
        let Some(odometry) = &round.odometry else {
            return;
        };
        let distance = |name: &Name| {
            neighbours
                .get(*name)
                .map_or(f64::INFINITY, |neighbour| neighbour.distance_m())
        };
        let mut measured: Vec<(f64, Addressed)> = Vec::new();
        for (name, list) in &round.measured {
            let addressed = |measured| {
                (
                    distance(name),
                    Addressed {
                        to: name.hash(),
                        measured,
                    },
                )
            };
            measured.extend(list.iter().copied().map(addressed));
        }
        measured.sort_by(|a, b| a.0.total_cmp(&b.0));
        self.cut.add(
            "measurements",
            measured.len().saturating_sub(MEASURED_PER_ROUND_MAX) as u64,
        );
        measured.truncate(MEASURED_PER_ROUND_MAX);
        let entry = record::Round {
            back: 0,
            segment: odometry.segment,
            odometry_from_body: odometry.odometry_from_body.to_numbers(),
            growth: translate::growth_to_wire(&odometry.growth),
            measured: measured
                .into_iter()
                .map(|(_, addressed)| addressed)
                .collect(),
        };
        let fixes = self.fixed(round);
        self.backlog.remember(BacklogRound {
            taken_ns: round.instant.as_nanos(),
            round: entry.clone(),
            fixes: fixes.clone(),
        });
        self.rounds.push_back(SaidRound {
            index: round.index,
            round: entry,
            fixes,
        });
        if self.rounds.len() > ROUNDS_PER_RECORD_MAX {
            self.rounds.pop_front();
        }
    }

    /// What was fixed in a round, as others are told.
    fn fixed(&mut self, round: &Round) -> Vec<Fixed> {
        let mut fixes = Vec::new();
        for fix in &round.fixes {
            match translate::fold_fix(&fix.value, &fix.body_from_sensor) {
                Ok(fixed) if fixes.len() < FIXES_PER_RECORD_MAX => fixes.push(fixed),
                Ok(_) | Err(_) => self.cut.count("fixes"),
            }
        }
        fixes
    }

    /// Whether the record of this round says where the vehicle was told to be: often at first, then now and then, for
    /// those who come later.
    fn is_due(&mut self, anchor: &Anchor) -> bool {
        let rounds = match self.anchor {
            Some((taken, rounds)) if taken == anchor.point.taken => rounds,
            _ => 0,
        };
        self.anchor = Some((anchor.point.taken, rounds + 1));
        rounds < ANCHOR_AT_FIRST_ROUNDS || rounds.is_multiple_of(ANCHOR_EVERY_ROUNDS)
    }

    /// Echoes of a few neighbours; the next ones take their turn in the next record.
    fn echoes(&mut self, now: Stamp, neighbours: &Neighbours) -> Vec<PeerEcho> {
        let fresh: Vec<PeerEcho> = neighbours
            .iter()
            .filter_map(|(name, neighbour)| Some((name, neighbour.to_echo()?)))
            .filter(|(_, echo)| now - Stamp::from_nanos(echo.received_ns) <= SENT_STAMPS_SPAN)
            .map(|(name, echo)| PeerEcho {
                to: name.hash(),
                heard_ns: echo.heard_ns,
                received_ns: echo.received_ns,
            })
            .collect();
        let count = fresh.len().min(ECHOES_PER_RECORD_MAX);
        let start = self.echo_turn;
        self.echo_turn = if fresh.is_empty() {
            0
        } else {
            (start + count) % fresh.len()
        };
        (0..count)
            .map(|turn| fresh[(start + turn) % fresh.len()])
            .collect()
    }

    const fn envelope(&self, sequence: u32, taken: Stamp) -> Envelope {
        Envelope {
            major: 0,
            minor: 0,
            body_bytes: 0,
            sequence,
            boot: self.boot,
            sender: self.hash,
            taken_ns: taken.as_nanos(),
        }
    }

    fn sendable(
        &mut self,
        now: Stamp,
        packet: Result<Vec<u8>, codec::EncodeError>,
    ) -> Option<Vec<u8>> {
        let bytes = self.counted(packet)?;
        self.sent.add(now);
        Some(bytes)
    }

    /// Every number that goes out was checked when it came in; should one break a limit all the same, the packet is
    /// not sent, and that is shown.
    fn counted(&mut self, packet: Result<Vec<u8>, codec::EncodeError>) -> Option<Vec<u8>> {
        packet.inspect_err(|_| self.cut.count("unsendable")).ok()
    }
}

const fn relay(now: Stamp, rounds: Vec<RelayedRound>) -> Relay {
    Relay {
        sent_ns: now.as_nanos(),
        rounds,
    }
}

fn fits(relay: &Relay) -> bool {
    relay.rounds.len() <= RELAYED_PER_PACKET_MAX && codec::body_bytes(relay) <= Relay::BYTES_MAX
}

#[cfg(test)]
mod tests {
    use super::*;

    use skein_estimation::odometry::{Growth, OdometryPoint};
    use skein_proto::frame::FixValue;
    use skein_proto::measured::{Measured, MeasuredValue};
    use std::collections::{BTreeMap, BTreeSet};

    use crate::rounds::Fix;
    use crate::told_pose::ToldPose;

    const PERIOD: Span = Span::millis(200);

    fn name(text: &str) -> Name {
        Name::parse(text).unwrap()
    }

    fn speech() -> Speech {
        Speech::new(name("v1"), 1, PERIOD, 3, &Transform::identity())
    }

    fn point(taken: Stamp) -> OdometryPoint {
        OdometryPoint {
            taken,
            segment: 0,
            odometry_from_body: Transform::identity(),
            growth: Growth::zero(),
        }
    }

    fn anchor(taken: Stamp) -> Anchor {
        Anchor::new(point(taken), ToldPose::exact(Transform::identity()), None)
    }

    /// A round in which so many neighbours were measured and so many heights fixed, the round's own number up.
    fn round(index: i64, neighbours: usize, fixes: usize) -> Round {
        let instant = Stamp::default() + PERIOD * index;
        let measured = Measured {
            taken_offset_us: 0,
            value: MeasuredValue::Pose {
                body_from_neighbour: [0.0; 6],
                rotation_sigma_rad: 0.1,
                translation_sigma_m: 0.1,
            },
        };
        let measured = (0..neighbours).map(|nth| (name(&format!("w{nth}")), vec![measured]));
        let fix = Fix {
            sensor: name("gps"),
            value: FixValue::Position {
                position_m: [0.0, 0.0, index as f64],
                sigma_m: 1.0,
            },
            body_from_sensor: Transform::identity(),
            taken_offset: Span::ZERO,
        };
        Round {
            index,
            instant,
            odometry: Some(point(instant)),
            measured: measured.collect::<BTreeMap<_, _>>(),
            fixes: vec![fix; fixes],
            told: BTreeSet::new(),
        }
    }

    fn say(speech: &mut Speech, round: &Round, anchor: Option<&Anchor>) -> RoundRecord {
        let neighbours = Neighbours::default();
        let (_, bytes) = speech
            .record(
                round.instant,
                round,
                Status::Tracking,
                None,
                &neighbours,
                anchor,
            )
            .unwrap();
        codec::decode(&bytes).unwrap().1
    }

    #[test]
    fn a_new_anchor_is_told_in_ten_rounds_and_then_in_one_of_five() {
        let mut speech = speech();
        let mut told_in = |rounds: std::ops::Range<i64>, anchor: &Anchor| -> Vec<i64> {
            rounds
                .filter(|index| {
                    let record = say(&mut speech, &round(*index, 0, 0), Some(anchor));
                    record.anchor.is_some()
                })
                .collect()
        };
        let first = anchor(Stamp::default());
        let later = anchor(Stamp::default() + Span::secs(5));
        let told: Vec<i64> = (0..10).chain([10, 15, 20]).collect();
        assert_eq!(told_in(0..25, &first), told);
        let told: Vec<i64> = (25..35).chain([35]).collect();
        assert_eq!(told_in(25..40, &later), told);
        assert_eq!(say(&mut speech, &round(40, 0, 0), None).anchor, None);
    }

    #[test]
    fn repeated_rounds_make_room_for_the_anchor_and_take_their_fixes_with_them() {
        let mut speech = speech();
        for index in 0..3 {
            say(&mut speech, &round(index, 2, 1), None);
        }
        let backs = |record: &RoundRecord| -> (Vec<u8>, Vec<u8>) {
            let rounds = record.rounds.iter().map(|round| round.back);
            let fixes = record.fixes.iter().map(|fix| fix.back);
            (rounds.collect(), fixes.collect())
        };
        let without = say(&mut speech, &round(3, 2, 1), None);
        assert_eq!(backs(&without), (vec![0, 1, 2], vec![0, 1, 2]));
        let before = speech.cut.to_document()["repeated_rounds"];
        let with = say(
            &mut speech,
            &round(4, 2, 1),
            Some(&anchor(Stamp::default())),
        );
        assert!(with.anchor.is_some());
        assert_eq!(backs(&with), (vec![0, 1], vec![0, 1]));
        assert_eq!(speech.cut.to_document()["repeated_rounds"] - before, 2);
    }

    #[test]
    fn the_newest_fixes_are_told_and_the_others_counted() {
        let mut speech = speech();
        say(&mut speech, &round(0, 0, 6), None);
        let record = say(&mut speech, &round(1, 0, 5), None);
        let heights = record.fixes.iter().map(|fix| match fix.fix {
            Fixed::Position { position_m, .. } => (fix.back, position_m[2]),
            _ => panic!("{fix:?}"),
        });
        let (newest, repeated) = (vec![(0, 1.0); 5], vec![(1, 0.0); 3]);
        assert_eq!(heights.collect::<Vec<_>>(), [newest, repeated].concat());
        assert_eq!(speech.cut.to_document()["fixes"], 3);
        // More in one round than a record holds.
        let record = say(&mut speech, &round(2, 0, 9), None);
        assert!(record.fixes.iter().all(|fix| fix.back == 0));
    }

    #[test]
    fn only_stamps_of_the_last_seconds_are_known_and_their_number_is_bounded() {
        let mut sent = SentStamps::default();
        for micros in 0..=SENT_STAMPS_MAX as i64 {
            sent.add(Stamp::default() + Span::micros(micros));
        }
        assert!(!sent.contains(Stamp::default()));
        assert!(sent.contains(Stamp::default() + Span::micros(1)));
        sent.add(Stamp::default() + Span::secs(6));
        assert!(!sent.contains(Stamp::default() + Span::micros(1)));
    }
}
