//! One line of a candump log: byte-oriented, no allocation

use crate::frame::{CanId, Frame};

/// What a line says
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Line<'a> {
    /// A frame
    Frame {
        /// Nanoseconds since the Unix epoch
        stamp_ns: i64,
        /// Interface name
        interface: &'a [u8],
        /// The frame
        frame: Frame,
    },
    /// The kernel dropped frames before this line
    Dropped {
        /// Interface name
        interface: &'a [u8],
        /// Number of frames since the last such line
        count: u32,
    },
    /// A blank line or a remark (`#`, `;`, `//`)
    Remark,
}

/// Why a line is none
#[derive(Clone, Copy, PartialEq, Eq, Debug, Hash, thiserror::Error)]
pub enum LineFault {
    /// No `(seconds.fraction)`
    #[error("it does not begin with (seconds.fraction)")]
    Stamp,
    /// No interface
    #[error("no interface name after the stamp")]
    Interface,
    /// No `#`
    #[error("no ID#DATA after the interface")]
    NoFrame,
    /// Identifier
    #[error("the identifier is not 3 or 8 hexadecimal digits")]
    Identifier,
    /// Identifier out of range
    #[error("the identifier is beyond 7FF (3 digits) or 3FFFFFFF (8 digits)")]
    IdentifierRange,
    /// Payload digits
    #[error("the payload is not pairs of hexadecimal digits")]
    Payload,
    /// Payload length of a classical frame
    #[error("a classical frame has at most 8 bytes")]
    ClassicalLength,
    /// Payload length of an FD frame
    #[error("CAN FD has no frame of this length (0..8, 12, 16, 20, 24, 32, 48, 64 bytes)")]
    FdLength,
    /// FD flags
    #[error("## is not followed by one hexadecimal digit of FD flags")]
    FdFlags,
    /// Remote request
    #[error("R is followed by something other than a length 0..8")]
    RemoteLength,
    /// Raw DLC
    #[error("_ is not followed by a raw DLC 9..F of a classical frame with 8 bytes")]
    RawDlc,
    /// CAN XL
    #[error("CAN XL frames are not supported")]
    CanXl,
    /// Text after the frame
    #[error("unexpected text after the frame")]
    Trailing,
    /// DROPCOUNT line
    #[error("a DROPCOUNT line without count or interface")]
    DropCount,
    /// Line length
    #[error("the line is longer than any candump line")]
    TooLong,
}

const BAD: u8 = 0xFF;

const HEX: [u8; 256] = {
    let mut table = [BAD; 256];
    let mut i = 0;
    while i < 10 {
        table[b'0' as usize + i] = i as u8;
        i += 1;
    }
    i = 0;
    while i < 6 {
        table[b'A' as usize + i] = 10 + i as u8;
        table[b'a' as usize + i] = 10 + i as u8;
        i += 1;
    }
    table
};

/// Reads one line, without its line end
pub fn parse_line(line: &[u8]) -> Result<Line<'_>, LineFault> {
    let line = line.trim_ascii();
    match line.first() {
        Some(b'(') => {}
        None | Some(b'#' | b';') => return Ok(Line::Remark),
        Some(b'/') if line.starts_with(b"//") => return Ok(Line::Remark),
        Some(b'D') if line.starts_with(b"DROPCOUNT:") => return parse_drop_count(line),
        Some(_) => return Err(LineFault::Stamp),
    }
    let (stamp_ns, rest) = parse_stamp(&line[1..])?;
    let rest = rest.trim_ascii_start();
    let end = rest.iter().position(|&byte| byte == b' ' || byte == b'\t').ok_or(LineFault::Interface)?;
    let (interface, rest) = rest.split_at(end);
    if interface.contains(&b'#') {
        return Err(LineFault::Interface);
    }
    let (frame, rest) = parse_frame(rest.trim_ascii_start())?;
    // candump -x appends the direction.
    match rest.trim_ascii() {
        b"" | b"R" | b"T" => Ok(Line::Frame { stamp_ns, interface, frame }),
        _ => Err(LineFault::Trailing),
    }
}

