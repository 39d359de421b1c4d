//! Why something was not used: every refusal has a word, is counted where it belongs, and is shown in the health.

use skein_estimation::cooperative::Refusal;
use skein_estimation::mutual::Unused;
use skein_proto::codec::DecodeError;

/// A reason. Silence is never the answer to "why is there no estimate?".
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Refused {
    /// The bytes are no message of the contract.
    Undecodable(DecodeError),
    /// The packet's hash is not that of the name in its key.
    WrongHash,
    /// The packet is addressed to another vehicle.
    NotForMe,
    /// The packet is from a boot that no longer counts.
    OldBoot,
    /// The packet is from a boot that has not proved that it is alive: a new one, a recording, or nobody.
    UnprovenBoot,
    /// The packet is from a boot whose predecessor has not yet left.
    NewBoot,
    /// Two processes of this name are alive.
    DuplicateId,
    /// A token of this vehicle's own name and another boot: of the process before this one, or of a duplicate.
    NamesakeToken,
    /// Its number is too far from any that is expected of its sender.
    OutOfSequence,
    /// This boot has not yet echoed a stamp of ours often enough to know its clock.
    ClockUnknown,
    /// Its round is solved already, or it lies too far back.
    TooLate,
    /// Its time lies ahead of any round that we keep.
    FromTheFuture,
    /// The same was heard before.
    Duplicate,
    /// Another measurement of the same neighbour and kind, nearer to the round's instant, was used.
    Superseded,
    /// Odometry around its time is missing, ours or the neighbour's.
    NoOdometry,
    /// The neighbour was not heard in this round, or has no estimate.
    NoPrior,
    /// This vehicle has no pose of its own yet.
    Unplaced,
    /// No sensor of that name is configured.
    UnknownSensor,
    /// Another sensor is the source of odometry.
    SecondOdometry,
    /// Another inertial sensor is the source of inertial readings.
    SecondInertial,
    /// Another camera is the source of anonymous bearings.
    SecondCamera,
    /// No inertial reading reaches the time of a camera frame, so it cannot be levelled.
    NoInertial,
    /// A reading that no vehicle can feel, or a motion that none can make.
    Implausible,
    /// Nothing here uses what it says: a relay, in other modes than `team`, or a feature set before this vehicle has one of
    /// its own.
    NoPipeline,
    /// Odometry that overlaps with what was already counted.
    Overlap,
    /// An answer to a question that was not asked, or of a time that was not asked for.
    Unasked,
    /// A bound was reached.
    Full,
    /// The robust kernel found that it disagrees with everything else. Its size is in the health of the neighbour.
    Gated,
    /// Its neighbour is in quarantine.
    Quarantined,
    /// The estimator refused it.
    Unusable(Refusal),
}

impl Refused {
    /// One word for counters.
    pub(crate) fn word(&self) -> &'static str {
        match self {
            Self::Undecodable(error) => error.reason(),
            Self::WrongHash => "wrong_hash",
            Self::NotForMe => "not_for_me",
            Self::OldBoot => "old_boot",
            Self::UnprovenBoot => "unproven_boot",
            Self::NewBoot => "new_boot",
            Self::DuplicateId => "duplicate_id",
            Self::NamesakeToken => "namesake_token",
            Self::OutOfSequence => "out_of_sequence",
            Self::ClockUnknown => "clock_unknown",
            Self::TooLate => "too_late",
            Self::FromTheFuture => "from_the_future",
            Self::Duplicate => "duplicate",
            Self::Superseded => "superseded",
            Self::NoOdometry => "no_odometry",
            Self::NoPrior => "no_prior",
            Self::Unplaced => "unplaced",
            Self::UnknownSensor => "unknown_sensor",
            Self::SecondOdometry => "second_odometry",
            Self::NoPipeline => "no_pipeline",
            Self::Overlap => "overlap",
            Self::SecondInertial => "second_inertial",
            Self::SecondCamera => "second_camera",
            Self::NoInertial => "no_inertial",
            Self::Implausible => "implausible",
            Self::Unasked => "unasked",
            Self::Full => "full",
            Self::Gated => "gated",
            Self::Quarantined => "quarantined",
            Self::Unusable(Refusal::Contradicts { .. }) => "contradicts",
            Self::Unusable(Refusal::Full { .. }) => "full",
            Self::Unusable(_) => "unusable",
        }
    }
}

impl From<Refusal> for Refused {
    fn from(refusal: Refusal) -> Self {
        Self::Unusable(refusal)
    }
}

impl From<Unused> for Refused {
    fn from(unused: Unused) -> Self {
        match unused {
            Unused::NothingOwn => Self::NoPipeline,
            Unused::Own => Self::DuplicateId,
            Unused::TooOld => Self::TooLate,
            Unused::TooNew => Self::FromTheFuture,
            Unused::Implausible => Self::Implausible,
            Unused::Full => Self::Full,
        }
    }
}

impl From<DecodeError> for Refused {
    fn from(error: DecodeError) -> Self {
        Self::Undecodable(error)
    }
}
