//! This vehicle's own last raw rounds, kept for neighbours that were out of reach.

use std::collections::VecDeque;

use skein_estimation::time::{Span, Stamp};
use skein_proto::backlog::{self, BacklogRound};
use skein_proto::codec;
use skein_proto::limits::{BACKLOG_BYTES_MAX, BACKLOG_ROUNDS_PER_PACKET_MAX};

/// Rounds kept: half a minute of them at the default period.
pub(crate) const BACKLOG_ROUNDS_MAX: usize = 150;
/// Packets in one answer.
pub(crate) const PACKETS_MAX: usize = 4;
/// Questions answered in one [`ANSWERS_SPAN`]: every neighbour that one talks to may ask once.
const ANSWERS_MAX: usize = 16;
const ANSWERS_SPAN: Span = Span::secs(1);

/// The rounds, and who was answered lately.
#[derive(Clone, Debug, Default)]
pub(crate) struct Backlog {
    rounds: VecDeque<BacklogRound>,
    answered: VecDeque<Stamp>,
}

/// The bodies of an answer.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Answer {
    /// The oldest rounds first.
    pub(crate) packets: Vec<backlog::Backlog>,
    /// Rounds that were asked for and did not fit: the oldest.
    pub(crate) cut: u64,
}

impl Backlog {
    pub(crate) fn remember(&mut self, round: BacklogRound) {
        self.rounds.push_back(round);
        if self.rounds.len() > BACKLOG_ROUNDS_MAX {
            self.rounds.pop_front();
        }
    }

    /// Whether one more question may be answered now; if so, it counts.
    pub(crate) fn may_answer(&mut self, now: Stamp) -> bool {
        let over = |at: &&Stamp| now - **at >= ANSWERS_SPAN;
        while self.answered.front().filter(over).is_some() {
            self.answered.pop_front();
        }
        let room = self.answered.len() < ANSWERS_MAX;
        if room {
            self.answered.push_back(now);
        }
        room
    }

    /// All rounds after an instant; where they do not fit the newest win. One packet at least, so that who asks knows that
    /// there is no more.
    pub(crate) fn since(&self, since_ns: i64) -> Answer {
        let asked = self.rounds.iter().rev();
        let mut asked = asked
            .take_while(|round| round.taken_ns > since_ns)
            .peekable();
        let mut packets: Vec<backlog::Backlog> = Vec::new();
        let mut behind = 0;
        while packets.len() < PACKETS_MAX && (packets.is_empty() || asked.peek().is_some()) {
            let mut rounds = Vec::new();
            let mut bytes = codec::body_bytes(&packet(Vec::new()));
            while let Some(round) = asked.peek() {
                bytes += round_bytes(round);
                if rounds.len() >= BACKLOG_ROUNDS_PER_PACKET_MAX || bytes > BACKLOG_BYTES_MAX {
                    break;
                }
                rounds.push((*round).clone());
                asked.next();
            }
            rounds.reverse();
            let count = u16::try_from(rounds.len()).unwrap_or(u16::MAX);
            packets.push(backlog::Backlog {
                remaining: behind,
                rounds,
            });
            behind += count;
        }
        packets.reverse();
        Answer {
            packets,
            cut: asked.count() as u64,
        }
    }
}

const fn packet(rounds: Vec<BacklogRound>) -> backlog::Backlog {
    backlog::Backlog {
        remaining: 0,
        rounds,
    }
}

/// How much a packet grows by a round.
fn round_bytes(round: &BacklogRound) -> usize {
    codec::body_bytes(&packet(vec![round.clone()])) - codec::body_bytes(&packet(Vec::new()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use skein_proto::codec::Body;
    use skein_proto::growth::Growth;
    use skein_proto::measured::{Measured, MeasuredValue};
    use skein_proto::record::{Addressed, Round};

    /// The round of one second, in which so many neighbours were measured.
    fn round(taken_s: i64, neighbours: usize) -> BacklogRound {
        let measured = Addressed {
            to: 2,
            measured: Measured {
                taken_offset_us: 0,
                value: MeasuredValue::Pose {
                    body_from_neighbour: [0.0; 6],
                    rotation_sigma_rad: 0.1,
                    translation_sigma_m: 0.1,
                },
            },
        };
        BacklogRound {
            taken_ns: taken_s * 1_000_000_000,
            round: Round {
                back: 0,
                segment: 0,
                odometry_from_body: [0.0; 6],
                growth: Growth::Isotropic([0.0; 11]),
                measured: vec![measured; neighbours],
            },
            fixes: Vec::new(),
        }
    }

    fn backlog(rounds: i64, neighbours: usize) -> Backlog {
        let mut backlog = Backlog::default();
        for taken_s in 1..=rounds {
            backlog.remember(round(taken_s, neighbours));
        }
        backlog
    }

    /// The seconds of the rounds in each packet, and how many remain after it.
    fn told(answer: &Answer) -> Vec<(Vec<i64>, u16)> {
        let seconds = |round: &BacklogRound| round.taken_ns / 1_000_000_000;
        let packets = answer.packets.iter();
        packets
            .map(|packet| {
                assert_eq!(packet.check(), Ok(()));
                assert!(codec::body_bytes(packet) <= BACKLOG_BYTES_MAX);
                (
                    packet.rounds.iter().map(seconds).collect(),
                    packet.remaining,
                )
            })
            .collect()
    }

    #[test]
    fn rounds_after_an_instant_are_told_the_oldest_first() {
        let answer = backlog(6, 1).since(3_000_000_000);
        assert_eq!(told(&answer), [(vec![4, 5, 6], 0)]);
        assert_eq!(answer.cut, 0);
        let nothing = backlog(6, 1).since(6_000_000_000);
        assert_eq!(told(&nothing), [(vec![], 0)]);
    }

    #[test]
    fn what_does_not_fit_one_packet_comes_in_the_next_and_each_says_what_remains() {
        let answer = backlog(1_000, 0).since(0);
        let (first, last) = ((851..=900).collect(), (901..=1_000).collect());
        assert_eq!(told(&answer), [(first, 100), (last, 0)]);
        assert_eq!(answer.cut, 0, "older ones are not kept");
    }

    #[test]
    fn where_the_answer_is_too_long_the_newest_rounds_win() {
        let answer = backlog(150, 16).since(0);
        let told = told(&answer);
        assert_eq!(told.len(), PACKETS_MAX);
        let seconds: Vec<i64> = told.iter().flat_map(|(rounds, _)| rounds.clone()).collect();
        let oldest = 150 - seconds.len() as i64 + 1;
        assert_eq!(seconds, (oldest..=150).collect::<Vec<_>>());
        assert_eq!(answer.cut, 150 - seconds.len() as u64);
        assert!((40..60).contains(&seconds.len()), "{}", seconds.len());
        let behind = told[1..]
            .iter()
            .map(|(rounds, _)| rounds.len())
            .sum::<usize>();
        assert_eq!(usize::from(told[0].1), behind);
    }

    #[test]
    fn so_many_questions_are_answered_in_a_second_and_no_more() {
        let mut backlog = Backlog::default();
        let at = |millis| Stamp::default() + Span::millis(millis);
        for nth in 0..ANSWERS_MAX as i64 {
            assert!(backlog.may_answer(at(nth * 10)));
        }
        assert!(!backlog.may_answer(at(999)));
        assert!(backlog.may_answer(at(1_000)));
        assert!(!backlog.may_answer(at(1_001)));
    }
}
