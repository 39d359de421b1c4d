//! The name of a fleet, a vehicle or a sensor: one chunk of a key, `[a-z0-9_]{1,32}`, and the hash that stands for it.

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::fmt;

/// Longest name in bytes.
pub const NAME_BYTES_MAX: usize = 32;

/// A checked name, held inline. In JSON a string; in bytes 32 bytes, padded with zeros.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Name {
    bytes: [u8; NAME_BYTES_MAX],
}

/// Why a text is no name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NameError {
    /// No character, or more than 32.
    #[error("a name has 1 to {NAME_BYTES_MAX} characters, this one has {length}")]
    Length {
        /// Its length in bytes.
        length: usize,
    },
    /// A character outside `[a-z0-9_]`.
    #[error("a name is made of a-z, 0-9 and _, this one has {found:?}")]
    Character {
        /// The first one that is not allowed.
        found: char,
    },
}

impl Name {
    /// Checks a text. Fails when it is empty, longer than 32 bytes or has another character than `[a-z0-9_]`.
    pub fn parse(text: &str) -> Result<Self, NameError> {
        if let Some(found) = text
            .chars()
            .find(|c| !matches!(c, 'a'..='z' | '0'..='9' | '_'))
        {
            return Err(NameError::Character { found });
        }
        if text.is_empty() || text.len() > NAME_BYTES_MAX {
            return Err(NameError::Length { length: text.len() });
        }
        let mut bytes = [0; NAME_BYTES_MAX];
        bytes[..text.len()].copy_from_slice(text.as_bytes());
        Ok(Self { bytes })
    }

    /// The name as text.
    pub fn as_str(&self) -> &str {
        let length = self
            .bytes
            .iter()
            .position(|b| *b == 0)
            .unwrap_or(NAME_BYTES_MAX);
        std::str::from_utf8(&self.bytes[..length]).expect("a name is ASCII by construction")
    }

    /// FNV-1a 64 of the UTF-8 bytes: how packets name a vehicle.
    pub fn hash(&self) -> u64 {
        const OFFSET_BASIS: u64 = 0xcbf2_9ce4_8422_2325;
        const PRIME: u64 = 0x0000_0100_0000_01b3;
        self.as_str().bytes().fold(OFFSET_BASIS, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(PRIME)
        })
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl fmt::Debug for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.as_str())
    }
}

impl std::str::FromStr for Name {
    type Err = NameError;
    fn from_str(text: &str) -> Result<Self, NameError> {
        Self::parse(text)
    }
}

impl Serialize for Name {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if serializer.is_human_readable() {
            serializer.serialize_str(self.as_str())
        } else {
            self.bytes.serialize(serializer)
        }
    }
}

impl<'de> Deserialize<'de> for Name {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        use serde::de::Error;
        if deserializer.is_human_readable() {
            return Self::parse(&String::deserialize(deserializer)?).map_err(D::Error::custom);
        }
        let bytes = <[u8; NAME_BYTES_MAX]>::deserialize(deserializer)?;
        let length = bytes.iter().position(|b| *b == 0).unwrap_or(NAME_BYTES_MAX);
        if bytes[length..].iter().any(|b| *b != 0) {
            return Err(D::Error::custom("a name is padded with zeros only"));
        }
        let text = std::str::from_utf8(&bytes[..length]).map_err(D::Error::custom)?;
        Self::parse(text).map_err(D::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_lower_case_digits_and_underscores_up_to_32_bytes() {
        assert_eq!(Name::parse("uav_07").unwrap().as_str(), "uav_07");
        assert_eq!(Name::parse(&"a".repeat(32)).unwrap().as_str().len(), 32);
        assert_eq!(
            Name::parse(&"a".repeat(33)),
            Err(NameError::Length { length: 33 })
        );
        assert_eq!(Name::parse(""), Err(NameError::Length { length: 0 }));
        assert_eq!(Name::parse("a/b"), Err(NameError::Character { found: '/' }));
        assert_eq!(Name::parse("Ä"), Err(NameError::Character { found: 'Ä' }));
    }

    #[test]
    fn the_hash_is_fnv_1a_64() {
        // Test vectors of the FNV reference distribution.
        assert_eq!(Name::parse("a").unwrap().hash(), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(Name::parse("foobar").unwrap().hash(), 0x8594_4171_f739_67e8);
    }

    #[test]
    fn a_padded_name_with_something_behind_the_zeros_is_refused() {
        let mut bytes = postcard::to_allocvec(&Name::parse("v1").unwrap()).unwrap();
        assert_eq!(postcard::from_bytes::<Name>(&bytes).unwrap().as_str(), "v1");
        bytes[5] = b'x';
        assert!(postcard::from_bytes::<Name>(&bytes).is_err());
    }
}
