//! The modes by the names of the command line.

use clap::ValueEnum;
use skein_estimation::cooperative::{Mode, Robust};

/// How rounds are weighed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum ModeName {
    /// As published: unit weights, no robust kernel.
    Paper,
    /// Fixed anchor weights and a robust kernel that follows contact.
    Star,
    /// Everybody's raw information, smoothed jointly, with covariance.
    Team,
}

impl ModeName {
    pub(crate) const fn mode(self) -> Mode {
        match self {
            Self::Paper => Mode::Paper,
            Self::Star => Mode::Star(Robust::DEFAULT),
            Self::Team => Mode::Team,
        }
    }
}
