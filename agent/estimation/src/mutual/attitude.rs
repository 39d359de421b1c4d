//! Which way is up: roll and pitch of a vehicle from its gyro and its accelerometer alone, also while it accelerates for
//! long and while the gyro is biased; and its yaw rate (Cognetti et al., section III-A).
//!
//! The gyro is integrated (in the *gyro frame*, whose z is up and whose x is the heading at the beginning). The
//! accelerometer corrects it not by the direction of its force, which is that of gravity only while nothing accelerates, but
//! by what the force comes to when it is integrated twice: a vehicle that comes and goes has gone nowhere, one that is
//! reckoned with a wrong tilt flies away. See `error_state` for the equations.

mod error_state;
mod rest;
mod roaming;
mod settings;
mod strapdown;

pub use settings::{ForceSettings, RateSettings, RestSettings, RoamingSettings, Settings};

use super::direction::wrapped;
use crate::so3;
use error_state::{ErrorState, Interval};
use nalgebra::{UnitQuaternion, Vector2, Vector3};
use rest::{Rest, Rested};
use roaming::Roaming;
use strapdown::{Between, Reading};

/// A longer time without a reading is a gap (s): what happened in it is not known.
pub const GAP_S: f64 = 0.5;
/// A faster turn than this is no reading (rad/s).
pub const RATE_MAX_RAD_S: f64 = 200.0;
/// A larger force than this is no reading (m/s^2).
pub const FORCE_MAX_M_S2: f64 = 2_000.0;

/// The covariance is advanced and corrected in steps of at least this (s).
const CORRECTED_EVERY_S: f64 = 0.02;
/// A rest would teach a bias of the rate that is further off than so many sigmas: then it is a steady turn.
const REST_SIGMAS_MAX: f64 = 4.0;

/// What came of a reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Levelled {
    /// The vehicle moved like this since the reading before.
    Moved(Moved),
    /// It is the first reading, or the first after a gap: the tilt is taken from its force, the biases stay known.
    Begun {
        /// How long after the last good reading; zero for the first (s).
        after_s: f64,
    },
    /// It is not finite or absurdly large, or takes no time, and changes nothing.
    Refused,
}

/// What happened since the reading before, in the gyro frame, gravity and the known biases taken off.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moved {
    /// How long it took (s).
    pub elapsed_s: f64,
    /// Change of velocity (m/s).
    pub velocity_m_s: Vector3<f64>,
    /// Change of position beyond what the velocity at the beginning explains (m).
    pub position_m: Vector3<f64>,
}

/// Levels one vehicle. Readings in the order of time; no allocation, and the same work for each.
#[derive(Clone, Debug)]
pub struct Attitude {
    settings: Settings,
    gyro_from_body: UnitQuaternion<f64>,
    /// Of that, not wrapped.
    yaw_rad: f64,
    rate_bias_rad_s: Vector3<f64>,
    force_bias_m_s2: Vector3<f64>,
    /// Where the vehicle has gone by its own reckoning, which its tilt's error drives away.
    velocity_m_s: Vector2<f64>,
    place_m: Vector2<f64>,
    roaming: Roaming,
    has_rested: bool,
    errors: ErrorState,
    newest: Option<Newest>,
    since_correction: SinceCorrection,
    age_s: f64,
}

/// The newest reading, as it came.
#[derive(Clone, Debug)]
struct Newest {
    reading: Reading,
    rest: Rest,
    /// How long refused readings have taken since (s).
    refused_s: f64,
}

/// What happened since the last correction.
#[derive(Clone, Debug, Default)]
struct SinceCorrection {
    elapsed_s: f64,
    /// Integral of the force in the gyro frame (m/s).
    force_m_s: Vector3<f64>,
    /// Integral of the rate (rad).
    turn_rad: Vector3<f64>,
}

