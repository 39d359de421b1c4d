//! Integers of fixed width, little end first, so that any language reads them (`struct.unpack`); plain numbers in JSON.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// An integer with a fixed little-endian form.
pub(crate) trait FixedWidth: Copy + Serialize + for<'de> Deserialize<'de> {
    /// `[u8; N]`.
    type Bytes: Serialize + for<'de> Deserialize<'de>;
    /// Little end first.
    fn to_bytes(self) -> Self::Bytes;
    /// The inverse of [`FixedWidth::to_bytes`].
    fn from_bytes(bytes: Self::Bytes) -> Self;
}

macro_rules! fixed_width {
    ($($integer:ty),*) => {$(
        impl FixedWidth for $integer {
            type Bytes = [u8; size_of::<Self>()];
            fn to_bytes(self) -> Self::Bytes { self.to_le_bytes() }
            fn from_bytes(bytes: Self::Bytes) -> Self { Self::from_le_bytes(bytes) }
        }
    )*};
}
fixed_width!(u16, u32, u64, i32, i64);

/// For `#[serde(with = "crate::le")]`.
pub(crate) fn serialize<T: FixedWidth, S: Serializer>(
    value: &T,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    if serializer.is_human_readable() {
        value.serialize(serializer)
    } else {
        value.to_bytes().serialize(serializer)
    }
}

/// For `#[serde(with = "crate::le")]`.
pub(crate) fn deserialize<'de, T: FixedWidth, D: Deserializer<'de>>(
    deserializer: D,
) -> Result<T, D::Error> {
    if deserializer.is_human_readable() {
        T::deserialize(deserializer)
    } else {
        Ok(T::from_bytes(T::Bytes::deserialize(deserializer)?))
    }
}
