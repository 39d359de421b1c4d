//! Counts by word, and how many a second.

use std::collections::BTreeMap;

use skein_estimation::time::{Span, Stamp};

use crate::refused::Refused;

/// How often each word was counted. The words are ours, so there are few.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Counters(BTreeMap<&'static str, u64>);

impl Counters {
    pub(crate) fn count(&mut self, word: &'static str) {
        self.add(word, 1);
    }

    pub(crate) fn add(&mut self, word: &'static str, times: u64) {
        if times > 0 {
            *self.0.entry(word).or_default() += times;
        }
    }

    pub(crate) fn refuse(&mut self, why: &Refused) {
        self.count(why.word());
    }

    /// As it stands in a document.
    pub(crate) fn to_document(&self) -> BTreeMap<String, u64> {
        self.0
            .iter()
            .map(|(word, times)| ((*word).to_owned(), *times))
            .collect()
    }
}

/// Events a second over the last whole window and the running one.
#[derive(Clone, Debug, Default)]
pub(crate) struct Rate {
    window: i64,
    now: u32,
    before: u32,
}

const WINDOW: Span = Span::secs(2);

impl Rate {
    pub(crate) fn count(&mut self, at: Stamp) {
        self.roll(at);
        self.now = self.now.saturating_add(1);
    }

    pub(crate) fn per_second(&self, at: Stamp) -> f64 {
        let mut rate = self.clone();
        rate.roll(at);
        let elapsed = Span::from_nanos(at.as_nanos().rem_euclid(WINDOW.as_nanos()));
        f64::from(rate.before + rate.now) / (WINDOW + elapsed).as_secs_f64()
    }

    fn roll(&mut self, at: Stamp) {
        let window = at.as_nanos().div_euclid(WINDOW.as_nanos());
        match window - self.window {
            0 => return,
            1 => self.before = self.now,
            _ => self.before = 0,
        }
        self.now = 0;
        self.window = window;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_steady_stream_shows_its_rate_and_a_silent_one_zero() {
        let mut rate = Rate::default();
        for tenth in 0..100 {
            rate.count(Stamp::default() + Span::millis(tenth * 100));
        }
        let at = |secs| Stamp::default() + Span::secs(secs);
        assert!(
            (rate.per_second(at(10)) - 10.0).abs() < 0.6,
            "{}",
            rate.per_second(at(10))
        );
        assert_eq!(rate.per_second(at(20)).to_bits(), 0.0f64.to_bits());
    }
}
