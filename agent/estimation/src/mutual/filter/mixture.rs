//! The answers of a registration about one neighbour as one measurement: a mixture of Gaussians over direction and yaw
//! (Cognetti et al., section III-B), with a part for "none of these".

use crate::mutual::direction;
use nalgebra::{Matrix2, Matrix3, UnitVector3, Vector3};
use std::f64::consts::PI;

/// Most answers that are kept; of more, the likeliest.
pub const COMPONENTS_MAX: usize = 16;

/// How a registration's answers are weighed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tempering {
    /// Exponent of the answers' likelihoods. Successive registrations make the same mistakes, so each is believed less
    /// than if it stood alone.
    pub exponent: f64,
    /// Probability that no answer is right.
    pub floor: f64,
    /// Exponent of the odds between the likeliest answer's density and that of no answer being right, for the same reason.
    pub floor_exponent: f64,
}

impl Tempering {
    /// Keeps alternatives alive: with the exponent at one and no floor, one or two of three neighbours of the square
    /// formation stay in a wrong place for good.
    pub const CAUTIOUS: Self = Self {
        exponent: 0.35,
        floor: 0.05,
        floor_exponent: 0.5,
    };
}

/// One answer about one neighbour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Answer {
    /// Where it is, in this vehicle's level frame.
    pub direction: UnitVector3<f64>,
    /// Its heading relative to this vehicle's (rad).
    pub yaw_rad: f64,
    /// Covariance along the two [`direction::tangents`] and of the yaw (rad^2).
    pub covariance_rad2: Matrix3<f64>,
    /// Logarithm of the likelihood of the whole registration it is part of; only differences count.
    pub log_likelihood: f64,
    /// Which of this vehicle's own features the neighbour is, if it is seen.
    pub own_feature: Option<usize>,
}

/// One Gaussian of a mixture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Component {
    pub(super) direction: UnitVector3<f64>,
    pub(super) tangents: [Vector3<f64>; 2],
    pub(super) yaw_rad: f64,
    pub(super) cos_yaw: f64,
    pub(super) sin_yaw: f64,
    pub(super) covariance: Matrix3<f64>,
    /// The covariance's lower Cholesky factor.
    pub(super) covariance_root: Matrix3<f64>,
    /// Inverse of that.
    pub(super) whitening: Matrix3<f64>,
    /// Tempered, of a sum of one over the components.
    pub(super) weight: f64,
    /// Logarithm of weight and height of the density's summit.
    pub(super) log_summit: f64,
    pub(super) own_feature: Option<usize>,
}

/// A measurement of direction and yaw with several answers.
#[derive(Clone, Debug, PartialEq)]
pub struct Mixture {
    components: Vec<Component>,
    /// Probability that one of the components is right.
    right: f64,
    floor_density: f64,
}

/// Probability of each own feature to be the neighbour, as far as answers named one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Responsibilities {
    /// Feature and probability, in the mixture's order of features.
    pub own_features: Vec<(usize, f64)>,
}

/// Answers that agree to this (rad) in direction and yaw, on the same feature, are one.
const SAME_WITHIN_RAD: f64 = 0.02;

impl Mixture {
    /// The measurement that these answers are; none without a usable one. `elsewhere` are the log-likelihoods of
    /// registrations that leave the neighbour out.
    ///
    /// Answers that differ in other neighbours only are one here, their weights added. Unusable is what is not finite or
    /// has no positive definite covariance.
    #[must_use]
    pub fn new(answers: &[Answer], elsewhere: &[f64], tempering: &Tempering) -> Option<Self> {
        let likeliest = answers
            .iter()
            .map(|answer| answer.log_likelihood)
            .chain(elsewhere.iter().copied())
            .filter(|likelihood| likelihood.is_finite())
            .fold(f64::NEG_INFINITY, f64::max);
        let tempered = |likelihood: f64| (tempering.exponent * (likelihood - likeliest)).exp();
        let mut components: Vec<Component> = Vec::new();
        for answer in answers {
            let Some(component) = Component::new(answer, tempered(answer.log_likelihood)) else {
                continue;
            };
            match components
                .iter_mut()
                .find(|known| known.is_same(&component))
            {
                Some(known) => known.weight += component.weight,
                None => components.push(component),
            }
        }
        components.sort_by(|a, b| b.weight.total_cmp(&a.weight));
        components.truncate(COMPONENTS_MAX);
        let sum: f64 = components.iter().map(|component| component.weight).sum();
        let left_out = elsewhere.iter().map(|&likelihood| tempered(likelihood));
        let left_out: f64 = left_out.filter(|weight| weight.is_finite()).sum();
        if components.is_empty() || sum.is_nan() || sum <= 0.0 {
            return None;
        }
        let right = (1.0 - tempering.floor) * sum / (sum + left_out);
        for component in &mut components {
            component.weight /= sum;
            let height = component.whitening.determinant() / (2.0 * PI).powf(1.5);
            component.log_summit = (component.weight * height * right).ln();
        }
        // All directions and yaws are equally likely when no answer is right.
        let uniform = (1.0 - right) / (4.0 * PI * 2.0 * PI);
        let highest = components
            .iter()
            .map(|component| component.log_summit.exp())
            .fold(0.0, f64::max);
        let odds = (uniform / highest).min(1.0);
        Some(Self {
            components,
            right,
            floor_density: uniform.max(highest * odds.powf(tempering.floor_exponent)),
        })
    }

    pub(super) fn components(&self) -> &[Component] {
        &self.components
    }

    /// Density of "none of these".
    pub(super) const fn floor_density(&self) -> f64 {
        self.floor_density
    }

    /// Probability of an answer, by its index.
    pub(super) fn probability(&self, component: usize) -> f64 {
        self.components[component].weight * self.right
    }

