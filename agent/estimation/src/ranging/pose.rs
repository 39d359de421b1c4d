//! Where a neighbour is, with the coordinates in which the estimators take their steps.
//!
//! A range is linear in the distance itself, and what a few ranges leave open is a piece of a circle. So steps and
//! covariances are in the distance, two angles across the line of sight and the yaw: there the circle is straight.

use nalgebra::{Matrix4, Vector3, Vector4};
use std::f64::consts::{PI, TAU};

/// Whether height counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// All in one plane: heights are ignored. Unknown are position and yaw, three numbers.
    Planar,
    /// In space, with attitudes known from gravity. Unknown are position and yaw, four numbers.
    Spatial,
}

/// A neighbour as seen from a vehicle, in its level frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativePose {
    /// Where the neighbour is (m).
    pub position_m: Vector3<f64>,
    /// Its heading relative to the vehicle's (rad), counter-clockwise, from -pi to pi.
    pub yaw_rad: f64,
}

/// A small change of a relative pose: distance (m), angle about the vertical and angle up (rad), yaw (rad).
pub(crate) type Step = Vector4<f64>;

/// Nearer than this there is no line of sight to take angles from (m).
const DISTANCE_MIN_M: f64 = 1e-3;
/// A line of sight within this sine of the vertical has no azimuth; its axes are then chosen.
const VERTICAL: f64 = 1e-6;

impl RelativePose {
    /// From a position (m) and a yaw (rad) of any turn.
    #[must_use]
    pub fn new(position_m: Vector3<f64>, yaw_rad: f64) -> Self {
        Self {
            position_m,
            yaw_rad: wrapped(yaw_rad),
        }
    }

    /// How the neighbour sees the vehicle.
    #[must_use]
    pub fn inverse(&self) -> Self {
        Self::new(turned(&-self.position_m, -self.yaw_rad), -self.yaw_rad)
    }

    /// How far the neighbour is (m).
    #[must_use]
    pub fn distance_m(&self) -> f64 {
        self.position_m.norm()
    }

    /// Unit vector to the neighbour and the two axes across it: about the vertical, and up. Distance (m) with them.
    pub(crate) fn axes(&self) -> Axes {
        Axes::of(&self.position_m)
    }

    /// The pose so far away, along a great circle.
    pub(crate) fn stepped(&self, step: &Step) -> Self {
        let axes = self.axes();
        let across = axes.about * step.y + axes.up * step.z;
        let angle = across.norm();
        let direction = if angle > 0.0 {
            axes.direction * angle.cos() + across * (angle.sin() / angle)
        } else {
            axes.direction
        };
        let distance = (axes.distance_m + step.x).max(DISTANCE_MIN_M);
        Self::new(direction * distance, self.yaw_rad + step.w)
    }

    /// The step from this pose to another.
    pub(crate) fn step_to(&self, other: &Self) -> Step {
        let axes = self.axes();
        let theirs = other.axes();
        let along = axes.direction.dot(&theirs.direction);
        let (about, up) = (
            axes.about.dot(&theirs.direction),
            axes.up.dot(&theirs.direction),
        );
        let sine = about.hypot(up);
        let angle = sine.atan2(along);
        let (about, up) = if sine > 0.0 {
            (about * angle / sine, up * angle / sine)
        } else {
            (angle, 0.0)
        };
        Step::new(
            theirs.distance_m - axes.distance_m,
            about,
            up,
            wrapped(other.yaw_rad - self.yaw_rad),
        )
    }

    /// The covariance of position and yaw (x, y, z in m, yaw in rad) from one of steps.
    pub(crate) fn covariance_of(&self, steps: &Matrix4<f64>) -> Matrix4<f64> {
        let jacobian = self.axes().position_by_step();
        jacobian * steps * jacobian.transpose()
    }
}

/// A line of sight.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axes {
    /// Its length (m), never zero.
    pub(crate) distance_m: f64,
    /// Unit vector along it.
    pub(crate) direction: Vector3<f64>,
    /// Unit vector across it, horizontal, counter-clockwise.
    pub(crate) about: Vector3<f64>,
    /// Unit vector across both.
    pub(crate) up: Vector3<f64>,
}

