//! A window's ranges and places, laid out for the descents.

use super::{Dimension, WINDOW_MAX, WindowSettings};
use crate::ranging::sample::RangeSample;
use crate::ranging::trail::Past;

/// Ranges, and where both were at each, each in its own newest level frame. Oldest first.
#[derive(Clone, Debug)]
pub(super) struct Geometry {
    pub(super) count: usize,
    /// Ranges (m).
    pub(super) range_m: [f64; WINDOW_MAX],
    /// Their variances (m^2).
    pub(super) variance_m2: [f64; WINDOW_MAX],
    /// The same with the odometry of both, as if the errors of different ranges had nothing in common (m^2).
    pub(super) apart_m2: [f64; WINDOW_MAX],
    /// Where the vehicle was: `u_j`.
    pub(super) own: [Past; WINDOW_MAX],
    /// Where the neighbour was: `v_j`.
    pub(super) neighbour: [Past; WINDOW_MAX],
}

impl Geometry {
    /// Of samples that are in order, at least one and at most [`WINDOW_MAX`].
    pub(super) fn of<'a>(
        samples: impl DoubleEndedIterator<Item = &'a RangeSample> + Clone,
        settings: &WindowSettings,
    ) -> Self {
        let mut geometry = Self {
            count: 0,
            range_m: [0.0; WINDOW_MAX],
            variance_m2: [0.0; WINDOW_MAX],
            apart_m2: [0.0; WINDOW_MAX],
            own: [Past::default(); WINDOW_MAX],
            neighbour: [Past::default(); WINDOW_MAX],
        };
        let Some(newest) = samples.clone().next_back() else {
            return geometry;
        };
        for (j, sample) in samples.take(WINDOW_MAX).enumerate() {
            let mut own = Past::of(&sample.own, &newest.own);
            let mut neighbour = Past::of(&sample.neighbour, &newest.neighbour);
            if settings.dimension == Dimension::Planar {
                own.place_m.z = 0.0;
                neighbour.place_m.z = 0.0;
            }
            geometry.range_m[j] = sample.range_m;
            geometry.variance_m2[j] = sample.variance_m2(settings.sigma_floor_m);
            geometry.apart_m2[j] = geometry.variance_m2[j] + own.variance() + neighbour.variance();
            geometry.own[j] = own;
            geometry.neighbour[j] = neighbour;
            geometry.count = j + 1;
        }
        geometry
    }

    /// The newest range (m).
    pub(super) fn newest_m(&self) -> f64 {
        self.range_m[self.count - 1]
    }
}
