//! Where a vehicle was at one point of its odometry, as it was told: by its start pose or by an operator. No estimate.

use crate::growth::Growth;
use crate::{check, codec::DecodeError};
use serde::{Deserialize, Serialize};

/// A told pose, tied to the odometry of its instant.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Anchor {
    /// When the vehicle was there, in nanoseconds of the sender's clock. Another anchor has another time.
    #[serde(with = "crate::le")]
    pub taken_ns: i64,
    /// The segment of odometry that this point is in; the anchor says nothing of another one.
    pub segment: u8,
    /// Cumulative odometry at that time: rotation vector (rad), then translation (m).
    pub odometry_from_body: [f64; 6],
    /// Covariance that odometry had gathered by then.
    pub growth: Growth,
    /// Where the vehicle was: rotation vector (rad), then translation (m).
    pub world_from_body: [f64; 6],
    /// Standard deviation of the rotation per axis (rad).
    pub rotation_sigma_rad: f32,
    /// Standard deviation of the translation per axis (m).
    pub translation_sigma_m: f32,
}

impl Anchor {
    /// Refuses numbers that are not finite or outside their range.
    pub fn check(&self) -> Result<(), DecodeError> {
        check::pose("anchor: odometry", &self.odometry_from_body)?;
        self.growth.check("anchor: growth")?;
        check::pose("anchor", &self.world_from_body)?;
        check::sigma("anchor: rotation sigma", f64::from(self.rotation_sigma_rad))?;
        check::sigma(
            "anchor: translation sigma",
            f64::from(self.translation_sigma_m),
        )
    }
}
