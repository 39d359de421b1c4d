//! Every bound of the wire contract, in one place.

/// Longest body of a packet between vehicles; fits one datagram of a secured link without fragmentation.
pub const PACKET_BYTES_MAX: usize = 1100;
/// Longest estimate: own pose and [`NEIGHBOURS_MAX`] neighbours with covariances, once by each pipeline; what the access
/// rules of a secured fleet let pass.
pub const ESTIMATE_BYTES_MAX: usize = 16_000;
/// Longest packet of a backlog: what the access rules of a secured fleet let pass.
pub const BACKLOG_BYTES_MAX: usize = 16_000;
/// Rounds in one packet of a backlog.
pub const BACKLOG_ROUNDS_PER_PACKET_MAX: usize = 100;
/// Longest driver frame, in either form (JSON or binary).
pub const FRAME_BYTES_MAX: usize = 16_384;
/// Longest JSON document that a tool of ours reads.
pub const DOCUMENT_BYTES_MAX: usize = 262_144;
/// Measurements of one neighbour in one exchange, each of another kind.
pub const MEASURED_PER_EXCHANGE_MAX: usize = 3;
/// Echoes in one round record; the neighbours take turns.
pub const ECHOES_PER_RECORD_MAX: usize = 4;
/// Rounds in one record: the newest and the repeated ones.
pub const ROUNDS_PER_RECORD_MAX: usize = 8;
/// Rounds in one packet of a relay.
pub const RELAYED_PER_PACKET_MAX: usize = 8;
/// Measurements in one round of a record.
pub const MEASURED_PER_ROUND_MAX: usize = 16;
/// Absolute fixes in one record, those of repeated rounds included.
pub const FIXES_PER_RECORD_MAX: usize = 8;
/// Neighbours in one estimate.
pub const NEIGHBOURS_MAX: usize = 32;
/// Ranges or anonymous bearings in one driver frame.
pub const FEATURES_PER_FRAME_MAX: usize = 32;
/// Tracks in one anonymous feature set.
pub const TRACKS_PER_SET_MAX: usize = 32;
/// Largest coordinate, in metres: a continent away is a mistake, not a position.
pub const COORDINATE_MAX_M: f64 = 1e7;
/// Largest rotation vector, in radians: a rotation needs no more than pi.
pub const ROTATION_VECTOR_MAX_RAD: f64 = 3.2;
/// How far from one the length of a unit vector may be.
pub const UNIT_TOLERANCE: f64 = 1e-6;
/// Largest speed, in m/s.
pub const SPEED_MAX_M_S: f64 = 1e4;
/// Largest acceleration, in m/s^2.
pub const ACCELERATION_MAX_M_S2: f64 = 1e4;
/// Largest angular rate, in rad/s.
pub const RATE_MAX_RAD_S: f64 = 1e3;
/// Largest number of a covariance growth: a year of poor odometry (0.1 rad and 1 m, 400 times a second) at the edge of the
/// world gathers less.
pub const GROWTH_MAX: f64 = 1e24;
/// Largest standard deviation, in radians or metres.
pub const SIGMA_MAX: f64 = 1e6;
