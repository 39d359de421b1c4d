//! Who localises: what each makes of a pair's distances, round by round, and what the bound of it is.

use super::bound::{self, UNKNOWNS};
use super::pair::{Pair, Places, Turns};
use crate::experiment::ranging::trilateration::turtle;
use crate::planar_swarm::PlanarMotion;
use nalgebra::{Matrix3, Matrix4};
use serde::{Serialize, Serializer};
use skein_estimation::ranging::neighbour::NeighbourSettings;
use skein_estimation::ranging::trilateration::{self, PairMotion, Relative, Trilaterator};
use skein_estimation::ranging::window::{Mode, Starts, WindowSettings};
use skein_estimation::ranging::{Neighbour, RelativePose, Window};

/// Distances of a trial of Algorithm 1.
pub const ROUNDS: usize = 20;
/// Of a trial of Algorithm 2, after the first: in each of its rounds one of the two moves.
pub const ALTERNATING_ROUNDS: usize = 40;
/// The first distance after which banks are scored: the last 14 of 20.
const BANK_SCORED_FROM: usize = 6;
/// The same of Algorithm 2: three moves of each.
const ALTERNATING_SCORED_FROM: usize = 7;

/// Who.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Method {
    /// Algorithm 1: the best fit of so many distances, sought everywhere.
    Window(usize),
    /// The same, sought only next to where the window before has it.
    Tracked(usize),
    /// The bank as a vehicle runs it, started from so many distances.
    Bank(usize),
    /// Algorithm 2, the paper's way.
    Trilateration,
    /// Algorithm 2, the bank.
    TrilaterationBank,
}

/// Where the other is, for one that localises.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// In its frame.
    pub at: Relative,
    /// Of x, y (m) and orientation (rad), for those who tell one.
    pub covariance: Option<Matrix3<f64>>,
}

impl Method {
    /// What it is called.
    #[must_use]
    pub fn name(self) -> String {
        match self {
            Self::Window(ranges) => format!("window of {ranges}"),
            Self::Tracked(ranges) => format!("tracked window of {ranges}"),
            Self::Bank(ranges) => format!("bank from {ranges}"),
            Self::Trilateration => "trilateration".to_owned(),
            Self::TrilaterationBank => "trilateration bank".to_owned(),
        }
    }

    /// Who moves.
    #[must_use]
    pub const fn turns(self) -> Turns {
        match self {
            Self::Window(_) | Self::Tracked(_) | Self::Bank(_) => Turns::Together,
            Self::Trilateration | Self::TrilaterationBank => Turns::Alternating,
        }
    }

    /// The first round that is scored, where 0 is that of the first distance.
    #[must_use]
    pub fn scored_from(self) -> usize {
        match self {
            // Three distances have as many unknowns, and are scored with the others: from the fourth on.
            Self::Window(ranges) | Self::Tracked(ranges) => UNKNOWNS.max(ranges.saturating_sub(1)),
            Self::Bank(ranges) => BANK_SCORED_FROM.max(ranges.saturating_sub(1)),
            Self::Trilateration | Self::TrilaterationBank => ALTERNATING_SCORED_FROM,
        }
    }

    /// The last round.
    #[must_use]
    pub const fn last_round(self) -> usize {
        match self.turns() {
            Turns::Together => ROUNDS - 1,
            Turns::Alternating => ALTERNATING_ROUNDS,
        }
    }

    /// What it answers after each distance; none where it does not.
    #[must_use]
    pub fn answers(self, pair: &Pair) -> Vec<Option<Answer>> {
        match self {
            Self::Window(ranges) => window(pair, ranges, false),
            Self::Tracked(ranges) => window(pair, ranges, true),
            Self::Bank(ranges) => bank(pair, ranges),
            Self::Trilateration => trilateration(pair),
            Self::TrilaterationBank => trilateration_bank(pair),
        }
    }

