//! Where a number lies among a payload's bits, with the shifts computed once

use crate::frame::MAX_LEN;

/// Order of a signal's bytes in the payload
#[derive(Clone, Copy, PartialEq, Eq, Debug, Hash)]
pub enum ByteOrder {
    /// Intel: the start bit is the least significant
    Little,
    /// Motorola: the start bit is the most significant
    Big,
}

/// Up to 64 bits of a payload as one unsigned number
///
/// Bits are numbered as DBC files do: bit `n` is bit `n % 8` (0 = least significant) of byte `n / 8`.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Field {
    order: ByteOrder,
    /// First byte of the 16-byte window that holds the field
    window: u8,
    /// Right shift of that window, read in `order`, that brings the field to bit 0
    shift: u8,
    bits: u8,
    /// Byte and shift of a 8-byte window, where one holds the field
    narrow: Option<(u8, u8)>,
    mask: u64,
    last_byte: u8,
}

impl Field {
    /// The field, or `None` if it has 0 or more than 64 bits or leaves a payload of 64 bytes
    pub fn new(start_bit: u64, bits: u64, order: ByteOrder) -> Option<Self> {
        if !(1..=64).contains(&bits) || start_bit >= 8 * MAX_LEN as u64 {
            return None;
        }
        // Position along the payload in the direction in which significance changes.
        let first = match order {
            ByteOrder::Little => start_bit,
            ByteOrder::Big => start_bit / 8 * 8 + (7 - start_bit % 8),
        };
        let last = first + bits - 1;
        if last >= 8 * MAX_LEN as u64 {
            return None;
        }
        let place = |bytes: u64| {
            let window = (first / 8).min(MAX_LEN as u64 - bytes);
            let shift = match order {
                ByteOrder::Little => first - 8 * window,
                ByteOrder::Big => (8 * window + 8 * bytes - 1).checked_sub(last)?,
            };
            (last < 8 * (window + bytes)).then_some((window as u8, shift as u8))
        };
        let (window, shift) = place(16)?;
        let mask = if bits == 64 { u64::MAX } else { (1 << bits) - 1 };
        Some(Self {
            order,
            window,
            shift,
            bits: bits as u8,
            narrow: place(8),
            mask,
            last_byte: (last / 8) as u8,
        })
    }

    /// Number of bits
    pub const fn bits(&self) -> u8 {
        self.bits
    }

    /// Number of payload bytes up to and including the field's last
    pub const fn end_byte(&self) -> usize {
        self.last_byte as usize + 1
    }

    /// The field's bits as an unsigned number
    #[inline]
    pub fn extract(&self, data: &[u8; MAX_LEN]) -> u64 {
        if let Some((byte, shift)) = self.narrow {
            let byte = byte as usize;
            let Some(window) = data.get(byte..byte + 8).and_then(|w| <[u8; 8]>::try_from(w).ok()) else {
                return 0;
            };
            let word = match self.order {
                ByteOrder::Little => u64::from_le_bytes(window),
                ByteOrder::Big => u64::from_be_bytes(window),
            };
            return (word >> shift) & self.mask;
        }
        (self.read_wide(data) >> self.shift) as u64 & self.mask
    }

    fn read_wide(&self, data: &[u8; MAX_LEN]) -> u128 {
        let mut window = [0; 16];
        let byte = self.window as usize;
        window.copy_from_slice(&data[byte..byte + 16]);
        match self.order {
            ByteOrder::Little => u128::from_le_bytes(window),
            ByteOrder::Big => u128::from_be_bytes(window),
        }
    }

    /// Puts the low bits of `raw` into the field; false, and nothing done, if `data` ends before the field does
    #[must_use]
    pub fn insert(&self, data: &mut [u8], raw: u64) -> bool {
        if data.len() < self.end_byte() || data.len() > MAX_LEN {
            return false;
        }
        let mut padded = [0; MAX_LEN];
        padded[..data.len()].copy_from_slice(data);
        let mask = u128::from(self.mask) << self.shift;
        let word = (self.read_wide(&padded) & !mask) | ((u128::from(raw) << self.shift) & mask);
        let bytes = match self.order {
            ByteOrder::Little => word.to_le_bytes(),
            ByteOrder::Big => word.to_be_bytes(),
        };
        let byte = self.window as usize;
        padded[byte..byte + 16].copy_from_slice(&bytes);
        data.copy_from_slice(&padded[..data.len()]);
        true
    }

