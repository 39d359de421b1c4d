//! How measurements and anchors are weighed: as in the paper, or weighted and robust.

use super::kernel::Kernel;
use super::refusal::Refusal;

/// How a vehicle's round is weighed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Mode {
    /// As in the paper: every measurement and every anchor has weight one, without a robust kernel.
    Paper,
    /// Fixed anchor weights and a redescending kernel whose scale follows the disagreement that is to be expected.
    Star(Robust),
    /// Everybody's raw information, smoothed jointly ([`super::team`]). The star then only places a vehicle that has no
    /// pose yet, weighed as in its own mode.
    Team,
}

impl Default for Mode {
    /// The team: at a third of the star's error or less, clean or with outliers, and the only one that says how certain it
    /// is (`skein-sim experiment modes`, `skein-sim experiment consistency`).
    fn default() -> Self {
        Self::Team
    }
}

impl Mode {
    /// The weight of a prior, this vehicle's own or a neighbour's.
    #[must_use]
    pub const fn anchor(&self) -> AnchorWeight {
        match self {
            Self::Paper => AnchorWeight::UNIT,
            Self::Star(robust) => robust.anchor,
            Self::Team => Robust::DEFAULT.anchor,
        }
    }

    /// The weight of a prior between whose vehicle and another an orientation is measured.
    #[must_use]
    pub const fn oriented_anchor(&self) -> AnchorWeight {
        match self {
            Self::Paper => AnchorWeight::UNIT,
            Self::Star(robust) => AnchorWeight {
                rotation: robust.oriented_rotation,
                translation: robust.anchor.translation,
            },
            Self::Team => Self::Star(Robust::DEFAULT).oriented_anchor(),
        }
    }

    /// How a star is weighed in this mode.
    #[must_use]
    pub const fn of_a_star(self) -> Self {
        match self {
            Self::Paper | Self::Star(_) => self,
            Self::Team => Self::Star(Robust::DEFAULT),
        }
    }

    /// The robust kernel, if it has one.
    #[must_use]
    pub const fn kernel(&self) -> Option<Kernel> {
        match self {
            Self::Paper => None,
            Self::Star(robust) => Some(robust.kernel),
            Self::Team => Some(Kernel::DEFAULT),
        }
    }

    /// Its name in configurations and documents.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Star(_) => "star",
            Self::Team => "team",
        }
    }
}

/// The settings of [`Mode::Star`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Robust {
    /// What measurements count.
    pub weighting: Weighting,
    /// What the priors count of vehicles between which nobody measured an orientation in the round.
    pub anchor: AnchorWeight,
    /// What the prior's orientation counts where one is measured.
    pub oriented_rotation: f64,
    /// What is done with measurements that disagree.
    pub kernel: Kernel,
}

impl Robust {
    /// Everything of weight one, but orientations of priors at a quarter of that where an orientation is measured: where
    /// positions alone turn a vehicle, its heading would follow their noise. Weights by stated noise are as good on clean
    /// flights and for gross outliers eight times worse: millimetres outweigh any prior.
    pub const DEFAULT: Self = Self {
        weighting: Weighting::Unit,
        anchor: AnchorWeight::UNIT,
        oriented_rotation: 0.25,
        kernel: Kernel::DEFAULT,
    };
}

impl Default for Robust {
    fn default() -> Self {
        Self::DEFAULT
    }
}

/// What a measurement counts before the kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Weighting {
    /// One per squared radian and squared metre; a fix more or less, by how its noise compares with what priors err by.
    Unit,
    /// One over its stated variance; a bearing by its residual on the sphere.
    Noise,
}

/// How much a prior counts, per squared radian and squared metre.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AnchorWeight {
    /// Of the prior's orientation.
    pub rotation: f64,
    /// Of the prior's position.
    pub translation: f64,
}

impl AnchorWeight {
    /// The paper's: one.
    pub const UNIT: Self = Self {
        rotation: 1.0,
        translation: 1.0,
    };
    /// None at all: the prior is only where the search begins.
    pub const NONE: Self = Self {
        rotation: 0.0,
        translation: 0.0,
    };

    pub(super) fn check(self) -> Result<Self, Refusal> {
        let good = |weight: f64| weight.is_finite() && weight >= 0.0;
        if good(self.rotation) && good(self.translation) {
            Ok(self)
        } else {
            Err(Refusal::BadWeight)
        }
    }
}
