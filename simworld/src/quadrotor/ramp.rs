//! The smooth start of every course: from 0 at rest to 1, with velocity and acceleration zero at both ends.

/// When the team begins to move (s).
pub(super) const BEGINS_S: f64 = 2.0;
/// How long it takes to reach full motion (s).
pub(super) const LASTS_S: f64 = 4.0;

/// A value with its first and second derivative in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Smooth {
    pub(super) value: f64,
    pub(super) rate_per_s: f64,
    pub(super) rate_per_s2: f64,
}

impl Smooth {
    /// `s^3 (10 - 15 s + 6 s^2)`, where `s` grows from 0 at `begins_s` to 1 within `lasts_s`.
    pub(super) fn step(t_s: f64, begins_s: f64, lasts_s: f64) -> Self {
        let s = ((t_s - begins_s) / lasts_s).clamp(0.0, 1.0);
        Self {
            value: s.powi(3) * (10.0 - 15.0 * s + 6.0 * s * s),
            rate_per_s: 30.0 * s * s * (1.0 - s).powi(2) / lasts_s,
            rate_per_s2: 60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (lasts_s * lasts_s),
        }
    }

    /// The ramp with which everyone starts.
    pub(super) fn start(t_s: f64) -> Self {
        Self::step(t_s, BEGINS_S, LASTS_S)
    }

    /// The time integral of that ramp (s), with the ramp as its rate.
    pub(super) fn started(t_s: f64) -> Self {
        let ramp = Self::start(t_s);
        let since_s = t_s - BEGINS_S;
        let s = (since_s / LASTS_S).clamp(0.0, 1.0);
        let within_s = LASTS_S * s.powi(4) * (2.5 - 3.0 * s + s * s);
        Self {
            value: within_s + (since_s - LASTS_S).max(0.0),
            rate_per_s: ramp.value,
            rate_per_s2: ramp.rate_per_s,
        }
    }
}
