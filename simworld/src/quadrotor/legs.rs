//! From point to point along straight lines, resting at each for an instant: smooth in velocity and acceleration.

use super::course::Place;
use super::ramp::{BEGINS_S, Smooth};
use crate::trajectory::{Waypoint, Waypoints};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// The points, with the heading at each. Unlike along [`Waypoints`], a leg starts and ends at rest, and headings are
/// taken as they are, so that a turn may be a long one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Legs(pub Waypoints);

impl Legs {
    /// A team of `starts.len()` that flies through a box without meeting: all on the same clock, each leg as long as
    /// the next, the points drawn at random.
    ///
    /// Whoever finds no free way to a new point in [`TRIES_MAX`] tries stays where it is for this leg.
    pub(crate) fn drawn(
        starts: &[(Vector3<f64>, f64)],
        arena: &Arena,
        until_s: f64,
        rng: &mut impl rand::Rng,
    ) -> Vec<Self> {
        let mut points: Vec<Vec<Waypoint>> = starts
            .iter()
            .map(|(position, heading_rad)| vec![waypoint(BEGINS_S, *position, *heading_rad)])
            .collect();
        let mut t_s = BEGINS_S;
        while t_s < until_s {
            t_s += LEG_S;
            let mut legs: Vec<(Vector3<f64>, Vector3<f64>)> = Vec::new();
            for robot in &mut points {
                let last = robot[robot.len() - 1];
                let from = Vector3::from(last.position_m);
                let to = (0..TRIES_MAX)
                    .map(|_| arena.any(rng))
                    .find(|to| {
                        legs.iter()
                            .all(|leg| least_distance_m(&(from, *to), leg) > APART_M)
                    })
                    .unwrap_or(from);
                legs.push((from, to));
                let turn_rad = rand::RngExt::random_range(rng, -TURN_RAD_MAX..TURN_RAD_MAX);
                robot.push(waypoint(t_s, to, last.yaw_deg.to_radians() + turn_rad));
            }
        }
        points
            .into_iter()
            .map(|points| {
                Self(Waypoints::try_from(points).expect("each leg ends later than the last"))
            })
            .collect()
    }

    pub(super) fn place_at(&self, t_s: f64) -> Place {
        let points = self.0.points();
        let next = points.partition_point(|point| point.t_s <= t_s);
        let to = points[next.min(points.len() - 1)];
        let from = points[next.saturating_sub(1)];
        // Before the first point and after the last, both ends are the same and the leg may be of any length.
        let leg_s = if to.t_s > from.t_s {
            to.t_s - from.t_s
        } else {
            LEG_S
        };
        let step = Smooth::step(t_s, from.t_s, leg_s);
        let start = Vector3::from(from.position_m);
        let way = Vector3::from(to.position_m) - start;
        let turn_rad = (to.yaw_deg - from.yaw_deg).to_radians();
        Place {
            position_m: start + way * step.value,
            velocity_m_s: way * step.rate_per_s,
            acceleration_m_s2: way * step.rate_per_s2,
            heading_rad: from.yaw_deg.to_radians() + turn_rad * step.value,
            heading_rate_rad_s: turn_rad * step.rate_per_s,
        }
    }
}

/// How long a leg takes (s).
const LEG_S: f64 = 4.5;
/// How often a free way is looked for.
const TRIES_MAX: usize = 200;
/// How near two robots may come (m).
const APART_M: f64 = 1.2;
/// Largest turn within a leg (rad).
const TURN_RAD_MAX: f64 = 1.6;

/// The box in which a team flies.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Arena {
    pub(crate) low_m: Vector3<f64>,
    pub(crate) high_m: Vector3<f64>,
}

impl Arena {
    /// The box around these places, this much larger on every side, and never below a metre.
    pub(crate) fn around(places: &[Vector3<f64>], margin_m: Vector3<f64>) -> Self {
        let far = Vector3::repeat(f64::INFINITY);
        let low = places.iter().fold(far, |low, place| low.inf(place)) - margin_m;
        let high = places.iter().fold(-far, |high, place| high.sup(place)) + margin_m;
        Self {
            low_m: Vector3::new(low.x, low.y, low.z.max(1.0)),
            high_m: high,
        }
    }

    /// Anywhere in it.
    pub(crate) fn any(&self, rng: &mut impl rand::Rng) -> Vector3<f64> {
        let shares = Vector3::from_fn(|_, _| rand::RngExt::random::<f64>(rng));
        self.low_m + (self.high_m - self.low_m).component_mul(&shares)
    }
}

/// How near two that fly these legs at the same time and in the same manner come: both are at the same share of their
/// leg, so what lies between them moves along a straight line too.
fn least_distance_m(a: &(Vector3<f64>, Vector3<f64>), b: &(Vector3<f64>, Vector3<f64>)) -> f64 {
    let (begins, ends) = (b.0 - a.0, b.1 - a.1);
    let way = ends - begins;
    let squared = way.norm_squared();
    if squared == 0.0 {
        return begins.norm();
    }
    let share = (-begins.dot(&way) / squared).clamp(0.0, 1.0);
    (begins + way * share).norm()
}

fn waypoint(t_s: f64, position: Vector3<f64>, heading_rad: f64) -> Waypoint {
    Waypoint {
        t_s,
        position_m: position.into(),
        yaw_deg: heading_rad.to_degrees(),
    }
}
