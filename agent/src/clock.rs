//! The one clock of a process: UNIX time at its start, monotonic after, perhaps faster than real. Nobody else reads time.

use skein_estimation::time::{Span, Stamp};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Furthest instant that a timer is armed for; later ones are armed again when it has passed.
const HORIZON: Duration = Duration::from_secs(3_600);

/// Tells the time of a process. Copies share one epoch, so all agents of a process agree.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    start: Stamp,
    epoch: Instant,
    rate: f64,
}

impl Clock {
    /// UNIX time of this moment, monotonic from here on.
    #[expect(clippy::disallowed_methods, reason = "this is the one clock")]
    pub fn real() -> Self {
        let unix = SystemTime::now()
            .duration_since(UNIX_EPOCH)
            .unwrap_or_default();
        let nanos = i64::try_from(unix.as_nanos()).unwrap_or(i64::MAX);
        Self::scaled(Stamp::from_nanos(nanos), 1.0)
    }

    /// Reads `start` at this moment and runs `rate` times as fast as real time.
    ///
    /// # Panics
    /// When the rate is not positive and finite: configuration is checked before it gets here.
    #[expect(clippy::disallowed_methods, reason = "this is the one clock")]
    pub fn scaled(start: Stamp, rate: f64) -> Self {
        assert!(
            rate.is_finite() && rate > 0.0,
            "a clock's rate is positive, not {rate}"
        );
        Self {
            start,
            epoch: Instant::now(),
            rate,
        }
    }

    /// The present.
    #[expect(clippy::disallowed_methods, reason = "this is the one clock")]
    pub fn now(&self) -> Stamp {
        self.stamp_of(Instant::now())
    }

    /// The real instant at which [`Clock::now`] has reached `stamp`; at most an hour ahead.
    pub fn instant_of(&self, stamp: Stamp) -> Instant {
        let ahead = self.real_time(stamp - self.start);
        // Rounded up, so that whoever wakes then finds the stamp reached.
        let after_epoch = ahead.saturating_add(Duration::from_nanos(1));
        let latest = real_now() + HORIZON;
        self.epoch
            .checked_add(after_epoch)
            .map_or(latest, |instant| instant.min(latest))
    }

    /// How long a span of this clock takes in real time; zero for a negative one.
    pub fn real_time(&self, span: Span) -> Duration {
        Duration::try_from_secs_f64(span.as_secs_f64().max(0.0) / self.rate)
            .unwrap_or(Duration::MAX)
    }

    /// How many times as fast as real time it runs.
    pub fn rate(&self) -> f64 {
        self.rate
    }

    /// What it read when it was made.
    pub fn start(&self) -> Stamp {
        self.start
    }

    fn stamp_of(&self, instant: Instant) -> Stamp {
        let elapsed = instant.saturating_duration_since(self.epoch);
        let nanos = i64::try_from(elapsed.as_nanos()).unwrap_or(i64::MAX);
        // At the real rate integers: a float would lose nanoseconds after some weeks.
        let elapsed = if self.rate.to_bits() == 1.0_f64.to_bits() {
            Span::from_nanos(nanos)
        } else {
            Span::from_nanos((nanos as f64 * self.rate) as i64)
        };
        self.start + elapsed
    }
}

/// The real present, for what does not run on the process's clock: retries, and deadlines of tools.
#[expect(clippy::disallowed_methods, reason = "this is the one clock")]
pub(crate) fn real_now() -> Instant {
    Instant::now()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scaled_clock_runs_at_its_rate_and_its_copies_agree() {
        let clock = Clock::scaled(Stamp::from_nanos(1_000), 20.0);
        let copy = clock;
        let instant = clock.epoch + Duration::from_millis(50);
        assert_eq!(
            clock.stamp_of(instant),
            Stamp::from_nanos(1_000) + Span::secs(1)
        );
        assert_eq!(clock.stamp_of(instant), copy.stamp_of(instant));
    }

    #[test]
    fn at_the_instant_of_a_stamp_the_stamp_is_reached() {
        for rate in [1.0, 3.0, 20.0] {
            let clock = Clock::scaled(Stamp::from_nanos(1_800_000_000_123_456_789), rate);
            for nanos in [0, 1, 333_333_333, 5_000_000_007] {
                let stamp = clock.start + Span::from_nanos(nanos);
                let reached = clock.stamp_of(clock.instant_of(stamp));
                assert!(reached >= stamp, "rate {rate}: {:?} early", stamp - reached);
                assert!(reached - stamp < Span::micros(1));
            }
        }
    }

    #[test]
    fn a_stamp_beyond_all_time_is_an_instant_within_the_horizon() {
        let clock = Clock::real();
        let far = clock.instant_of(Stamp::from_nanos(i64::MAX));
        assert!(far <= real_now() + HORIZON);
        assert!(clock.instant_of(Stamp::from_nanos(i64::MIN)) <= real_now());
    }
}
