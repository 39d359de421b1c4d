//! Why a neighbour's feature set changes nothing, and which of those reasons its numbers give by themselves.

use super::feature_set::{FeatureSet, Inertial, Motion};

/// A reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unused {
    /// There is no own set yet that it could be compared with.
    NothingOwn,
    /// It bears the own name.
    Own,
    /// It is much older than the own newest set, or not newer than the one before it.
    TooOld,
    /// It is much newer than the own newest set.
    TooNew,
    /// Its integrals are no numbers, or no vehicle moves as they say.
    Implausible,
    /// As many neighbours are known as are kept.
    Full,
}

/// Greatest magnitude of an integral: seconds, radians, m/s and metres.
const BELIEVED_MAX: f64 = 1e9;
/// Fastest turn (rad/s) and greatest acceleration (m/s^2) that are believed: what inertial sensors for vehicles can
/// measure, 2300 degrees per second and 20 g.
const TURN_MAX_RAD_S: f64 = 40.0;
const ACCELERATION_MAX_M_S2: f64 = 200.0;
/// What rounding and the jitter of a clock may add (rad, m/s and m).
const SLACK: f64 = 0.1;

/// Whether all integrals are numbers that a flight can come to.
pub(super) fn is_understood(set: &FeatureSet) -> bool {
    let Inertial {
        elapsed_s,
        yaw_rad,
        velocity_m_s,
        position_m,
    } = &set.inertial;
    [*elapsed_s, *yaw_rad]
        .iter()
        .chain(velocity_m_s.iter())
        .chain(position_m.iter())
        .all(|number| number.abs() < BELIEVED_MAX)
}

/// Whether a vehicle can have moved so. Taken for true, a jump would carry its place, and by what neighbours see of each
/// other everyone's, out of the world.
pub(super) fn is_flyable(motion: &Motion) -> bool {
    let elapsed_s = motion.elapsed_s;
    // Comparisons with what is no number are false.
    elapsed_s > 0.0
        && motion.yaw_rad.abs() <= TURN_MAX_RAD_S * elapsed_s + SLACK
        && motion.velocity_m_s.norm() <= ACCELERATION_MAX_M_S2 * elapsed_s + SLACK
        && motion.position_m.norm() <= 0.5 * ACCELERATION_MAX_M_S2 * elapsed_s * elapsed_s + SLACK
}
