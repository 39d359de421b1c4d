//! What a vehicle writes down of itself, so that a restart begins where it stood: one pose and when it was there, in
//! 96 bytes that tell whether they are whole.
//!
//! Little endian: magic (8 bytes), version (u16), length of everything (u16), hash of the vehicle's name (u64), boot
//! (u64), time taken (i64, ns of UNIX time), quaternion x y z w and translation of `world_from_body` (7 f64), CRC-32 of
//! all bytes before it (u32).

use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use skein_estimation::time::Stamp;
use skein_estimation::{Body, Transform, World};
use skein_proto::name::Name;

use crate::translate;

const MAGIC: [u8; 8] = *b"SKEIN-CP";
const VERSION: u16 = 1;
/// Length of an encoded checkpoint.
pub const CHECKPOINT_BYTES: usize = 96;
/// How far from one the length of the quaternion may be.
const UNIT_TOLERANCE: f64 = 1e-9;

/// Where a vehicle was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Checkpoint {
    /// Which process wrote it.
    pub boot: u64,
    /// When the vehicle was there, in UNIX time.
    pub taken: Stamp,
    /// Where.
    pub world_from_body: Transform<World, Body>,
}

/// Why bytes are no checkpoint of this vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CheckpointError {
    /// Not as long as a checkpoint: the file was cut short.
    #[error("it has {0} bytes, not {CHECKPOINT_BYTES}: it was cut short, or is another file")]
    Length(usize),
    /// It does not begin as a checkpoint does.
    #[error("it is no checkpoint")]
    Magic,
    /// Written by another version of the program.
    #[error("it has version {0}, this program reads version {VERSION}")]
    Version(u16),
    /// Some bytes are not those that were written.
    #[error("its checksum is wrong: it is damaged")]
    Checksum,
    /// It belongs to a vehicle of another name.
    #[error("it is of another vehicle")]
    OtherVehicle,
    /// Its numbers are no pose.
    #[error("its numbers are no pose")]
    NoPose,
}

impl Checkpoint {
    /// The bytes to be kept for a vehicle.
    pub fn encode(&self, vehicle: Name) -> [u8; CHECKPOINT_BYTES] {
        let mut bytes = Vec::with_capacity(CHECKPOINT_BYTES);
        bytes.extend(MAGIC);
        bytes.extend(VERSION.to_le_bytes());
        bytes.extend((CHECKPOINT_BYTES as u16).to_le_bytes());
        bytes.extend(vehicle.hash().to_le_bytes());
        bytes.extend(self.boot.to_le_bytes());
        bytes.extend(self.taken.as_nanos().to_le_bytes());
        let rotation = self.world_from_body.rotation.coords;
        for number in rotation.iter().chain(&self.world_from_body.translation) {
            bytes.extend(number.to_le_bytes());
        }
        bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
        bytes.try_into().expect("the fields add up to its length")
    }

    /// Reads a checkpoint of a vehicle. Fails for bytes of another origin, and when as much as one bit is not as it was
    /// written.
    pub fn decode(vehicle: Name, bytes: &[u8]) -> Result<Self, CheckpointError> {
        let bytes: &[u8; CHECKPOINT_BYTES] = bytes
            .try_into()
            .map_err(|_| CheckpointError::Length(bytes.len()))?;
        if bytes[..8] != MAGIC {
            return Err(CheckpointError::Magic);
        }
        let (content, checksum) = bytes.split_at(CHECKPOINT_BYTES - 4);
        let mut rest = Reader(&content[8..]);
        let [version, length] = [rest.u16(), rest.u16()];
        if version != VERSION {
            return Err(CheckpointError::Version(version));
        }
        if usize::from(length) != CHECKPOINT_BYTES
            || crc32fast::hash(content).to_le_bytes() != *checksum
        {
            return Err(CheckpointError::Checksum);
        }
        if rest.u64() != vehicle.hash() {
            return Err(CheckpointError::OtherVehicle);
        }
        let boot = rest.u64();
        let taken = Stamp::from_nanos(rest.u64().cast_signed());
        let [x, y, z, w, east, north, up] = std::array::from_fn(|_| f64::from_bits(rest.u64()));
        let quaternion = Quaternion::new(w, x, y, z);
        // Not normalised again: a resumed pose is the one that was written, to the bit.
        let world_from_body = Transform::new(
            UnitQuaternion::new_unchecked(quaternion),
            Vector3::new(east, north, up),
        );
        let is_unit = (quaternion.norm() - 1.0).abs() <= UNIT_TOLERANCE;
        if !is_unit || !translate::is_sayable(&world_from_body) {
            return Err(CheckpointError::NoPose);
        }
        Ok(Self {
            boot,
            taken,
            world_from_body,
        })
    }
}

