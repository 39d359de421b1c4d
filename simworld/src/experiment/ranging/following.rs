//! What a follower of one neighbour told at one distance, beside the truth. Only a place that it calls known is told to
//! anyone; of all else it says what is the matter.

use crate::truth::wrapped_rad;
use nalgebra::{Matrix4, Vector3, Vector4};
use serde::Serialize;
use skein_estimation::ranging::Dimension;
use skein_estimation::ranging::bank::Place;
use skein_estimation::ranging::neighbour::Estimate;
use skein_estimation::ranging::window::Observability;

/// Where a neighbour truly is, in the observer's level frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truth {
    /// Metres.
    pub position_m: Vector3<f64>,
    /// Its heading less the observer's (rad).
    pub yaw_rad: f64,
}

/// What was told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Told {
    /// One place, that is so far off.
    Place(Off),
    /// About one place, but not precisely.
    Imprecise,
    /// Several places.
    Ambiguous,
    /// Nothing.
    Nothing,
}

/// How far off a place is that was told.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Off {
    /// Metres.
    pub position_m: f64,
    /// From 0 to pi (rad).
    pub yaw_rad: f64,
    /// The squared error over its covariance per dimension: one where the covariance is right.
    pub nees: f64,
}

/// How often what was told, as shares of one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Shares {
    /// A place.
    pub place: f64,
    /// An imprecise one.
    pub imprecise: f64,
    /// Several.
    pub ambiguous: f64,
    /// None.
    pub nothing: f64,
}

/// Many numbers in three; not a number of none.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Root of the mean square.
    pub rms: f64,
    /// Mean.
    pub mean: f64,
    /// Median.
    pub median: f64,
}

impl Told {
    /// What an estimate tells.
    #[must_use]
    pub fn of(estimate: &Estimate, truth: &Truth, dimension: Dimension) -> Self {
        match (estimate.observability, &estimate.best) {
            (Observability::Observable, Some(place)) => {
                Self::Place(Off::of(place, truth, dimension))
            }
            (Observability::Imprecise, _) => Self::Imprecise,
            (Observability::Ambiguous { .. }, _) => Self::Ambiguous,
            (Observability::Observable | Observability::Unknown, _) => Self::Nothing,
        }
    }

    /// The place, if one was told.
    #[must_use]
    pub const fn off(&self) -> Option<Off> {
        match self {
            Self::Place(off) => Some(*off),
            Self::Imprecise | Self::Ambiguous | Self::Nothing => None,
        }
    }
}

impl Off {
    fn of(place: &Place, truth: &Truth, dimension: Dimension) -> Self {
        let position_m = place.pose.position_m - truth.position_m;
        let yaw_rad = wrapped_rad(place.pose.yaw_rad - truth.yaw_rad);
        let mut error = position_m.push(yaw_rad);
        let mut covariance = place.covariance;
        let dimensions = match dimension {
            Dimension::Spatial => 4.0,
            Dimension::Planar => {
                // The height is no unknown.
                set_apart(&mut error, &mut covariance);
                3.0
            }
        };
        let square = covariance
            .cholesky()
            .map_or(f64::INFINITY, |factor| error.dot(&factor.solve(&error)));
        Self {
            position_m: error.xyz().norm(),
            yaw_rad: yaw_rad.abs(),
            nees: square / dimensions,
        }
    }
}

fn set_apart(error: &mut Vector4<f64>, covariance: &mut Matrix4<f64>) {
    error.z = 0.0;
    for other in 0..4 {
        covariance[(2, other)] = 0.0;
        covariance[(other, 2)] = 0.0;
    }
    covariance[(2, 2)] = 1.0;
}

impl Shares {
    /// Of everything told; all zero of nothing.
    #[must_use]
    pub fn of<'a>(told: impl Iterator<Item = &'a Told>) -> Self {
        let mut shares = Self::default();
        let mut count = 0.0_f64;
        for one in told {
            count += 1.0;
            match one {
                Told::Place(_) => shares.place += 1.0,
                Told::Imprecise => shares.imprecise += 1.0,
                Told::Ambiguous => shares.ambiguous += 1.0,
                Told::Nothing => shares.nothing += 1.0,
            }
        }
        let each = |number: f64| number / count.max(1.0);
        Self {
            place: each(shares.place),
            imprecise: each(shares.imprecise),
            ambiguous: each(shares.ambiguous),
            nothing: each(shares.nothing),
        }
    }
}

impl Spread {
    /// Of numbers.
    #[must_use]
    pub fn of(numbers: impl Iterator<Item = f64>) -> Self {
        let mut all: Vec<f64> = numbers.collect();
        all.sort_by(f64::total_cmp);
        let count = all.len() as f64;
        Self {
            rms: (all.iter().map(|one| one.powi(2)).sum::<f64>() / count).sqrt(),
            mean: all.iter().sum::<f64>() / count,
            median: all.get(all.len() / 2).copied().unwrap_or(f64::NAN),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use skein_estimation::ranging::RelativePose;

    fn estimate(observability: Observability) -> Estimate {
        let place = Place {
            pose: RelativePose::new(Vector3::new(3.0, 4.0, 7.0), 3.1),
            weight: 1.0,
            covariance: Matrix4::from_diagonal(&Vector4::new(1.0, 4.0, 9.0, 0.01)),
            angle_sigma_rad: 0.1,
        };
        Estimate {
            observability,
            best: Some(place),
            all: None,
            places: [None; skein_estimation::ranging::bank::HYPOTHESES_MAX],
            is_disagreeing: false,
        }
    }

    #[test]
    fn an_error_counts_by_what_was_said_of_it_and_heights_only_in_space() {
        let truth = Truth {
            position_m: Vector3::new(2.0, 2.0, 1.0),
            yaw_rad: -3.1,
        };
        let seen = estimate(Observability::Observable);
        // The yaws are 0.0832 rad apart, across half a turn.
        let planar = Told::of(&seen, &truth, Dimension::Planar).off().unwrap();
        assert!((planar.position_m - 5.0_f64.sqrt()).abs() < 1e-9);
        assert!((planar.yaw_rad - 0.083_185).abs() < 1e-5, "{planar:?}");
        assert!((planar.nees - (1.0 + 1.0 + 0.691_98) / 3.0).abs() < 1e-4);
        let spatial = Told::of(&seen, &truth, Dimension::Spatial).off().unwrap();
        assert!((spatial.position_m - 41.0_f64.sqrt()).abs() < 1e-9);
        assert!((spatial.nees - (1.0 + 1.0 + 4.0 + 0.691_98) / 4.0).abs() < 1e-4);
    }

    #[test]
    fn only_a_place_that_is_known_is_told() {
        let truth = Truth {
            position_m: Vector3::zeros(),
            yaw_rad: 0.0,
        };
        let told = [Observability::Imprecise, Observability::Unknown]
            .map(|seen| Told::of(&estimate(seen), &truth, Dimension::Planar));
        assert_eq!(told, [Told::Imprecise, Told::Nothing]);
        let shares = Shares::of(told.iter());
        assert!((shares.imprecise - 0.5).abs() < 1e-12 && shares.place == 0.0);
    }
}
