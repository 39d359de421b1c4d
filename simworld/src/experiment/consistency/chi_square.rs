//! The quantiles of the chi-square distribution, by which a mean NEES is judged.

/// Standard normal deviations of the two-sided 95 % bounds.
const TWO_SIDED_95: f64 = 1.959_963_985;

/// The two-sided 95 % bounds of the mean of `samples` independent values of a chi-square distribution with so many
/// degrees of freedom, per degree of freedom.
#[must_use]
pub fn bounds_95(degrees_of_freedom: usize, samples: usize) -> (f64, f64) {
    let all = (degrees_of_freedom * samples).max(1) as f64;
    (
        quantile(all, -TWO_SIDED_95) / all,
        quantile(all, TWO_SIDED_95) / all,
    )
}

/// The quantile that belongs to a standard normal deviation: Wilson and Hilferty's cube, to 3 % from 6 degrees of freedom
/// on, and to 3e-4 from 60 on.
fn quantile(degrees_of_freedom: f64, deviation: f64) -> f64 {
    let ninth = 2.0 / (9.0 * degrees_of_freedom);
    let root = 1.0 - ninth + deviation * ninth.sqrt();
    degrees_of_freedom * root.max(0.0).powi(3)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_bounds_are_those_of_the_tables() {
        // Degrees of freedom, quantiles of 2.5 % and 97.5 %, as printed, and the share by which they may be off.
        for (degrees, low, high, share) in [
            (6.0, 1.237, 14.449, 0.03),
            (30.0, 16.791, 46.979, 1e-3),
            (60.0, 40.482, 83.298, 3e-4),
            (100.0, 74.222, 129.561, 1e-4),
        ] {
            let found = (
                quantile(degrees, -TWO_SIDED_95),
                quantile(degrees, TWO_SIDED_95),
            );
            assert!((found.0 / low - 1.0).abs() < share, "{found:?}");
            assert!((found.1 / high - 1.0).abs() < share, "{found:?}");
        }
        let (low, high) = bounds_95(6, 10);
        assert!((low - 0.6747).abs() < 2e-4 && (high - 1.3883).abs() < 3e-4);
    }
}
