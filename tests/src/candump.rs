//! Recordings as text: parsed, retimed and repacked without the code under test.

use crate::{Check, Failure, IoContext};
use std::fmt::{self, Write as _};
use std::path::Path;
use std::process::Command;
use std::time::Duration;

const SECOND_NS: i64 = 1_000_000_000;
const UNPACK_LIMIT: Duration = Duration::from_secs(120);
/// The identifier of the CAN FD message that carries a whole round.
pub const ROUND_ID: &str = "180";
/// What a round of arm A carries, in its order on the bus: drives first, then gauges. Temperatures come between rounds.
pub const ROUND: [&str; 7] = ["201", "202", "203", "101", "102", "103", "104"];
/// Where the gauge messages carry their count of frames.
const SEQUENCE_BYTE: usize = 6;

/// One line of a recording: `(seconds.fraction) interface ID#DATA`, or `ID##FDATA` for CAN FD.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Nanoseconds since the Unix epoch; candump writes microseconds, the daemon nanoseconds.
    pub stamp_ns: i64,
    /// The interface's name.
    pub interface: String,
    /// The identifier in hexadecimal, as written.
    pub id: String,
    /// The flags of a CAN FD frame; `None` for a classical one.
    pub fd_flags: Option<char>,
    /// The payload.
    pub data: Vec<u8>,
}

impl Line {
    /// Reads a line; anything but a data frame is a failure.
    pub fn parse(line: &str) -> Check<Self> {
        Self::read(line).ok_or_else(|| Failure::new(format!("not a line of candump -L: {line:?}")))
    }

    fn read(line: &str) -> Option<Self> {
        let mut words = line.split_ascii_whitespace();
        let (seconds, fraction) = words.next()?.strip_prefix('(')?.strip_suffix(')')?.split_once('.')?;
        let unit_ns = match fraction.len() {
            6 => 1000,
            9 => 1,
            _ => return None,
        };
        let stamp_ns = seconds.parse::<i64>().ok()? * SECOND_NS + fraction.parse::<i64>().ok()? * unit_ns;
        let interface = words.next()?.to_owned();
        let (id, rest) = words.next()?.split_once('#')?;
        let (fd_flags, payload) = match rest.strip_prefix('#') {
            Some(rest) => (Some(rest.chars().next()?), rest.get(1..)?),
            None => (None, rest),
        };
        let data = (0..payload.len())
            .step_by(2)
            .map(|at| payload.get(at..at + 2).and_then(|byte| u8::from_str_radix(byte, 16).ok()))
            .collect::<Option<Vec<u8>>>()?;
        Some(Self { stamp_ns, interface, id: id.to_owned(), fd_flags, data })
    }

    /// Identifier and payload as the line writes them: what must arrive unchanged. Of CAN FD's flags only bit rate
    /// switch and error state (1 and 2) count: kernels from 6.1 on add a 4, which says CAN FD once more.
    pub fn frame(&self) -> String {
        self.written(|flags| {
            flags.to_digit(16).and_then(|bits| char::from_digit(bits & 3, 16)).unwrap_or(flags)
        })
    }

    fn written(&self, flags: impl Fn(char) -> char) -> String {
        let mut text = format!("{}#", self.id);
        if let Some(given) = self.fd_flags {
            text.push('#');
            text.push(flags(given));
        }
        for byte in &self.data {
            // Writing to a string cannot fail.
            let _ = write!(text, "{byte:02X}");
        }
        text
    }
}

impl fmt::Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (seconds, micros) = (self.stamp_ns / SECOND_NS, self.stamp_ns % SECOND_NS / 1000);
        write!(f, "({seconds}.{micros:06}) {} {}", self.interface, self.written(|flags| flags))
    }
}

/// Reads a recording, plain or packed with gzip or zstd. Remarks (`#`) are left out; anything else that is no data frame is a failure.
pub fn read(path: &Path) -> Check<Vec<Line>> {
    let tool = match path.extension().and_then(|end| end.to_str()) {
        Some("gz") => "gzip",
        Some("zst") => "zstd",
        _ => "cat",
    };
    let mut command = Command::new(tool);
    if tool != "cat" {
        command.args(["-d", "-c"]);
    }
    let finished = crate::process::run(command.arg(path), UNPACK_LIMIT)?;
    finished.stdout().lines().filter(|line| !line.starts_with('#')).map(Line::parse).collect()
}

/// Writes a recording as plain text, with microseconds.
pub fn write(path: &Path, lines: &[Line]) -> Check {
    let mut text = String::new();
    for line in lines {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{line}");
    }
    std::fs::write(path, text).at("write", path)
}

/// The complete rounds of a recording of arm A, temperatures left out.
pub fn rounds(lines: &[Line]) -> Vec<[Line; ROUND.len()]> {
    let wanted: Vec<&Line> = lines.iter().filter(|line| ROUND.contains(&line.id.as_str())).collect();
    let complete = |window: &&[&Line]| window.iter().zip(ROUND).all(|(line, id)| line.id == id);
    wanted
        .windows(ROUND.len())
        .filter(complete)
        .filter_map(|window| {
            <[&Line; ROUND.len()]>::try_from(window).ok().map(|round| round.map(Line::clone))
        })
        .collect()
}

