//! How measurements and anchors are weighed: as in the paper, or weighted and robust.

use super::refusal::Refusal;

/// How a vehicle's round is weighed.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Mode {
    /// As in the paper: every measurement and every anchor has weight one, without a robust kernel.
    #[default]
    Paper,
    /// Fixed anchor weights and a redescending kernel whose scale follows the disagreement that is to be expected.
    Star(Robust),
}

impl Mode {
    /// The weight of a prior, this vehicle's own or a neighbour's.
    #[must_use]
    pub const fn anchor(&self) -> AnchorWeight {
        match self {
            Self::Paper => AnchorWeight::UNIT,
            Self::Star(robust) => robust.anchor,
        }
    }

    /// Its name in configurations and documents.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        match self {
            Self::Paper => "paper",
            Self::Star(_) => "star",
        }
    }
}

/// The settings of [`Mode::Star`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Robust {
    /// What measurements count.
    pub weighting: Weighting,
    /// What priors count.
    pub anchor: AnchorWeight,
    /// What is done with measurements that disagree.
    pub kernel: Kernel,
}

impl Robust {
    /// Measurements of weight one, orientations of priors at a quarter of that.
    pub const DEFAULT: Self = Self {
        weighting: Weighting::Unit,
        anchor: AnchorWeight {
            rotation: 0.25,
            translation: 1.0,
        },
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
    /// One per squared radian and squared metre.
    Unit,
    /// One over its stated variance; a bearing by its residual on the sphere.
    Noise,
}

/// The redescending kernel of Geman and McClure: a measurement that disagrees by `r` counts `1 / (1 + (r/c)^2)^2`.
///
/// The scale `c` is the floor times the [`Contact`] of the neighbour: it must cover how far the priors may be apart. With
/// a fixed scale the *correct* measurements are refused after a partition, and the error goes on growing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kernel {
    /// The least scale of an angle, in radians.
    pub rotation_floor_rad: f64,
    /// The least scale of a length, in metres.
    pub translation_floor_m: f64,
    /// By which part of the floor the scale widens with every round without contact.
    pub widening: f64,
    /// By which factor an accepted contact narrows the scale.
    pub narrowing: f64,
}

impl Kernel {
    /// The best of a study over clean flights, outliers, blackouts and loss.
    pub const DEFAULT: Self = Self {
        rotation_floor_rad: 0.15,
        translation_floor_m: 0.3,
        widening: 0.1,
        narrowing: 0.85,
    };
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
