//! One DBC signal: where its bits lie, and its physical value both ways

use crate::field::{ByteOrder, Field};
use crate::frame::{CanId, MAX_LEN};

/// How a signal's bits are a number
#[derive(Clone, Copy, PartialEq, Eq, Debug, Hash)]
pub enum ValueKind {
    /// Unsigned integer
    Unsigned,
    /// Two's complement integer
    Signed,
    /// IEEE 754 single
    F32,
    /// IEEE 754 double
    F64,
}

/// A multiplexed signal is present only in frames whose selector has one of these values
#[derive(Clone, PartialEq, Debug)]
pub struct MuxCondition {
    /// The selector's name
    pub selector: String,
    /// The selector's bits
    pub field: Field,
    /// Raw values, both ends included
    pub ranges: Vec<(u64, u64)>,
}

impl MuxCondition {
    /// Whether a payload's selector has one of the values
    #[inline]
    pub fn holds(&self, data: &[u8; MAX_LEN]) -> bool {
        let raw = self.field.extract(data);
        self.ranges.iter().any(|&(low, high)| (low..=high).contains(&raw))
    }
}

/// A signal of a DBC: physical = raw * scale + offset, in `unit`
#[derive(Clone, PartialEq, Debug)]
pub struct SignalSpec {
    /// Identifier of its message
    pub message_id: CanId,
    /// Name of its message
    pub message: String,
    /// Its own name
    pub name: String,
    /// Payload bytes of its message as the DBC has them
    pub message_len: u8,
    /// Start bit in the DBC's numbering
    pub start_bit: u16,
    /// Number of bits, 1..=64
    pub bits: u8,
    /// Byte order
    pub order: ByteOrder,
    /// How the bits are a number
    pub kind: ValueKind,
    /// Physical units per count
    pub scale: f64,
    /// Physical value of raw 0
    pub offset: f64,
    /// Smallest physical value, where the DBC limits it
    pub min: Option<f64>,
    /// Largest physical value, where the DBC limits it
    pub max: Option<f64>,
    /// Unit as the DBC writes it
    pub unit: String,
    /// All conditions for the signal to be in a frame, outermost selector first; empty: always
    pub mux: Vec<MuxCondition>,
    /// Its bits
    pub field: Field,
}

/// Why a physical value cannot be encoded
#[derive(Clone, Copy, PartialEq, Eq, Debug, thiserror::Error)]
pub enum EncodeError {
    /// NaN or infinite
    #[error("not a finite number")]
    NotFinite,
    /// Outside the DBC's `[min|max]`
    #[error("outside the signal's [min|max]")]
    OutOfLimits,
    /// More than the signal's bits can hold
    #[error("does not fit the signal's bits")]
    DoesNotFit,
    /// The payload ends before the signal does
    #[error("the payload is too short for the signal")]
    TooShort,
}

impl SignalSpec {
    /// `Message.Signal`, as configuration files name it
    pub fn full_name(&self) -> String {
        format!("{}.{}", self.message, self.name)
    }

    /// Payload bytes of its frame on the wire (FD pads to the next length that exists)
    pub fn wire_len(&self) -> usize {
        crate::frame::wire_len(self.message_len.into()).unwrap_or(MAX_LEN)
    }

    /// Whether a payload has this signal: every selector matches
    #[inline]
    pub fn present(&self, data: &[u8; MAX_LEN]) -> bool {
        self.mux.iter().all(|condition| condition.holds(data))
    }

    /// Physical value in `unit`, or `None` where a selector says that the signal is absent
    pub fn decode(&self, data: &[u8; MAX_LEN]) -> Option<f64> {
        self.present(data).then(|| self.physical(self.field.extract(data)))
    }

    /// Physical value in `unit` of raw bits
    #[inline]
    pub fn physical(&self, raw: u64) -> f64 {
        as_number(self.kind, self.bits, raw) * self.scale + self.offset
    }

    /// Raw bits of the count nearest to a physical value in `unit`
    pub fn raw(&self, value: f64) -> Result<u64, EncodeError> {
        if !value.is_finite() {
            return Err(EncodeError::NotFinite);
        }
        let slack =
            if matches!(self.kind, ValueKind::F32 | ValueKind::F64) { 0.0 } else { 0.5 * self.scale.abs() };
        if self.min.is_some_and(|min| value < min - slack) || self.max.is_some_and(|max| value > max + slack)
        {
            return Err(EncodeError::OutOfLimits);
        }
        let count = (value - self.offset) / self.scale;
        match self.kind {
            ValueKind::F64 => Ok(count.to_bits()),
            ValueKind::F32 => {
                let single = count as f32;
                if single.is_finite() {
                    Ok(u64::from(single.to_bits()))
                } else {
                    Err(EncodeError::DoesNotFit)
                }
            }
            ValueKind::Unsigned => {
                let count = count.round();
                // 2^bits is exact in f64, also for 64
                if count < 0.0 || count >= 2f64.powi(self.bits.into()) {
                    return Err(EncodeError::DoesNotFit);
                }
                Ok(count as u64)
            }
            ValueKind::Signed => {
                let count = count.round();
                let half = 2f64.powi(i32::from(self.bits) - 1);
                if count < -half || count >= half {
                    return Err(EncodeError::DoesNotFit);
                }
                Ok(count as i64 as u64)
            }
        }
    }

