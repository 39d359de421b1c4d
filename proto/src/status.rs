//! How good a vehicle's estimate is, in one word and one byte.

use serde::{Deserialize, Serialize};

/// The state of a vehicle's own estimate.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// No pose in the common frame yet: no start pose was given and nobody has placed this vehicle.
    Unplaced,
    /// Neighbours or fixes correct the odometry.
    Tracking,
    /// Corrected, but worse than the figures promise.
    Degraded,
    /// Neighbours are present, but none has corrected the odometry lately.
    DeadReckoning,
    /// Nobody is present; odometry alone.
    Alone,
    /// Resumed from a checkpoint and not yet confirmed.
    Resuming,
    /// There was a pose, but odometry is missing: it is no longer known.
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
