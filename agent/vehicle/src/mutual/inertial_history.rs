//! The vehicle's own attitude and inertial integrals over the last moments, so that a camera frame that comes later is
//! levelled as the vehicle was when it was taken.

use std::collections::VecDeque;

use nalgebra::{UnitQuaternion, Vector3};
use skein_estimation::mutual::attitude::{Levelled, Settings};
use skein_estimation::mutual::{Inertial, OwnMotion};
use skein_estimation::time::{Span, Stamp};
use skein_estimation::{Body, Sensor, Transform};
use skein_proto::frame::ImuFrame;

use crate::refused::Refused;

/// Readings kept: half a second at 1 kHz.
const READINGS_MAX: usize = 512;
/// A camera frame that is at most so much newer than the newest reading is levelled by that one.
const AHEAD_MAX: Span = Span::millis(5);

/// Attitude and integrals, reading by reading.
#[derive(Clone, Debug)]
pub(crate) struct InertialHistory {
    motion: OwnMotion,
    gravity_m_s2: f64,
    instants: VecDeque<Moment>,
}

/// How the vehicle was at one instant.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Moment {
    pub(crate) taken: Stamp,
    pub(crate) level_from_body: UnitQuaternion<f64>,
    pub(crate) yaw_rate_rad_s: f64,
    pub(crate) inertial: Inertial,
}

/// Whether the vehicle's attitude at a time is known.
#[derive(Clone, Copy, Debug)]
pub(crate) enum At {
    Known(Moment),
    /// The readings have not come that far.
    NotYet,
    /// It lies before the oldest reading that is kept.
    Gone,
}

impl InertialHistory {
    pub(crate) fn new(settings: Settings) -> Self {
        Self {
            gravity_m_s2: settings.gravity_m_s2,
            motion: OwnMotion::new(settings),
            instants: VecDeque::new(),
        }
    }

    /// Takes one reading. Its mount turns it; that the sensor does not sit at the body's origin is not accounted for.
    pub(crate) fn read(
        &mut self,
        body_from_sensor: &Transform<Body, Sensor>,
        frame: &ImuFrame,
    ) -> Result<(), Refused> {
        let taken = Stamp::from_nanos(frame.taken_ns);
        let newest = self.instants.back().map(|moment| moment.taken);
        let elapsed = newest.map_or(Span::ZERO, |newest| taken - newest);
        if newest.is_some() && elapsed <= Span::ZERO {
            return Err(Refused::Overlap);
        }
        let turned = |vector: &[f64; 3]| body_from_sensor.rotation * Vector3::from(*vector);
        let levelled = self.motion.update(
            elapsed.as_secs_f64(),
            &turned(&frame.angular_rate_rad_s),
            &turned(&frame.specific_force_m_s2),
        );
        if matches!(levelled, Levelled::Refused) {
            return Err(Refused::Implausible);
        }
        let attitude = self.motion.attitude();
        self.instants.push_back(Moment {
            taken,
            level_from_body: attitude.level_from_body(),
            yaw_rate_rad_s: attitude.yaw_rate_rad_s(),
            inertial: *self.motion.inertial(),
        });
        if self.instants.len() > READINGS_MAX {
            self.instants.pop_front();
        }
        Ok(())
    }

    /// How the vehicle was at an instant, between the two readings around it.
    pub(crate) fn at(&self, instant: Stamp) -> At {
        let after = self
            .instants
            .partition_point(|moment| moment.taken < instant);
        let Some(later) = self.instants.get(after) else {
            return match self.instants.back() {
                Some(newest) if instant - newest.taken <= AHEAD_MAX => At::Known(*newest),
                _ => At::NotYet,
            };
        };
        if later.taken == instant {
            return At::Known(*later);
        }
        let Some(earlier) = after.checked_sub(1).and_then(|at| self.instants.get(at)) else {
            return At::Gone;
        };
        At::Known(earlier.towards(later, instant))
    }

    pub(crate) fn newest(&self) -> Option<&Moment> {
        self.instants.back()
    }

    pub(crate) const fn motion(&self) -> &OwnMotion {
        &self.motion
    }

    /// Mean proper acceleration between two moments, in the level frame half way between them (m/s^2).
    pub(crate) fn mean_acceleration(
        &self,
        earlier: Option<&Moment>,
        later: &Moment,
    ) -> Vector3<f64> {
        let gravity = Vector3::z() * self.gravity_m_s2;
        let Some(earlier) = earlier else {
            return gravity;
        };
        let since = later.inertial.since(&earlier.inertial);
        if since.elapsed_s <= 0.0 {
            return gravity;
        }
        let back = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), -since.yaw_rad);
        gravity + back * since.velocity_m_s / since.elapsed_s
    }
}