    /// The information that nobody has more of after each distance who is given what it is; none before it is given
    /// enough.
    #[must_use]
    pub fn bound(self, pair: &Pair) -> Vec<Option<Matrix3<f64>>> {
        let places = pair.places();
        let noise = &pair.noise;
        match self {
            Self::Window(ranges) | Self::Tracked(ranges) => {
                let newest = |end: usize| {
                    let window: Option<&[Places]> =
                        places.get((end + 1).checked_sub(ranges)?..=end);
                    window.map(|window| bound::windowed(window, noise))
                };
                (0..places.len()).map(newest).collect()
            }
            Self::Bank(ranges) => bound::recursive(&places, ranges, noise),
            Self::Trilateration | Self::TrilaterationBank => bound::recursive(&places, 1, noise),
        }
    }
}

impl Serialize for Method {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(&self.name())
    }
}

fn window(pair: &Pair, ranges: usize, tracked: bool) -> Vec<Option<Answer>> {
    let mut window = Window::new();
    let mut before: Option<Answer> = None;
    let answers = pair.samples().into_iter().zip(&pair.rounds);
    let answers = answers.map(|(sample, round)| {
        window.push(&sample).ok()?;
        window.keep_newest(ranges);
        if window.len() < ranges {
            return None;
        }
        let carried = before.filter(|_| tracked).map(|before| {
            let at = motion(&round.motions).carried(&before.at);
            RelativePose::new(at.position_m.push(0.0), at.orientation_rad)
        });
        let starts = match &carried {
            Some(carried) => Starts::Tracked(std::slice::from_ref(carried)),
            None => Starts::Exhaustive,
        };
        let modes = window.solve(&WindowSettings::PLANAR, starts, None);
        before = modes.best().map(|best| Answer {
            at: relative(&best.pose),
            covariance: Mode::covariance(best).map(|all| planar(&all)),
        });
        before
    });
    answers.collect()
}

fn bank(pair: &Pair, ranges: usize) -> Vec<Option<Answer>> {
    let mut neighbour = Neighbour::new(NeighbourSettings {
        start_ranges: ranges,
        ..NeighbourSettings::PLANAR
    });
    let answers = pair.samples().into_iter().map(|sample| {
        neighbour.handle(&sample).ok()?;
        let best = neighbour.estimate().best?;
        Some(Answer {
            at: relative(&best.pose),
            covariance: Some(planar(&best.covariance)),
        })
    });
    answers.collect()
}

fn trilateration(pair: &Pair) -> Vec<Option<Answer>> {
    let mut trilaterator = Trilaterator::new();
    let answers = pair.rounds.iter().map(|round| {
        let taken = trilaterator.update(&motion(&round.motions), round.range_m, None);
        taken.ok()?;
        let at = trilaterator.estimate()?;
        Some(Answer {
            at,
            covariance: None,
        })
    });
    answers.collect()
}

fn trilateration_bank(pair: &Pair) -> Vec<Option<Answer>> {
    let noise = trilateration::Noise {
        range_sigma_m: pair.noise.range_sigma_m,
        translation_sigma_m: pair.noise.translation_sigma_m,
        rotation_sigma_rad: pair.noise.rotation_sigma_rad,
    };
    let mut bank: Option<trilateration::Bank> = None;
    let answers = pair.rounds.iter().map(|round| {
        let Some(bank) = &mut bank else {
            bank = trilateration::Bank::new(round.range_m, &noise).ok();
            return None;
        };
        let taken = bank.update(&motion(&round.motions), Some(round.range_m), &noise);
        taken.ok()?;
        let mode = bank.estimate()?;
        Some(Answer {
            at: mode.at,
            covariance: Some(mode.covariance),
        })
    });
    answers.collect()
}

fn motion(motions: &[PlanarMotion; 2]) -> PairMotion {
    PairMotion {
        own: turtle(motions[0]),
        theirs: turtle(motions[1]),
    }
}

fn relative(pose: &RelativePose) -> Relative {
    Relative {
        position_m: pose.position_m.xy(),
        orientation_rad: pose.yaw_rad,
    }
}

/// Without height.
fn planar(covariance: &Matrix4<f64>) -> Matrix3<f64> {
    covariance.remove_row(2).remove_column(2)
}
