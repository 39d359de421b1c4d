//! The anonymous feature set: what one vehicle tells everybody of its attitude, its motion and the robots that its camera
//! sees, levelled by its own attitude (Cognetti et al., section II). Who a feature is, nobody says, for nobody knows.

use crate::check;
use crate::codec::{Body, DecodeError};
use crate::limits::{
    ACCELERATION_MAX_M_S2, COORDINATE_MAX_M, FEATURES_PER_FRAME_MAX, PACKET_BYTES_MAX,
    RATE_MAX_RAD_S, SPEED_MAX_M_S, TRACKS_PER_SET_MAX,
};
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI};

/// Largest turn or time since the boot that is told, in radians or seconds: thirty years.
const SINCE_BOOT_MAX: f64 = 1e9;

/// Body of a packet on `x/features`. The envelope's time is when the features were seen. Vectors are in the level frame
/// of that instant (the body's origin, z up, x along its heading), and the gyro frame is that turned back by
/// [`Integrals::yaw_rad`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct FeatureSet {
    /// When this packet was sent, in nanoseconds of the sender's clock.
    #[serde(with = "crate::le")]
    pub sent_ns: i64,
    /// Roll (rad); attitude is `Rz(yaw) Ry(pitch) Rx(roll)`.
    pub roll_rad: f32,
    /// Pitch (rad), positive nose down.
    pub pitch_rad: f32,
    /// Yaw rate (rad/s), counter-clockwise.
    pub yaw_rate_rad_s: f32,
    /// Mean proper acceleration since the set before (m/s^2); at rest (0, 0, g).
    pub acceleration_m_s2: [f32; 3],
    /// Integrals of the inertial sensor since the boot: a lost packet loses nothing.
    pub integrals: Integrals,
    /// What was seen, in no order that tells who it is.
    pub features: Vec<Feature>,
    /// What has been seen for a while.
    pub tracks: Vec<Track>,
}

/// What the inertial sensor said since the boot, summed up.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Integrals {
    /// How long it was summed up (s).
    pub elapsed_s: f64,
    /// Yaw, not wrapped (rad).
    pub yaw_rad: f64,
    /// Acceleration without gravity, in the gyro frame (m/s).
    pub velocity_m_s: [f64; 3],
    /// The integral of that (m).
    pub position_m: [f64; 3],
}

/// One robot, or what looks like one.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Feature {
    /// Counter-clockwise from the x axis (rad), -pi to pi.
    pub azimuth_rad: f32,
    /// From straight up (rad), 0 to pi.
    pub zenith_rad: f32,
    /// Standard deviation across the direction, per axis (rad).
    pub sigma_rad: f32,
    /// Which of the tracks it went into.
    pub track: Option<TrackNumber>,
}

/// Number of a track within a boot: two features with one number are the same thing, whatever it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct TrackNumber(#[serde(with = "crate::le")] pub u16);

/// Something that the sender follows from image to image.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Track {
    /// Which.
    pub number: TrackNumber,
    /// In the gyro frame, as a feature's (rad).
    pub azimuth_rad: f32,
    /// In the gyro frame, as a feature's (rad).
    pub zenith_rad: f32,
    /// Variance across the direction, per axis (rad^2).
    pub variance_rad2: f32,
    /// 1 when it was seen often enough to be believed, else 0.
    pub confirmed: u8,
}

impl Body for FeatureSet {
    const BYTES_MAX: usize = PACKET_BYTES_MAX;
    fn check(&self) -> Result<(), DecodeError> {
        check::within("roll_rad", &[self.roll_rad.into()], ANGLE_MAX_RAD)?;
        check::within("pitch_rad", &[self.pitch_rad.into()], FRAC_PI_2 + ROUNDING)?;
        check::within(
            "yaw_rate_rad_s",
            &[self.yaw_rate_rad_s.into()],
            RATE_MAX_RAD_S,
        )?;
        check::within(
            "acceleration_m_s2",
            &self.acceleration_m_s2.map(f64::from),
            ACCELERATION_MAX_M_S2,
        )?;
        self.integrals.check()?;
        check::at_most("features", &self.features, FEATURES_PER_FRAME_MAX)?;
        self.features.iter().try_for_each(Feature::check)?;
        check::at_most("tracks", &self.tracks, TRACKS_PER_SET_MAX)?;
        self.tracks.iter().try_for_each(Track::check)
    }
}

/// What single precision may add to an angle.
const ROUNDING: f64 = 1e-6;
const ANGLE_MAX_RAD: f64 = PI + ROUNDING;

