//! Who a vehicle is, as the estimators know it: a short name held inline, ordered so that runs repeat.

use std::fmt;

/// Longest name in bytes.
pub const VEHICLE_ID_BYTES_MAX: usize = 32;

/// A vehicle's name, 1 to 32 bytes. Copying it allocates nothing.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct VehicleId {
    bytes: [u8; VEHICLE_ID_BYTES_MAX],
    length: u8,
}

impl VehicleId {
    /// The id of a name. None when it is empty or longer than 32 bytes.
    pub fn new(name: &str) -> Option<Self> {
        let length = u8::try_from(name.len()).ok()?;
        let mut bytes = [0; VEHICLE_ID_BYTES_MAX];
        bytes
            .get_mut(..name.len())?
            .copy_from_slice(name.as_bytes());
        (length > 0).then_some(Self { bytes, length })
    }

    /// The name.
    pub fn as_str(&self) -> &str {
        std::str::from_utf8(&self.bytes[..usize::from(self.length)])
            .expect("built from a whole string")
    }
}

impl fmt::Display for VehicleId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

impl fmt::Debug for VehicleId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_of_32_bytes_fits_and_one_more_does_not() {
        assert_eq!(VehicleId::new(&"v".repeat(32)).unwrap().as_str().len(), 32);
        assert_eq!(VehicleId::new(&"v".repeat(33)), None);
        assert_eq!(VehicleId::new(""), None);
    }
}
