//! Range checks of decoded numbers: each names the field that it refuses.

use crate::codec::DecodeError;
use crate::limits::{COORDINATE_MAX_M, ROTATION_VECTOR_MAX_RAD, SIGMA_MAX, UNIT_TOLERANCE};

type Checked = Result<(), DecodeError>;

/// Every number is finite.
pub(crate) fn finite(field: &'static str, numbers: &[f64]) -> Checked {
    if numbers.iter().all(|n| n.is_finite()) {
        Ok(())
    } else {
        Err(DecodeError::NotFinite { field })
    }
}

/// Every number is finite and at most `max` in size.
pub(crate) fn within(field: &'static str, numbers: &[f64], max: f64) -> Checked {
    finite(field, numbers)?;
    if numbers.iter().all(|n| n.abs() <= max) {
        Ok(())
    } else {
        Err(DecodeError::OutOfRange { field })
    }
}

/// A position in metres.
pub(crate) fn position(field: &'static str, position_m: &[f64; 3]) -> Checked {
    within(field, position_m, COORDINATE_MAX_M)
}

/// A rotation vector in radians, not longer than a rotation needs.
pub(crate) fn rotation_vector(field: &'static str, vector_rad: &[f64; 3]) -> Checked {
    finite(field, vector_rad)?;
    if norm(vector_rad) <= ROTATION_VECTOR_MAX_RAD {
        Ok(())
    } else {
        Err(DecodeError::OutOfRange { field })
    }
}

/// Six numbers of a pose: rotation vector (rad), then translation (m).
pub(crate) fn pose(field: &'static str, [rx, ry, rz, x, y, z]: &[f64; 6]) -> Checked {
    rotation_vector(field, &[*rx, *ry, *rz])?;
    position(field, &[*x, *y, *z])
}

/// A vector of length one.
pub(crate) fn unit(field: &'static str, direction: &[f64; 3]) -> Checked {
    finite(field, direction)?;
    if (norm(direction) - 1.0).abs() <= UNIT_TOLERANCE {
        Ok(())
    } else {
        Err(DecodeError::OutOfRange { field })
    }
}

/// A standard deviation: positive, finite and not absurd.
pub(crate) fn sigma(field: &'static str, sigma: f64) -> Checked {
    finite(field, &[sigma])?;
    if sigma > 0.0 && sigma <= SIGMA_MAX {
        Ok(())
    } else {
        Err(DecodeError::OutOfRange { field })
    }
}

/// A distance in metres: not negative and not absurd.
pub(crate) fn distance(field: &'static str, distance_m: f64) -> Checked {
    within(field, &[distance_m], COORDINATE_MAX_M)?;
    if distance_m >= 0.0 {
        Ok(())
    } else {
        Err(DecodeError::OutOfRange { field })
    }
}

/// A list within its bound.
pub(crate) fn at_most<T>(field: &'static str, list: &[T], max: usize) -> Checked {
    if list.len() <= max {
        Ok(())
    } else {
        Err(DecodeError::TooMany {
            field,
            count: list.len(),
            max,
        })
    }
}

fn norm(v: &[f64; 3]) -> f64 {
    (v[0] * v[0] + v[1] * v[1] + v[2] * v[2]).sqrt()
}
