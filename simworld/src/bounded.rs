//! Numbers of a settings file that must lie in a range. Checked while they are read, so that the error still knows
//! its place in the file.

use serde::de::{Deserialize, Deserializer, Error};

/// A finite number that is not below zero.
pub(crate) fn not_negative<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    checked(
        deserializer,
        |value| value >= 0.0,
        "a finite number, 0 or more",
    )
}

/// A finite number above zero.
pub(crate) fn positive<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    checked(deserializer, |value| value > 0.0, "a finite number above 0")
}

/// A finite number.
pub(crate) fn finite<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    checked(deserializer, |_| true, "a finite number")
}

/// A number from 0 to 1.
pub(crate) fn probability<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    checked(
        deserializer,
        |value| (0.0..=1.0).contains(&value),
        "a probability from 0 to 1",
    )
}

fn checked<'de, D: Deserializer<'de>>(
    deserializer: D,
    holds: fn(f64) -> bool,
    law: &str,
) -> Result<f64, D::Error> {
    let value = f64::deserialize(deserializer)?;
    if value.is_finite() && holds(value) {
        Ok(value)
    } else {
        Err(D::Error::custom(format!("{value} is not {law}")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(serde::Deserialize)]
    struct Settings {
        #[serde(deserialize_with = "probability")]
        loss: f64,
    }

    #[test]
    fn the_ends_of_the_range_are_allowed_and_one_step_beyond_is_not() {
        for allowed in ["0", "1", "0.5"] {
            let settings: Settings = toml::from_str(&format!("loss = {allowed}")).unwrap();
            assert!((0.0..=1.0).contains(&settings.loss));
        }
        for refused in ["-1e-9", "1.000001", "nan", "inf"] {
            let text = format!("loss = {refused}");
            let error = toml::from_str::<Settings>(&text).err().unwrap();
            assert_eq!(error.span(), Some(7..text.len()), "{error}");
            assert!(error.message().contains("a probability from 0 to 1"));
        }
    }
}
