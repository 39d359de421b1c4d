//! `[cooperative]`: how often the vehicle solves, by which mode, and what it tells the others.

use super::{Checked, Wrong, positive};
use serde::Deserialize;
use skein_estimation::cooperative::{Mode, Optimiser, Robust};
use skein_estimation::time::Span;
use skein_proto::limits::ROUNDS_PER_RECORD_MAX;
use toml::Spanned;

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct RawCooperative {
    period_s: Option<Spanned<f64>>,
    round_wait_s: Option<Spanned<f64>>,
    mode: Option<Spanned<String>>,
    optimiser: Option<Spanned<String>>,
    repeats: Option<Spanned<usize>>,
    relay: Option<bool>,
    presence_timeout_s: Option<Spanned<f64>>,
}

/// The same, checked.
pub(super) struct Cooperative {
    pub(super) period: Span,
    pub(super) round_wait: Span,
    pub(super) mode: Mode,
    pub(super) optimiser: Optimiser,
    pub(super) repeats: usize,
    pub(super) relay: bool,
    pub(super) presence_timeout: Span,
}

impl RawCooperative {
    pub(super) fn check(self) -> Checked<Cooperative> {
        let period_s = positive(self.period_s.as_ref(), 0.2, "period_s")?;
        if let Some(given) = &self.period_s
            && !(0.01..=10.0).contains(&period_s)
        {
            return Err(Wrong::at(
                given,
                format!("period_s = {period_s} is outside 0.01 to 10"),
                "the papers use 0.2; all vehicles of a fleet should have the same period",
            ));
        }
        let mode = match &self.mode {
            None => Mode::default(),
            Some(word) => match word.get_ref().as_str() {
                "paper" => Mode::Paper,
                "star" => Mode::Star(Robust::DEFAULT),
                "team" => Mode::Team,
                other => {
                    return Err(Wrong::at(
                        word,
                        format!("there is no mode {other:?}"),
                        "use \"team\" (everybody's raw information, with covariance), \"star\" (robust) or \"paper\" (as published)",
                    ));
                }
            },
        };
        let optimiser = match &self.optimiser {
            None => Optimiser::default(),
            Some(word) => match word.get_ref().as_str() {
                "gauss-newton" => Optimiser::gauss_newton(),
                "descent" => Optimiser::descent(),
                other => {
                    return Err(Wrong::at(
                        word,
                        format!("there is no optimiser {other:?}"),
                        "use \"gauss-newton\" (fast) or \"descent\" (the paper's)",
                    ));
                }
            },
        };
        let repeats = self.repeats.as_ref().map_or(3, |r| *r.get_ref());
        if let Some(given) = &self.repeats
            && repeats >= ROUNDS_PER_RECORD_MAX
        {
            return Err(Wrong::at(
                given,
                format!("repeats = {repeats} is too many"),
                &format!(
                    "a round record holds the newest round and at most {} repeated ones",
                    ROUNDS_PER_RECORD_MAX - 1
                ),
            ));
        }
        let round_wait_s = positive(self.round_wait_s.as_ref(), 1.5 * period_s, "round_wait_s")?;
        let presence_timeout_s =
            positive(self.presence_timeout_s.as_ref(), 2.0, "presence_timeout_s")?;
        Ok(Cooperative {
            period: Span::from_secs_f64(period_s),
            round_wait: Span::from_secs_f64(round_wait_s),
            mode,
            optimiser,
            repeats,
            relay: self.relay.unwrap_or(false),
            presence_timeout: Span::from_secs_f64(presence_timeout_s),
        })
    }
}