/// A recording of `count` rounds, `period_ns` apart: these rounds to and fro, so that nothing jumps, with the gauges' counts of frames going on.
/// Frames of a round keep the spacing of a 1 Mbit/s bus (0.132 ms).
pub fn repeated(rounds: &[[Line; ROUND.len()]], count: usize, period_ns: i64) -> Vec<Line> {
    let Some(first) = rounds.first() else { return Vec::new() };
    let mut lines = Vec::with_capacity(count * ROUND.len());
    let turn = (2 * rounds.len()).saturating_sub(2).max(1);
    let mut start_ns = first[0].stamp_ns;
    for number in 0..count {
        let at = number % turn;
        let round = &rounds[if at < rounds.len() { at } else { turn - at }];
        for (place, line) in (0i64..).zip(round) {
            let mut line = line.clone();
            line.stamp_ns = start_ns + place * 132_000;
            if line.id.starts_with('1') {
                line.data[SEQUENCE_BYTE] = number.to_le_bytes()[0];
            }
            lines.push(line);
        }
        start_ns += period_ns;
    }
    lines
}

/// The same recording with each round in one CAN FD frame (bit rate switched), the payloads one after the other; everything else as it is.
pub fn as_fd(lines: &[Line]) -> Vec<Line> {
    let mut packed = Vec::new();
    let mut open: Vec<&Line> = Vec::new();
    for line in lines {
        if ROUND.get(open.len()).is_some_and(|id| *id == line.id) {
            open.push(line);
        } else if ROUND.contains(&line.id.as_str()) {
            // A round with a frame missing is not sent.
            open.clear();
            if line.id == ROUND[0] {
                open.push(line);
            }
        } else {
            packed.push(line.clone());
        }
        if open.len() == ROUND.len() {
            let mut data: Vec<u8> = open.iter().flat_map(|line| line.data.iter().copied()).collect();
            // 56 bytes is no length of CAN FD; 64 is the next.
            data.resize(64, 0);
            let (id, interface) = (ROUND_ID.to_owned(), line.interface.clone());
            packed.push(Line { stamp_ns: line.stamp_ns, interface, id, fd_flags: Some('1'), data });
            open.clear();
        }
    }
    packed
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round(stamp_ns: i64, value: u8) -> [Line; ROUND.len()] {
        ROUND.map(|id| Line {
            stamp_ns,
            interface: "can0".into(),
            id: id.into(),
            fd_flags: None,
            data: vec![value; 8],
        })
    }

    #[test]
    fn lines_are_written_as_they_were_read() {
        for text in [
            "(1790000000.000019) can0 201#3E9507008979E2FF",
            "(1790000000.000019) vcan1 18FEF100#",
            "(1790000000.999999) vcan1 180##5112233",
        ] {
            assert_eq!(Line::parse(text).unwrap().to_string(), text);
        }
        assert_eq!(Line::parse("(0000000000.000001) vcan1 180##51122").unwrap().frame(), "180##11122");
        let exact = "(1790000000.000019123) can0 201#3E9507008979E2FF";
        assert_eq!(Line::parse(exact).unwrap().stamp_ns, 1_790_000_000_000_019_123);
        assert_eq!(Line::parse(exact).unwrap().to_string(), exact.replace("123)", ")"));
        for bad in [
            "",
            "201#00",
            "(1.5) can0 201#00",
            "(1.000000) can0 201#0",
            "(1.000000) can0 201#R",
            "(1.000000)",
            "(1.0000000) can0 201#00",
        ] {
            assert!(Line::parse(bad).is_err(), "{bad}");
        }
    }

    #[test]
    fn rounds_turn_back_at_the_end_and_count_on() {
        let given = [round(0, 1), round(8000, 2), round(16000, 3)];
        let lines = repeated(&given, 300, 1_000_000);
        assert_eq!(lines.len(), 300 * ROUND.len());
        let firsts: Vec<&Line> = lines.iter().filter(|line| line.id == "201").collect();
        let values: Vec<u8> = firsts.iter().take(6).map(|line| line.data[0]).collect();
        assert_eq!(values, [1, 2, 3, 2, 1, 2]);
        assert!(firsts.windows(2).all(|pair| pair[1].stamp_ns - pair[0].stamp_ns == 1_000_000));
        let counts: Vec<u8> =
            lines.iter().filter(|line| line.id == "104").map(|line| line.data[SEQUENCE_BYTE]).collect();
        assert!(counts.windows(2).all(|pair| pair[1] == pair[0].wrapping_add(1)));
        assert_eq!(rounds(&lines).len(), 300);
    }

    #[test]
    fn a_round_becomes_one_frame_unless_a_part_is_missing() {
        let mut lines: Vec<Line> = round(0, 7).into();
        lines.push(Line { id: "301".into(), ..lines[0].clone() });
        lines.extend(round(1000, 8).into_iter().filter(|line| line.id != "102"));
        lines.extend(round(2000, 9));
        let packed = as_fd(&lines);
        assert_eq!(packed.iter().map(|line| line.id.as_str()).collect::<Vec<_>>(), ["180", "301", "180"]);
        assert_eq!((packed[2].data.len(), packed[2].data[55], packed[2].data[56]), (64, 9, 0));
    }
}
