//! A neighbour's clock: its stamps are another type until echoes of four time stamps each, or a relay that has them, tell
//! how far its clock is from ours. Echoes that queued do not move it, a single lie does not move it, and a step begins it anew.

use std::collections::VecDeque;

use skein_estimation::time::{Span, Stamp};

/// Echoes needed before anything of a neighbour is used.
pub(crate) const ECHOES_MIN: u64 = 4;
/// Longest round trip of an echo that is believed; it covers an echo that waited its turn in a round record.
const ROUND_TRIP_MAX: Span = Span::secs(5);
/// How fast two clocks part at most, in parts per million: twice what a poor crystal does.
const DRIFT_MAX_PPM: i64 = 200;
/// Two echoes may contradict each other by so much more than their bounds allow before a clock is said to have stepped.
const STEP_MARGIN: Span = Span::millis(5);
/// The best of so many echoes is believed; six seconds of them at one a round.
const WINDOW: usize = 32;
/// So many contradictions in a row end what was known, even if they contradict each other too.
const DOUBTS_MAX: u32 = 5;

/// An instant on a neighbour's clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PeerStamp(Stamp);

impl PeerStamp {
    pub(crate) const fn from_nanos(nanos: i64) -> Self {
        Self(Stamp::from_nanos(nanos))
    }

    pub(crate) fn since(self, earlier: Self) -> Span {
        self.0 - earlier.0
    }

    pub(crate) fn plus(self, span: Span) -> Self {
        Self(self.0 + span)
    }

    /// For a track that is kept wholly in the neighbour's time.
    pub(crate) const fn on_its_own_clock(self) -> Stamp {
        self.0
    }
}

/// The four time stamps of one echo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct FourStamps {
    /// When we sent a packet.
    pub(crate) sent: Stamp,
    /// When the neighbour received it.
    pub(crate) heard: PeerStamp,
    /// When the neighbour sent the echo.
    pub(crate) echoed: PeerStamp,
    /// When the echo reached us.
    pub(crate) received: Stamp,
}

/// How far off the offset of one echo can be: its packets took some time each way, and nobody knows which took longer;
/// since then the clocks may have drifted apart.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Sample {
    offset: Span,
    round_trip: Span,
    taken: Stamp,
}

impl Sample {
    fn of(stamps: &FourStamps) -> Option<Self> {
        let waited = stamps.echoed.since(stamps.heard);
        let round_trip = (stamps.received - stamps.sent) - waited;
        if waited < Span::ZERO || round_trip < Span::ZERO || round_trip > ROUND_TRIP_MAX {
            return None;
        }
        // offset = ((heard - sent) + (echoed - received)) / 2, each difference across the two clocks; halved first,
        // so that clocks that are ages apart do not overflow.
        let there = stamps.heard.on_its_own_clock() - stamps.sent;
        let back = stamps.echoed.on_its_own_clock() - stamps.received;
        Some(Self {
            offset: Span::from_nanos(there.as_nanos().midpoint(back.as_nanos())),
            round_trip,
            taken: stamps.received,
        })
    }

    /// |error| <= round_trip / 2 + drift * age: a law while no clock steps, since no packet arrives before it is sent.
    fn error_bound(&self, now: Stamp) -> Span {
        let age = (now - self.taken).as_nanos().max(0);
        let drift_ns = age / 1_000_000 * DRIFT_MAX_PPM;
        Span::from_nanos(self.round_trip.as_nanos() / 2) + Span::from_nanos(drift_ns)
    }

    /// Whether one clock that keeps its pace can have given both.
    fn agrees(&self, other: &Self, now: Stamp) -> bool {
        let allowed = self.error_bound(now) + other.error_bound(now) + STEP_MARGIN;
        (self.offset - other.offset).abs() <= allowed
    }
}

/// What an echo told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Observed {
    /// It agrees with what is known.
    Taken,
    /// Its times are impossible: nothing is changed.
    Impossible,
    /// It contradicts what is known, alone: the offset stays.
    Doubted,
    /// Others before it contradicted too: one of the two clocks stepped. Everything begins again from here.
    Stepped,
}

/// What is known of the clock of one boot of one neighbour.
///
/// The offset held is the middle of what the last echoes have in common, or, when they have nothing, that of the echo
/// with the least error bound (the clock filter of RFC 5905, section 10): packets that queued on their way do not move
/// it. The window ends a lie, or an echo during which a clock stepped by little, that only looks good.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct PeerClock {
    echoes: u64,
    window: VecDeque<Sample>,
    best: Option<Sample>,
    doubted: Option<Sample>,
    doubts: u32,
    steps: u64,
}

impl PeerClock {
    /// Takes one echo.
    pub(crate) fn observe(&mut self, stamps: FourStamps) -> Observed {
        Sample::of(&stamps).map_or(Observed::Impossible, |sample| self.take(sample))
    }

