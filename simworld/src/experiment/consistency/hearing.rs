//! Who hears which round of whom, and when: what loss, repeats and delay leave of everybody's packets.
//!
//! A vehicle sends one packet a round. It carries that round and repeats the rounds before it, so a round arrives with
//! the first packet that is heard of those that carry it, late rounds late, or never.

use crate::streams::{Purpose, Streams};
use rand::RngExt;

/// What happens to packets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Air {
    /// The probability that a packet is lost, for each receiver by itself.
    pub loss: f64,
    /// How many rounds before its own a packet repeats.
    pub repeats: usize,
    /// Rounds that a packet takes.
    pub delay_rounds: usize,
    /// Rounds in which the two halves of the team, vehicles of even and of odd numbers, are out of each other's reach.
    pub apart_rounds: usize,
}

impl Air {
    /// Everything is heard at once.
    pub const PERFECT: Self = Self {
        loss: 0.0,
        repeats: 0,
        delay_rounds: 0,
        apart_rounds: 0,
    };

    /// Whether everybody hears everything at once.
    #[must_use]
    pub fn is_perfect(&self) -> bool {
        self.loss <= 0.0 && self.delay_rounds == 0 && self.apart_rounds == 0
    }
}

/// Whether two vehicles are of the same half of their team.
#[must_use]
pub const fn is_one_half(a: usize, b: usize) -> bool {
    a % 2 == b % 2
}

/// What everybody hears in one flight.
#[derive(Clone, Debug, PartialEq)]
pub struct Hearing {
    /// In which round: `[receiver][sender][k]`.
    arrivals: Vec<Vec<Vec<Option<usize>>>>,
}

impl Hearing {
    /// Of a flight of so many vehicles whose last round is `last`. Everybody hears itself, and knows where everybody
    /// starts.
    #[must_use]
    pub fn new(air: &Air, team: usize, last: usize, streams: &Streams) -> Self {
        let of_pair = |receiver: usize, sender: usize| -> Vec<Option<usize>> {
            if receiver == sender {
                return (0..=last).map(Some).collect();
            }
            let mut stream = streams.pair(sender, receiver, Purpose::Radio);
            let is_apart = |k: usize| k < air.apart_rounds && !is_one_half(receiver, sender);
            let is_heard: Vec<bool> = (0..=last)
                .map(|k| (stream.random::<f64>() >= air.loss && !is_apart(k)) || k == 0)
                .collect();
            let arrival = |k: usize| {
                let carriers = k..=(k + air.repeats).min(last);
                let first = carriers.into_iter().find(|carrier| is_heard[*carrier])?;
                let round = if k == 0 { 0 } else { first + air.delay_rounds };
                (round <= last).then_some(round)
            };
            (0..=last).map(arrival).collect()
        };
        let of_receiver =
            |receiver: usize| (0..team).map(|sender| of_pair(receiver, sender)).collect();
        Self {
            arrivals: (0..team).map(of_receiver).collect(),
        }
    }

    /// In which round a receiver hears what a sender said of round `k`.
    #[must_use]
    pub fn arrival(&self, receiver: usize, sender: usize, k: usize) -> Option<usize> {
        self.arrivals[receiver][sender][k]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOSSY: Air = Air {
        loss: 0.3,
        ..Air::PERFECT
    };

    fn hearing(air: &Air) -> Hearing {
        Hearing::new(air, 2, 2000, &Streams::new(1, 0))
    }

    fn unheard(hearing: &Hearing) -> f64 {
        let unheard = (0..=2000).filter(|k| hearing.arrival(0, 1, *k).is_none());
        unheard.count() as f64 / 2001.0
    }

    #[test]
    fn over_a_perfect_air_every_round_is_heard_at_once() {
        let hearing = hearing(&Air::PERFECT);
        assert!((0..=2000).all(|k| hearing.arrival(0, 1, k) == Some(k)));
    }

    #[test]
    fn of_three_packets_in_ten_nothing_is_heard_and_of_oneself_everything() {
        let hearing = hearing(&LOSSY);
        assert!((unheard(&hearing) - 0.3).abs() < 0.03);
        assert!((0..=2000).all(|k| hearing.arrival(1, 1, k) == Some(k)));
        assert!(
            (0..=2000).any(|k| hearing.arrival(0, 1, k) != hearing.arrival(1, 0, k)),
            "each receiver loses its own"
        );
    }

    #[test]
    fn a_repeated_round_comes_with_the_next_packet_that_is_heard() {
        let (once, repeated) = (
            hearing(&LOSSY),
            hearing(&Air {
                repeats: 3,
                ..LOSSY
            }),
        );
        for k in 0..=1990 {
            let packets = (k..=k + 3).find(|packet| once.arrival(0, 1, *packet).is_some());
            assert_eq!(repeated.arrival(0, 1, k), packets, "round {k}");
        }
        // Four in a row: 0.3^4.
        assert!(unheard(&repeated) < 0.02);
    }

    #[test]
    fn two_halves_that_are_apart_hear_each_other_from_when_they_meet_and_know_the_starts() {
        let air = Air {
            apart_rounds: 100,
            ..Air::PERFECT
        };
        let hearing = Hearing::new(&air, 3, 200, &Streams::new(1, 0));
        for k in 0..=200 {
            let heard = (k == 0 || k >= 100).then_some(k);
            assert_eq!(hearing.arrival(0, 1, k), heard);
            assert_eq!(hearing.arrival(0, 2, k), Some(k));
        }
        assert!(!air.is_perfect());
    }

    #[test]
    fn a_delayed_round_is_heard_so_much_later_or_after_the_end() {
        let delayed = hearing(&Air {
            delay_rounds: 2,
            ..Air::PERFECT
        });
        assert_eq!(delayed.arrival(0, 1, 7), Some(9));
        assert_eq!(delayed.arrival(0, 1, 1999), None);
    }
}
