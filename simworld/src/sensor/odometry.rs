//! Odometry between two instants: the true increment of the body, with noise on its right (the later body's) side.

use super::position;
use super::settings::section_v_concentration;
use crate::bounded::not_negative;
use crate::streams::{Purpose, Streams};
use crate::trajectory::Trajectory;
use crate::truth::{self, Pose};
use crate::von_mises_fisher::VonMisesFisher;
use rand_chacha::ChaCha8Rng;
use rand_distr::Distribution;
use serde::{Deserialize, Serialize};

/// The noise that one round's increment carries; the default is section V's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct OdometryNoise {
    /// Concentration of the rotation noise of one round.
    pub rotation_concentration: VonMisesFisher,
    /// Standard deviation of one round's translation per axis, metres.
    #[serde(deserialize_with = "not_negative")]
    pub translation_std_m: f64,
}

impl Default for OdometryNoise {
    fn default() -> Self {
        Self {
            rotation_concentration: section_v_concentration(),
            translation_std_m: 0.001,
        }
    }
}

/// The odometer of one vehicle.
#[derive(Clone, Debug)]
pub struct Odometry {
    noise: OdometryNoise,
    period_s: f64,
    rng: ChaCha8Rng,
}

impl Odometry {
    /// The odometer of the vehicle with this index; `noise` is that of one round of `period_s` seconds.
    #[must_use]
    pub fn new(noise: OdometryNoise, period_s: f64, vehicle: usize, streams: &Streams) -> Self {
        Self {
            noise,
            period_s,
            rng: streams.vehicle(vehicle, Purpose::Odometry),
        }
    }

    /// The measured `earlier_from_later` of the body, metres, of two true poses `elapsed_s` seconds apart. The
    /// variance of the noise grows with the time, so that the parts of a round add up to the noise of the round.
    pub fn increment(
        &mut self,
        world_from_earlier: &Pose,
        world_from_later: &Pose,
        elapsed_s: f64,
    ) -> Pose {
        let increment = world_from_earlier.inv_mul(world_from_later);
        if elapsed_s <= 0.0 {
            return increment;
        }
        let ratio = elapsed_s / self.period_s;
        let rotation = self
            .noise
            .rotation_concentration
            .grown(ratio)
            .sample(&mut self.rng);
        let translation_m =
            position::normal(self.noise.translation_std_m * ratio.sqrt(), &mut self.rng);
        increment * truth::pose(rotation, translation_m)
    }

    /// The measured increment of a vehicle on this trajectory between two times, seconds since the start of the
    /// motion. While it stands before the start (t < 0) there is no noise: its pose at the start is known exactly.
    pub fn between(&mut self, trajectory: &Trajectory, from_s: f64, to_s: f64) -> Pose {
        let noisy_s = to_s.max(0.0) - from_s.max(0.0);
        self.increment(
            &trajectory.pose_at(from_s),
            &trajectory.pose_at(to_s),
            noisy_s,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::truth::pose_from_euler;
    use nalgebra::Vector3;

    fn odometer(noise: OdometryNoise) -> Odometry {
        Odometry::new(noise, 0.2, 0, &Streams::new(5, 0))
    }

    #[test]
    fn an_almost_exact_odometer_composes_to_the_true_pose() {
        let exact = OdometryNoise {
            rotation_concentration: VonMisesFisher::new(1e24).unwrap(),
            translation_std_m: 0.0,
        };
        let mut odometer = odometer(exact);
        let path: Trajectory = toml::from_str("section-v = { robot = 3 }").unwrap();
        let mut world_from_body = path.pose_at(0.0);
        for k in 0..100 {
            world_from_body *= odometer.between(&path, 0.2 * f64::from(k), 0.2 * f64::from(k + 1));
        }
        let error = world_from_body.inv_mul(&path.pose_at(20.0));
        assert!(
            error.translation.vector.norm() < 1e-9 && error.rotation.angle() < 1e-9,
            "{error}"
        );
    }

    #[test]
    fn the_noise_sits_on_the_right_side_of_the_increment() {
        // Far apart and turned about: noise on the left would be blown up by the lever arm and show in world axes.
        let noise = OdometryNoise {
            rotation_concentration: VonMisesFisher::new(10_000.0).unwrap(),
            translation_std_m: 0.0,
        };
        let mut odometer = odometer(noise);
        let (from, to) = (
            Pose::identity(),
            pose_from_euler(Vector3::new(100.0, 0.0, 0.0), 1.0, 0.0, 0.0),
        );
        let measured = odometer.increment(&from, &to, 0.2);
        assert!((measured.translation.vector - Vector3::new(100.0, 0.0, 0.0)).norm() < 1e-9);
        assert!(measured.rotation.angle_to(&to.rotation) > 1e-4);
    }

    #[test]
    fn the_noise_of_four_quarters_of_a_round_is_the_noise_of_the_round() {
        let mut odometer = odometer(OdometryNoise::default());
        let still = Pose::identity();
        let (mut rotation, mut translation, n) = (0.0, 0.0, 20_000);
        for _ in 0..n {
            let round = (0..4).fold(still, |pose, _| {
                pose * odometer.increment(&still, &still, 0.05)
            });
            rotation += round.rotation.scaled_axis().norm_squared() / f64::from(3 * n);
            translation += round.translation.vector.norm_squared() / f64::from(3 * n);
        }
        assert!((rotation.sqrt() - 0.02).abs() < 2e-4, "{}", rotation.sqrt());
        assert!(
            (translation.sqrt() - 0.001).abs() < 1e-5,
            "{}",
            translation.sqrt()
        );
    }

    #[test]
    fn standing_before_the_start_costs_nothing() {
        let mut odometer = odometer(OdometryNoise::default());
        let path: Trajectory = toml::from_str("section-v = { robot = 1 }").unwrap();
        let increment = odometer.between(&path, -2.0, 0.0);
        assert!(increment.rotation.angle() < 1e-12 && increment.translation.vector.norm() < 1e-12);
        assert!(odometer.between(&path, -0.1, 0.1).rotation.angle() > 0.0);
    }
}
