//! What some vehicle saw in one image, ready for the filters, and how far they believe it.

use nalgebra::UnitVector3;

/// A feature's variance is widened by this: its noise is not white, and the attitudes err too.
pub(super) const FEATURE_WIDENED: f64 = 1.5;
/// Squared normalised distance beyond which a sight is not of a neighbour.
pub(super) const GATE: f64 = 13.8;
/// Least probability that is believed of an identity.
pub(super) const CHANCE_MIN: f64 = 0.02;
/// Weight of a sight being of no located neighbour.
pub(super) const NONE_WEIGHT: f64 = 0.3;
/// Most that a doubtful sight's variance is widened.
pub(super) const SOFTENED_MAX: f64 = 12.0;

/// A feature of some talker.
#[derive(Clone, Debug)]
pub(super) struct Sight {
    /// In the level frame of now of who saw it.
    pub(super) direction: UnitVector3<f64>,
    /// Per axis across the direction (rad^2).
    pub(super) variance_rad2: f64,
    /// For each talker the probability that it is this feature, as far as the pair models know.
    pub(super) chances: Vec<f64>,
    /// Tracks of who saw it that were given no feature of this image and are near this one: their squared normalised
    /// distance, and for each talker the probability that the track is it. The feature may be theirs.
    pub(super) strays: Vec<(f64, Vec<f64>)>,
}