    /// Takes what somebody between the two of us told of this clock: by how much it is ahead of ours, and how far off that
    /// can be. It is worth an echo whose round trip was twice that.
    pub(crate) fn tell(&mut self, now: Stamp, offset: Span, error: Span) -> Observed {
        let round_trip = error + error;
        if error < Span::ZERO || round_trip > ROUND_TRIP_MAX {
            return Observed::Impossible;
        }
        self.take(Sample {
            offset,
            round_trip,
            taken: now,
        })
    }

    fn take(&mut self, sample: Sample) -> Observed {
        let now = sample.taken;
        if self.best.is_some_and(|best| !best.agrees(&sample, now)) {
            return self.doubt(sample);
        }
        self.echoes += 1;
        self.doubts = 0;
        self.doubted = None;
        if self.window.len() >= WINDOW {
            self.window.pop_front();
        }
        self.window.push_back(sample);
        self.best = self.in_common(now).or_else(|| self.shortest(now));
        Observed::Taken
    }

    /// What all echoes of the window leave of the offset: the truth lies within the bounds of every one. The least way
    /// there and the least way back need not be of one echo, so this is much narrower than the best echo alone where
    /// delays jitter. Nothing when they leave nothing: one lied, or a clock is being slewed.
    fn in_common(&self, now: Stamp) -> Option<Sample> {
        let bounds = || {
            let of = |sample: &Sample| (sample.offset, sample.error_bound(now));
            self.window.iter().map(of)
        };
        let least = bounds().map(|(offset, error)| offset - error).max()?;
        let most = bounds().map(|(offset, error)| offset + error).min()?;
        (least <= most).then(|| Sample {
            offset: Span::from_nanos(least.as_nanos().midpoint(most.as_nanos())),
            round_trip: most - least,
            taken: now,
        })
    }

    /// The echo of the least error bound. All bounds grow at one pace, so that the best of now stays it until the next
    /// echo; of equals, the newest.
    fn shortest(&self, now: Stamp) -> Option<Sample> {
        let newest_first = self.window.iter().rev();
        newest_first
            .min_by_key(|sample| sample.error_bound(now))
            .copied()
    }

    /// One contradiction may be a lie; two that agree with each other are a step, and so many in a row mean that the
    /// clock is being slewed faster than any drift.
    fn doubt(&mut self, sample: Sample) -> Observed {
        self.doubts += 1;
        let confirmed = self
            .doubted
            .replace(sample)
            .is_some_and(|before| before.agrees(&sample, sample.taken));
        if !confirmed && self.doubts < DOUBTS_MAX {
            return Observed::Doubted;
        }
        *self = Self {
            echoes: if confirmed { 2 } else { 1 },
            window: [sample].into(),
            best: Some(sample),
            doubted: None,
            doubts: 0,
            steps: self.steps + 1,
        };
        Observed::Stepped
    }

    pub(crate) const fn echoes(&self) -> u64 {
        self.echoes
    }

    pub(crate) const fn is_known(&self) -> bool {
        self.echoes >= ECHOES_MIN
    }

    /// How often one of the two clocks stepped.
    pub(crate) const fn steps(&self) -> u64 {
        self.steps
    }

    /// The neighbour's clock minus ours, once known.
    pub(crate) fn offset(&self) -> Option<Span> {
        let best = self.best.filter(|_| self.is_known())?;
        Some(best.offset)
    }

    /// How far off the offset can be by now.
    pub(crate) fn error_bound(&self, now: Stamp) -> Option<Span> {
        let best = self.best.filter(|_| self.is_known())?;
        Some(best.error_bound(now))
    }

    /// Round trip of the last echo, without the time that it waited at the neighbour's.
    pub(crate) fn round_trip(&self) -> Option<Span> {
        self.window.back().map(|sample| sample.round_trip)
    }

    pub(crate) fn to_mine(&self, peer: PeerStamp) -> Option<Stamp> {
        Some(peer.on_its_own_clock() - self.offset()?)
    }

