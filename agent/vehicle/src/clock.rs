//! A neighbour's clock: its stamps are another type until four time stamps tell how far its clock is from ours.

use skein_estimation::time::{Span, Stamp};

/// Echoes needed before anything of a neighbour is used.
pub(crate) const ECHOES_MIN: u64 = 4;
/// Longest round trip of an echo that is believed; it covers an echo that waited its turn in a round record.
const ROUND_TRIP_MAX: Span = Span::secs(5);

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

/// What is known of the clock of one boot of one neighbour.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct PeerClock {
    echoes: u64,
    offset: Span,
    round_trip: Span,
}

impl PeerClock {
    /// Takes one echo. False when its times are impossible: nothing is changed then.
    pub(crate) fn observe(&mut self, stamps: FourStamps) -> bool {
        let waited = stamps.echoed.since(stamps.heard);
        let round_trip = (stamps.received - stamps.sent) - waited;
        if waited < Span::ZERO || round_trip < Span::ZERO || round_trip > ROUND_TRIP_MAX {
            return false;
        }
        // offset = ((heard - sent) + (echoed - received)) / 2, each difference across the two clocks; halved first,
        // so that clocks that are ages apart do not overflow.
        let there = stamps.heard.on_its_own_clock() - stamps.sent;
        let back = stamps.echoed.on_its_own_clock() - stamps.received;
        self.offset = Span::from_nanos(there.as_nanos().midpoint(back.as_nanos()));
        self.round_trip = round_trip;
        self.echoes += 1;
        true
    }

    pub(crate) const fn echoes(&self) -> u64 {
        self.echoes
    }

    pub(crate) const fn is_known(&self) -> bool {
        self.echoes >= ECHOES_MIN
    }

    /// The neighbour's clock minus ours, once known.
    pub(crate) fn offset(&self) -> Option<Span> {
        self.is_known().then_some(self.offset)
    }

    /// Round trip of the last echo, without the time that it waited at the neighbour's.
    pub(crate) fn round_trip(&self) -> Option<Span> {
        (self.echoes > 0).then_some(self.round_trip)
    }

    pub(crate) fn to_mine(self, peer: PeerStamp) -> Option<Stamp> {
        Some(peer.on_its_own_clock() - self.offset()?)
    }

    pub(crate) fn to_peer(self, mine: Stamp) -> Option<PeerStamp> {
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

    #[test]
    fn four_stamps_give_the_offset_whatever_the_neighbour_waited() {
        let mut clock = PeerClock::default();
        for _ in 0..ECHOES_MIN {
            assert_eq!(clock.offset(), None, "not before {ECHOES_MIN} echoes");
            // The neighbour is 5000 ms ahead, each way takes 10 ms, and it waits 70 ms.
            assert!(clock.observe(stamps(100, 5110, 5180, 190)));
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
        assert!(
            !clock.observe(stamps(100, 200, 150, 190)),
            "echoed before it was heard"
        );
        assert!(
            !clock.observe(stamps(100, 110, 300, 190)),
            "waited longer than we did"
        );
        assert!(
            !clock.observe(stamps(0, 1, 2, 10_000)),
            "older than any echo"
        );
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
        assert!(clock.observe(taken));
    }
}
