//! How good a vehicle's estimate is, in one word and one byte.

use serde::{Deserialize, Serialize};

/// The state of a vehicle's own estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// No pose in the common frame yet: no start pose was given and nobody has placed this vehicle.
    Unplaced,
    /// Neighbours or fixes have corrected the odometry within the last 2 s, and when the estimator supplies a covariance,
    /// its orientation sigma is at most 0.2 rad (root of the sum of the variances about the three axes).
    Tracking,
    /// Corrected within the last 2 s, but the orientation sigma is above 0.2 rad, or the estimator of mode `team` had to
    /// begin again within the last 10 s: an error that the whole team's orientation shares is then too large for a
    /// linearised covariance, and the estimate may be further off than that says.
    Degraded,
    /// Neighbours are present, but nothing has corrected the odometry within the last 2 s.
    DeadReckoning,
    /// Nobody is present; odometry alone.
    Alone,
    /// Resumed from a checkpoint and not yet confirmed.
    Resuming,
    /// There was a pose, but odometry has been missing for more than 1 s: it is no longer known.
    Lost,
}

impl Status {
    /// All of them, in the order of their codes.
    pub const ALL: [Self; 7] = [
        Self::Unplaced,
        Self::Tracking,
        Self::Degraded,
        Self::DeadReckoning,
        Self::Alone,
        Self::Resuming,
        Self::Lost,
    ];

    /// Its byte on the wire.
    pub fn code(self) -> u8 {
        self as u8
    }

    /// The status of a byte; none for a code of a newer version.
    pub fn from_code(code: u8) -> Option<Self> {
        Self::ALL.get(usize::from(code)).copied()
    }

    /// Whether a vehicle of this status has a pose that others may use.
    pub fn is_located(self) -> bool {
        matches!(
            self,
            Self::Tracking | Self::Degraded | Self::DeadReckoning | Self::Alone
        )
    }

    /// As people read it.
    pub fn words(self) -> &'static str {
        match self {
            Self::Unplaced => "unplaced",
            Self::Tracking => "tracking",
            Self::Degraded => "degraded",
            Self::DeadReckoning => "dead reckoning",
            Self::Alone => "alone",
            Self::Resuming => "resuming",
            Self::Lost => "lost",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_status_has_its_own_byte() {
        for (code, status) in Status::ALL.into_iter().enumerate() {
            assert_eq!(usize::from(status.code()), code);
            assert_eq!(Status::from_code(status.code()), Some(status));
        }
        assert_eq!(Status::from_code(7), None);
    }
}
