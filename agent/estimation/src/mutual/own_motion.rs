//! What a vehicle tells of its own motion: level acceleration and cumulative integrals, for its
//! [`FeatureSet`](super::FeatureSet), from its inertial sensor and its attitude.

use super::attitude::{Attitude, Levelled, Settings};
use super::feature_set::Inertial;
use nalgebra::{Rotation3, UnitVector3, Vector3};

/// What happened up to now, as a feature set tells it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Told {
    /// Roll (rad).
    pub roll_rad: f64,
    /// Pitch (rad).
    pub pitch_rad: f64,
    /// Yaw rate (rad/s) of the newest reading (paper, eq. 15).
    pub yaw_rate_rad_s: f64,
    /// Mean proper acceleration in the level frame since something was told last (m/s^2), paper eq. 12; that of rest when
    /// nothing was read since.
    pub acceleration_m_s2: Vector3<f64>,
    /// The integrals since the boot.
    pub inertial: Inertial,
}

/// Integrates one vehicle's readings.
#[derive(Clone, Debug)]
pub struct OwnMotion {
    attitude: Attitude,
    gravity_m_s2: f64,
    inertial: Inertial,
    since_told: SinceTold,
}

#[derive(Clone, Debug, Default)]
struct SinceTold {
    elapsed_s: f64,
    /// Integral of the level acceleration, gravity taken off, each in the level frame of its own instant (m/s).
    velocity_m_s: Vector3<f64>,
}

impl OwnMotion {
    /// Nothing integrated yet.
    #[must_use]
    pub fn new(settings: Settings) -> Self {
        Self {
            gravity_m_s2: settings.gravity_m_s2,
            attitude: Attitude::new(settings),
            inertial: Inertial::zero(),
            since_told: SinceTold::default(),
        }
    }

    /// Takes a reading, as [`Attitude::update`] does. What happened in a gap is not in the integrals but its time is: a
    /// vehicle is held to have kept its heading and velocity.
    pub fn update(
        &mut self,
        elapsed_s: f64,
        rate_rad_s: &Vector3<f64>,
        force_m_s2: &Vector3<f64>,
    ) -> Levelled {
        let yaw_before_rad = self.attitude.yaw_rad();
        let levelled = self.attitude.update(elapsed_s, rate_rad_s, force_m_s2);
        let inertial = &mut self.inertial;
        match levelled {
            Levelled::Moved(moved) => {
                inertial.elapsed_s += moved.elapsed_s;
                inertial.position_m += inertial.velocity_m_s * moved.elapsed_s + moved.position_m;
                inertial.velocity_m_s += moved.velocity_m_s;
                inertial.yaw_rad = self.attitude.yaw_rad();
                // Half way between the two level frames: the mean is one of second order, as the integrals are.
                let yaw_rad = 0.5 * (yaw_before_rad + inertial.yaw_rad);
                self.since_told.elapsed_s += moved.elapsed_s;
                self.since_told.velocity_m_s += about_vertical(-yaw_rad) * moved.velocity_m_s;
            }
            Levelled::Begun { after_s } => {
                inertial.elapsed_s += after_s;
                inertial.position_m += inertial.velocity_m_s * after_s;
            }
            Levelled::Refused => {}
        }
        levelled
    }

    /// What there is to tell now. The mean acceleration of the next begins here.
    pub fn tell(&mut self) -> Told {
        let since = std::mem::take(&mut self.since_told);
        let mean = if since.elapsed_s > 0.0 {
            since.velocity_m_s / since.elapsed_s
        } else {
            Vector3::zeros()
        };
        Told {
            roll_rad: self.attitude.roll_rad(),
            pitch_rad: self.attitude.pitch_rad(),
            yaw_rate_rad_s: self.attitude.yaw_rate_rad_s(),
            acceleration_m_s2: mean + Vector3::z() * self.gravity_m_s2,
            inertial: self.inertial,
        }
    }

    /// A direction seen from the body, in the level frame (paper, eq. 14).
    #[must_use]
    pub fn levelled(&self, direction_in_body: &UnitVector3<f64>) -> UnitVector3<f64> {
        self.attitude.level_from_body() * direction_in_body
    }

    /// The integrals since the boot.
    #[must_use]
    pub const fn inertial(&self) -> &Inertial {
        &self.inertial
    }

    /// The attitude.
    #[must_use]
    pub fn attitude(&self) -> &Attitude {
        &self.attitude
    }
}

fn about_vertical(yaw_rad: f64) -> Rotation3<f64> {
    Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad)
}

#[cfg(test)]
mod tests;
