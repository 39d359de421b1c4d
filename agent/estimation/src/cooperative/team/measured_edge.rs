//! What was measured between two poses of the window, or of one pose from the world: a factor with a robust weight.

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use super::noise_scales::ScalePair;
use crate::cooperative::measurement::{End, Jacobian, Kind, Measurement, Noise};
use crate::{Body, Sensor, Transform, VehicleId, World, so3};

/// Names a pose of the window for good: never used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct PoseId(pub(super) u64);

/// A measurement with both its ends.
#[derive(Clone, Debug)]
pub(super) struct MeasuredEdge {
    /// The measuring pose; none for the world, of which an absolute fix is measured.
    pub(super) from: Option<PoseId>,
    pub(super) to: PoseId,
    pub(super) from_end: Transform<Body, Sensor>,
    pub(super) to_end: Transform<Body, Sensor>,
    pub(super) measurement: Measurement,
    pub(super) noise: Noise,
    /// Who measured it.
    pub(super) by: VehicleId,
    /// Of whom it is.
    pub(super) of: VehicleId,
    /// Whether it came in this round.
    pub(super) is_new: bool,
    pub(super) failed_gate: bool,
    /// Whether, before it, so little was known of how its ends are turned against each other that it proves nobody wrong.
    pub(super) is_apart: bool,
    /// At the last poses.
    pub(super) linear: Linear,
    /// By its kernel, at the last linearisation.
    pub(super) weight: f64,
}

/// A linearised edge, whitened: `r + J (xi_to - xi_from)` of unit variance. Angles are in the first three rows, lengths
/// in the last three; rows that the kind has not are zero.
#[derive(Clone, Debug, Default)]
pub(super) struct Linear {
    pub(super) residual: Vector6<f64>,
    pub(super) twist: Matrix6<f64>,
}

impl Linear {
    pub(super) fn square(&self) -> f64 {
        self.residual.norm_squared()
    }
}

/// Degrees of freedom in angles and in lengths.
pub(super) const fn degrees_of_freedom(kind: Kind) -> (f64, f64) {
    match kind {
        Kind::Pose => (3.0, 3.0),
        Kind::Orientation => (3.0, 0.0),
        Kind::Position => (0.0, 3.0),
        Kind::Bearing => (2.0, 0.0),
        Kind::Distance => (0.0, 1.0),
    }
}

impl MeasuredEdge {
    pub(super) fn degrees_of_freedom(&self) -> f64 {
        let (rotation, translation) = degrees_of_freedom(self.measurement.kind());
        rotation + translation
    }

    /// The same by axis of the residual, angles first: what noise of one standard deviation comes to on each.
    pub(super) fn degrees_of_freedom_by_row(&self) -> [f64; 6] {
        match &self.measurement {
            Measurement::Pose(_) => [1.0; 6],
            Measurement::Orientation(_) => [1.0, 1.0, 1.0, 0.0, 0.0, 0.0],
            Measurement::Position(_) => [0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
            // Nothing along the direction itself.
            Measurement::Bearing(bearing) => {
                let along = bearing.direction();
                let across = |axis: usize| 1.0 - along[axis] * along[axis];
                [across(0), across(1), across(2), 0.0, 0.0, 0.0]
            }
            Measurement::Distance(_) => [0.0, 0.0, 0.0, 1.0, 0.0, 0.0],
        }
    }

    /// Linearises at two poses; `from` is that of the world for an absolute fix.
    ///
    /// A relative measurement depends on `xi_to - xi_from` alone, whatever the lever arms: a twist of the world moves both
    /// ends alike. So one Jacobian says both.
    pub(super) fn linearise(
        &self,
        from: &Transform<World, Body>,
        to: &Transform<World, Body>,
        scales: &ScalePair,
    ) -> Linear {
        let from: End = (*from * self.from_end).reframe();
        let to: End = (*to * self.to_end).reframe();
        let mut linear = Linear {
            residual: Vector6::zeros(),
            twist: Matrix6::zeros(),
        };
        match &self.measurement {
            Measurement::Pose(pose) => {
                linear.residual = pose.residual(&from, &to);
                linear.twist = world_twist(&pose.jacobian(&from, &to), &to);
            }
            Measurement::Orientation(orientation) => linear.angles(
                &orientation.residual(&from, &to),
                &orientation.jacobian(&from, &to),
                &to,
            ),
            Measurement::Bearing(bearing) => linear.angles(
                &bearing.residual_on_sphere(&from, &to),
                &bearing.jacobian_on_sphere(&from, &to),
                &to,
            ),
            Measurement::Position(position) => {
                let jacobian = world_twist(&position.jacobian(&from, &to), &to);
                linear.lengths(&position.residual(&from, &to), &jacobian);
            }
            Measurement::Distance(distance) => {
                let row = world_twist(&distance.jacobian(&from, &to), &to);
                linear.residual[3] = distance.residual(&from, &to);
                linear.twist.set_row(3, &row);
            }
        }
        let weigh = |sigma: f64, scale: f64| {
            if sigma > 0.0 {
                1.0 / (sigma * scale)
            } else {
                0.0
            }
        };
        let angles = weigh(self.noise.rotation_rad, scales.rotation());
        let lengths = weigh(self.noise.translation, scales.translation());
        for row in 0..6 {
            let weight = if row < 3 { angles } else { lengths };
            linear.residual[row] *= weight;
            linear.twist.row_mut(row).scale_mut(weight);
        }
        linear
    }
}

impl Linear {
    fn angles(&mut self, residual: &Vector3<f64>, jacobian: &Jacobian<3>, to: &End) {
        self.residual.fixed_rows_mut::<3>(0).copy_from(residual);
        self.twist
            .fixed_rows_mut::<3>(0)
            .copy_from(&world_twist(jacobian, to));
    }

    fn lengths(&mut self, residual: &Vector3<f64>, jacobian: &nalgebra::Matrix3x6<f64>) {
        self.residual.fixed_rows_mut::<3>(3).copy_from(residual);
        self.twist.fixed_rows_mut::<3>(3).copy_from(jacobian);
    }
}

/// The derivative in a world twist `(w, v)` of the measured end: `R <- exp(w) R` turns the end by `R^T w` in its own
/// axes, and its origin moves by `v + w x t`.
fn world_twist<const D: usize>(jacobian: &Jacobian<D>, to: &End) -> nalgebra::SMatrix<f64, D, 6> {
    let rotation: Matrix3<f64> = to.rotation.to_rotation_matrix().into_inner();
    let turned = jacobian.to.fixed_columns::<3>(0);
    let moved = jacobian.to.fixed_columns::<3>(3);
    let mut twist = nalgebra::SMatrix::<f64, D, 6>::zeros();
    twist
        .fixed_columns_mut::<3>(0)
        .copy_from(&(turned * rotation.transpose() - moved * so3::hat(&to.translation)));
    twist.fixed_columns_mut::<3>(3).copy_from(&moved);
    twist
}