/// `seconds.fraction)`, one to nine digits of fraction
#[inline]
fn parse_stamp(text: &[u8]) -> Result<(i64, &[u8]), LineFault> {
    let mut seconds: i64 = 0;
    let mut at = 0;
    while let Some(digit) = text.get(at).map(|byte| byte.wrapping_sub(b'0')).filter(|&digit| digit < 10) {
        seconds = seconds * 10 + i64::from(digit);
        at += 1;
        if at > 11 {
            return Err(LineFault::Stamp);
        }
    }
    if at == 0 || text.get(at) != Some(&b'.') {
        return Err(LineFault::Stamp);
    }
    at += 1;
    let first = at;
    let mut fraction: i64 = 0;
    while let Some(digit) = text.get(at).map(|byte| byte.wrapping_sub(b'0')).filter(|&digit| digit < 10) {
        fraction = fraction * 10 + i64::from(digit);
        at += 1;
        if at - first > 9 {
            return Err(LineFault::Stamp);
        }
    }
    if at == first || text.get(at) != Some(&b')') {
        return Err(LineFault::Stamp);
    }
    const SCALE: [i64; 10] =
        [1_000_000_000, 100_000_000, 10_000_000, 1_000_000, 100_000, 10_000, 1_000, 100, 10, 1];
    let stamp_ns =
        seconds.checked_mul(1_000_000_000).and_then(|ns| ns.checked_add(fraction * SCALE[at - first]));
    Ok((stamp_ns.ok_or(LineFault::Stamp)?, &text[at + 1..]))
}

#[inline]
fn parse_hex(text: &[u8]) -> Option<u32> {
    let mut value = 0;
    for &byte in text {
        let digit = HEX[usize::from(byte)];
        if digit == BAD {
            return None;
        }
        value = value << 4 | u32::from(digit);
    }
    Some(value)
}

/// `ID#DATA` in all its forms; what follows it is handed back
#[inline]
fn parse_frame(text: &[u8]) -> Result<(Frame, &[u8]), LineFault> {
    let digits = if text.get(3) == Some(&b'#') {
        3
    } else if text.get(8) == Some(&b'#') {
        8
    } else if text.contains(&b'#') {
        return Err(LineFault::Identifier);
    } else {
        return Err(LineFault::NoFrame);
    };
    let number = parse_hex(&text[..digits]).ok_or(LineFault::Identifier)?;
    let rest = &text[digits + 1..];
    let error = digits == 8 && number & 0x2000_0000 != 0;
    let id = match digits {
        3 => CanId::standard(number),
        _ if number <= 0x3FFF_FFFF => CanId::extended(number & 0x1FFF_FFFF),
        _ => None,
    };
    let id = id.ok_or(LineFault::IdentifierRange)?;
    match rest.first() {
        Some(b'#') => parse_fd(id, &rest[1..]),
        Some(b'R' | b'r') => parse_remote(id, &rest[1..]),
        _ => parse_classical(id, error, rest),
    }
}

/// Payload bytes up to the first that is no hexadecimal digit; dots between bytes are skipped
#[inline]
fn parse_bytes<'a>(text: &'a [u8], data: &mut [u8; 64]) -> Result<(usize, &'a [u8]), LineFault> {
    let mut len = 0;
    let mut rest = text;
    loop {
        match rest {
            [b'.', tail @ ..] => rest = tail,
            [high, low, tail @ ..] if HEX[usize::from(*high)] != BAD => {
                let low = HEX[usize::from(*low)];
                if low == BAD {
                    return Err(LineFault::Payload);
                }
                *data.get_mut(len).ok_or(LineFault::FdLength)? = HEX[usize::from(*high)] << 4 | low;
                len += 1;
                rest = tail;
            }
            [single] if HEX[usize::from(*single)] != BAD => return Err(LineFault::Payload),
            _ => return Ok((len, rest)),
        }
    }
}

