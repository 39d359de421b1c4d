//! What the team estimator says of itself, of this vehicle and of its neighbours.

use skein_estimation::VehicleId;
use skein_proto::document::{NoiseScales, TeamHealth, TeamMemberHealth};
use skein_proto::name::Name;

use super::Smoothing;

impl Smoothing {
    /// How uncertain the own orientation is (rad): root of the sum of its variances about the three axes.
    pub(crate) fn rotation_sigma_rad(&self) -> Option<f64> {
        self.sigma(0)
    }

    /// The root of the sum of three variances of the own pose, from a row on.
    fn sigma(&self, from: usize) -> Option<f64> {
        let covariance = &self.team.own()?.covariance;
        let sum: f64 = (from..from + 3).map(|axis| covariance[(axis, axis)]).sum();
        Some(sum.sqrt()).filter(|sigma| sigma.is_finite())
    }

    /// What the health says of the estimator.
    pub(crate) fn to_document(&self) -> TeamHealth {
        let (scales, counted) = (self.team.scales(), self.team.statistics());
        TeamHealth {
            noise_scales: NoiseScales {
                odometry_rotation: scales.odometry.rotation(),
                odometry_translation: scales.odometry.translation(),
                measurement_rotation: scales.measurement.rotation(),
                measurement_translation: scales.measurement.translation(),
            },
            lag_rounds: counted.lag_rounds,
            poses: counted.poses,
            members: counted.members,
            edges: counted.edges,
            new_edges: self.last.verdicts.len() as u64,
            gated: self
                .last
                .verdicts
                .iter()
                .filter(|verdict| verdict.failed_gate)
                .count() as u64,
            gated_total: counted.gated_total,
            edges_total: counted.edges_total,
            left_out: counted.left_out,
            evicted: counted.evicted,
            restarts: self.restarts,
            position_sigma_m: self.sigma(3),
            rotation_sigma_rad: self.rotation_sigma_rad(),
        }
    }

    /// What it thinks of a neighbour: its health, and whether it is in quarantine.
    pub(crate) fn member(&self, name: Name) -> Option<(TeamMemberHealth, bool)> {
        let member = self.team.member(VehicleId(name.hash()))?;
        let document = TeamMemberHealth {
            doubted_share: member.doubted_share,
            odometry_ratio: member.odometry_ratio,
            gyro_bias_rad_s: member.gyro_bias_rad_s.map(|turned| -turned),
            odometer_scale: member.odometer_scale,
            odometry_liar: member.odometry_lies,
        };
        Some((document, member.quarantined))
    }
}
