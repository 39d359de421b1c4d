//! The sequence numbers of one boot: which packets are new, which come late, and which were heard before.
//!
//! Serial-number arithmetic with a bounded jump and resynchronisation (RFC 3550, appendix A.1), and a window of what was
//! heard lately (RFC 4303, section 3.4.3). A number that jumps far proves nothing: it is only followed when two packets
//! in order bring it together with proof that their sender is alive, so that no forged number mutes a sender for ever
//! and no replay turns the count back.

/// Numbers that may be missing before a packet is out of sequence.
const JUMP_MAX: u32 = 3_000;
/// How far behind the newest a packet may come and still be told from one that was heard.
const WINDOW: u32 = u64::BITS;

/// Which of the counts a packet belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Exchange,
    Odometry,
    Features,
    Relay,
}

impl Kind {
    /// One word for counters.
    pub(crate) const fn word(self) -> &'static str {
        match self {
            Self::Exchange => "exchange",
            Self::Odometry => "odometry",
            Self::Features => "features",
            Self::Relay => "relay",
        }
    }
}

/// What a sequence number says of its packet.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Novelty {
    /// It is the newest.
    New,
    /// Newer ones came before it; its content may still be of use, but it says nothing of the present.
    Late,
    /// It was heard before.
    Repeated,
    /// Its number is too far from any that is expected.
    Astray,
}

/// The counts of all kinds of messages of one boot.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Sequences {
    exchange: Sequence,
    odometry: Sequence,
    features: Sequence,
    relay: Sequence,
}

impl Sequences {
    /// Takes the number of a packet; `proves` says whether the packet proves that its sender is alive now.
    pub(crate) fn take(&mut self, kind: Kind, number: u32, proves: bool) -> Novelty {
        let sequence = match kind {
            Kind::Exchange => &mut self.exchange,
            Kind::Odometry => &mut self.odometry,
            Kind::Features => &mut self.features,
            Kind::Relay => &mut self.relay,
        };
        sequence.take(number, proves)
    }
}

/// One count.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sequence {
    newest: Option<u32>,
    /// Bit `n`: whether `newest - n` was heard.
    heard: u64,
    /// The last number out of sequence that came with proof.
    candidate: Option<u32>,
}

impl Sequence {
    fn take(&mut self, number: u32, proves: bool) -> Novelty {
        let Some(newest) = self.newest else {
            return self.begin(number);
        };
        let ahead = number.wrapping_sub(newest);
        let behind = newest.wrapping_sub(number);
        if behind < WINDOW {
            let bit = 1 << behind;
            let known = self.heard & bit != 0;
            self.heard |= bit;
            return if known {
                Novelty::Repeated
            } else {
                Novelty::Late
            };
        }
        if ahead <= JUMP_MAX {
            self.heard = self.heard.checked_shl(ahead).unwrap_or(0) | 1;
            self.newest = Some(number);
            self.candidate = None;
            return Novelty::New;
        }
        if !proves {
            return Novelty::Astray;
        }
        let follows = |candidate: u32| (1..=JUMP_MAX).contains(&number.wrapping_sub(candidate));
        if self.candidate.is_some_and(follows) {
            return self.begin(number);
        }
        self.candidate = Some(number);
        Novelty::Astray
    }

    fn begin(&mut self, number: u32) -> Novelty {
        *self = Self {
            newest: Some(number),
            // What was overtaken by the first number is not told from a lie, and of no use yet.
            heard: u64::MAX,
            candidate: None,
        };
        Novelty::New
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Novelty::{Astray, Late, New, Repeated};

    fn after(numbers: impl IntoIterator<Item = u32>) -> Sequence {
        let mut sequence = Sequence::default();
        for number in numbers {
            sequence.take(number, true);
        }
        sequence
    }

    #[test]
    fn numbers_that_rise_are_new_also_over_gaps_and_over_the_end_of_the_count() {
        let mut sequence = Sequence::default();
        for number in [
            u32::MAX - 70,
            u32::MAX - 1,
            u32::MAX,
            0,
            1,
            900,
            900 + JUMP_MAX,
        ] {
            assert_eq!(sequence.take(number, false), New, "{number}");
        }
    }

    #[test]
    fn what_was_heard_is_repeated_and_what_was_overtaken_is_late_once() {
        let mut sequence = after([u32::MAX - 3, u32::MAX - 1, 1]);
        for (number, expected) in [
            (1, Repeated),
            (u32::MAX - 1, Repeated),
            (0, Late),
            (0, Repeated),
            (u32::MAX, Late),
            (u32::MAX - 3, Repeated),
            (2, New),
            (u32::MAX, Repeated),
        ] {
            assert_eq!(sequence.take(number, false), expected, "{number}");
        }
    }

    #[test]
    fn the_window_and_the_jump_end_where_they_say() {
        let known = after(1_000..=1_100);
        for (number, expected) in [
            (1_100 - (WINDOW - 1), Repeated),
            (1_100 - WINDOW, Astray),
            (1_100 + JUMP_MAX, New),
            (1_100 + JUMP_MAX + 1, Astray),
        ] {
            assert_eq!(known.clone().take(number, false), expected, "{number}");
        }
    }

    #[test]
    fn a_forged_number_far_ahead_mutes_nobody_even_if_it_looks_alive() {
        let mut sequence = after(1_000..=1_009);
        assert_eq!(sequence.take(u32::MAX, true), Astray);
        assert_eq!(sequence.take(1 << 31, true), Astray);
        assert_eq!(sequence.take(1_010, false), New);
        let mut just_begun = after([1]);
        assert_eq!(just_begun.take(u32::MAX, true), Repeated);
        assert_eq!(just_begun.take(2, false), New);
    }

    #[test]
    fn a_sender_muted_by_a_forged_number_is_heard_again_by_its_second_proof() {
        let mut sequence = after([5]);
        // Near enough to be believed.
        assert_eq!(sequence.take(2_000, false), New);
        assert_eq!(sequence.take(6, true), Astray);
        assert_eq!(sequence.take(7, false), Astray, "a record without our echo");
        assert_eq!(sequence.take(8, true), New);
        assert_eq!(sequence.take(9, false), New);
    }

    #[test]
    fn replays_without_proof_never_turn_the_count_back() {
        let mut sequence = after(0..=500);
        for number in 0..=500 - WINDOW {
            assert_eq!(sequence.take(number, false), Astray, "{number}");
        }
        assert_eq!(sequence.take(501, false), New);
    }

    #[test]
    fn the_bits_of_a_long_gap_are_forgotten() {
        let mut sequence = after([0, 1, 64]);
        assert_eq!(sequence.take(1, false), Repeated);
        assert_eq!(sequence.take(2, false), Late);
        assert_eq!(sequence.take(u32::MAX, false), Astray);
        sequence.take(300, false);
        assert_eq!(sequence.take(299, false), Late);
    }
}
