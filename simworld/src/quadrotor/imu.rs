//! The inertial sensor of a quadrotor: what it feels, with noise, vibration, bias and rounding.

use super::{Course, Motion};
use crate::bounded::{not_negative, positive};
use crate::streams::{Purpose, Streams};
use nalgebra::Vector3;
use rand::{Rng, RngExt};
use rand_distr::{Distribution, StandardNormal};
use serde::{Deserialize, Serialize};

/// The paper states its noise in the unit of a standard deviation and calls it a variance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stated {
    /// The word is taken: the numbers are squared.
    #[default]
    Variance,
    /// The unit is taken.
    StandardDeviation,
}

/// What the inertial sensor is like. The defaults are the sensor of Cognetti et al., section IV; its noise contains
/// the vibration of motors and propellers.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ImuSettings {
    /// Samples a second.
    #[serde(deserialize_with = "positive")]
    pub rate_hz: f64,
    /// How the noise below is to be read.
    pub stated: Stated,
    /// Accelerometer noise per axis, in m/s^2, or its square.
    pub force_noise: [f64; 3],
    /// Gyroscope noise per axis, in deg/s, or its square.
    pub rate_noise: [f64; 3],
    /// The accelerometer's resolution, m/s^2; 0 does not round.
    #[serde(deserialize_with = "not_negative")]
    pub force_resolution_m_s2: f64,
    /// The gyroscope's resolution, deg/s; 0 does not round.
    #[serde(deserialize_with = "not_negative")]
    pub rate_resolution_deg_s: f64,
    /// Constant accelerometer bias, this large on every axis, its signs drawn, m/s^2.
    #[serde(deserialize_with = "not_negative")]
    pub force_bias_m_s2: f64,
    /// Constant gyroscope bias, this large on every axis, its signs drawn, deg/s.
    #[serde(deserialize_with = "not_negative")]
    pub rate_bias_deg_s: f64,
}

impl Default for ImuSettings {
    fn default() -> Self {
        Self {
            rate_hz: 400.0,
            stated: Stated::Variance,
            force_noise: [0.1, 0.1, 0.6],
            rate_noise: [0.64, 0.64, 1.12],
            force_resolution_m_s2: 0.019,
            rate_resolution_deg_s: 0.29,
            force_bias_m_s2: 0.0,
            rate_bias_deg_s: 0.0,
        }
    }
}

impl ImuSettings {
    /// What a driver says of the accelerometer's noise, one number for all axes: the root of their mean square, m/s^2.
    #[must_use]
    pub fn stated_force_sigma_m_s2(&self) -> f64 {
        (self.force_sigma_m_s2().norm_squared() / 3.0).sqrt()
    }

    /// The same of the gyroscope, rad/s.
    #[must_use]
    pub fn stated_rate_sigma_rad_s(&self) -> f64 {
        (self.rate_sigma_rad_s().norm_squared() / 3.0).sqrt()
    }

    /// A sensor that errs in nothing.
    #[must_use]
    pub fn perfect() -> Self {
        Self {
            force_noise: [0.0; 3],
            rate_noise: [0.0; 3],
            force_resolution_m_s2: 0.0,
            rate_resolution_deg_s: 0.0,
            ..Self::default()
        }
    }

    /// Standard deviation of the accelerometer's noise per axis, m/s^2.
    #[must_use]
    pub fn force_sigma_m_s2(&self) -> Vector3<f64> {
        self.sigma(self.force_noise)
    }

    /// Standard deviation of the gyroscope's noise per axis, rad/s.
    #[must_use]
    pub fn rate_sigma_rad_s(&self) -> Vector3<f64> {
        self.sigma(self.rate_noise).map(f64::to_radians)
    }

    fn sigma(&self, stated: [f64; 3]) -> Vector3<f64> {
        Vector3::from(stated).map(|stated| match self.stated {
            Stated::Variance => stated.sqrt(),
            Stated::StandardDeviation => stated,
        })
    }
}

/// One sample.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuSample {
    /// When, in seconds since the start.
    pub taken_s: f64,
    /// Angular rate, body frame, rad/s.
    pub rate_rad_s: Vector3<f64>,
    /// Specific force, body frame, m/s^2; at rest it points up.
    pub force_m_s2: Vector3<f64>,
}

/// The inertial sensor of one quadrotor. Every sample can be asked for in any order.
#[derive(Clone, Debug)]
pub struct Imu {
    settings: ImuSettings,
    vehicle: usize,
    begins_s: f64,
    streams: Streams,
    rate_bias_rad_s: Vector3<f64>,
    force_bias_m_s2: Vector3<f64>,
}

impl Imu {
    /// The sensor of a vehicle, with its biases drawn; its first sample is taken at `begins_s`.
    #[must_use]
    pub fn new(settings: ImuSettings, vehicle: usize, begins_s: f64, streams: Streams) -> Self {
        let mut rng = streams.vehicle(vehicle, Purpose::InertialBias);
        let mut signs =
            |size: f64| Vector3::from_fn(|_, _| if rng.random::<bool>() { size } else { -size });
        Self {
            rate_bias_rad_s: signs(settings.rate_bias_deg_s.to_radians()),
            force_bias_m_s2: signs(settings.force_bias_m_s2),
            settings,
            vehicle,
            begins_s,
            streams,
        }
    }

    /// Its constant errors: gyroscope, rad/s, and accelerometer, m/s^2.
    #[must_use]
    pub const fn biases(&self) -> (Vector3<f64>, Vector3<f64>) {
        (self.rate_bias_rad_s, self.force_bias_m_s2)
    }

    /// When the `index`th sample is taken (s).
    #[must_use]
    pub fn taken_s(&self, index: usize) -> f64 {
        self.begins_s + index as f64 / self.settings.rate_hz
    }

    /// The `index`th sample on a course.
    #[must_use]
    pub fn sample(&self, course: &Course, index: usize) -> ImuSample {
        let taken_s = self.taken_s(index);
        let motion = Motion::at(course, taken_s);
        let mut rng = self.streams.nth(self.vehicle, index, Purpose::Inertial);
        let force = motion.specific_force_m_s2()
            + self.force_bias_m_s2
            + noise(&self.settings.force_sigma_m_s2(), &mut rng);
        let rate = motion.angular_rate_rad_s
            + self.rate_bias_rad_s
            + noise(&self.settings.rate_sigma_rad_s(), &mut rng);
        let rate_resolution = self.settings.rate_resolution_deg_s.to_radians();
        ImuSample {
            taken_s,
            rate_rad_s: rounded(&rate, rate_resolution),
            force_m_s2: rounded(&force, self.settings.force_resolution_m_s2),
        }
    }
}

fn noise(sigma: &Vector3<f64>, rng: &mut impl Rng) -> Vector3<f64> {
    let mut normal = || -> f64 { StandardNormal.sample(rng) };
    Vector3::new(normal(), normal(), normal()).component_mul(sigma)
}

fn rounded(value: &Vector3<f64>, resolution: f64) -> Vector3<f64> {
    if resolution > 0.0 {
        value.map(|value| (value / resolution).round() * resolution)
    } else {
        *value
    }
}