fn parse_classical(id: CanId, error: bool, text: &[u8]) -> Result<(Frame, &[u8]), LineFault> {
    let mut data = [0; 64];
    let (len, rest) = parse_bytes(text, &mut data)?;
    let frame =
        if error { Frame::error(id.number(), &data[..len]) } else { Frame::classical(id, &data[..len]) };
    let frame = frame.ok_or(LineFault::ClassicalLength)?;
    match rest {
        [b'_', dlc, tail @ ..] => {
            let dlc = HEX[usize::from(*dlc)];
            let fits = len == 8 && (9..=15).contains(&dlc);
            if fits { Ok((frame.with_raw_dlc(dlc), tail)) } else { Err(LineFault::RawDlc) }
        }
        [b'_'] => Err(LineFault::RawDlc),
        [b' ' | b'\t', ..] | [] => Ok((frame, rest)),
        [b'#' | b':', ..] => Err(LineFault::CanXl),
        _ => Err(LineFault::Payload),
    }
}

fn parse_fd(id: CanId, text: &[u8]) -> Result<(Frame, &[u8]), LineFault> {
    let (&flags, text) = text.split_first().ok_or(LineFault::FdFlags)?;
    let nibble = HEX[usize::from(flags)];
    if nibble == BAD {
        return Err(LineFault::FdFlags);
    }
    let mut data = [0; 64];
    let (len, rest) = parse_bytes(text, &mut data)?;
    match rest {
        [b' ' | b'\t', ..] | [] => {}
        _ => return Err(LineFault::Payload),
    }
    Frame::fd(id, nibble, &data[..len]).map(|frame| (frame, rest)).ok_or(LineFault::FdLength)
}

fn parse_remote(id: CanId, text: &[u8]) -> Result<(Frame, &[u8]), LineFault> {
    let (len, rest) = match text {
        [digit @ b'0'..=b'8', rest @ ..] => (digit - b'0', rest),
        rest => (0, rest),
    };
    let (dlc, rest) = match rest {
        [b'_', dlc, rest @ ..] if len == 8 => (HEX[usize::from(*dlc)], rest),
        rest => (0, rest),
    };
    if !matches!(rest, [b' ' | b'\t', ..] | []) {
        return Err(LineFault::RemoteLength);
    }
    if dlc != 0 && !(9..=15).contains(&dlc) {
        return Err(LineFault::RawDlc);
    }
    Frame::remote(id, len).map(|frame| (frame.with_raw_dlc(dlc), rest)).ok_or(LineFault::RemoteLength)
}