impl Moment {
    /// A moment between this one and a later one.
    fn towards(&self, later: &Self, instant: Stamp) -> Self {
        let share = (instant - self.taken).as_secs_f64() / (later.taken - self.taken).as_secs_f64();
        let between = |a: f64, b: f64| a + (b - a) * share;
        let (a, b) = (&self.inertial, &later.inertial);
        Self {
            taken: instant,
            level_from_body: self
                .level_from_body
                .try_slerp(&later.level_from_body, share, 1e-9)
                .unwrap_or(later.level_from_body),
            yaw_rate_rad_s: between(self.yaw_rate_rad_s, later.yaw_rate_rad_s),
            inertial: Inertial {
                elapsed_s: between(a.elapsed_s, b.elapsed_s),
                yaw_rad: between(a.yaw_rad, b.yaw_rad),
                velocity_m_s: a.velocity_m_s.lerp(&b.velocity_m_s, share),
                position_m: a.position_m.lerp(&b.position_m, share),
            },
        }
    }

    /// Roll and pitch (rad).
    pub(crate) fn roll_pitch_rad(&self) -> (f64, f64) {
        let (roll, pitch, _) = self.level_from_body.euler_angles();
        (roll, pitch)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const G: f64 = 9.81;

    fn at(millis: i64) -> Stamp {
        Stamp::default() + Span::millis(millis)
    }

    /// Readings each 5 ms of a vehicle that turns about the vertical.
    fn turning(until_ms: i64, rate_rad_s: f64) -> InertialHistory {
        let mut history = InertialHistory::new(Settings::standard());
        for millis in (0..=until_ms).step_by(5) {
            history
                .read(&Transform::identity(), &frame(millis, rate_rad_s))
                .unwrap();
        }
        history
    }

    fn frame(millis: i64, rate_rad_s: f64) -> ImuFrame {
        ImuFrame {
            taken_ns: at(millis).as_nanos(),
            angular_rate_rad_s: [0.0, 0.0, rate_rad_s],
            specific_force_m_s2: [0.0, 0.0, G],
            rate_sigma_rad_s: 0.01,
            force_sigma_m_s2: 0.1,
        }
    }

    #[test]
    fn between_two_readings_the_vehicle_is_half_way() {
        let history = turning(1_000, 0.5);
        let [before, between, after] = [500, 502, 505].map(|millis| match history.at(at(millis)) {
            At::Known(moment) => moment.inertial.yaw_rad,
            other => panic!("{other:?}"),
        });
        assert!((after - before - 0.0025).abs() < 1e-4, "{before} {after}");
        assert!((between - before - 0.4 * (after - before)).abs() < 1e-12);
    }

    #[test]
    fn a_time_that_is_to_come_is_waited_for_and_one_long_gone_is_given_up() {
        let history = turning(5_000, 0.0);
        assert!(matches!(history.at(at(5_006)), At::NotYet));
        assert!(
            matches!(history.at(at(5_005)), At::Known(_)),
            "the next reading is due"
        );
        assert!(
            matches!(history.at(at(1_000)), At::Gone),
            "only some seconds are kept"
        );
        assert!(history.instants.len() <= READINGS_MAX);
    }

    #[test]
    fn readings_that_go_back_are_refused() {
        let mut history = turning(100, 0.0);
        for millis in [100, 50] {
            let read = history.read(&Transform::identity(), &frame(millis, 0.0));
            assert_eq!(read, Err(Refused::Overlap));
        }
        let absurd = history.read(&Transform::identity(), &frame(105, 900.0));
        assert_eq!(absurd, Err(Refused::Implausible));
    }

    #[test]
    fn a_mount_turns_the_readings() {
        // The sensor stands on its head: what it feels as down is up, and what it feels as left is right.
        let upside_down = Transform::new(
            UnitQuaternion::from_euler_angles(std::f64::consts::PI, 0.0, 0.0),
            Vector3::zeros(),
        );
        let mut history = InertialHistory::new(Settings::standard());
        for millis in (0..=1_000).step_by(5) {
            let mut frame = frame(millis, -0.5);
            frame.specific_force_m_s2 = [0.0, 0.0, -G];
            history.read(&upside_down, &frame).unwrap();
        }
        let newest = history.newest().unwrap();
        let (roll_rad, pitch_rad) = newest.roll_pitch_rad();
        assert!(roll_rad.abs() < 1e-3 && pitch_rad.abs() < 1e-3);
        assert!((newest.inertial.yaw_rad - 0.5).abs() < 0.02);
    }
}
