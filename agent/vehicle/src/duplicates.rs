//! Two processes under one name: what proves that a boot is alive, and when two of them are duplicates.

use skein_estimation::time::{Span, Stamp};

use crate::sequence::{Kind, Novelty, Sequences};

/// How long two boots of one name may overlap when one takes over from the other.
pub(crate) const HANDOVER: Span = Span::millis(500);
/// How long a boot must be silent before it is gone.
pub(crate) const SILENCE: Span = Span::secs(5);
/// Boots of one name known at most.
pub(crate) const BOOTS_MAX: usize = 4;

/// Proof that a boot is alive: it named stamps of ours, each newer than the one before. Nobody can have known such a
/// stamp before we sent it, so a recording proves nothing: neither an echo that was heard before nor one of a stamp
/// older than the last.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Life {
    proven: Option<Proven>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
struct Proven {
    /// When the first proof reached us: from then on the boot counts.
    first: Stamp,
    /// When the last one did.
    last: Stamp,
    /// The newest stamp of ours that it named.
    named: Stamp,
}

impl Life {
    /// Whether naming this stamp of ours is a proof.
    pub(crate) fn would_prove(&self, sent: Stamp) -> bool {
        self.proven.is_none_or(|proven| sent > proven.named)
    }

    /// Takes a proof.
    pub(crate) fn prove(&mut self, now: Stamp, sent: Stamp) {
        let first = self.proven.map_or(now, |proven| proven.first);
        self.proven = Some(Proven {
            first,
            last: now,
            named: sent,
        });
    }

    /// Since when the boot counts.
    pub(crate) fn counts_since(&self) -> Option<Stamp> {
        self.proven.map(|proven| proven.first)
    }

    /// When it last proved that it is alive.
    pub(crate) fn last(&self) -> Option<Stamp> {
        self.proven.map(|proven| proven.last)
    }

    /// Whether its last proof is that long ago; also when it never gave any.
    pub(crate) fn is_silent(&self, now: Stamp, since: Span) -> bool {
        self.last().is_none_or(|last| now - last >= since)
    }

    /// Whether this boot and a newer one are both alive and no hand-over is under way: this one named a stamp that we
    /// sent *after* the newer one counted. However long its packets were under way, a dead process cannot have done so.
    pub(crate) fn outlives(&self, newer: &Self, now: Stamp) -> bool {
        let (Some(older), Some(newer)) = (self.proven, newer.proven) else {
            return false;
        };
        older.first < newer.first
            && older.named > newer.first
            && older.last - newer.first >= HANDOVER
            && now - newer.last < SILENCE
    }
}

/// Other processes under this vehicle's own name.
#[derive(Clone, Debug, Default)]
pub(crate) struct Namesakes(Vec<Namesake>);

#[derive(Clone, Copy, Debug)]
struct Namesake {
    boot: u64,
    sequences: Sequences,
    first: Stamp,
    last: Stamp,
}

impl Namesake {
    /// Packets of the process before this one may still be under way when it starts, but not for so long. A namesake
    /// says nothing to this vehicle that could prove more.
    fn is_alive(&self, now: Stamp) -> bool {
        self.last - self.first >= HANDOVER && now - self.last < SILENCE
    }
}

impl Namesakes {
    /// Notes a packet of another boot of this vehicle's name. Tells whether that one is alive.
    pub(crate) fn note(&mut self, now: Stamp, boot: u64, kind: Kind, sequence: u32) -> bool {
        self.0.retain(|known| now - known.last < SILENCE);
        let at = match self.0.iter().position(|known| known.boot == boot) {
            Some(at) => at,
            None => {
                if self.0.len() >= BOOTS_MAX {
                    self.0.remove(0);
                }
                self.0.push(Namesake {
                    boot,
                    sequences: Sequences::default(),
                    first: now,
                    last: now,
                });
                self.0.len() - 1
            }
        };
        let known = &mut self.0[at];
        if known.sequences.take(kind, sequence, false) == Novelty::New {
            known.last = now;
        }
        known.is_alive(now)
    }

    /// The boot of another process that flies under this vehicle's name now.
    pub(crate) fn alive(&self, now: Stamp) -> Option<u64> {
        let alive = self.0.iter().find(|known| known.is_alive(now));
        alive.map(|known| known.boot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(millis: i64) -> Stamp {
        Stamp::default() + Span::millis(millis)
    }

    /// A boot that named a stamp of each `(sent, received)`.
    fn life(proofs: impl IntoIterator<Item = (i64, i64)>) -> Life {
        let mut life = Life::default();
        for (sent, received) in proofs {
            assert!(life.would_prove(at(sent)));
            life.prove(at(received), at(sent));
        }
        life
    }

    #[test]
    fn a_stamp_named_before_and_an_older_one_prove_nothing() {
        let life = life([(100, 110), (300, 310)]);
        assert!(!life.would_prove(at(300)) && !life.would_prove(at(200)));
        assert!(life.would_prove(at(301)));
        assert_eq!(life.counts_since(), Some(at(110)));
    }

    #[test]
    fn two_boots_that_both_go_on_are_duplicates_half_a_second_after_the_second_counted() {
        let newer = life([(900, 1_000), (1_100, 1_200), (1_300, 1_400)]);
        let until = |last: i64| life((0..=last / 200).map(|k| (k * 200, k * 200 + 50)));
        assert!(!until(1_400).outlives(&newer, at(1_450)));
        assert!(until(1_600).outlives(&newer, at(1_650)));
        assert!(!newer.outlives(&until(1_600), at(1_650)), "it came later");
    }

    #[test]
    fn packets_of_a_dead_boot_prove_nothing_however_late_they_come() {
        let newer = life([(900, 1_000), (1_100, 1_200)]);
        let dead = life([(100, 150), (980, 1_900)]);
        assert!(!dead.outlives(&newer, at(1_900)));
    }

    #[test]
    fn a_newer_boot_that_fell_silent_is_nobody_s_duplicate() {
        let newer = life([(900, 1_000)]);
        let older = life([(100, 150), (5_900, 6_000)]);
        assert!(!older.outlives(&newer, at(6_000)));
    }

    #[test]
    fn the_last_packets_of_the_process_before_are_no_namesake_and_one_that_goes_on_is() {
        let mut namesakes = Namesakes::default();
        for k in 0..3 {
            assert!(!namesakes.note(at(k * 200), 7, Kind::Odometry, 50 + k as u32));
        }
        // The same packets again and again, however long: a replay is nobody.
        assert!(!namesakes.note(at(900), 7, Kind::Odometry, 52));
        assert_eq!(namesakes.alive(at(900)), None);
        assert!(namesakes.note(at(1_000), 7, Kind::Odometry, 53));
        assert_eq!(namesakes.alive(at(1_000)), Some(7));
        assert_eq!(namesakes.alive(at(6_000)), None, "it fell silent");
    }

    #[test]
    fn namesakes_are_bounded() {
        let mut namesakes = Namesakes::default();
        for boot in 0..10_000 {
            namesakes.note(at(0), boot, Kind::Odometry, 1);
        }
        assert_eq!(namesakes.0.len(), BOOTS_MAX);
    }
}
