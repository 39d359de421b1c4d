//! The anonymous feature set: what one vehicle tells of itself and of what it sees at one instant, levelled by its own
//! attitude (Cognetti et al., section II), and what identity that persists needs besides.

use crate::time::Stamp;
use nalgebra::{Rotation3, UnitVector3, Vector3};

/// Features in one set.
pub const FEATURES_MAX: usize = 32;
/// Tracks in one set.
pub const TRACKS_MAX: usize = 32;

/// What one vehicle tells at one instant. All vectors are in its level frame of that instant unless said otherwise.
#[derive(Clone, Debug, PartialEq)]
pub struct FeatureSet {
    /// When the features were seen and the rest was so.
    pub taken: Stamp,
    /// Roll (rad), with pitch and yaw as `R = Rz(yaw) Ry(pitch) Rx(roll)`.
    pub roll_rad: f64,
    /// Pitch (rad), positive nose down as the body's y axis points left.
    pub pitch_rad: f64,
    /// Yaw rate (rad/s), counter-clockwise (paper eq. 15).
    pub yaw_rate_rad_s: f64,
    /// Mean proper acceleration since the set before (m/s^2): at rest (0, 0, g) (paper eq. 12).
    pub acceleration_m_s2: Vector3<f64>,
    /// Cumulative integrals since the boot.
    pub inertial: Inertial,
    /// What is seen, in no order that tells who it is; at most [`FEATURES_MAX`].
    pub features: Vec<Feature>,
    /// What the vehicle has been seeing for a while; at most [`TRACKS_MAX`].
    pub tracks: Vec<Track>,
}

/// A robot, or what looks like one, seen in one image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feature {
    /// Where, in the level frame.
    pub direction: UnitVector3<f64>,
    /// Standard deviation across the direction, per axis (rad).
    pub sigma_rad: f64,
    /// Which of the set's tracks it went into.
    pub track: Option<TrackNumber>,
}

/// Number of a track, unique within a boot until it wraps. It says that two features are the same thing, not which.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TrackNumber(pub u16);

/// Something that is followed from image to image, in the vehicle's gyro frame: the level frame turned back by
/// [`Inertial::yaw_rad`], so that it does not turn with the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    /// Which.
    pub number: TrackNumber,
    /// Where, in the gyro frame.
    pub direction: UnitVector3<f64>,
    /// Variance across the direction, per axis (rad^2).
    pub variance_rad2: f64,
    /// It was seen often enough to be believed.
    pub confirmed: bool,
}

/// Integrals of what the inertial sensor said since the boot. As they are cumulative, a lost message loses nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertial {
    /// How long was integrated (s).
    pub elapsed_s: f64,
    /// Integrated yaw rate, not wrapped (rad): it takes the level frame to the gyro frame.
    pub yaw_rad: f64,
    /// Integral of the acceleration, gravity taken off, in the gyro frame (m/s).
    pub velocity_m_s: Vector3<f64>,
    /// Integral of that (m).
    pub position_m: Vector3<f64>,
}

/// What happened between two sets of one vehicle, in the level frame of the earlier.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// For how long (s).
    pub elapsed_s: f64,
    /// Turn about the vertical (rad).
    pub yaw_rad: f64,
    /// Change of velocity (m/s).
    pub velocity_m_s: Vector3<f64>,
    /// Change of position beyond what the velocity at the beginning explains (m).
    pub position_m: Vector3<f64>,
}

impl Inertial {
    /// Nothing integrated yet.
    #[must_use]
    pub fn zero() -> Self {
        Self {
            elapsed_s: 0.0,
            yaw_rad: 0.0,
            velocity_m_s: Vector3::zeros(),
            position_m: Vector3::zeros(),
        }
    }

    /// What happened since an earlier state of the same integrals.
    #[must_use]
    pub fn since(&self, earlier: &Self) -> Motion {
        let elapsed_s = self.elapsed_s - earlier.elapsed_s;
        let level_from_gyro = Rotation3::from_axis_angle(&Vector3::z_axis(), -earlier.yaw_rad);
        Motion {
            elapsed_s,
            yaw_rad: self.yaw_rad - earlier.yaw_rad,
            velocity_m_s: level_from_gyro * (self.velocity_m_s - earlier.velocity_m_s),
            position_m: level_from_gyro
                * (self.position_m - earlier.position_m - earlier.velocity_m_s * elapsed_s),
        }
    }
}