fn check_direction(azimuth_rad: f32, zenith_rad: f32) -> Result<(), DecodeError> {
    check::within("azimuth_rad", &[azimuth_rad.into()], ANGLE_MAX_RAD)?;
    check::within("zenith_rad", &[zenith_rad.into()], ANGLE_MAX_RAD)?;
    if zenith_rad >= 0.0 {
        Ok(())
    } else {
        Err(DecodeError::OutOfRange {
            field: "zenith_rad",
        })
    }
}

impl Integrals {
    fn check(&self) -> Result<(), DecodeError> {
        check::within("elapsed_s", &[self.elapsed_s], SINCE_BOOT_MAX)?;
        check::within("yaw_rad", &[self.yaw_rad], SINCE_BOOT_MAX)?;
        // Nothing holds these: they drift as far as the accelerometer's bias takes them.
        let drift_max = SPEED_MAX_M_S * COORDINATE_MAX_M;
        check::within("velocity_m_s", &self.velocity_m_s, drift_max)?;
        check::finite("position_m", &self.position_m)
    }
}

impl Feature {
    fn check(&self) -> Result<(), DecodeError> {
        check_direction(self.azimuth_rad, self.zenith_rad)?;
        check::sigma("sigma_rad", self.sigma_rad.into())
    }
}

impl Track {
    fn check(&self) -> Result<(), DecodeError> {
        check_direction(self.azimuth_rad, self.zenith_rad)?;
        check::sigma("variance_rad2", self.variance_rad2.into())?;
        if self.confirmed <= 1 {
            Ok(())
        } else {
            Err(DecodeError::OutOfRange { field: "confirmed" })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec;

    fn full() -> FeatureSet {
        FeatureSet {
            sent_ns: i64::MAX,
            roll_rad: 0.1,
            pitch_rad: -0.1,
            yaw_rate_rad_s: 0.5,
            acceleration_m_s2: [0.0, 0.0, 9.8],
            integrals: Integrals {
                elapsed_s: 1e6,
                yaw_rad: -1e4,
                velocity_m_s: [1.0; 3],
                position_m: [1.0; 3],
            },
            features: vec![
                Feature {
                    azimuth_rad: 1.0,
                    zenith_rad: 1.0,
                    sigma_rad: 0.1,
                    track: Some(TrackNumber(u16::MAX)),
                };
                FEATURES_PER_FRAME_MAX
            ],
            tracks: vec![
                Track {
                    number: TrackNumber(u16::MAX),
                    azimuth_rad: 1.0,
                    zenith_rad: 1.0,
                    variance_rad2: 0.01,
                    confirmed: 1,
                };
                TRACKS_PER_SET_MAX
            ],
        }
    }

    #[test]
    fn a_set_of_everything_that_is_allowed_fits_a_packet() {
        assert_eq!(full().check(), Ok(()));
        let bytes = codec::body_bytes(&full());
        assert!(bytes <= FeatureSet::BYTES_MAX, "{bytes}");
    }

    #[test]
    fn one_feature_or_track_too_many_is_refused() {
        let mut set = full();
        set.features.push(set.features[0]);
        assert!(matches!(
            set.check(),
            Err(DecodeError::TooMany { field, .. }) if field == "features"
        ));
        let mut set = full();
        set.tracks.push(set.tracks[0]);
        assert!(matches!(
            set.check(),
            Err(DecodeError::TooMany { field, .. }) if field == "tracks"
        ));
    }

    #[test]
    fn what_is_no_angle_no_variance_or_no_word_is_refused_by_name() {
        let refused = |change: &dyn Fn(&mut FeatureSet)| {
            let mut set = full();
            change(&mut set);
            match set.check() {
                Err(DecodeError::OutOfRange { field } | DecodeError::NotFinite { field }) => field,
                other => panic!("{other:?}"),
            }
        };
        assert_eq!(refused(&|set| set.roll_rad = 4.0), "roll_rad");
        assert_eq!(refused(&|set| set.pitch_rad = 2.0), "pitch_rad");
        assert_eq!(
            refused(&|set| set.features[3].zenith_rad = -0.1),
            "zenith_rad"
        );
        assert_eq!(
            refused(&|set| set.features[3].azimuth_rad = f32::NAN),
            "azimuth_rad"
        );
        assert_eq!(refused(&|set| set.features[3].sigma_rad = 0.0), "sigma_rad");
        assert_eq!(
            refused(&|set| set.tracks[3].variance_rad2 = -1.0),
            "variance_rad2"
        );
        assert_eq!(refused(&|set| set.tracks[3].confirmed = 2), "confirmed");
        assert_eq!(
            refused(&|set| set.integrals.position_m[1] = f64::INFINITY),
            "position_m"
        );
    }
}