    /// Calls `bit` with each payload bit number (DBC numbering) that the field uses
    pub fn for_each_bit(&self, mut bit: impl FnMut(usize)) {
        let window = 8 * self.window as usize;
        for i in 0..self.bits as usize {
            let from_lsb = self.shift as usize + i;
            match self.order {
                ByteOrder::Little => bit(window + from_lsb),
                ByteOrder::Big => {
                    let along = window + 127 - from_lsb;
                    bit(along / 8 * 8 + 7 - along % 8);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Bit by bit, as the DBC format defines it
    fn slow_extract(data: &[u8; 64], start: u64, bits: u64, order: ByteOrder) -> u64 {
        let bit = |n: u64| u64::from(data[(n / 8) as usize] >> (n % 8) & 1);
        let mut value = 0;
        let mut at = start;
        for i in 0..bits {
            match order {
                ByteOrder::Little => value |= bit(start + i) << i,
                ByteOrder::Big => {
                    value = value << 1 | bit(at);
                    at = if at.is_multiple_of(8) { at + 15 } else { at - 1 };
                }
            }
        }
        value
    }

    fn orders() -> impl Strategy<Value = ByteOrder> {
        prop_oneof![Just(ByteOrder::Little), Just(ByteOrder::Big)]
    }

    proptest! {
        #[test]
        fn extract_is_the_definition(seed in prop::array::uniform32(any::<u8>()), start in 0u64..512, bits in 1u64..=64, order in orders()) {
            let mut data = [0; 64];
            data[..32].copy_from_slice(&seed);
            for i in 32..64 { data[i] = seed[63 - i].wrapping_mul(37) ^ 0x5A; }
            if let Some(field) = Field::new(start, bits, order) {
                prop_assert_eq!(field.extract(&data), slow_extract(&data, start, bits, order));
                let mut used = Vec::new();
                field.for_each_bit(|bit| used.push(bit));
                prop_assert_eq!(used.len() as u64, bits);
                prop_assert!(used.contains(&(start as usize)));
                prop_assert!(used.iter().all(|bit| bit / 8 < field.end_byte()));
            }
        }

        #[test]
        fn insert_touches_only_its_bits(start in 0u64..512, bits in 1u64..=64, raw: u64, order in orders(), fill: u8) {
            if let Some(field) = Field::new(start, bits, order) {
                let mut data = [fill; 64];
                prop_assert!(field.insert(&mut data, raw));
                prop_assert_eq!(field.extract(&data), raw & field.mask);
                let kept = Field::new(start, bits, order).map(|f| f.insert(&mut data, [fill; 64][0] as u64));
                prop_assert_eq!(kept, Some(true));
                let mut mine = [false; 512];
                field.for_each_bit(|bit| mine[bit] = true);
                for bit in 0..512 {
                    if !mine[bit] { prop_assert_eq!(data[bit / 8] >> (bit % 8) & 1, fill >> (bit % 8) & 1); }
                }
            }
        }
    }

    #[test]
    fn what_does_not_fit_is_refused() {
        assert!(Field::new(0, 0, ByteOrder::Little).is_none());
        assert!(Field::new(0, 65, ByteOrder::Little).is_none());
        assert!(Field::new(511, 2, ByteOrder::Little).is_none());
        assert!(Field::new(504, 2, ByteOrder::Big).is_none(), "motorola: bit 504 is the payload's very last");
        assert!(Field::new(511, 8, ByteOrder::Big).is_some());
        assert!(!Field::new(8, 8, ByteOrder::Little).unwrap().insert(&mut [0], 1));
    }
}
