//! How far off a pose may be, as tables show it: `+-0.03`, and `-` when the estimator does not say.

use skein_proto::document::CovarianceDocument;

/// Above this a number says no more than that nothing is known.
const SHOWN_MAX: f64 = 9_999.0;

/// Of a position, in metres: the expected distance to the truth.
pub(super) fn position_m(covariance: Option<&CovarianceDocument>, decimals: usize) -> String {
    plus_minus(
        covariance.and_then(CovarianceDocument::position_sigma_m),
        decimals,
    )
}

/// Of an orientation, in degrees: the expected angle to the truth.
pub(super) fn rotation_deg(covariance: Option<&CovarianceDocument>, decimals: usize) -> String {
    let sigma_rad = covariance.and_then(CovarianceDocument::rotation_sigma_rad);
    plus_minus(sigma_rad.map(f64::to_degrees), decimals)
}

/// One standard deviation behind its sign.
pub(super) fn plus_minus(sigma: Option<f64>, decimals: usize) -> String {
    match sigma {
        None => "-".to_owned(),
        Some(sigma) if sigma > SHOWN_MAX => format!("+->{SHOWN_MAX:.0}"),
        Some(sigma) => format!("+-{sigma:.decimals$}"),
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A covariance of so many metres along each axis and radians about each.
    pub(in crate::command) fn covariance(
        rotation_rad: f64,
        translation_m: f64,
    ) -> CovarianceDocument {
        let mut numbers = vec![0.0; 21];
        for place in [0, 6, 11] {
            numbers[place] = rotation_rad * rotation_rad;
        }
        for place in [15, 18, 20] {
            numbers[place] = translation_m * translation_m;
        }
        CovarianceDocument {
            body_twist_rotation_first: numbers,
        }
    }

    #[test]
    fn a_sigma_is_metres_or_degrees_over_all_three_axes() {
        let covariance = covariance(0.1, 0.2);
        assert_eq!(position_m(Some(&covariance), 3), "+-0.346");
        assert_eq!(rotation_deg(Some(&covariance), 2), "+-9.92");
    }

    #[test]
    fn without_a_covariance_nothing_is_promised() {
        assert_eq!(position_m(None, 3), "-");
        let of_nothing = CovarianceDocument {
            body_twist_rotation_first: vec![],
        };
        assert_eq!(rotation_deg(Some(&of_nothing), 2), "-");
    }

    #[test]
    fn a_sigma_without_bounds_still_fits_its_column() {
        assert_eq!(plus_minus(Some(1e300), 3), "+->9999");
        assert_eq!(plus_minus(Some(9_999.0), 0), "+-9999");
    }
}
