//! Time as the estimators know it: stamps of one clock and the spans between them. Nobody here reads a clock.

use std::fmt;
use std::ops::{Add, AddAssign, Mul, Neg, Sub};

/// An instant on the owner's clock: nanoseconds of UNIX time at start, monotonic after.
///
/// A neighbour's stamp is another type until its clock offset is known.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Stamp(i64);

/// A length of time in nanoseconds; may be negative.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct Span(i64);

impl Stamp {
    /// The stamp of so many nanoseconds.
    pub const fn from_nanos(nanos: i64) -> Self {
        Self(nanos)
    }

    /// Nanoseconds.
    pub const fn as_nanos(self) -> i64 {
        self.0
    }

    /// Seconds, rounded to what a float holds (about 0.2 microseconds at today's UNIX time).
    pub fn as_secs_f64(self) -> f64 {
        self.0 as f64 * 1e-9
    }
}

impl Span {
    /// No time at all.
    pub const ZERO: Self = Self(0);

    /// So many nanoseconds.
    pub const fn from_nanos(nanos: i64) -> Self {
        Self(nanos)
    }

    /// So many microseconds.
    pub const fn micros(micros: i64) -> Self {
        Self(micros * 1_000)
    }

    /// So many milliseconds.
    pub const fn millis(millis: i64) -> Self {
        Self(millis * 1_000_000)
    }

    /// So many seconds.
    pub const fn secs(secs: i64) -> Self {
        Self(secs * 1_000_000_000)
    }

    /// The nearest number of nanoseconds; saturates, and zero for a number that is none.
    pub fn from_secs_f64(secs: f64) -> Self {
        Self((secs * 1e9).round() as i64)
    }

    /// Nanoseconds.
    pub const fn as_nanos(self) -> i64 {
        self.0
    }

    /// Whole microseconds, rounded to nearest.
    pub const fn as_micros_rounded(self) -> i64 {
        self.0.saturating_add(500).div_euclid(1_000)
    }

    /// Seconds.
    pub fn as_secs_f64(self) -> f64 {
        self.0 as f64 * 1e-9
    }

    /// Its size without its sign.
    pub const fn abs(self) -> Self {
        Self(self.0.saturating_abs())
    }
}

// Stamps come from packets too: arithmetic saturates, so that no hostile number can overflow it.
impl Add<Span> for Stamp {
    type Output = Self;
    fn add(self, span: Span) -> Self {
        Self(self.0.saturating_add(span.0))
    }
}

impl Sub<Span> for Stamp {
    type Output = Self;
    fn sub(self, span: Span) -> Self {
        Self(self.0.saturating_sub(span.0))
    }
}

impl Sub for Stamp {
    type Output = Span;
    fn sub(self, earlier: Self) -> Span {
        Span(self.0.saturating_sub(earlier.0))
    }
}

impl AddAssign<Span> for Stamp {
    fn add_assign(&mut self, span: Span) {
        *self = *self + span;
    }
}

impl Add for Span {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self(self.0.saturating_add(other.0))
    }
}

impl Sub for Span {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self(self.0.saturating_sub(other.0))
    }
}

impl Neg for Span {
    type Output = Self;
    fn neg(self) -> Self {
        Self(self.0.saturating_neg())
    }
}

impl Mul<i64> for Span {
    type Output = Self;
    fn mul(self, times: i64) -> Self {
        Self(self.0.saturating_mul(times))
    }
}

impl fmt::Debug for Stamp {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}.{:09} s",
            self.0.div_euclid(1_000_000_000),
            self.0.rem_euclid(1_000_000_000)
        )
    }
}

impl fmt::Debug for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} s", self.as_secs_f64())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hostile_stamps_saturate_instead_of_overflowing() {
        assert_eq!(
            Stamp::from_nanos(i64::MAX) + Span::secs(1),
            Stamp::from_nanos(i64::MAX)
        );
        assert_eq!(
            Stamp::from_nanos(i64::MIN) - Stamp::from_nanos(1),
            Span::from_nanos(i64::MIN)
        );
        assert_eq!(Span::from_nanos(i64::MIN).abs(), Span::from_nanos(i64::MAX));
    }

    #[test]
    fn spans_round_to_the_nearest_microsecond_on_both_sides_of_zero() {
        assert_eq!(Span::from_nanos(1_499).as_micros_rounded(), 1);
        assert_eq!(Span::from_nanos(1_500).as_micros_rounded(), 2);
        assert_eq!(Span::from_nanos(-1_499).as_micros_rounded(), -1);
        assert_eq!(
            Span::from_nanos(i64::MAX).as_micros_rounded(),
            i64::MAX / 1_000
        );
    }
}
