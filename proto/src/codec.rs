//! Bytes to checked values and back. Decoding is total: whatever comes in, a value or a counted reason comes out.

use crate::envelope::{ENVELOPE_BYTES, Envelope};
use crate::{VERSION_MAJOR, VERSION_MINOR};
use serde::{Serialize, de::DeserializeOwned};

/// A message body: how long it may be and what its numbers must satisfy.
pub trait Body: Serialize + DeserializeOwned {
    /// Longest encoded body, envelope not counted.
    const BYTES_MAX: usize;
    /// Refuses numbers that are not finite or outside their range, and lists over their bound.
    fn check(&self) -> Result<(), DecodeError>;
    /// How many fields were appended since a minor version. Each is an option or a list, whose absent form is one zero
    /// byte: a body of that version is read as if so many zeros followed it.
    fn appended_since(_minor: u8) -> usize {
        0
    }
}

/// Why bytes were refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DecodeError {
    /// Longer than any message of this kind; nothing was read.
    #[error("{bytes} bytes, at most {max} are read")]
    TooLong {
        /// Bytes that came.
        bytes: usize,
        /// Bytes allowed.
        max: usize,
    },
    /// Shorter than an envelope, or than the body that its envelope announces.
    #[error("cut short: {bytes} bytes of {needed}")]
    Truncated {
        /// Bytes that came.
        bytes: usize,
        /// Bytes needed.
        needed: usize,
    },
    /// Another major version.
    #[error("version {major}.{minor}, this program speaks {VERSION_MAJOR}.x")]
    Version {
        /// Major version of the sender.
        major: u8,
        /// Minor version of the sender.
        minor: u8,
    },
    /// Bytes behind the body, or behind the fields of a body whose sender is not newer than we are.
    #[error("{bytes} bytes too many")]
    Trailing {
        /// How many.
        bytes: usize,
    },
    /// Not the fields of this message.
    #[error("malformed body")]
    Malformed,
    /// A number that is infinite or none.
    #[error("{field} is not finite")]
    NotFinite {
        /// Which.
        field: &'static str,
    },
    /// A number outside its range.
    #[error("{field} is out of range")]
    OutOfRange {
        /// Which.
        field: &'static str,
    },
    /// A list over its bound.
    #[error("{count} entries in {field}, at most {max}")]
    TooMany {
        /// Which.
        field: &'static str,
        /// How many came.
        count: usize,
        /// How many may.
        max: usize,
    },
}

impl DecodeError {
    /// One word for counters.
    pub fn reason(&self) -> &'static str {
        match self {
            Self::TooLong { .. } => "too_long",
            Self::Truncated { .. } => "truncated",
            Self::Version { .. } => "version",
            Self::Trailing { .. } => "trailing",
            Self::Malformed => "malformed",
            Self::NotFinite { .. } => "not_finite",
            Self::OutOfRange { .. } => "out_of_range",
            Self::TooMany { .. } => "too_many",
        }
    }
}

/// A message that cannot be sent: it breaks the limits that its receivers check.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("cannot be encoded: {0}")]
pub struct EncodeError(pub DecodeError);

/// Encodes a packet. `body_bytes` and the version of `envelope` are filled in. Fails when the body breaks a limit.
pub fn encode<B: Body>(envelope: Envelope, body: &B) -> Result<Vec<u8>, EncodeError> {
    body.check().map_err(EncodeError)?;
    let bytes = postcard::to_extend(body, vec![0; ENVELOPE_BYTES])
        .map_err(|_| EncodeError(DecodeError::Malformed))?;
    let body_bytes = bytes.len() - ENVELOPE_BYTES;
    if body_bytes > B::BYTES_MAX {
        return Err(EncodeError(DecodeError::TooLong {
            bytes: body_bytes,
            max: B::BYTES_MAX,
        }));
    }
    let envelope = Envelope {
        major: VERSION_MAJOR,
        minor: VERSION_MINOR,
        body_bytes: u16::try_from(body_bytes).expect("BYTES_MAX is below 65,536 for every message"),
        ..envelope
    };
    let mut packet = bytes;
    postcard::to_slice(&envelope, &mut packet[..ENVELOPE_BYTES])
        .expect("an envelope always takes 32 bytes");
    Ok(packet)
}

/// How many bytes a body takes, envelope not counted.
pub fn body_bytes<B: Body>(body: &B) -> usize {
    postcard::serialize_with_flavor(body, postcard::ser_flavors::Size::default())
        .unwrap_or(usize::MAX)
}

/// Decodes a packet: length, version, announced length, fields, bytes left over, ranges, in this order.
pub fn decode<B: Body>(packet: &[u8]) -> Result<(Envelope, B), DecodeError> {
    let bytes = packet.len();
    if bytes > ENVELOPE_BYTES + B::BYTES_MAX {
        return Err(DecodeError::TooLong {
            bytes,
            max: ENVELOPE_BYTES + B::BYTES_MAX,
        });
    }
    if bytes < ENVELOPE_BYTES {
        return Err(DecodeError::Truncated {
            bytes,
            needed: ENVELOPE_BYTES,
        });
    }
    let (head, body) = packet.split_at(ENVELOPE_BYTES);
    let envelope: Envelope = postcard::from_bytes(head).map_err(|_| DecodeError::Malformed)?;
    if envelope.major != VERSION_MAJOR {
        return Err(DecodeError::Version {
            major: envelope.major,
            minor: envelope.minor,
        });
    }
    let announced = usize::from(envelope.body_bytes);
    if body.len() < announced {
        return Err(DecodeError::Truncated {
            bytes,
            needed: ENVELOPE_BYTES + announced,
        });
    }
    if body.len() > announced {
        return Err(DecodeError::Trailing {
            bytes: body.len() - announced,
        });
    }
    let appended = B::appended_since(envelope.minor);
    let completed;
    let body = if appended == 0 {
        body
    } else {
        completed = [body, &vec![0; appended]].concat();
        &completed
    };
    let (value, rest) = postcard::take_from_bytes::<B>(body).map_err(|_| DecodeError::Malformed)?;
    // A newer minor version may append fields; from anybody else they are a mistake or an attack.
    let from_newer = envelope.minor > VERSION_MINOR;
    if !rest.is_empty() && !from_newer {
        return Err(DecodeError::Trailing { bytes: rest.len() });
    }
    value.check()?;
    Ok((envelope, value))
}