    /// Puts a physical value (in `unit`) and the signal's selectors into a payload; on error nothing is changed
    pub fn insert(&self, data: &mut [u8], value: f64) -> Result<(), EncodeError> {
        let raw = self.raw(value)?;
        let end = self.mux.iter().map(|c| c.field.end_byte()).fold(self.field.end_byte(), usize::max);
        if data.len() < end {
            return Err(EncodeError::TooShort);
        }
        for condition in &self.mux {
            if let Some(&(low, _)) = condition.ranges.first()
                && !condition.field.insert(data, low)
            {
                return Err(EncodeError::TooShort);
            }
        }
        if self.field.insert(data, raw) { Ok(()) } else { Err(EncodeError::TooShort) }
    }
}

/// Raw bits as the number they stand for, before scale and offset
#[inline]
pub(crate) fn as_number(kind: ValueKind, bits: u8, raw: u64) -> f64 {
    match kind {
        ValueKind::Unsigned => raw as f64,
        ValueKind::Signed => {
            let unused = 64 - u32::from(bits);
            ((raw << unused) as i64 >> unused) as f64
        }
        ValueKind::F32 => f64::from(f32::from_bits(raw as u32)),
        ValueKind::F64 => f64::from_bits(raw),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn spec(
        start: u64,
        bits: u64,
        order: ByteOrder,
        kind: ValueKind,
        scale: f64,
        offset: f64,
    ) -> Option<SignalSpec> {
        Some(SignalSpec {
            message_id: CanId::standard(1)?,
            message: "M".into(),
            name: "S".into(),
            message_len: 64,
            start_bit: start as u16,
            bits: bits as u8,
            order,
            kind,
            scale,
            offset,
            min: None,
            max: None,
            unit: String::new(),
            mux: Vec::new(),
            field: Field::new(start, bits, order)?,
        })
    }

    proptest! {
        #[test]
        fn integers_round_trip(start in 0u64..512, bits in 1u64..=52, raw: u64, big: bool, signed: bool,
                               scale in prop_oneof![Just(1.0), Just(-0.25), Just(1e-6), Just(0.1)], offset in -1e3f64..1e3) {
            let order = if big { ByteOrder::Big } else { ByteOrder::Little };
            let kind = if signed { ValueKind::Signed } else { ValueKind::Unsigned };
            if let Some(spec) = spec(start, bits, order, kind, scale, offset) {
                let raw = raw & ((1 << bits) - 1);
                let value = spec.physical(raw);
                // Only where the offset does not swallow the last bits.
                prop_assume!(spec.physical(raw ^ 1) != value && (value - offset).abs() / scale.abs() < 1e12);
                let mut data = [0; 64];
                spec.insert(&mut data, value).unwrap();
                prop_assert_eq!(spec.field.extract(&data), raw);
                prop_assert_eq!(spec.decode(&data), Some(value));
            }
        }

        #[test]
        fn floats_round_trip(start in 0u64..512, value: f64, single: f32, big: bool) {
            let order = if big { ByteOrder::Big } else { ByteOrder::Little };
            for (kind, bits, value) in [(ValueKind::F64, 64, value), (ValueKind::F32, 32, f64::from(single))] {
                if let Some(spec) = spec(start, bits, order, kind, 1.0, 0.0) {
                    let mut data = [0xFF; 64];
                    if value.is_finite() {
                        spec.insert(&mut data, value).unwrap();
                        prop_assert_eq!(spec.decode(&data), Some(value));
                    } else {
                        prop_assert_eq!(spec.insert(&mut data, value), Err(EncodeError::NotFinite));
                    }
                }
            }
        }
    }

    #[test]
    fn range_is_checked_at_its_very_ends() {
        let signed = spec(0, 16, ByteOrder::Little, ValueKind::Signed, 0.01, 0.0).unwrap();
        let mut data = [0; 8];
        assert_eq!(signed.insert(&mut data, 327.67), Ok(()));
        assert_eq!(data[..2], [0xFF, 0x7F]);
        assert_eq!(signed.insert(&mut data, 327.68), Err(EncodeError::DoesNotFit));
        assert_eq!(signed.insert(&mut data, -327.68), Ok(()));
        assert_eq!(signed.insert(&mut data, -327.69), Err(EncodeError::DoesNotFit));
        assert_eq!(signed.insert(&mut data[..1], 1.0), Err(EncodeError::TooShort));
        let wide = spec(0, 64, ByteOrder::Little, ValueKind::Unsigned, 1.0, 0.0).unwrap();
        assert_eq!(wide.raw(18446744073709551615.0), Err(EncodeError::DoesNotFit), "rounds to 2^64");
        assert_eq!(wide.raw(-1.0), Err(EncodeError::DoesNotFit));
        let limited = SignalSpec { min: Some(0.0), max: Some(10.0), ..signed };
        assert_eq!(limited.raw(10.1), Err(EncodeError::OutOfLimits));
        assert_eq!(limited.raw(10.0), Ok(1000));
    }
}