impl Attitude {
    /// Nothing is known yet; the heading at the first reading becomes the gyro frame's x.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            gyro_from_body: UnitQuaternion::identity(),
            yaw_rad: 0.0,
            rate_bias_rad_s: Vector3::zeros(),
            force_bias_m_s2: settings.force.bias_m_s2,
            velocity_m_s: Vector2::zeros(),
            place_m: Vector2::zeros(),
            roaming: Roaming::new(&settings.roaming),
            has_rested: false,
            errors: ErrorState::new(&settings),
            newest: None,
            since_correction: SinceCorrection::default(),
            age_s: 0.0,
            settings,
        }
    }

    /// Takes a reading of the turn rate (rad/s) and of the proper acceleration (m/s^2, at rest +g upwards), both in the
    /// body, `elapsed_s` after the one before.
    ///
    /// After more than [`GAP_S`] without a good reading the tilt begins anew from the force; yaw and biases stay.
    pub fn update(
        &mut self,
        elapsed_s: f64,
        rate_rad_s: &Vector3<f64>,
        force_m_s2: &Vector3<f64>,
    ) -> Levelled {
        let reading = Reading {
            rate_rad_s: *rate_rad_s,
            force_m_s2: *force_m_s2,
        };
        let Some(newest) = &mut self.newest else {
            return if is_one(&reading) {
                self.begin(&reading);
                Levelled::Begun { after_s: 0.0 }
            } else {
                Levelled::Refused
            };
        };
        if !(elapsed_s > 0.0 && elapsed_s.is_finite()) {
            return Levelled::Refused;
        }
        if !is_one(&reading) {
            newest.refused_s += elapsed_s;
            return Levelled::Refused;
        }
        let elapsed_s = elapsed_s + newest.refused_s;
        if elapsed_s > GAP_S {
            self.begin(&reading);
            return Levelled::Begun { after_s: elapsed_s };
        }
        newest.refused_s = 0.0;
        newest.rest.update(&self.settings.rest, &reading, elapsed_s);
        let earlier = std::mem::replace(&mut newest.reading, reading);
        self.age_s += elapsed_s;
        Levelled::Moved(self.advance(&earlier, &reading, elapsed_s))
    }

    /// `level_from_body`: turns what the body sees into the frame that has its z up and its x along the heading
    /// (paper, eq. 12 to 14).
    #[must_use]
    pub fn level_from_body(&self) -> UnitQuaternion<f64> {
        UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -self.yaw_rad) * self.gyro_from_body
    }

    /// `gyro_from_body`: the same without taking the heading off.
    #[must_use]
    pub fn gyro_from_body(&self) -> UnitQuaternion<f64> {
        self.gyro_from_body
    }

    /// Roll (rad), with pitch and yaw as `R = Rz(yaw) Ry(pitch) Rx(roll)`.
    #[must_use]
    pub fn roll_rad(&self) -> f64 {
        let up = self.up_in_body();
        up.y.atan2(up.z)
    }

    /// Pitch (rad), positive nose down.
    #[must_use]
    pub fn pitch_rad(&self) -> f64 {
        let up = self.up_in_body();
        (-up.x).atan2(up.y.hypot(up.z))
    }

    /// Yaw in the gyro frame (rad), not wrapped: the integral of the yaw rate.
    #[must_use]
    pub fn yaw_rad(&self) -> f64 {
        self.yaw_rad
    }

    /// Yaw rate (rad/s), counter-clockwise, of the newest reading (paper, eq. 15): how fast the heading turns. Nose up or
    /// down there is no heading, and the rate is the finite one of a nose two degrees off.
    #[must_use]
    pub fn yaw_rate_rad_s(&self) -> f64 {
        let up = self.up_in_body();
        let rate = self.rate_rad_s();
        // psi' = (q sin phi + r cos phi) / cos theta, with (sin phi, cos phi) cos theta = (up.y, up.z).
        let level = (up.y * up.y + up.z * up.z).max(LEVEL_MIN * LEVEL_MIN);
        (rate.y * up.y + rate.z * up.z) / level
    }

    /// The newest turn rate in the body without its bias (rad/s); zero before the first.
    #[must_use]
    pub fn rate_rad_s(&self) -> Vector3<f64> {
        self.newest.as_ref().map_or_else(Vector3::zeros, |newest| {
            newest.reading.rate_rad_s - self.rate_bias_rad_s
        })
    }

    /// The bias of the turn rate (rad/s, body). About the vertical it is learnt at rest only.
    #[must_use]
    pub fn rate_bias_rad_s(&self) -> Vector3<f64> {
        self.rate_bias_rad_s
    }

    /// The bias of the force (m/s^2, body), what was calibrated included.
    #[must_use]
    pub fn force_bias_m_s2(&self) -> Vector3<f64> {
        self.force_bias_m_s2
    }

    /// Standard deviation of the tilt, of each of its two axes (rad).
    #[must_use]
    pub fn tilt_sigma_rad(&self) -> f64 {
        self.errors.tilt_variance_rad2().sqrt()
    }

    /// The tilt is known as well as the settings ask.
    #[must_use]
    pub fn is_settled(&self) -> bool {
        self.newest.is_some() && self.tilt_sigma_rad() < self.settings.settled_sigma_rad
    }

    /// For how long readings came without a gap (s).
    #[must_use]
    pub fn age_s(&self) -> f64 {
        self.age_s
    }

    fn up_in_body(&self) -> Vector3<f64> {
        self.gyro_from_body.inverse() * Vector3::z()
    }

    /// Takes the tilt from the direction of the force, and keeps the heading.
    fn begin(&mut self, reading: &Reading) {
        let force = reading.force_m_s2 - self.force_bias_m_s2;
        // In free fall nothing says where up is: then the old tilt is as good as any.
        let up = force
            .try_normalize(1e-3)
            .unwrap_or_else(|| self.up_in_body());
        let roll = up.y.atan2(up.z);
        let pitch = (-up.x).atan2(up.y.hypot(up.z));
        self.gyro_from_body = UnitQuaternion::from_euler_angles(roll, pitch, self.yaw_rad);
        self.velocity_m_s = Vector2::zeros();
        self.place_m = Vector2::zeros();
        self.errors.forget_tilt(&self.settings);
        self.since_correction = SinceCorrection::default();
        self.age_s = 0.0;
        self.newest = Some(Newest {
            reading: *reading,
            rest: Rest::from(reading),
            refused_s: 0.0,
        });
    }

    fn advance(&mut self, earlier: &Reading, later: &Reading, elapsed_s: f64) -> Moved {
        let unbiased = |reading: &Reading| Reading {
            rate_rad_s: reading.rate_rad_s - self.rate_bias_rad_s,
            force_m_s2: reading.force_m_s2 - self.force_bias_m_s2,
        };
        let between = Between::of(&unbiased(earlier), &unbiased(later), elapsed_s);
        let force_m_s = self.gyro_from_body * between.velocity_m_s;
        let gravity = Vector3::z() * (self.settings.gravity_m_s2 * elapsed_s);
        let moved = Moved {
            elapsed_s,
            velocity_m_s: force_m_s - gravity,
            position_m: self.gyro_from_body * between.position_m - gravity * (0.5 * elapsed_s),
        };
        self.gyro_from_body *= between.turn;
        self.gyro_from_body.renormalize_fast();
        self.place_m += self.velocity_m_s * elapsed_s + moved.position_m.xy();
        self.velocity_m_s += moved.velocity_m_s.xy();

        let since = &mut self.since_correction;
        since.elapsed_s += elapsed_s;
        since.force_m_s += force_m_s;
        since.turn_rad += (earlier.rate_rad_s + later.rate_rad_s) * (0.5 * elapsed_s);
        if since.elapsed_s >= CORRECTED_EVERY_S {
            self.correct();
        }
        self.follow_heading();
        moved
    }

    fn correct(&mut self) {
        let since = std::mem::take(&mut self.since_correction);
        let interval = Interval {
            elapsed_s: since.elapsed_s,
            rotation: self.gyro_from_body.to_rotation_matrix().into_inner(),
            force_m_s2: since.force_m_s / since.elapsed_s,
            rate_rad_s: since.turn_rad / since.elapsed_s - self.rate_bias_rad_s,
        };
        let settings = &self.settings;
        self.errors.advance(settings, &interval);
        let density = self
            .roaming
            .density(&settings.roaming, &self.place_m, since.elapsed_s);
        self.errors
            .does_not_go_away(density, &interval, &self.place_m);
        self.errors
            .does_not_accelerate(settings.force.jolting, &interval);
        let rested = self
            .newest
            .as_mut()
            .and_then(|newest| newest.rest.told(&settings.rest));
        if let Some(rested) = rested {
            self.learn_from_rest(&rested, &interval);
        }
        let correction = self.errors.take();
        let tilt = Vector3::new(correction.tilt_rad.x, correction.tilt_rad.y, 0.0);
        self.gyro_from_body = so3::exp(&tilt) * self.gyro_from_body;
        self.rate_bias_rad_s += correction.rate_bias_rad_s;
        self.force_bias_m_s2 += correction.force_bias_m_s2;
        self.velocity_m_s += correction.velocity_m_s;
        self.place_m += correction.place_m;
    }

    /// What does not turn shows the bias of its gyro, and what does not accelerate the vertical.
    fn learn_from_rest(&mut self, rested: &Rested, interval: &Interval) {
        let settings = &self.settings;
        // Biases are small as a rule and large as an exception, which is only believed of a vehicle that seems to rest for
        // the first time: in motion, a wide belief takes a circle that is flown for a bias and a slant.
        if !self.has_rested && rested.mean_rate_rad_s.norm() < settings.rest.first_bias_max_rad_s {
            self.errors
                .forget_rate_bias(settings.rest.first_bias_max_rad_s);
            self.has_rested = true;
        }
        let excess_rad_s = rested.mean_rate_rad_s - self.rate_bias_rad_s;
        let density = settings.rest.turning.powi(2) + settings.rate.noise.powi(2);
        let variance = density / rested.elapsed_s;
        if self
            .errors
            .may_be_biased_by(&excess_rad_s, variance, REST_SIGMAS_MAX)
        {
            self.errors.does_not_turn(&excess_rad_s, variance);
            self.errors
                .does_not_accelerate(settings.rest.jolting, interval);
        }
    }

    /// Counts the turns of the heading. Nose up or down there is none, and the old one is kept.
    fn follow_heading(&mut self) {
        let nose = self.gyro_from_body * Vector3::x();
        if nose.x.hypot(nose.y) > 1e-9 {
            self.yaw_rad += wrapped(nose.y.atan2(nose.x) - self.yaw_rad);
        }
    }
}

/// The cosine of the pitch is not taken for less: of a nose two degrees off the vertical.
const LEVEL_MIN: f64 = 0.035;

fn is_one(reading: &Reading) -> bool {
    // A comparison with NaN is false.
    reading.rate_rad_s.norm() <= RATE_MAX_RAD_S && reading.force_m_s2.norm() <= FORCE_MAX_M_S2
}

#[cfg(test)]
mod tests;