    pub(crate) fn to_peer(&self, mine: Stamp) -> Option<PeerStamp> {
        Some(PeerStamp(mine + self.offset()?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamps(sent: i64, heard: i64, echoed: i64, received: i64) -> FourStamps {
        let millis = |ms: i64| Stamp::default() + Span::millis(ms);
        FourStamps {
            sent: millis(sent),
            heard: PeerStamp(millis(heard)),
            echoed: PeerStamp(millis(echoed)),
            received: millis(received),
        }
    }

    /// The echo of a packet sent at `sent_us`, from a clock so far ahead, over ways so long.
    fn echo(sent_us: i64, ahead_us: i64, there_us: i64, back_us: i64) -> FourStamps {
        let at = |us: i64| Stamp::default() + Span::micros(us);
        let heard_us = sent_us + there_us;
        let echoed_us = heard_us + 70_000;
        FourStamps {
            sent: at(sent_us),
            heard: PeerStamp(at(heard_us + ahead_us)),
            echoed: PeerStamp(at(echoed_us + ahead_us)),
            received: at(echoed_us + back_us),
        }
    }

    /// A clock that is known to be so far ahead, after 10 s of echoes five times a second.
    fn known(ahead_us: i64) -> PeerClock {
        let mut clock = PeerClock::default();
        for k in 0..50 {
            let observed = clock.observe(echo(k * 200_000, ahead_us, 1_000, 1_000));
            assert_eq!(observed, Observed::Taken);
        }
        clock
    }

    #[test]
    fn what_a_relay_tells_is_worth_an_echo_and_two_words_that_contradict_it_are_a_step() {
        let at = |millis| Stamp::default() + Span::millis(millis);
        let mut clock = PeerClock::default();
        for millis in [0, 200, 400, 600] {
            assert_eq!(clock.offset(), None, "too few so far");
            let told = clock.tell(at(millis), Span::secs(7), Span::millis(3));
            assert_eq!(told, Observed::Taken);
        }
        assert_eq!(clock.offset(), Some(Span::secs(7)));
        assert_eq!(clock.error_bound(at(600)), Some(Span::millis(3)));
        let unbounded = clock.tell(at(800), Span::secs(7), Span::secs(3));
        assert_eq!(unbounded, Observed::Impossible);
        let mut nine = |millis| clock.tell(at(millis), Span::secs(9), Span::millis(3));
        assert_eq!(nine(1_000), Observed::Doubted);
        assert_eq!(nine(1_200), Observed::Stepped);
    }

    #[test]
    fn four_stamps_give_the_offset_whatever_the_neighbour_waited() {
        let mut clock = PeerClock::default();
        for _ in 0..ECHOES_MIN {
            assert_eq!(clock.offset(), None, "not before {ECHOES_MIN} echoes");
            // The neighbour is 5000 ms ahead, each way takes 10 ms, and it waits 70 ms.
            assert_eq!(clock.observe(stamps(100, 5110, 5180, 190)), Observed::Taken);
        }
        assert_eq!(clock.offset(), Some(Span::millis(5000)));
        assert_eq!(clock.round_trip(), Some(Span::millis(20)));
        assert_eq!(
            clock.to_mine(PeerStamp(Stamp::default() + Span::millis(5500))),
            Some(Stamp::default() + Span::millis(500))
        );
    }

    #[test]
    fn impossible_times_change_nothing() {
        let mut clock = PeerClock::default();
        for (impossible, why) in [
            (stamps(100, 200, 150, 190), "echoed before it was heard"),
            (stamps(100, 110, 300, 190), "waited longer than we did"),
            (stamps(0, 1, 2, 10_000), "older than any echo"),
        ] {
            assert_eq!(clock.observe(impossible), Observed::Impossible, "{why}");
        }
        assert_eq!(clock, PeerClock::default());
    }

    #[test]
    fn clocks_that_are_ages_apart_do_not_overflow() {
        let mut clock = PeerClock::default();
        let far = PeerStamp::from_nanos(i64::MAX);
        let taken = FourStamps {
            sent: Stamp::from_nanos(i64::MIN + 5),
            heard: far,
            echoed: far,
            received: Stamp::from_nanos(i64::MIN + 9),
        };
        assert_eq!(clock.observe(taken), Observed::Taken);
        let near = stamps(100, 110, 120, 130);
        assert_ne!(clock.observe(near), Observed::Impossible);
    }

    #[test]
    fn queues_that_are_long_one_way_only_do_not_move_the_offset() {
        let mut clock = PeerClock::default();
        let (mut last_errors_us, mut errors_us) = (Vec::new(), Vec::new());
        // 100 ms each way, and on the way back a queue that mostly holds a packet up to 80 ms longer.
        for k in 0..1_000 {
            let queued_us = k * 7_919 % 80_000;
            clock.observe(echo(k * 200_000, 5_000_000, 100_000, 100_000 + queued_us));
            if k >= 50 {
                let error = clock.offset().unwrap() - Span::micros(5_000_000);
                errors_us.push(error.as_micros_rounded().abs());
                last_errors_us.push(queued_us / 2);
                let now = Stamp::default() + Span::micros(k * 200_000 + 270_000 + queued_us);
                assert!(error.abs() <= clock.error_bound(now).unwrap());
            }
        }
        let mean = |values: &[i64]| values.iter().sum::<i64>() / values.len() as i64;
        let (filtered, unfiltered) = (mean(&errors_us), mean(&last_errors_us));
        assert!(
            filtered < 2_000 && unfiltered > 15_000,
            "{filtered} us, unfiltered {unfiltered} us"
        );
        assert_eq!(clock.steps(), 0);
    }

    #[test]
    fn ways_that_jitter_both_ways_leave_a_few_milliseconds() {
        let mut clock = PeerClock::default();
        let (mut worst, mut sum_us) = (Span::ZERO, 0);
        // 50 to 150 ms each way.
        for k in 0..1_000 {
            let (there_us, back_us) = (k * 7_919 % 100_000, k * 6_007 % 100_000);
            clock.observe(echo(
                k * 200_000,
                5_000_000,
                50_000 + there_us,
                50_000 + back_us,
            ));
            if k >= WINDOW as i64 {
                let error = clock.offset().unwrap() - Span::micros(5_000_000);
                worst = worst.max(error.abs());
                sum_us += error.as_micros_rounded().abs();
                let now = clock.window.back().unwrap().taken;
                assert!(error.abs() <= clock.error_bound(now).unwrap());
            }
        }
        let mean_us = sum_us / (1_000 - WINDOW as i64);
        assert!(mean_us < 2_500, "mean {mean_us} us, worst {worst:?}");
    }

    #[test]
    fn a_drifting_clock_is_followed() {
        let mut clock = PeerClock::default();
        // 50 parts in a million: 3 ms a minute, over ten minutes.
        for k in 0..3_000 {
            clock.observe(echo(k * 200_000, k * 10, 1_000 + k % 7 * 100, 1_000));
        }
        let error = clock.offset().unwrap() - Span::micros(2_999 * 10);
        assert!(error.abs() < Span::millis(1), "{error:?}");
        assert_eq!(clock.steps(), 0);
    }

    #[test]
    fn one_absurd_echo_moves_nothing_whenever_it_comes() {
        for absurd_us in [-5_000_000, -20_000, 20_000, 5_000_000] {
            let mut clock = known(0);
            let lie = echo(10_100_000, absurd_us, 0, 0);
            assert_eq!(clock.observe(lie), Observed::Doubted);
            assert_eq!(clock.offset(), Some(Span::ZERO));
            // An honest one in between, and the next lie stands alone again.
            let honest = echo(10_200_000, 0, 1_000, 1_000);
            assert_eq!(clock.observe(honest), Observed::Taken);
            let lie = echo(10_300_000, absurd_us, 0, 0);
            assert_eq!(clock.observe(lie), Observed::Doubted);
            assert_eq!((clock.offset(), clock.steps()), (Some(Span::ZERO), 0));
        }
        let mut fooled_at_first = PeerClock::default();
        fooled_at_first.observe(echo(0, 5_000_000, 0, 0));
        for k in 1..=5 {
            fooled_at_first.observe(echo(k * 200_000, 0, 1_000, 1_000));
        }
        assert_eq!(fooled_at_first.offset(), Some(Span::ZERO));
    }

    #[test]
    fn a_step_either_way_is_unknown_time_until_four_echoes_of_after_it() {
        for step_us in [-5_000_000, -20_000, 20_000, 5_000_000] {
            let mut clock = known(300);
            let ahead_us = 300 + step_us;
            let after = |k: i64| echo(10_000_000 + k * 200_000, ahead_us, 1_000, 1_000);
            let observed = [0, 1, 2, 3].map(|k| (clock.observe(after(k)), clock.offset()));
            let (before, new) = (Some(Span::micros(300)), Some(Span::micros(ahead_us)));
            assert_eq!(
                observed,
                [
                    (Observed::Doubted, before),
                    (Observed::Stepped, None),
                    (Observed::Taken, None),
                    (Observed::Taken, new),
                ]
            );
            assert_eq!(clock.steps(), 1);
        }
    }

    #[test]
    fn a_lie_that_looks_good_is_believed_for_no_longer_than_the_window() {
        let mut clock = known(0);
        // Within what the round trips of 2 ms leave open, and without any round trip of its own.
        assert_eq!(
            clock.observe(echo(10_000_000, 3_000, 0, 0)),
            Observed::Taken
        );
        assert_eq!(clock.offset(), Some(Span::micros(3_000)));
        for k in 1..=WINDOW as i64 {
            clock.observe(echo(10_000_000 + k * 200_000, 0, 1_000, 1_000));
        }
        assert_eq!(clock.offset(), Some(Span::ZERO));
        assert_eq!(clock.window.len(), WINDOW);
    }

    #[test]
    fn a_clock_that_is_slewed_fast_is_not_held_to_what_it_was() {
        let mut clock = known(0);
        // 80 ms a second: no two echoes agree.
        for k in 0..50 {
            clock.observe(echo(10_000_000 + k * 200_000, k * 16_000, 1_000, 1_000));
        }
        let held = clock.best.unwrap().offset;
        let error = held - Span::micros(49 * 16_000);
        assert!(error.abs() < Span::millis(100), "{error:?}");
        assert!(clock.steps() > 0);
    }
}
