//! What the levelling filter holds to be true of its sensors and of how vehicles move.

use nalgebra::Vector3;

/// Settings of [`Attitude`](super::Attitude). Noises are densities per root hertz, of each axis: a standard deviation of
/// single readings divided by the root of their rate.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Gravity (m/s^2).
    pub gravity_m_s2: f64,
    /// What is held of the turn rate.
    pub rate: RateSettings,
    /// What is held of the proper acceleration.
    pub force: ForceSettings,
    /// How far vehicles come and go.
    pub roaming: RoamingSettings,
    /// When a vehicle rests.
    pub rest: RestSettings,
    /// Standard deviation of each axis of the tilt that the first reading gives (rad).
    pub first_tilt_sigma_rad: f64,
    /// Standard deviation of each axis of the velocity at the first reading (m/s).
    pub first_speed_m_s: f64,
    /// A tilt whose standard deviation is below this (rad) counts as settled.
    pub settled_sigma_rad: f64,
}

/// What is held of the turn rate.
#[derive(Clone, Debug, PartialEq)]
pub struct RateSettings {
    /// White noise (rad/s per root Hz).
    pub noise: f64,
    /// How far it is wrong by scale and misalignment, as a part of it.
    pub scale_error: f64,
    /// Standard deviation of its bias as long as the vehicle has never rested (rad/s).
    pub bias_sigma_rad_s: f64,
    /// Random walk of the bias (rad/s per root s).
    pub bias_walk: f64,
}

/// What is held of the proper acceleration.
#[derive(Clone, Debug, PartialEq)]
pub struct ForceSettings {
    /// White noise (m/s^2 per root Hz).
    pub noise: f64,
    /// Its bias in the body frame as calibrated (m/s^2); zero when it is not known.
    pub bias_m_s2: Vector3<f64>,
    /// Standard deviation of what the bias is beyond that (m/s^2).
    pub bias_sigma_m_s2: f64,
    /// Random walk of the bias (m/s^2 per root s).
    pub bias_walk: f64,
    /// How hard vehicles accelerate (m/s^2 per root Hz): it makes the force's direction a weak witness of the vertical,
    /// which matters only while nothing better is known.
    pub jolting: f64,
}

/// How far vehicles come and go.
#[derive(Clone, Debug, PartialEq)]
pub struct RoamingSettings {
    /// In what time they come back (s): the correlation time of the place.
    pub back_in_s: f64,
    /// How far, of each axis, is believed at the beginning (m).
    pub first_m: f64,
    /// The least that is ever believed (m).
    pub least_m: f64,
    /// The most (m).
    pub most_m: f64,
    /// In what time the belief becomes wider where the vehicle is seen farther away (s).
    pub widened_in_s: f64,
    /// In what time it becomes narrower (s).
    pub narrowed_in_s: f64,
}

/// When a vehicle is held to rest, and what that says.
#[derive(Clone, Debug, PartialEq)]
pub struct RestSettings {
    /// The rate, smoothed, stays so near to itself, smoothed for longer (rad/s).
    pub rate_change_max_rad_s: f64,
    /// The force, smoothed, stays so near to itself, smoothed for longer (m/s^2).
    pub force_change_max_m_s2: f64,
    /// For so long (s).
    pub confirmed_s: f64,
    /// A mean rate below this may all be bias in the first rest (rad/s). In later ones the bias is known, and what is far
    /// from it is a steady turn.
    pub first_bias_max_rad_s: f64,
    /// How far a resting vehicle still turns (rad/s per root Hz).
    pub turning: f64,
    /// How hard it still accelerates (m/s^2 per root Hz).
    pub jolting: f64,
}

impl Settings {
    /// The one set for everything from a sensor in a hand to a quadrotor whose motors shake it.
    #[must_use]
    pub fn standard() -> Self {
        Self {
            gravity_m_s2: 9.80665,
            rate: RateSettings {
                noise: 7e-4,
                scale_error: 0.002,
                bias_sigma_rad_s: 0.01,
                bias_walk: 5e-5,
            },
            force: ForceSettings {
                noise: 0.02,
                bias_m_s2: Vector3::zeros(),
                bias_sigma_m_s2: 0.04,
                bias_walk: 1e-4,
                jolting: 8.0,
            },
            roaming: RoamingSettings {
                back_in_s: 1.1,
                first_m: 2.0,
                least_m: 0.2,
                most_m: 10.0,
                widened_in_s: 1.0,
                narrowed_in_s: 15.0,
            },
            rest: RestSettings {
                rate_change_max_rad_s: 0.006,
                force_change_max_m_s2: 0.2,
                confirmed_s: 1.0,
                first_bias_max_rad_s: 0.1,
                turning: 8e-4,
                jolting: 0.03,
            },
            first_tilt_sigma_rad: 0.15,
            first_speed_m_s: 3.0,
            settled_sigma_rad: 0.02,
        }
    }
}
