//! A neighbour whose identity and heading are known but not its distance: seven filters from near to far. What the
//! inertial sensors say of both decides between them. It starts the joint filter.

use super::relative::{
    ACCELERATION_M_S2, Bend, Matrix7, YAW_STEP_RAD, corrected, line, moved, spread,
};
use crate::mutual::direction::{difference, turned};
use crate::mutual::feature_set::Motion;
use crate::mutual::located::Reduced;
use nalgebra::{Matrix2, UnitVector3, Vector2, Vector3};

/// Filters.
const RANGES: usize = 7;
/// Nearest and farthest start (m).
const NEAREST_M: f64 = 1.0;
const FARTHEST_M: f64 = 9.8;
/// Start: relative standard deviation of the distance, of the direction (rad), velocity (m/s) and yaw (rad).
const START_RADIAL: f64 = 0.22;
const START_ACROSS_RAD: f64 = 0.09;
const START_VELOCITY_M_S: f64 = 0.8;
const START_YAW_RAD: f64 = 0.12;
/// Least logarithm of a filter's weight against the heaviest: a filter may come back.
const LOG_WEIGHT_MIN: f64 = -12.0;

/// A sight of one of the pair of the other.
#[derive(Clone, Copy, Debug)]
pub(super) struct PairSight {
    /// The neighbour saw this vehicle, not the other way.
    pub(super) by_neighbour: bool,
    /// In the level frame of now of who saw.
    pub(super) direction: UnitVector3<f64>,
    /// How long ago (s).
    pub(super) age_s: f64,
    /// Per axis across the direction (rad^2).
    pub(super) variance_rad2: f64,
}

/// The filters.
#[derive(Clone, Debug)]
pub(super) struct RangeBank {
    filters: Vec<Filter>,
}

#[derive(Clone, Debug)]
struct Filter {
    state: Reduced,
    covariance: Matrix7,
    log_weight: f64,
}

impl RangeBank {
    /// A neighbour seen in `direction` (own level frame of now) with a relative yaw of `yaw_rad`.
    pub(super) fn new(direction: &UnitVector3<f64>, yaw_rad: f64) -> Self {
        let ratio = (FARTHEST_M / NEAREST_M).powf(1.0 / (RANGES - 1) as f64);
        let start = |index: usize| {
            let position_m = direction.into_inner() * NEAREST_M * ratio.powi(index as i32);
            Filter {
                state: Reduced {
                    position_m,
                    velocity_m_s: Vector3::zeros(),
                    yaw_rad,
                },
                covariance: spread(
                    &position_m,
                    START_RADIAL,
                    START_ACROSS_RAD,
                    START_VELOCITY_M_S,
                    START_YAW_RAD,
                ),
                log_weight: 0.0,
            }
        };
        Self {
            filters: (0..RANGES).map(start).collect(),
        }
    }

    /// Both have moved for `dt_s`; `unheard` as in the joint filter.
    pub(super) fn predict(
        &mut self,
        dt_s: f64,
        own: &Motion,
        neighbour: &Motion,
        unheard: (f64, f64),
    ) {
        for filter in &mut self.filters {
            let (state, bend) = moved(&filter.state, dt_s, own, neighbour);
            filter.state = state;
            filter.covariance = bend * filter.covariance * bend.transpose();
            for axis in 3..6 {
                filter.covariance[(axis, axis)] += (ACCELERATION_M_S2 * dt_s).powi(2) + unheard.0;
            }
            filter.covariance[(6, 6)] += 2.0 * YAW_STEP_RAD * YAW_STEP_RAD + unheard.1;
        }
    }

    /// Squared normalised distance of a sight from the heaviest filter.
    pub(super) fn distance(&self, sight: &PairSight) -> f64 {
        let innovation = self.heaviest().innovation(sight);
        innovation.squared_distance
    }