/// `DROPCOUNT: dropped 3 CAN frames on 'can0' socket (total drops 5)`
fn parse_drop_count(line: &[u8]) -> Result<Line<'_>, LineFault> {
    let parse = || {
        let rest = line.strip_prefix(b"DROPCOUNT: dropped ")?;
        let end = rest.iter().position(|byte| !byte.is_ascii_digit())?;
        let count = std::str::from_utf8(&rest[..end]).ok()?.parse().ok()?;
        let open = rest.iter().position(|&byte| byte == b'\'')? + 1;
        let close = open + rest[open..].iter().position(|&byte| byte == b'\'')?;
        Some(Line::Dropped { interface: &rest[open..close], count })
    };
    parse().ok_or(LineFault::DropCount)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::Flags;

    fn frame(text: &str) -> Result<Frame, LineFault> {
        match parse_line(format!("(1.5) can0 {text}").as_bytes())? {
            Line::Frame { frame, stamp_ns: 1_500_000_000, interface: b"can0" } => Ok(frame),
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn every_form_of_frame() {
        let standard = CanId::standard(0x123).unwrap();
        let extended = CanId::extended(0x123).unwrap();
        assert_eq!(frame("123#"), Ok(Frame::classical(standard, &[]).unwrap()));
        assert_eq!(frame("123#1aFF"), Ok(Frame::classical(standard, &[0x1A, 0xFF]).unwrap()));
        assert_eq!(frame("123#1A.FF"), frame("123#1AFF"));
        assert_eq!(
            frame("00000123#00"),
            Ok(Frame::classical(extended, &[0]).unwrap()),
            "extended below 0x800"
        );
        assert_eq!(frame("123#R"), Ok(Frame::remote(standard, 0).unwrap()));
        assert_eq!(frame("123#R8"), Ok(Frame::remote(standard, 8).unwrap()));
        assert_eq!(frame("123#R5 T"), Ok(Frame::remote(standard, 5).unwrap()));
        assert_eq!(frame("123##5001122"), Ok(Frame::fd(standard, 5, &[0, 0x11, 0x22]).unwrap()));
        assert_eq!(frame("123##0"), Ok(Frame::fd(standard, 0, &[]).unwrap()));
        let error = frame("20000004#0004000000000000 R").unwrap();
        assert!(error.flags().has(Flags::ERROR) && error.id().number() == 4 && error.len() == 8);
        assert_eq!(frame("123#0011223344556677_9").unwrap().raw_dlc(), 9);
        assert_eq!(frame("123#R8_F").unwrap(), Frame::remote(standard, 8).unwrap().with_raw_dlc(15));
    }

    #[test]
    fn every_fault_by_its_name() {
        use LineFault::*;
        for (text, fault) in [
            ("123", NoFrame),
            ("12#00", Identifier),
            ("1234#00", Identifier),
            ("12G#00", Identifier),
            ("800#00", IdentifierRange),
            ("40000000#00", IdentifierRange),
            ("123#0", Payload),
            ("123#0G", Payload),
            ("123#G0", Payload),
            ("123#001122334455667788", ClassicalLength),
            ("123##0001122334455667788", FdLength),
            ("123##", FdFlags),
            ("123##G", FdFlags),
            ("123##100Z", Payload),
            ("123#R9", RemoteLength),
            ("123#RX", RemoteLength),
            ("123#00_9", RawDlc),
            ("123#0011223344556677_8", RawDlc),
            ("123#0011223344556677_", RawDlc),
            ("123#00 more", Trailing),
            ("123#81:00:12345678#00", CanXl),
        ] {
            assert_eq!(frame(text), Err(fault), "{text}");
        }
        for (line, fault) in [
            ("1.5 can0 123#", Stamp),
            ("(1) can0 123#", Stamp),
            ("(1.) can0 123#", Stamp),
            ("(.5) can0 123#", Stamp),
            ("(1.1234567890) can0 123#", Stamp),
            ("(99999999999.0) can0 123#", Stamp),
            ("(2024-01-01 00:00:00.0) can0 123#", Stamp),
            ("(1.5", Stamp),
            ("(1.5)", Interface),
            ("(1.5) 123#00", Interface),
            ("(1.5) 123#00 R", Interface),
            ("DROPCOUNT: dropped many", DropCount),
        ] {
            assert_eq!(parse_line(line.as_bytes()), Err(fault), "{line}");
        }
    }

    #[test]
    fn stamps_drops_and_remarks() {
        for (text, expected) in
            [("1790000000.000004", 1_790_000_000_000_004_000), ("0000000000.000000007", 7)]
        {
            let line = format!("({text})   vcan12  123#\r");
            let Ok(Line::Frame { stamp_ns, interface, .. }) = parse_line(line.as_bytes()) else {
                panic!("{line}")
            };
            assert_eq!((stamp_ns, interface), (expected, &b"vcan12"[..]));
        }
        let drop = b"DROPCOUNT: dropped 12 CAN frames on 'can0' socket (total drops 20)";
        assert_eq!(parse_line(drop), Ok(Line::Dropped { interface: b"can0", count: 12 }));
        for remark in ["", "   ", "# x", "; x", "// x", "\r"] {
            assert_eq!(parse_line(remark.as_bytes()), Ok(Line::Remark));
        }
    }
}
