//! Covariance that cumulative odometry gathers, as it crosses the wire.

use crate::limits::GROWTH_MAX;
use crate::{check, codec::DecodeError};
use serde::{Deserialize, Serialize};

/// Additive covariance of cumulative odometry, in the odometry frame (rotation first).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Growth {
    /// The driver gave no noise.
    Unknown,
    /// Isotropic increments: `a, b[3], upper triangle of M[6], c` with
    /// `Sigma_ww = a I`, `Sigma_vw = [b]x`, `Sigma_vv = tr(M) I - M + c I`.
    Isotropic([f64; 11]),
    /// Any increments: the upper triangle of the 6 x 6 matrix, row by row.
    Full([f64; 21]),
}

impl Growth {
    /// Refuses numbers that are not finite or beyond their bound, and variances below zero.
    pub(crate) fn check(&self, field: &'static str) -> Result<(), DecodeError> {
        /// `a`, the diagonal of `M`, `c`.
        const VARIANCES: [usize; 5] = [0, 4, 7, 9, 10];
        /// The diagonal of a 6 x 6 matrix in its upper triangle, row by row.
        const DIAGONAL: [usize; 6] = [0, 6, 11, 15, 18, 20];
        let (numbers, variances): (&[f64], &[usize]) = match self {
            Self::Unknown => return Ok(()),
            Self::Isotropic(numbers) => (numbers, &VARIANCES),
            Self::Full(numbers) => (numbers, &DIAGONAL),
        };
        check::within(field, numbers, GROWTH_MAX)?;
        if variances.iter().all(|at| numbers[*at] >= 0.0) {
            Ok(())
        } else {
            Err(DecodeError::OutOfRange { field })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FIELD: &str = "growth";

    #[test]
    fn variances_below_zero_and_numbers_beyond_the_bound_are_refused() {
        let with = |at: usize, number: f64| {
            let mut numbers = [1.0; 11];
            numbers[at] = number;
            Growth::Isotropic(numbers).check(FIELD)
        };
        let out_of_range = Err(DecodeError::OutOfRange { field: FIELD });
        for variance in [0, 4, 7, 9, 10] {
            assert_eq!(with(variance, -1e-9), out_of_range, "{variance}");
            assert_eq!(with(variance, 0.0), Ok(()));
        }
        assert_eq!(with(1, -1.0), Ok(()), "a lever has a sign");
        assert_eq!(with(1, -1.1 * GROWTH_MAX), out_of_range);
        let not_finite = Err(DecodeError::NotFinite { field: FIELD });
        assert_eq!(with(5, f64::NAN), not_finite);
        let mut full = [0.0; 21];
        full[11] = -1.0;
        assert_eq!(Growth::Full(full).check(FIELD), out_of_range);
        assert_eq!(Growth::Unknown.check(FIELD), Ok(()));
    }
}
