//! A hole in what was heard of a neighbour, and the question for what is missing in it: when it may be asked, and which
//! answer is one.

use skein_estimation::time::{Span, Stamp};

use crate::clock::PeerStamp;

/// A neighbour is asked no more often than this; one that has not answered by then may be asked again.
const ASK_EVERY: Span = Span::secs(1);
/// How long an answer may take.
const ANSWER_WITHIN: Span = Span::secs(3);
/// Questions for one hole; what is missing then is not to be had.
const QUESTIONS_MAX: u32 = 5;

/// What is missing of one boot of a neighbour.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Asking {
    hole: Option<Hole>,
    asked_at: Option<Stamp>,
    /// How often this hole was asked for.
    questions: u32,
}

/// Between two instants, on the neighbour's clock, nothing was heard.
#[derive(Clone, Copy, Debug)]
struct Hole {
    after: PeerStamp,
    before: PeerStamp,
}

impl Asking {
    /// A record came whose oldest round is `oldest`, where `newest` was the newest round known. If there is room for another
    /// between the two, something is missing. A second hole beside one that is still open makes it wider.
    pub(crate) fn note(&mut self, newest: PeerStamp, oldest: PeerStamp, period: Span) {
        let a_round_is_missing = Span::from_nanos(period.as_nanos() / 2) + period;
        if oldest.since(newest) < a_round_is_missing {
            return;
        }
        let after = self.hole.map_or(newest, |hole| hole.after.min(newest));
        self.hole = Some(Hole {
            after,
            before: oldest,
        });
        self.questions = 0;
    }

    /// The instant after which rounds are to be asked for now; then it counts as asked.
    pub(crate) fn ask(&mut self, now: Stamp) -> Option<PeerStamp> {
        let hole = self.hole?;
        if self.asked_at.is_some_and(|at| now - at < ASK_EVERY) {
            return None;
        }
        if self.questions >= QUESTIONS_MAX {
            if !self.expects(now) {
                self.close();
            }
            return None;
        }
        self.asked_at = Some(now);
        self.questions += 1;
        Some(hole.after)
    }

    /// Whether an answer may come now.
    pub(crate) fn expects(&self, now: Stamp) -> bool {
        let lately = self.asked_at.is_some_and(|at| now - at <= ANSWER_WITHIN);
        self.hole.is_some() && self.questions > 0 && lately
    }

    /// Whether an instant lies in the hole.
    pub(crate) fn misses(&self, instant: PeerStamp) -> bool {
        self.hole
            .is_some_and(|hole| hole.after < instant && instant < hole.before)
    }

    /// All that is to be had has come.
    pub(crate) fn close(&mut self) {
        self.hole = None;
        self.questions = 0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: Span = Span::millis(200);

    fn at(millis: i64) -> Stamp {
        Stamp::default() + Span::millis(millis)
    }

    fn theirs(millis: i64) -> PeerStamp {
        PeerStamp::from_nanos(millis * 1_000_000)
    }

    #[test]
    fn only_where_a_round_is_missing_is_there_a_hole() {
        let mut asking = Asking::default();
        asking.note(theirs(200), theirs(400), PERIOD);
        asking.note(theirs(400), theirs(401), PERIOD);
        asking.note(theirs(600), theirs(200), PERIOD);
        assert_eq!(asking.ask(at(0)), None);
        asking.note(theirs(600), theirs(1_000), PERIOD);
        assert_eq!(asking.ask(at(0)), Some(theirs(600)));
        assert!(asking.misses(theirs(800)));
        assert!(!asking.misses(theirs(600)) && !asking.misses(theirs(1_000)));
    }

    #[test]
    fn a_hole_is_asked_for_once_a_second_and_five_times_at_most() {
        let mut asking = Asking::default();
        asking.note(theirs(200), theirs(5_000), PERIOD);
        let asked: Vec<i64> = (0..100)
            .map(|tenth| tenth * 100)
            .filter(|millis| asking.ask(at(*millis)).is_some())
            .collect();
        assert_eq!(asked, [0, 1_000, 2_000, 3_000, 4_000]);
        assert!(!asking.misses(theirs(1_000)), "it is given up");
    }

    #[test]
    fn an_answer_is_one_within_three_seconds_of_its_question() {
        let mut asking = Asking::default();
        asking.note(theirs(200), theirs(5_000), PERIOD);
        assert!(!asking.expects(at(0)), "nobody asked");
        asking.ask(at(0)).unwrap();
        assert!(asking.expects(at(3_000)) && !asking.expects(at(3_001)));
        asking.close();
        assert!(!asking.expects(at(1)));
        // The next hole has to be asked for itself.
        asking.note(theirs(6_000), theirs(7_000), PERIOD);
        assert!(!asking.expects(at(2)));
        assert_eq!(asking.ask(at(500)), None, "one question a second");
        assert_eq!(asking.ask(at(1_000)), Some(theirs(6_000)));
    }

    #[test]
    fn a_second_hole_widens_the_first() {
        let mut asking = Asking::default();
        asking.note(theirs(200), theirs(1_000), PERIOD);
        asking.ask(at(0)).unwrap();
        asking.note(theirs(1_200), theirs(3_000), PERIOD);
        assert_eq!(asking.ask(at(1_000)), Some(theirs(200)));
        assert!(asking.misses(theirs(600)) && asking.misses(theirs(2_000)));
    }
}
