//! CAN frames as they are on the wire, and the stamp and interface they were received with

/// Largest payload of a CAN FD frame in bytes
pub const MAX_LEN: usize = 64;

const EXTENDED_BIT: u32 = 1 << 31;

/// An identifier: 11 bits (standard) or 29 bits (extended); the two spaces are distinct
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct CanId(u32);

impl CanId {
    /// Standard identifier, or `None` above 0x7FF
    pub const fn standard(id: u32) -> Option<Self> {
        if id <= 0x7FF { Some(Self(id)) } else { None }
    }

    /// Extended identifier, or `None` above 0x1FFF_FFFF; small values are extended too
    pub const fn extended(id: u32) -> Option<Self> {
        if id <= 0x1FFF_FFFF { Some(Self(id | EXTENDED_BIT)) } else { None }
    }

    /// The identifier's number without any flag
    pub const fn number(self) -> u32 {
        self.0 & 0x1FFF_FFFF
    }

    /// Whether the identifier has 29 bits
    pub const fn is_extended(self) -> bool {
        self.0 & EXTENDED_BIT != 0
    }

    /// The number with bit 31 set where extended, as DBC files and the kernel write it
    pub const fn with_flag(self) -> u32 {
        self.0
    }
}

impl std::fmt::Display for CanId {
    /// Three hexadecimal digits for a standard identifier, eight for an extended one
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.is_extended() {
            write!(f, "{:08X}", self.number())
        } else {
            write!(f, "{:03X}", self.number())
        }
    }
}

impl std::fmt::Debug for CanId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        std::fmt::Display::fmt(self, f)
    }
}

/// Properties of a frame beside identifier and payload; the low nibble is CAN FD's flags as the kernel has them
#[derive(Clone, Copy, PartialEq, Eq, Hash, Debug, Default)]
pub struct Flags(u8);

impl Flags {
    /// CAN FD: the payload was sent at the data bit rate
    pub const BRS: Self = Self(0x01);
    /// CAN FD: the sender is error passive
    pub const ESI: Self = Self(0x02);
    /// CAN FD: the kernel's own mark of an FD frame (set by newer kernels on reception)
    pub const FDF: Self = Self(0x04);
    /// A remote request: it has a length but no payload
    pub const REMOTE: Self = Self(0x10);
    /// An error frame made by the kernel: the identifier is the error class
    pub const ERROR: Self = Self(0x20);
    /// A CAN FD frame
    pub const FD: Self = Self(0x40);

    /// A classical data frame: no flag at all
    pub const fn classical() -> Self {
        Self(0)
    }

    /// FD frame with the kernel's flags nibble
    pub const fn fd(nibble: u8) -> Self {
        Self(Self::FD.0 | (nibble & 0x0F))
    }

    /// Whether every flag of `other` is set
    pub const fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Both sets of flags
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// CAN FD's flags nibble as the kernel has it
    pub const fn fd_nibble(self) -> u8 {
        self.0 & 0x0F
    }
}

/// One CAN frame; bytes of the payload beyond its length are zero
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    id: CanId,
    flags: Flags,
    len: u8,
    raw_dlc: u8,
    data: [u8; MAX_LEN],
}

impl Frame {
    /// A classical data frame, or `None` for more than 8 bytes
    pub fn classical(id: CanId, data: &[u8]) -> Option<Self> {
        if data.len() > 8 { None } else { Some(Self::filled(id, Flags::classical(), data)) }
    }

    /// A CAN FD frame with the kernel's flags nibble, or `None` for a length that FD does not have
    pub fn fd(id: CanId, nibble: u8, data: &[u8]) -> Option<Self> {
        if is_fd_len(data.len()) { Some(Self::filled(id, Flags::fd(nibble), data)) } else { None }
    }

    /// A remote request for `len` bytes, or `None` for more than 8
    pub fn remote(id: CanId, len: u8) -> Option<Self> {
        if len > 8 {
            return None;
        }
        let mut frame = Self::filled(id, Flags::REMOTE, &[]);
        frame.len = len;
        Some(frame)
    }

    /// An error frame of a class (`CAN_ERR_*` bits), or `None` for a class above 29 bits or more than 8 bytes
    pub fn error(class: u32, data: &[u8]) -> Option<Self> {
        if data.len() > 8 {
            return None;
        }
        CanId::extended(class).map(|id| Self::filled(id, Flags::ERROR, data))
    }

    /// The same frame with a raw DLC of 9..=15 on the wire; no effect unless it is classical with 8 bytes
    #[must_use]
    pub fn with_raw_dlc(mut self, dlc: u8) -> Self {
        if !self.flags.has(Flags::FD) && self.len == 8 && (9..=15).contains(&dlc) {
            self.raw_dlc = dlc;
        }
        self
    }

