//! What one vehicle measures of another: one of five kinds (paper section II). Each kind is one file with the same
//! functions: `residual`, `cost` (the paper's `g_e`, eq. 6), `gradient` (of `g_e`) and `jacobian` (of the residual).
//!
//! Here an *end* is the frame that measures (`from`) or is measured (`to`), as `world_from_sensor`; `edge.rs` ties
//! ends to nodes. Perturbations are `(w, delta)`: `R exp(w)` in rad on the sensor side, `t + delta` in m in the world.
//! With `d = t_j - t_i`, `v = R_i^T d`, `rho = |d|` and `u = d / rho`, i the `from` end and j the `to` end.

pub mod bearing;
pub mod distance;
pub mod orientation;
pub mod pose;
pub mod position;

use std::fmt;

use nalgebra::{SMatrix, UnitQuaternion, Vector3, Vector6};

pub use self::bearing::Bearing;
pub use self::distance::Distance;
pub use self::orientation::Orientation;
pub use self::pose::Pose;
pub use self::position::Position;
use super::refusal::Refusal;
use crate::so3;
use crate::transform::{Sensor, Transform, World};

/// One end of a measurement.
pub type End = Transform<World, Sensor>;

/// Longest relative position or distance that is taken for a measurement, metres.
pub const RANGE_LIMIT_M: f64 = 1e6;

/// Ends closer than this have no direction from one to the other: `u` is put to zero there, so that bearing and
/// distance pull nowhere instead of somewhere at random.
pub const COINCIDENT_BELOW_M: f64 = 1e-9;

/// Two measurements of one kind between the same ends, further apart than this many standard deviations of their
/// difference, exclude each other.
pub const CONTRADICTION_SIGMAS: f64 = 30.0;

/// How far from one the length of a unit quaternion or bearing may be.
const UNIT_TOLERANCE: f64 = 1e-3;

/// The gradient of a cost in the perturbations `(w, delta)` of both ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gradient {
    /// In the perturbation of the measuring end.
    pub from: Vector6<f64>,
    /// In the perturbation of the measured end.
    pub to: Vector6<f64>,
}

/// The derivative of a residual of `D` numbers in the perturbations `(w, delta)` of both ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jacobian<const D: usize> {
    /// In the perturbation of the measuring end.
    pub from: SMatrix<f64, D, 6>,
    /// In the perturbation of the measured end.
    pub to: SMatrix<f64, D, 6>,
}

/// The kinds of measurement, with the paper's letters.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Kind {
    /// T: orientation and position together.
    Pose,
    /// R.
    Orientation,
    /// t.
    Position,
    /// tau.
    Bearing,
    /// delta.
    Distance,
}

impl fmt::Display for Kind {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(match self {
            Self::Pose => "pose",
            Self::Orientation => "orientation",
            Self::Position => "position",
            Self::Bearing => "bearing",
            Self::Distance => "distance",
        })
    }
}

/// A measurement of one of the five kinds, checked when it was made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Measurement {
    /// Relative orientation and position.
    Pose(Pose),
    /// Relative orientation only.
    Orientation(Orientation),
    /// Relative position only, in the measuring frame.
    Position(Position),
    /// Direction only, in the measuring frame.
    Bearing(Bearing),
    /// Distance only.
    Distance(Distance),
}

impl Measurement {
    /// The measured frame's pose in the measuring frame.
    ///
    /// # Errors
    /// [`Refusal`] when not finite, not unit or further than [`RANGE_LIMIT_M`].
    pub fn pose(from_from_to: Transform<Sensor, Sensor>) -> Result<Self, Refusal> {
        Pose::new(from_from_to).map(Self::Pose)
    }

    /// The rotation from the measured frame to the measuring frame, `R_i^T R_j`.
    ///
    /// # Errors
    /// [`Refusal`] when not finite or not unit.
    pub fn orientation(from_from_to: UnitQuaternion<f64>) -> Result<Self, Refusal> {
        Orientation::new(from_from_to).map(Self::Orientation)
    }

    /// The measured origin in the measuring frame, metres.
    ///
    /// # Errors
    /// [`Refusal`] when not finite or further than [`RANGE_LIMIT_M`].
    pub fn position(in_from: Vector3<f64>) -> Result<Self, Refusal> {
        Position::new(in_from).map(Self::Position)
    }

    /// The unit vector towards the measured origin, in the measuring frame.
    ///
    /// # Errors
    /// [`Refusal`] when not finite or not unit.
    pub fn bearing(in_from: Vector3<f64>) -> Result<Self, Refusal> {
        Bearing::new(in_from).map(Self::Bearing)
    }

    /// The distance between the two origins, metres.
    ///
    /// # Errors
    /// [`Refusal`] when not finite, negative or further than [`RANGE_LIMIT_M`].
    pub fn distance(metres: f64) -> Result<Self, Refusal> {
        Distance::new(metres).map(Self::Distance)
    }