impl Axes {
    pub(crate) fn of(position_m: &Vector3<f64>) -> Self {
        let length = position_m.norm();
        let direction = if length > DISTANCE_MIN_M * 1e-3 {
            position_m / length
        } else {
            Vector3::x()
        };
        let sine = direction.x.hypot(direction.y);
        let about = if sine > VERTICAL {
            Vector3::new(-direction.y / sine, direction.x / sine, 0.0)
        } else {
            Vector3::y()
        };
        Self {
            distance_m: length.max(DISTANCE_MIN_M),
            direction,
            about,
            up: direction.cross(&about),
        }
    }

    /// How position and yaw change with a step.
    pub(crate) fn position_by_step(&self) -> Matrix4<f64> {
        let mut jacobian = Matrix4::zeros();
        let columns = [
            self.direction,
            self.about * self.distance_m,
            self.up * self.distance_m,
        ];
        for (i, column) in columns.iter().enumerate() {
            jacobian.fixed_view_mut::<3, 1>(0, i).copy_from(column);
        }
        jacobian[(3, 3)] = 1.0;
        jacobian
    }

    /// How a step changes with position and yaw: the inverse of [`Axes::position_by_step`].
    pub(crate) fn step_by_position(&self) -> Matrix4<f64> {
        let mut jacobian = Matrix4::zeros();
        let rows = [
            self.direction,
            self.about / self.distance_m,
            self.up / self.distance_m,
        ];
        for (i, row) in rows.iter().enumerate() {
            jacobian
                .fixed_view_mut::<1, 3>(i, 0)
                .copy_from(&row.transpose());
        }
        jacobian[(3, 3)] = 1.0;
        jacobian
    }
}

/// A vector turned about the vertical.
pub(crate) fn turned(vector: &Vector3<f64>, angle_rad: f64) -> Vector3<f64> {
    let (sin, cos) = angle_rad.sin_cos();
    Vector3::new(
        cos * vector.x - sin * vector.y,
        sin * vector.x + cos * vector.y,
        vector.z,
    )
}

/// The angle within half a turn of zero.
pub(crate) fn wrapped(angle_rad: f64) -> f64 {
    let within = angle_rad - TAU * (angle_rad / TAU).round();
    if within <= -PI { within + TAU } else { within }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_step_to_a_pose_leads_there(
            from in prop::array::uniform4(-5.0..5.0_f64),
            to in prop::array::uniform4(-5.0..5.0_f64),
        ) {
            let pose = |n: [f64; 4]| RelativePose::new(Vector3::new(n[0], n[1], n[2]), n[3]);
            let (from, to) = (pose(from), pose(to));
            prop_assume!(from.distance_m() > 0.01 && to.distance_m() > 0.01);
            let reached = from.stepped(&from.step_to(&to));
            prop_assert!((reached.position_m - to.position_m).norm() < 1e-6);
            prop_assert!(wrapped(reached.yaw_rad - to.yaw_rad).abs() < 1e-9);
            let twice = from.inverse().inverse();
            prop_assert!((twice.position_m - from.position_m).norm() < 1e-9);
        }

        #[test]
        fn jacobians_are_what_small_steps_do(numbers in prop::array::uniform4(-5.0..5.0_f64)) {
            let pose = RelativePose::new(Vector3::new(numbers[0], numbers[1], numbers[2]), numbers[3]);
            prop_assume!(numbers[0].hypot(numbers[1]) > 0.1);
            let jacobian = pose.axes().position_by_step();
            for i in 0..4 {
                let mut step = Step::zeros();
                step[i] = 1e-6;
                let moved = pose.stepped(&step);
                let by = (moved.position_m - pose.position_m) * 1e6;
                prop_assert!((by - jacobian.fixed_view::<3, 1>(0, i)).norm() < 1e-4);
            }
            let unit = jacobian * pose.axes().step_by_position();
            prop_assert!((unit - Matrix4::identity()).norm() < 1e-9);
        }
    }

    #[test]
    fn straight_above_and_at_the_same_place_are_no_traps() {
        for position in [Vector3::new(0.0, 0.0, 3.0), Vector3::zeros()] {
            let pose = RelativePose::new(position, 0.0);
            let moved = pose.stepped(&Step::new(0.1, 0.2, -0.1, 4.0));
            assert!(moved.position_m.iter().all(|number| number.is_finite()));
            assert!(moved.yaw_rad.abs() <= PI);
        }
    }
}