/// Reads numbers from bytes whose length was checked.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        let (taken, rest) = self.0.split_at(N);
        self.0 = rest;
        taken.try_into().expect("split at N")
    }

    fn u16(&mut self) -> u16 {
        u16::from_le_bytes(self.take())
    }

    fn u64(&mut self) -> u64 {
        u64::from_le_bytes(self.take())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(text: &str) -> Name {
        Name::parse(text).unwrap()
    }

    fn checkpoint() -> Checkpoint {
        Checkpoint {
            boot: 77,
            taken: Stamp::from_nanos(1_800_000_000_123_456_789),
            world_from_body: Transform::new(
                UnitQuaternion::from_euler_angles(0.1, -0.2, 2.5),
                Vector3::new(12.5, -3.25, 40.0),
            ),
        }
    }

    #[test]
    fn what_was_written_is_read_to_the_bit() {
        let bytes = checkpoint().encode(name("v1"));
        assert_eq!(Checkpoint::decode(name("v1"), &bytes), Ok(checkpoint()));
        assert_eq!(
            Checkpoint::decode(name("v2"), &bytes),
            Err(CheckpointError::OtherVehicle)
        );
    }

    #[test]
    fn a_checkpoint_torn_at_any_byte_or_with_any_bit_flipped_is_refused() {
        let bytes = checkpoint().encode(name("v1"));
        for length in 0..bytes.len() {
            let torn = Checkpoint::decode(name("v1"), &bytes[..length]);
            assert_eq!(torn, Err(CheckpointError::Length(length)));
        }
        for bit in 0..8 * bytes.len() {
            let mut flipped = bytes;
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(
                Checkpoint::decode(name("v1"), &flipped).is_err(),
                "bit {bit}"
            );
        }
        // A page of zeros that the disk never wrote behind the first part.
        for written in 0..bytes.len() {
            let mut half = bytes;
            half[written..].fill(0);
            let same = half == bytes;
            assert!(
                same || Checkpoint::decode(name("v1"), &half).is_err(),
                "{written}"
            );
        }
    }

    #[test]
    fn numbers_that_are_no_pose_and_other_versions_are_refused() {
        let signed = |change: &dyn Fn(&mut [u8; CHECKPOINT_BYTES])| {
            let mut bytes = checkpoint().encode(name("v1"));
            change(&mut bytes);
            let sum = crc32fast::hash(&bytes[..92]).to_le_bytes();
            bytes[92..].copy_from_slice(&sum);
            Checkpoint::decode(name("v1"), &bytes)
        };
        let infinite = signed(&|bytes| bytes[68..76].copy_from_slice(&f64::INFINITY.to_le_bytes()));
        assert_eq!(infinite, Err(CheckpointError::NoPose));
        let no_rotation = signed(&|bytes| bytes[36..68].fill(0));
        assert_eq!(no_rotation, Err(CheckpointError::NoPose));
        assert_eq!(
            signed(&|bytes| bytes[8] = 2),
            Err(CheckpointError::Version(2))
        );
    }
}