    /// Which kind this is.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        match self {
            Self::Pose(_) => Kind::Pose,
            Self::Orientation(_) => Kind::Orientation,
            Self::Position(_) => Kind::Position,
            Self::Bearing(_) => Kind::Bearing,
            Self::Distance(_) => Kind::Distance,
        }
    }

    /// The paper's `g_e` (eq. 6), rad^2 and m^2 added with weight one.
    #[must_use]
    pub fn cost(&self, from: &End, to: &End) -> f64 {
        match self {
            Self::Pose(pose) => pose.cost(from, to),
            Self::Orientation(orientation) => orientation.cost(from, to),
            Self::Position(position) => position.cost(from, to),
            Self::Bearing(bearing) => bearing.cost(from, to),
            Self::Distance(distance) => distance.cost(from, to),
        }
    }

    /// The gradient of [`Measurement::cost`] in both ends' perturbations.
    #[must_use]
    pub fn gradient(&self, from: &End, to: &End) -> Gradient {
        match self {
            Self::Pose(pose) => pose.gradient(from, to),
            Self::Orientation(orientation) => orientation.gradient(from, to),
            Self::Position(position) => position.gradient(from, to),
            Self::Bearing(bearing) => bearing.gradient(from, to),
            Self::Distance(distance) => distance.gradient(from, to),
        }
    }

    /// How many standard deviations of their difference lie between two measurements of the same two ends; zero for
    /// different kinds, which say different things.
    #[must_use]
    pub fn sigmas_apart(&self, noise: &Noise, other: &Self, other_noise: &Noise) -> f64 {
        let rotation = noise.rotation_rad.hypot(other_noise.rotation_rad);
        let translation = noise.translation.hypot(other_noise.translation);
        match (self, other) {
            (Self::Pose(a), Self::Pose(b)) => {
                let turned = a.relative().rotation.angle_to(&b.relative().rotation) / rotation;
                let moved =
                    (a.relative().translation - b.relative().translation).norm() / translation;
                turned.max(moved)
            }
            (Self::Orientation(a), Self::Orientation(b)) => {
                a.rotation().angle_to(&b.rotation()) / rotation
            }
            (Self::Position(a), Self::Position(b)) => {
                (a.vector() - b.vector()).norm() / translation
            }
            (Self::Bearing(a), Self::Bearing(b)) => {
                let cross = a.direction().cross(&b.direction()).norm();
                cross.atan2(a.direction().dot(&b.direction())) / rotation
            }
            (Self::Distance(a), Self::Distance(b)) => (a.metres() - b.metres()).abs() / translation,
            _ => 0.0,
        }
    }
}

/// The stated noise of a measurement: standard deviations per axis. A bearing has only the first, a position and a
/// distance only the second; the other number is then not looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Noise {
    /// Of orientation or bearing, radians per axis.
    pub rotation_rad: f64,
    /// Of position per axis or distance, metres.
    pub translation: f64,
}

impl Noise {
    /// One radian, one metre: the noise that amounts to the paper's weight of one.
    pub const UNIT: Self = Self {
        rotation_rad: 1.0,
        translation: 1.0,
    };

    /// Checks the numbers that `kind` uses.
    ///
    /// # Errors
    /// [`Refusal::BadNoise`] unless they are finite and above zero.
    pub fn check(&self, kind: Kind) -> Result<(), Refusal> {
        let good = |sigma: f64| sigma.is_finite() && sigma > 0.0;
        let enough = match kind {
            Kind::Pose => good(self.rotation_rad) && good(self.translation),
            Kind::Orientation | Kind::Bearing => good(self.rotation_rad),
            Kind::Position | Kind::Distance => good(self.translation),
        };
        if enough {
            Ok(())
        } else {
            Err(Refusal::BadNoise { kind })
        }
    }
}

/// The rotation that `log` measures, in the form all files here use: `Log(a^-1 b)`.
fn rotation_between(a: &UnitQuaternion<f64>, b: &UnitQuaternion<f64>) -> Vector3<f64> {
    so3::log(&(a.inverse() * b))
}

/// `(rho, u)`: distance and unit direction of `d`, the direction zero where it is undefined.
fn range_and_direction(d: &Vector3<f64>) -> (f64, Vector3<f64>) {
    let rho = d.norm();
    let u = if rho < COINCIDENT_BELOW_M {
        Vector3::zeros()
    } else {
        d / rho
    };
    (rho, u)
}

fn check_rotation(rotation: &UnitQuaternion<f64>) -> Result<UnitQuaternion<f64>, Refusal> {
    let norm = rotation.norm();
    if !norm.is_finite() {
        return Err(Refusal::NotFinite {
            what: "the rotation",
        });
    }
    if (norm - 1.0).abs() > UNIT_TOLERANCE {
        return Err(Refusal::NotUnit {
            what: "the rotation",
            norm,
        });
    }
    Ok(UnitQuaternion::new_normalize(rotation.into_inner()))
}

fn check_vector(vector: &Vector3<f64>, what: &'static str) -> Result<(), Refusal> {
    if vector.iter().all(|number| number.is_finite()) {
        Ok(())
    } else {
        Err(Refusal::NotFinite { what })
    }
}

fn check_range(metres: f64, what: &'static str) -> Result<(), Refusal> {
    // Not `metres > limit`: a sum of squares that overflowed must be refused too.
    if metres <= RANGE_LIMIT_M {
        Ok(())
    } else {
        Err(Refusal::TooFar {
            what,
            metres,
            limit_m: RANGE_LIMIT_M,
        })
    }
}

#[cfg(test)]
mod tests;
