//! Where a vehicle was, seen from where it is now, and how sure that is.
//!
//! Odometry errors add up backwards: what is said of an earlier place turns about every later one. With the noise of an
//! increment on its body side, the error of a place `p` and the yaw there, in the newest level frame, is
//! `delta = -(v + w x p)`, `epsilon = -w`, where the twist `(w, v)` has the covariance that odometry gathered between.

use super::pose::{RelativePose, turned};
use super::sample::LevelOdometry;
use nalgebra::{Matrix4, Vector2, Vector3};

/// A place of the past, in the newest level frame.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Past {
    /// Where (m).
    pub(crate) place_m: Vector3<f64>,
    /// The heading there, relative to now's (rad).
    pub(crate) yaw_rad: f64,
    /// What odometry gathered since, about the newest place, in the newest axes.
    gathered: Gathered,
}

/// The numbers of a [`Growth`](crate::odometry::Growth) that count when only the yaw is uncertain.
#[derive(Clone, Copy, Debug, Default)]
struct Gathered {
    /// Sum of yaw variances.
    rotation: f64,
    /// The same times where.
    lever: Vector2<f64>,
    /// The same times the squares xx, xy and yy of where.
    square: [f64; 3],
    /// Sum of translation variances, per axis.
    translation: f64,
}

impl Past {
    /// An earlier pose of the same odometry, seen from now.
    pub(crate) fn of(earlier: &LevelOdometry, now: &LevelOdometry) -> Self {
        let seen = now.sees(earlier);
        let growth = now.growth.since(&earlier.growth).about(&now.position_m);
        let (sin, cos) = now.yaw_rad.sin_cos();
        let in_newest = |x: f64, y: f64| Vector2::new(cos * x + sin * y, cos * y - sin * x);
        let square = &growth.lever_square;
        // R^T M R, by turning columns and then rows.
        let first = in_newest(square[(0, 0)], square[(0, 1)]);
        let second = in_newest(square[(1, 0)], square[(1, 1)]);
        let along = in_newest(first.x, second.x);
        let across = in_newest(first.y, second.y);
        Self {
            place_m: seen.position_m,
            yaw_rad: seen.yaw_rad,
            gathered: Gathered {
                rotation: growth.rotation.max(0.0),
                lever: in_newest(growth.lever.x, growth.lever.y),
                square: [along.x, along.y, across.y],
                translation: growth.translation.max(0.0),
            },
        }
    }

    /// Where a neighbour is now that was at a pose then, this being the vehicle's past and `neighbour` the other's.
    pub(crate) fn carried(&self, neighbour: &Self, then: &RelativePose) -> RelativePose {
        let yaw = then.yaw_rad + self.yaw_rad - neighbour.yaw_rad;
        RelativePose::new(
            turned(&then.position_m, self.yaw_rad) + self.place_m - turned(&neighbour.place_m, yaw),
            yaw,
        )
    }

    /// Covariance (m^2) of this place's error along `direction` and that of a `later` place along another.
    pub(crate) fn covariance_along(
        &self,
        direction: &Vector3<f64>,
        later: &Self,
        later_direction: &Vector3<f64>,
    ) -> f64 {
        let shared = &later.gathered;
        // J^T n, J = z x: the error of a turn about t is w J (p - t).
        let across = Vector2::new(direction.y, -direction.x);
        let later_across = Vector2::new(later_direction.y, -later_direction.x);
        let arm = across.dot(&self.place_m.xy());
        let later_arm = later_across.dot(&later.place_m.xy());
        let [xx, xy, yy] = shared.square;
        shared.rotation * arm * later_arm
            - arm * shared.lever.dot(&later_across)
            - shared.lever.dot(&across) * later_arm
            + across.x * (xx * later_across.x + xy * later_across.y)
            + across.y * (xy * later_across.x + yy * later_across.y)
            + shared.translation * direction.dot(later_direction)
    }

    /// Mean variance of the place over the directions in the plane (m^2).
    pub(crate) fn variance(&self) -> f64 {
        let x = Vector3::x();
        let y = Vector3::y();
        0.5 * (self.covariance_along(&x, self, &x) + self.covariance_along(&y, self, &y))
    }

    /// Covariance of the errors of place (m) and yaw (rad).
    pub(crate) fn covariance(&self) -> Matrix4<f64> {
        let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
        let shared = &self.gathered;
        let mut covariance = Matrix4::zeros();
        for i in 0..3 {
            for j in 0..3 {
                covariance[(i, j)] = self.covariance_along(&axes[i], self, &axes[j]);
            }
        }
        // -(v + w x p) with -w: J (a p - b).
        let arm = self.place_m.xy() * shared.rotation - shared.lever;
        covariance[(0, 3)] = -arm.y;
        covariance[(3, 0)] = -arm.y;
        covariance[(1, 3)] = arm.x;
        covariance[(3, 1)] = arm.x;
        covariance[(3, 3)] = shared.rotation;
        covariance
    }
}