    /// Takes a sight that is held to be of the pair, with its variance made wider by `softened`.
    pub(super) fn update(&mut self, sight: &PairSight, softened: f64) {
        let sight = PairSight {
            variance_rad2: sight.variance_rad2 * softened,
            ..*sight
        };
        for filter in &mut self.filters {
            filter.update(&sight);
        }
        let heaviest = self.heaviest().log_weight;
        for filter in &mut self.filters {
            filter.log_weight = (filter.log_weight - heaviest).max(LOG_WEIGHT_MIN);
        }
    }

    /// The neighbour's state: the mean of the logarithms of the distances along the heaviest filter's direction.
    pub(super) fn state(&self) -> Reduced {
        let heaviest = self.heaviest();
        let weights = self.filters.iter().map(|filter| filter.log_weight.exp());
        let log_distance = |filter: &Filter| filter.state.position_m.norm().max(0.05).ln();
        let total: f64 = weights.clone().sum();
        let mean: f64 = weights
            .zip(&self.filters)
            .map(|(weight, filter)| weight * log_distance(filter))
            .sum();
        let growth = (mean / total - log_distance(heaviest)).exp();
        Reduced {
            position_m: heaviest.state.position_m * growth,
            velocity_m_s: heaviest.state.velocity_m_s * growth,
            yaw_rad: heaviest.state.yaw_rad,
        }
    }

    /// Standard deviation across the direction (rad), the greater of the two axes.
    pub(super) fn across_rad(&self) -> f64 {
        let heaviest = self.heaviest();
        let line = line(&heaviest.state.position_m);
        let across = line.per_metre
            * heaviest.covariance.fixed_view::<3, 3>(0, 0)
            * line.per_metre.transpose();
        across[(0, 0)].max(across[(1, 1)]).max(0.0).sqrt()
    }

    fn heaviest(&self) -> &Filter {
        let mut heaviest = &self.filters[0];
        for filter in &self.filters {
            if filter.log_weight > heaviest.log_weight {
                heaviest = filter;
            }
        }
        heaviest
    }
}

struct Innovation {
    residual: Vector2<f64>,
    bend: Bend,
    inverse: Matrix2<f64>,
    squared_distance: f64,
    log_determinant: f64,
}

impl Filter {
    fn innovation(&self, sight: &PairSight) -> Innovation {
        let then = self.state.position_m - self.state.velocity_m_s * sight.age_s;
        let mut bend = Bend::zeros();
        let (line, seen) = if sight.by_neighbour {
            let line = line(&-then);
            bend.set_column(6, &line.per_heading);
            bend.fixed_view_mut::<2, 3>(0, 0)
                .copy_from(&-line.per_metre);
            bend.fixed_view_mut::<2, 3>(0, 3)
                .copy_from(&(line.per_metre * sight.age_s));
            (line, turned(&sight.direction, self.state.yaw_rad))
        } else {
            let line = line(&then);
            bend.fixed_view_mut::<2, 3>(0, 0).copy_from(&line.per_metre);
            bend.fixed_view_mut::<2, 3>(0, 3)
                .copy_from(&(-line.per_metre * sight.age_s));
            (line, sight.direction)
        };
        let residual = difference(&line.direction, &seen);
        let variance =
            bend * self.covariance * bend.transpose() + Matrix2::identity() * sight.variance_rad2;
        let inverse = variance.try_inverse().unwrap_or_else(Matrix2::zeros);
        Innovation {
            residual,
            bend,
            inverse,
            squared_distance: residual.dot(&(inverse * residual)),
            log_determinant: variance.determinant().max(f64::MIN_POSITIVE).ln(),
        }
    }

    fn update(&mut self, sight: &PairSight) {
        let innovation = self.innovation(sight);
        self.log_weight -= 0.5 * (innovation.squared_distance + innovation.log_determinant);
        let across = self.covariance * innovation.bend.transpose();
        let gain = across * innovation.inverse;
        self.state = corrected(&self.state, &(gain * innovation.residual));
        let covariance = self.covariance - gain * across.transpose();
        self.covariance = (covariance + covariance.transpose()) * 0.5;
    }
}

#[cfg(test)]
mod tests;
