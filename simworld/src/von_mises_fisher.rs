//! Random rotations around identity: the von Mises-Fisher distribution of unit quaternions on the sphere S^3, density
//! proportional to `exp(kappa w)`, drawn by rejection after Wood (1994) and Ulrich (1984) with p = 4.

use nalgebra::{Quaternion, UnitQuaternion};
use rand::{Rng, RngExt};
use rand_distr::{Beta, Distribution, UnitSphere};
use serde::{Deserialize, Serialize};

/// The distribution around identity with one concentration; the paper's 10,000 is 0.020 rad per axis.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "f64", into = "f64")]
pub struct VonMisesFisher {
    concentration: f64,
}

/// A concentration that is not a positive finite number.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error("a von Mises-Fisher concentration is positive and finite, not {concentration}")]
pub struct BadConcentration {
    /// What was asked for.
    pub concentration: f64,
}

impl VonMisesFisher {
    /// The distribution with this concentration `kappa`, dimensionless. Fails unless it is positive and finite.
    pub fn new(concentration: f64) -> Result<Self, BadConcentration> {
        if concentration.is_finite() && concentration > 0.0 {
            Ok(Self { concentration })
        } else {
            Err(BadConcentration { concentration })
        }
    }

    /// The concentration `kappa`, dimensionless.
    #[must_use]
    pub const fn concentration(&self) -> f64 {
        self.concentration
    }

    /// The standard deviation of the rotation angle about each axis, radians, for a large concentration: the vector
    /// part of the quaternion has 1/sqrt(kappa) per axis and is *half* the angle.
    #[must_use]
    pub fn angle_std_rad(&self) -> f64 {
        2.0 / self.concentration.sqrt()
    }

    /// This distribution when the noise has had `ratio` times as long to grow as its own unit of time. Angles add up
    /// in variance, so the concentration falls in proportion. `ratio` must be positive.
    #[must_use]
    pub fn grown(&self, ratio: f64) -> Self {
        assert!(
            ratio.is_finite() && ratio > 0.0,
            "noise grows over a positive time, not {ratio} of its unit"
        );
        Self {
            concentration: self.concentration / ratio,
        }
    }
}

impl TryFrom<f64> for VonMisesFisher {
    type Error = BadConcentration;

    fn try_from(concentration: f64) -> Result<Self, BadConcentration> {
        Self::new(concentration)
    }
}

impl From<VonMisesFisher> for f64 {
    fn from(distribution: VonMisesFisher) -> Self {
        distribution.concentration
    }
}