    /// Sums what each component is held responsible for by the feature it names.
    pub(super) fn by_feature(&self, responsible: &[f64]) -> Responsibilities {
        let mut own_features: Vec<(usize, f64)> = Vec::new();
        for (component, &responsible) in self.components.iter().zip(responsible) {
            let Some(feature) = component.own_feature else {
                continue;
            };
            match own_features.iter_mut().find(|(known, _)| *known == feature) {
                Some((_, sum)) => *sum += responsible,
                None => own_features.push((feature, responsible)),
            }
        }
        Responsibilities { own_features }
    }
}

impl Component {
    fn new(answer: &Answer, weight: f64) -> Option<Self> {
        let covariance_root = answer.covariance_rad2.cholesky()?.l();
        let whitening = covariance_root.try_inverse()?;
        let finite = answer.direction.iter().all(|x| x.is_finite())
            && answer.yaw_rad.is_finite()
            && whitening.iter().all(|x| x.is_finite())
            && weight.is_finite();
        finite.then(|| Self {
            direction: answer.direction,
            tangents: direction::tangents(&answer.direction),
            yaw_rad: answer.yaw_rad,
            cos_yaw: answer.yaw_rad.cos(),
            sin_yaw: answer.yaw_rad.sin(),
            covariance: answer.covariance_rad2,
            covariance_root,
            whitening,
            weight,
            log_summit: 0.0,
            own_feature: answer.own_feature,
        })
    }

    fn is_same(&self, other: &Self) -> bool {
        self.own_feature == other.own_feature
            && self.direction.dot(&other.direction) > SAME_WITHIN_RAD.cos()
            && direction::wrapped(self.yaw_rad - other.yaw_rad).abs() < SAME_WITHIN_RAD
    }
}

/// How the tangents of one direction turn into those of another, carried along the arc between them.
pub(super) fn carried(from: &UnitVector3<f64>, to: &UnitVector3<f64>) -> Matrix2<f64> {
    let (before, after) = (direction::tangents(from), direction::tangents(to));
    let carry = nalgebra::Rotation3::rotation_between(from, to)
        .unwrap_or_else(nalgebra::Rotation3::identity);
    Matrix2::from_fn(|row, column| after[row].dot(&(carry * before[column])))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn answer(azimuth_rad: f64, yaw_rad: f64, log_likelihood: f64, feature: usize) -> Answer {
        Answer {
            direction: direction::from_angles(azimuth_rad, 1.5),
            yaw_rad,
            covariance_rad2: Matrix3::identity() * 0.01,
            log_likelihood,
            own_feature: Some(feature),
        }
    }

    #[test]
    fn answers_that_differ_in_other_neighbours_only_are_one() {
        let answers = [
            answer(0.3, 1.0, -2.0, 0),
            answer(0.3, 1.0, -2.0, 0),
            answer(2.0, -1.0, -2.0, 1),
        ];
        let mixture = Mixture::new(&answers, &[], &Tempering::CAUTIOUS).unwrap();
        assert_eq!(mixture.components().len(), 2);
        assert!((mixture.components()[0].weight - 2.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn tempering_brings_the_unlikely_nearer() {
        let answers = [answer(0.3, 1.0, 0.0, 0), answer(2.0, -1.0, -10.0, 1)];
        let ratio = |exponent| {
            let tempering = Tempering {
                exponent,
                ..Tempering::CAUTIOUS
            };
            let mixture = Mixture::new(&answers, &[], &tempering).unwrap();
            (mixture.components()[0].weight / mixture.components()[1].weight).ln()
        };
        assert!((ratio(1.0) - 10.0).abs() < 1e-9);
        assert!((ratio(0.35) - 3.5).abs() < 1e-9);
    }

    #[test]
    fn what_leaves_the_neighbour_out_speaks_for_no_answer() {
        let answers = [answer(0.3, 1.0, -5.0, 0)];
        let odds = |elsewhere: &[f64]| {
            let mixture = Mixture::new(&answers, elsewhere, &Tempering::CAUTIOUS).unwrap();
            mixture.floor_density() / mixture.components()[0].log_summit.exp()
        };
        assert!(odds(&[-5.0]) > 2.0 * odds(&[]));
        assert!(odds(&[5.0]) > 2.0 * odds(&[-5.0]));
    }

    #[test]
    fn an_answer_without_covariance_is_no_answer() {
        let mut flat = answer(0.3, 1.0, 0.0, 0);
        flat.covariance_rad2 = Matrix3::zeros();
        let mut nowhere = answer(0.3, f64::NAN, 0.0, 0);
        nowhere.log_likelihood = f64::NAN;
        assert!(Mixture::new(&[flat, nowhere], &[], &Tempering::CAUTIOUS).is_none());
        assert!(Mixture::new(&[], &[], &Tempering::CAUTIOUS).is_none());
    }

    #[test]
    fn of_too_many_answers_the_likeliest_are_kept() {
        let answers: Vec<_> = (0..=COMPONENTS_MAX)
            .map(|i| answer(0.3 * i as f64 - 2.5, 0.0, i as f64, i))
            .collect();
        let mixture = Mixture::new(&answers, &[], &Tempering::CAUTIOUS).unwrap();
        assert_eq!(mixture.components().len(), COMPONENTS_MAX);
        assert!(
            mixture
                .components()
                .iter()
                .all(|kept| kept.own_feature != Some(0))
        );
    }

    #[test]
    fn tangents_are_carried_across_the_pole() {
        let (near, beyond) = (
            direction::from_angles(0.0, 0.01),
            direction::from_angles(PI, 0.01),
        );
        let carried = carried(&near, &beyond);
        assert!((carried + Matrix2::identity()).norm() < 1e-9, "{carried}");
    }
}
