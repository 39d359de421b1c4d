//! One iterated Kalman filter of a neighbour's place.
//!
//! A range is linear in the state, what both did since the last range is not. So it is the motion that is linearised
//! again and again: what is sought is the place now, `x`; what was known is of the place then, `g(x)`, with
//! `q = p + R(psi) v - u`, where `u` and `v` are the places of then in the newest level frames of the two.

use crate::ranging::pose::{Axes, RelativePose, Step, turned};
use crate::ranging::trail::Past;
use nalgebra::{Matrix4, Vector3};

/// Most times that the motion is linearised for one range.
const ITERATIONS_MAX: usize = 4;
/// A step of less than this, squared and over its covariance, ends the iteration.
const NEGLIGIBLE: f64 = 1e-4;
/// A step turns by no more than this (rad).
const TURN_MAX_RAD: f64 = 0.8;

/// What both ends did since the last range.
#[derive(Clone, Copy, Debug)]
pub(super) struct Moved {
    own: Past,
    neighbour: Past,
    own_covariance: Matrix4<f64>,
    neighbour_covariance: Matrix4<f64>,
    planar: bool,
}

impl Moved {
    pub(super) fn new(mut own: Past, mut neighbour: Past, planar: bool) -> Self {
        if planar {
            own.place_m.z = 0.0;
            neighbour.place_m.z = 0.0;
        }
        Self {
            own_covariance: own.covariance(),
            neighbour_covariance: neighbour.covariance(),
            own,
            neighbour,
            planar,
        }
    }
}

/// A Gaussian of where the neighbour is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Hypothesis {
    pub(super) pose: RelativePose,
    /// In steps; in the plane the height's is one, and nothing comes of it.
    pub(super) covariance: Matrix4<f64>,
    pub(super) log_weight: f64,
}

/// A range taken into account.
pub(super) struct Updated {
    pub(super) pose: RelativePose,
    pub(super) covariance: Matrix4<f64>,
    /// Logarithm of how likely the range was (1/m).
    pub(super) log_likelihood: f64,
}

/// What was known of then, around a place now.
struct Linear {
    /// From what was known to the place then.
    off: Step,
    /// How that changes with a step now.
    jacobian: Matrix4<f64>,
    /// Inverse covariance of `off`, that of both odometries included.
    information: Matrix4<f64>,
}

impl Hypothesis {
    /// The place that follows from both motions, with its covariance. None when that is none.
    pub(super) fn predicted(&self, moved: &Moved) -> Option<(RelativePose, Matrix4<f64>)> {
        let pose = moved.own.carried(&moved.neighbour, &self.pose);
        let linear = self.linear(&pose, moved)?;
        let information = linear.jacobian.transpose() * linear.information * linear.jacobian;
        Some((pose, settled(&information, moved.planar)?))
    }

    /// After both motions and a range (m) of some variance (m^2). None when numbers fail.
    pub(super) fn updated(&self, moved: &Moved, range_m: f64, variance_m2: f64) -> Option<Updated> {
        let mut pose = moved.own.carried(&moved.neighbour, &self.pose);
        let (mut information, mut before, mut cost);
        let mut iteration = 0;
        loop {
            let linear = self.linear(&pose, moved)?;
            let pull = linear.jacobian.transpose() * linear.information;
            let residual = range_m - pose.distance_m();
            before = pull * linear.jacobian;
            information = before;
            information[(0, 0)] += 1.0 / variance_m2;
            let mut gradient = -(pull * linear.off);
            gradient.x += residual / variance_m2;
            cost = linear.off.dot(&(linear.information * linear.off))
                + residual * residual / variance_m2;
            let step = information.cholesky()?.solve(&gradient);
            let change = step.dot(&(information * step));
            if iteration == ITERATIONS_MAX || change < NEGLIGIBLE {
                // What the last, small step still gains.
                cost -= change.min(cost);
                pose = pose.stepped(&bounded(&step));
                break;
            }
            pose = pose.stepped(&bounded(&step));
            iteration += 1;
        }
        let volumes = information.determinant() / before.determinant();
        let log_likelihood = -0.5 * (cost + (std::f64::consts::TAU * variance_m2 * volumes).ln());
        let covariance = settled(&information, moved.planar)?;
        let sound = log_likelihood.is_finite() && pose.position_m.iter().all(|one| one.is_finite());
        sound.then_some(Updated {
            pose,
            covariance,
            log_likelihood,
        })
    }