impl Distribution<UnitQuaternion<f64>> for VonMisesFisher {
    fn sample<R: Rng + ?Sized>(&self, rng: &mut R) -> UnitQuaternion<f64> {
        // Wood's steps with p = 4, hence p - 1 = 3. `b` is written without the difference of two nearly equal
        // numbers, and 1 - w is kept instead of w, so that a concentration of 1e12 loses no digits.
        let kappa = self.concentration;
        let b = 3.0 / (2.0 * kappa + (4.0 * kappa * kappa + 9.0).sqrt());
        let one_minus_x = 2.0 * b / (1.0 + b);
        let one_minus_x_squared = 4.0 * b / ((1.0 + b) * (1.0 + b));
        let beta = Beta::new(1.5, 1.5).expect("3/2 is a valid shape");
        let one_minus_w = loop {
            let z = beta.sample(rng);
            let uniform: f64 = rng.random();
            let one_minus_w = 2.0 * b * z / ((1.0 - z) + b * z);
            let one_minus_xw = one_minus_x + (1.0 - one_minus_x) * one_minus_w;
            // kappa w + 3 ln(1 - x w) - c >= ln u with c = kappa x + 3 ln(1 - x^2)
            let exponent = kappa * (one_minus_x - one_minus_w)
                + 3.0 * (one_minus_xw / one_minus_x_squared).ln();
            if exponent >= uniform.ln() {
                break one_minus_w;
            }
        };
        let sine = (one_minus_w * (2.0 - one_minus_w)).max(0.0).sqrt();
        let [x, y, z]: [f64; 3] = UnitSphere.sample(rng);
        UnitQuaternion::from_quaternion(Quaternion::new(
            1.0 - one_minus_w,
            sine * x,
            sine * y,
            sine * z,
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::streams::{Purpose, Streams};

    /// `I_2(kappa) / I_1(kappa)` by Gauss's continued fraction, evaluated from its tail: every term is positive, so
    /// nothing cancels and nothing overflows.
    fn mean_resultant_length(kappa: f64) -> f64 {
        let first_ignored = 200 + (2.0 * kappa) as usize;
        (2..=first_ignored)
            .rev()
            .fold(0.0, |tail, order| 1.0 / (2.0 * order as f64 / kappa + tail))
    }

    fn draws(kappa: f64, n: usize) -> Vec<UnitQuaternion<f64>> {
        let mut rng = Streams::new(11, 0).vehicle(0, Purpose::Measurement);
        VonMisesFisher::new(kappa)
            .unwrap()
            .sample_iter(&mut rng)
            .take(n)
            .collect()
    }

    #[test]
    fn the_bessel_ratio_has_its_tabulated_values() {
        // I_1(1) = 0.5651591040, I_2(1) = 0.1357476698; I_1(10) = 2670.988304, I_2(10) = 2281.518968.
        assert!((mean_resultant_length(1.0) - 0.135_747_669_8 / 0.565_159_104_0).abs() < 1e-9);
        assert!((mean_resultant_length(10.0) - 2_281.518_968 / 2_670.988_304).abs() < 1e-9);
        // The expansion 1 - 3/(2 kappa) + 3/(8 kappa^2) for a large argument.
        assert!((mean_resultant_length(1e4) - (1.0 - 1.5e-4 + 0.375e-8)).abs() < 1e-11);
    }

    #[test]
    fn the_mean_resultant_length_is_the_analytic_one() {
        let n = 200_000;
        for kappa in [0.1, 1.0, 10.0, 100.0, 10_000.0] {
            let one_minus_w: Vec<f64> = draws(kappa, n).iter().map(|q| 1.0 - q.w).collect();
            let mean = one_minus_w.iter().sum::<f64>() / n as f64;
            let variance = one_minus_w.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / n as f64;
            let standard_error = (variance / n as f64).sqrt();
            let expected = 1.0 - mean_resultant_length(kappa);
            assert!(
                (mean - expected).abs() < 4.0 * standard_error,
                "kappa {kappa}: 1 - w is {mean}, should be {expected} +- {standard_error}"
            );
        }
    }

    #[test]
    fn the_paper_s_concentration_is_twenty_milliradians_about_every_axis() {
        let n = 100_000;
        let angles: Vec<_> = draws(10_000.0, n)
            .iter()
            .map(UnitQuaternion::scaled_axis)
            .collect();
        for axis in 0..3 {
            let mean = angles.iter().map(|a| a[axis]).sum::<f64>() / n as f64;
            let std = (angles.iter().map(|a| a[axis].powi(2)).sum::<f64>() / n as f64).sqrt();
            assert!(
                mean.abs() < 4.0 * 0.02 / (n as f64).sqrt(),
                "axis {axis}: mean {mean}"
            );
            assert!(
                (std - 0.02).abs() < 2e-4,
                "axis {axis}: standard deviation {std}"
            );
        }
        assert!((VonMisesFisher::new(10_000.0).unwrap().angle_std_rad() - 0.02).abs() < 1e-15);
    }

    #[test]
    fn an_extreme_concentration_keeps_its_digits() {
        let n = 20_000;
        let kappa = 1e12;
        let angles = draws(kappa, n);
        let mean_square = angles
            .iter()
            .map(|q| q.scaled_axis().norm_squared())
            .sum::<f64>()
            / n as f64;
        let expected = 3.0 * 4.0 / kappa;
        assert!(
            (mean_square / expected - 1.0).abs() < 0.03,
            "{mean_square} should be {expected}"
        );
    }

    #[test]
    fn four_steps_of_a_quarter_add_up_to_one_step() {
        let step = VonMisesFisher::new(10_000.0).unwrap();
        assert!((step.grown(0.25).angle_std_rad() - 0.01).abs() < 1e-15);
    }

    #[test]
    fn a_concentration_that_is_not_positive_and_finite_is_refused() {
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(VonMisesFisher::new(bad).is_err(), "{bad}");
        }
    }
}
