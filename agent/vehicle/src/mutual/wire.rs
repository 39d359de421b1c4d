//! Feature sets between the wire and the estimator. Both sides look alike; neither knows the other.

use nalgebra::Vector3;
use skein_estimation::mutual::{
    Feature, FeatureSet, Inertial, Track, TrackNumber, direction, feature_set,
};
use skein_estimation::time::Stamp;
use skein_proto::features;

/// A set as everybody is told.
pub(crate) fn to_wire(set: &FeatureSet, sent: Stamp) -> features::FeatureSet {
    let inertial = &set.inertial;
    let feature = |feature: &Feature| features::Feature {
        azimuth_rad: direction::azimuth_rad(&feature.direction) as f32,
        zenith_rad: direction::zenith_rad(&feature.direction) as f32,
        sigma_rad: feature.sigma_rad as f32,
        track: feature.track.map(|track| features::TrackNumber(track.0)),
    };
    let track = |track: &Track| features::Track {
        number: features::TrackNumber(track.number.0),
        azimuth_rad: direction::azimuth_rad(&track.direction) as f32,
        zenith_rad: direction::zenith_rad(&track.direction) as f32,
        variance_rad2: track.variance_rad2 as f32,
        confirmed: track.confirmed.into(),
    };
    features::FeatureSet {
        sent_ns: sent.as_nanos(),
        roll_rad: set.roll_rad as f32,
        pitch_rad: set.pitch_rad as f32,
        yaw_rate_rad_s: set.yaw_rate_rad_s as f32,
        acceleration_m_s2: set.acceleration_m_s2.map(|number| number as f32).into(),
        integrals: features::Integrals {
            elapsed_s: inertial.elapsed_s,
            yaw_rad: inertial.yaw_rad,
            velocity_m_s: inertial.velocity_m_s.into(),
            position_m: inertial.position_m.into(),
        },
        features: set
            .features
            .iter()
            .take(feature_set::FEATURES_MAX)
            .map(feature)
            .collect(),
        tracks: set
            .tracks
            .iter()
            .take(feature_set::TRACKS_MAX)
            .map(track)
            .collect(),
    }
}

/// A set as it was told, at its time on our clock.
pub(crate) fn from_wire(set: &features::FeatureSet, taken: Stamp) -> FeatureSet {
    let at = |azimuth_rad: f32, zenith_rad: f32| {
        direction::from_angles(azimuth_rad.into(), zenith_rad.into())
    };
    let feature = |feature: &features::Feature| Feature {
        direction: at(feature.azimuth_rad, feature.zenith_rad),
        sigma_rad: feature.sigma_rad.into(),
        track: feature.track.map(|track| TrackNumber(track.0)),
    };
    let track = |track: &features::Track| Track {
        number: TrackNumber(track.number.0),
        direction: at(track.azimuth_rad, track.zenith_rad),
        variance_rad2: track.variance_rad2.into(),
        confirmed: track.confirmed == 1,
    };
    let integrals = &set.integrals;
    FeatureSet {
        taken,
        roll_rad: set.roll_rad.into(),
        pitch_rad: set.pitch_rad.into(),
        yaw_rate_rad_s: set.yaw_rate_rad_s.into(),
        acceleration_m_s2: Vector3::from(set.acceleration_m_s2).map(f64::from),
        inertial: Inertial {
            elapsed_s: integrals.elapsed_s,
            yaw_rad: integrals.yaw_rad,
            velocity_m_s: Vector3::from(integrals.velocity_m_s),
            position_m: Vector3::from(integrals.position_m),
        },
        features: set.features.iter().map(feature).collect(),
        tracks: set.tracks.iter().map(track).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_is_what_is_heard_but_for_the_last_digits() {
        let taken = Stamp::from_nanos(5_000_000_000);
        let told = FeatureSet {
            taken,
            roll_rad: 0.1,
            pitch_rad: -0.2,
            yaw_rate_rad_s: 0.3,
            acceleration_m_s2: Vector3::new(0.1, 0.2, 9.8),
            inertial: Inertial {
                elapsed_s: 5.0,
                yaw_rad: -40.0,
                velocity_m_s: Vector3::new(1.0, 2.0, 3.0),
                position_m: Vector3::new(4.0, 5.0, 6.0),
            },
            features: vec![
                Feature {
                    direction: direction::from_angles(2.0, 1.0),
                    sigma_rad: 0.09,
                    track: Some(TrackNumber(7)),
                },
                Feature {
                    direction: direction::from_angles(0.0, 0.0),
                    sigma_rad: 0.09,
                    track: None,
                },
            ],
            tracks: vec![Track {
                number: TrackNumber(7),
                direction: direction::from_angles(-1.0, 2.0),
                variance_rad2: 0.002,
                confirmed: true,
            }],
        };
        let heard = from_wire(&to_wire(&told, taken), taken);
        assert_eq!(heard.taken, taken);
        assert_eq!(heard.inertial, told.inertial);
        assert!((heard.acceleration_m_s2 - told.acceleration_m_s2).norm() < 1e-6);
        for (heard, told) in heard.features.iter().zip(&told.features) {
            assert_eq!(heard.track, told.track);
            assert!(direction::difference(&heard.direction, &told.direction).norm() < 1e-6);
        }
        let [heard] = &heard.tracks[..] else { panic!() };
        assert_eq!((heard.number, heard.confirmed), (TrackNumber(7), true));
        assert!((heard.variance_rad2 - 0.002).abs() < 1e-9);
        let away = direction::difference(&heard.direction, &told.tracks[0].direction);
        assert!(away.norm() < 1e-6);
    }
}