    fn filled(id: CanId, flags: Flags, bytes: &[u8]) -> Self {
        let mut data = [0; MAX_LEN];
        let len = bytes.len().min(MAX_LEN);
        data[..len].copy_from_slice(&bytes[..len]);
        Self { id, flags, len: len as u8, raw_dlc: 0, data }
    }

    /// Identifier; for an error frame its class, as an extended identifier
    pub const fn id(&self) -> CanId {
        self.id
    }

    /// What kind of frame it is
    pub const fn flags(&self) -> Flags {
        self.flags
    }

    /// Number of payload bytes (of requested bytes for a remote request)
    pub const fn len(&self) -> usize {
        self.len as usize
    }

    /// Whether the frame has no payload
    pub const fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Raw DLC 9..=15 of a classical frame with 8 bytes, 0 where it is just the length
    pub const fn raw_dlc(&self) -> u8 {
        self.raw_dlc
    }

    /// Payload bytes (none for a remote request)
    pub fn data(&self) -> &[u8] {
        if self.flags.has(Flags::REMOTE) { &[] } else { &self.data[..self.len as usize] }
    }

    /// Payload bytes to write into
    pub fn data_mut(&mut self) -> &mut [u8] {
        let len = if self.flags.has(Flags::REMOTE) { 0 } else { self.len as usize };
        &mut self.data[..len]
    }

    /// All 64 bytes, zero beyond the payload
    pub const fn padded(&self) -> &[u8; MAX_LEN] {
        &self.data
    }

    /// Whether the frame carries data: neither a remote request nor an error frame
    pub const fn is_data(&self) -> bool {
        self.flags.0 & (Flags::REMOTE.0 | Flags::ERROR.0) == 0
    }

    /// Bits on the wire without stuffing, interframe space included: what a bus load is made of
    ///
    /// Classical: 47 (67 extended) + 8 per byte. FD: nominal-rate overhead and data phase are counted as if at one rate.
    pub const fn bits_on_wire(&self) -> u32 {
        let payload = if self.flags.has(Flags::REMOTE) { 0 } else { 8 * self.len as u32 };
        let head = if self.id.is_extended() { 67 } else { 47 };
        let fd = if self.flags.has(Flags::FD) { if self.len > 16 { 17 } else { 13 } } else { 0 };
        head + fd + payload
    }
}

impl std::fmt::Debug for Frame {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}#{:02X?} (len {}, flags {:#04x})", self.id, self.data(), self.len, self.flags.0)
    }
}

/// A frame as received: kernel stamp and interface
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub struct Stamped {
    /// Reception (kernel, `CLOCK_REALTIME`) in nanoseconds since the Unix epoch
    pub stamp_ns: i64,
    /// Index into the configured list of interfaces
    pub interface: u8,
    /// The frame
    pub frame: Frame,
}

/// Whether CAN FD has frames of this many bytes
pub const fn is_fd_len(len: usize) -> bool {
    matches!(len, 0..=8 | 12 | 16 | 20 | 24 | 32 | 48 | 64)
}

/// Smallest length in bytes that a frame carrying `len` bytes has on the wire, or `None` above 64
pub const fn wire_len(len: usize) -> Option<usize> {
    Some(match len {
        0..=8 => len,
        9..=12 => 12,
        13..=16 => 16,
        17..=20 => 20,
        21..=24 => 24,
        25..=32 => 32,
        33..=48 => 48,
        49..=64 => 64,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_keep_their_space_apart() {
        let short = CanId::standard(0x123).unwrap();
        let long = CanId::extended(0x123).unwrap();
        assert_ne!(short, long);
        assert_eq!((short.number(), long.number()), (0x123, 0x123));
        assert_eq!(format!("{short} {long}"), "123 00000123");
        assert!(CanId::standard(0x800).is_none() && CanId::extended(0x2000_0000).is_none());
    }

    #[test]
    fn only_lengths_that_exist() {
        let id = CanId::standard(1).unwrap();
        assert!(Frame::classical(id, &[0; 9]).is_none());
        assert!(Frame::fd(id, 0, &[0; 9]).is_none());
        assert_eq!(Frame::fd(id, 1, &[7; 12]).unwrap().data(), [7; 12]);
        assert!(Frame::remote(id, 8).unwrap().data().is_empty());
        for len in 0..=64 {
            let wire = wire_len(len).unwrap();
            assert!(wire >= len && is_fd_len(wire));
            assert!((len..wire).all(|shorter| !is_fd_len(shorter)));
        }
        assert_eq!(wire_len(65), None);
    }
}
