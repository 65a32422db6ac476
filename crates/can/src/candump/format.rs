//! A frame as a line of a candump log, byte for byte as `candump -L` prints it

use crate::frame::{Flags, Stamped};

/// Most bytes that a line has: stamp, the longest interface name, 64 bytes of payload
pub const MAX_LINE: usize = 192;

/// Digits of a stamp's fraction
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub enum StampDigits {
    /// 6, as candump has it
    #[default]
    Micros,
    /// 9: the kernel's stamp without loss
    Nanos,
}

struct Cursor<'a> {
    line: &'a mut [u8; MAX_LINE],
    at: usize,
}

impl Cursor<'_> {
    #[inline]
    fn push(&mut self, byte: u8) {
        if let Some(place) = self.line.get_mut(self.at) {
            *place = byte;
            self.at += 1;
        }
    }

    fn decimal(&mut self, mut value: u64, width: usize) {
        let mut digits = [b'0'; 20];
        let mut first = digits.len();
        while value > 0 || digits.len() - first < width.min(20) {
            first -= 1;
            digits[first] = b'0' + (value % 10) as u8;
            value /= 10;
        }
        digits[first..].iter().for_each(|&digit| self.push(digit));
    }

    #[inline]
    fn hex(&mut self, value: u32, digits: u32) {
        for digit in (0..digits).rev() {
            self.push(b"0123456789ABCDEF"[(value >> (4 * digit) & 0xF) as usize]);
        }
    }
}

/// Writes a line with its line end into `line`; the number of bytes. Stamps before 1970 are written as 0.
pub fn format_line(
    line: &mut [u8; MAX_LINE],
    stamped: &Stamped,
    interface: &str,
    digits: StampDigits,
) -> usize {
    let mut out = Cursor { line, at: 0 };
    let stamp_ns = stamped.stamp_ns.max(0) as u64;
    out.push(b'(');
    out.decimal(stamp_ns / 1_000_000_000, 10);
    out.push(b'.');
    match digits {
        StampDigits::Micros => out.decimal(stamp_ns % 1_000_000_000 / 1_000, 6),
        StampDigits::Nanos => out.decimal(stamp_ns % 1_000_000_000, 9),
    }
    out.push(b')');
    out.push(b' ');
    interface.bytes().take(32).for_each(|byte| out.push(byte));
    out.push(b' ');
    let frame = &stamped.frame;
    let flags = frame.flags();
    let id = frame.id();
    if flags.has(Flags::ERROR) {
        out.hex(id.number() | 0x2000_0000, 8);
    } else {
        out.hex(id.number(), if id.is_extended() { 8 } else { 3 });
    }
    out.push(b'#');
    if flags.has(Flags::REMOTE) {
        out.push(b'R');
        if !frame.is_empty() {
            out.hex(frame.len() as u32, 1);
        }
    } else if flags.has(Flags::FD) {
        out.push(b'#');
        out.hex(flags.fd_nibble().into(), 1);
    }
    frame.data().iter().for_each(|&byte| out.hex(byte.into(), 2));
    if frame.raw_dlc() != 0 {
        out.push(b'_');
        out.hex(frame.raw_dlc().into(), 1);
    }
    out.push(b'\n');
    out.at
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::candump::{Line, parse_line};
    use crate::frame::{CanId, Frame};
    use proptest::prelude::*;

    fn frames() -> impl Strategy<Value = Frame> {
        let ids = prop_oneof![
            (0u32..=0x7FF).prop_map(|id| CanId::standard(id).unwrap()),
            (0u32..=0x1FFF_FFFF).prop_map(|id| CanId::extended(id).unwrap()),
            (0u32..0x800).prop_map(|id| CanId::extended(id).unwrap()),
        ];
        (ids, prop::collection::vec(any::<u8>(), 64), 0usize..16, 0u8..6, 0u8..16).prop_map(
            |(id, bytes, dlc, kind, flags)| {
                let fd_len = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64][dlc];
                let short = &bytes[..dlc.min(8)];
                match kind {
                    0 => Frame::remote(id, dlc.min(8) as u8),
                    1 => Frame::error(id.number(), short),
                    2 => Frame::fd(id, flags, &bytes[..fd_len]),
                    3 => Frame::classical(id, short).map(|frame| frame.with_raw_dlc(flags)),
                    _ => Frame::classical(id, short),
                }
                .unwrap()
            },
        )
    }

    proptest! {
        #[test]
        fn lines_round_trip(frame in frames(), stamp_ns in 0i64..4_000_000_000_000_000_000) {
            let stamped = Stamped { stamp_ns, interface: 0, frame };
            let mut line = [0; MAX_LINE];
            let len = format_line(&mut line, &stamped, "can0", StampDigits::Nanos);
            prop_assert_eq!(line[len - 1], b'\n');
            prop_assert_eq!(parse_line(&line[..len - 1]), Ok(Line::Frame { stamp_ns, interface: b"can0", frame }));
            let len = format_line(&mut line, &stamped, "vcan0", StampDigits::Micros);
            let micros = stamp_ns / 1000 * 1000;
            prop_assert_eq!(parse_line(&line[..len]), Ok(Line::Frame { stamp_ns: micros, interface: b"vcan0", frame }));
        }

        #[test]
        fn no_line_makes_it_panic(line in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = parse_line(&line);
        }

        #[test]
        fn no_damaged_line_makes_it_panic(frame in frames(), at in 0usize..100, byte: u8) {
            let stamped = Stamped { stamp_ns: 1, interface: 0, frame };
            let mut line = [0; MAX_LINE];
            let len = format_line(&mut line, &stamped, "can0", StampDigits::Micros);
            line[at % len] = byte;
            let _ = parse_line(&line[..len]);
        }
    }
}