    fn linear(&self, pose: &RelativePose, moved: &Moved) -> Option<Linear> {
        let known = RelativePose::new(
            turned(&self.pose.position_m, moved.own.yaw_rad),
            self.pose.yaw_rad + moved.own.yaw_rad,
        );
        let lever = turned(&moved.neighbour.place_m, pose.yaw_rad);
        let then = RelativePose::new(
            pose.position_m + lever - moved.own.place_m,
            pose.yaw_rad + moved.neighbour.yaw_rad,
        );
        let to_steps = Axes::of(&then.position_m).step_by_position();
        let mut by_step = pose.axes().position_by_step();
        by_step[(0, 3)] = -lever.y;
        by_step[(1, 3)] = lever.x;
        let noise = self.odometry_noise(&then.position_m, pose.yaw_rad, moved);
        let mut covariance = self.covariance + to_steps * noise * to_steps.transpose();
        if moved.planar {
            decouple(&mut covariance);
        }
        Some(Linear {
            off: known.step_to(&then),
            jacobian: to_steps * by_step,
            information: covariance.cholesky()?.inverse(),
        })
    }

    /// Covariance of position and yaw of then, from the errors of place and yaw of both odometries:
    /// `dq = -delta_a - epsilon_a z x q + R delta_b`, `dpsi = epsilon_b - epsilon_a`.
    fn odometry_noise(&self, then: &Vector3<f64>, yaw_rad: f64, moved: &Moved) -> Matrix4<f64> {
        let mut own = Matrix4::identity();
        own[(0, 3)] = -then.y;
        own[(1, 3)] = then.x;
        let (sin, cos) = yaw_rad.sin_cos();
        let mut neighbour = Matrix4::identity();
        neighbour[(0, 0)] = cos;
        neighbour[(0, 1)] = -sin;
        neighbour[(1, 0)] = sin;
        neighbour[(1, 1)] = cos;
        own * moved.own_covariance * own.transpose()
            + neighbour * moved.neighbour_covariance * neighbour.transpose()
    }

    /// The same in a world upside down.
    pub(super) fn below(&self) -> Self {
        let place = &self.pose.position_m;
        let below = Vector3::new(place.x, place.y, -place.z);
        let mut covariance = self.covariance;
        // The axis up across the line of sight is the one that the mirror turns round.
        for i in [0, 1, 3] {
            covariance[(2, i)] = -covariance[(2, i)];
            covariance[(i, 2)] = -covariance[(i, 2)];
        }
        Self {
            pose: RelativePose::new(below, self.pose.yaw_rad),
            covariance,
            log_weight: self.log_weight,
        }
    }

    /// Whether two have become one: each within a standard deviation of the other.
    pub(super) fn is_same(&self, other: &Self) -> bool {
        let there = self.pose.step_to(&other.pose);
        [self, other].iter().all(|one| {
            one.covariance
                .cholesky()
                .is_some_and(|factor| there.dot(&factor.solve(&there)) < 1.0)
        })
    }
}

fn bounded(step: &Step) -> Step {
    let turn = step.y.hypot(step.z).max(step.w.abs());
    step * (TURN_MAX_RAD / turn).min(1.0)
}

/// The covariance of an information matrix.
fn settled(information: &Matrix4<f64>, planar: bool) -> Option<Matrix4<f64>> {
    let mut covariance = information.cholesky()?.inverse();
    if planar {
        decouple(&mut covariance);
    }
    covariance
        .iter()
        .all(|one| one.is_finite())
        .then_some(covariance)
}

/// Makes the height's row that of a number which has nothing to do with the others.
pub(super) fn decouple(covariance: &mut Matrix4<f64>) {
    for i in 0..4 {
        covariance[(2, i)] = 0.0;
        covariance[(i, 2)] = 0.0;
    }
    covariance[(2, 2)] = 1.0;
}
