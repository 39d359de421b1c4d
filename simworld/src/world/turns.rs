//! How far along its path a vehicle is that stands still when it may not move: its path waits for it.

use std::collections::VecDeque;

/// Times of standing that are remembered one by one: those of the last minutes.
const STANDS_MAX: usize = 64;

/// Path time of one vehicle, nanoseconds.
#[derive(Clone, Debug, Default)]
pub(super) struct Turns {
    /// From when to when it stood; the last may not have ended.
    stands: VecDeque<(i64, Option<i64>)>,
    /// How long it stood before those.
    stood_ns: i64,
}

impl Turns {
    /// From a time on it moves, or stands. Times never go back.
    pub(super) fn told(&mut self, at_ns: i64, moves: bool) {
        let stands = self.stands.back().is_some_and(|(_, end)| end.is_none());
        if stands != moves {
            return;
        }
        if !moves {
            self.stands.push_back((at_ns, None));
        } else if let Some((_, end)) = self.stands.back_mut() {
            *end = Some(at_ns);
        }
        if self.stands.len() > STANDS_MAX
            && let Some((from_ns, Some(to_ns))) = self.stands.pop_front()
        {
            self.stood_ns += to_ns - from_ns;
        }
    }

    /// Which time of its path the vehicle has reached at a time.
    pub(super) fn path_ns(&self, at_ns: i64) -> i64 {
        let stood = |(from_ns, to_ns): &(i64, Option<i64>)| {
            let until_ns = to_ns.map_or(at_ns, |to_ns| to_ns.min(at_ns));
            (until_ns - from_ns).max(0)
        };
        at_ns - self.stood_ns - self.stands.iter().map(stood).sum::<i64>()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_waits_while_its_vehicle_stands() {
        let mut turns = Turns::default();
        assert_eq!(turns.path_ns(50), 50);
        turns.told(100, false);
        turns.told(110, false);
        assert_eq!((turns.path_ns(90), turns.path_ns(170)), (90, 100));
        turns.told(180, true);
        assert_eq!((turns.path_ns(150), turns.path_ns(200)), (100, 120));
    }

    #[test]
    fn what_is_forgotten_of_long_ago_was_stood_all_the_same() {
        let mut turns = Turns::default();
        for nth in 0..2 * STANDS_MAX as i64 {
            turns.told(nth * 10, false);
            turns.told(nth * 10 + 5, true);
        }
        assert_eq!(turns.stands.len(), STANDS_MAX);
        let end_ns = 2 * STANDS_MAX as i64 * 10;
        assert_eq!(turns.path_ns(end_ns), end_ns / 2);
    }
}
