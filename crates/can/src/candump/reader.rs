//! A candump log file as events: plain, gzip or zstd by content, malformed lines counted and told

use std::fs::File;
use std::io::{self, Read};
use std::path::{Path, PathBuf};

use super::{Interfaces, Line, LineFault, parse_line};
use crate::error::{Error, Result};
use crate::frame::Stamped;

const BUFFER: usize = 256 * 1024;

/// The next thing that a log says
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum LogEvent {
    /// A frame of a known interface
    Frame(Stamped),
    /// The kernel dropped frames while this was recorded
    Dropped {
        /// Index of the interface
        interface: u8,
        /// Number of frames
        count: u32,
    },
    /// A line that is none; reading goes on
    Malformed {
        /// Line number from 1
        line: u64,
        /// What is wrong with it
        fault: LineFault,
    },
}

/// What a log had so far
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct LogCounts {
    /// Lines, remarks included
    pub lines: u64,
    /// Frames of known interfaces
    pub frames: u64,
    /// Frames of interfaces that are not in the list
    pub foreign: u64,
    /// Frames that the kernel dropped while this was recorded
    pub dropped: u64,
    /// Lines that are none
    pub malformed: u64,
}

/// Reads a log with one buffer; no allocation per line
pub struct LogReader {
    path: PathBuf,
    kind: Option<&'static str>,
    input: Box<dyn Read + Send>,
    buffer: Vec<u8>,
    start: usize,
    end: usize,
    at_end: bool,
    skipping: bool,
    bytes: u64,
    interfaces: Interfaces,
    counts: LogCounts,
}

impl std::fmt::Debug for LogReader {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LogReader")
            .field("path", &self.path)
            .field("counts", &self.counts)
            .finish_non_exhaustive()
    }
}

impl LogReader {
    /// Opens a log; its compression is told by its first bytes, not by its name
    pub fn open(path: &Path, interfaces: Interfaces) -> Result<Self> {
        let open = |source| Error::Open { path: path.to_owned(), source };
        let file = File::open(path).map_err(open)?;
        if file.metadata().map_err(open)?.is_dir() {
            return Err(open(io::Error::new(io::ErrorKind::IsADirectory, "it is a directory, not a log")));
        }
        Self::from_reader(Box::new(file), path, interfaces)
    }

    /// Reads a log from anything; `path` is how errors name it
    pub fn from_reader(mut input: Box<dyn Read + Send>, path: &Path, interfaces: Interfaces) -> Result<Self> {
        let failed = |source| Error::Read { path: path.to_owned(), line: 0, source };
        let mut magic = [0; 4];
        let mut got = 0;
        while got < magic.len() {
            match input.read(&mut magic[got..]) {
                Ok(0) => break,
                Ok(more) => got += more,
                Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                Err(error) => return Err(failed(error)),
            }
        }
        let whole = io::Cursor::new(magic[..got].to_vec()).chain(input);
        let (kind, input): (_, Box<dyn Read + Send>) = match magic {
            [0x1F, 0x8B, ..] => (Some("gzip"), Box::new(flate2::read::MultiGzDecoder::new(whole))),
            [0x28, 0xB5, 0x2F, 0xFD] => {
                (Some("zstd"), Box::new(zstd::stream::read::Decoder::new(whole).map_err(failed)?))
            }
            _ => (None, Box::new(whole)),
        };
        Ok(Self {
            path: path.to_owned(),
            kind,
            input,
            buffer: vec![0; BUFFER],
            start: 0,
            end: 0,
            at_end: false,
            skipping: false,
            bytes: 0,
            interfaces,
            counts: LogCounts::default(),
        })
    }

    /// The file
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Interface names by index
    pub fn interfaces(&self) -> &Interfaces {
        &self.interfaces
    }

    /// What the log had so far
    pub fn counts(&self) -> LogCounts {
        self.counts
    }

    /// Uncompressed bytes read so far
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// The next event, or `None` at the end; remarks and foreign frames are passed over (and counted)
    #[inline]
    pub fn next_event(&mut self) -> Result<Option<LogEvent>> {
        loop {
            match self.next_line() {
                Some(line) => {
                    if let Some(event) = self.judge(line) {
                        return Ok(Some(event));
                    }
                }
                None if self.at_end => return Ok(None),
                None => self.fill()?,
            }
        }
    }

    /// Adds all events that one more filling of the buffer brings; false once there is nothing more
    pub(super) fn next_events(&mut self, events: &mut Vec<LogEvent>) -> Result<bool> {
        self.fill()?;
        while let Some(line) = self.next_line() {
            events.extend(self.judge(line));
        }
        Ok(!self.at_end)
    }

    /// The next line of the buffer, counted; `None` where more must be read first, or nothing is left.
    #[inline]
    fn next_line(&mut self) -> Option<std::ops::Range<usize>> {
        let window = &self.buffer[self.start..self.end];
        let line = match find_newline(window) {
            Some(len) => self.start..self.start + len,
            None if self.at_end && !window.is_empty() => self.start..self.end,
            None => return None,
        };
        self.start = (line.end + 1).min(self.end);
        self.counts.lines += 1;
        Some(line)
    }

    #[inline]
    fn judge(&mut self, line: std::ops::Range<usize>) -> Option<LogEvent> {
        let parsed = if std::mem::take(&mut self.skipping) {
            Err(LineFault::TooLong)
        } else {
            parse_line(&self.buffer[line])
        };
        match parsed {
            Ok(Line::Frame { stamp_ns, interface, frame }) => {
                match self.interfaces.find_or_learn(interface) {
                    Some(interface) => {
                        self.counts.frames += 1;
                        Some(LogEvent::Frame(Stamped { stamp_ns, interface, frame }))
                    }
                    None => {
                        self.counts.foreign += 1;
                        None
                    }
                }
            }
            Ok(Line::Dropped { interface, count }) => {
                let interface = self.interfaces.find_or_learn(interface)?;
                self.counts.dropped += u64::from(count);
                Some(LogEvent::Dropped { interface, count })
            }
            Ok(Line::Remark) => None,
            Err(fault) => {
                self.counts.malformed += 1;
                Some(LogEvent::Malformed { line: self.counts.lines, fault })
            }
        }
    }

    /// Moves the rest of the last line to the front and reads on
    fn fill(&mut self) -> Result<()> {
        self.buffer.copy_within(self.start..self.end, 0);
        self.end -= self.start;
        self.start = 0;
        if self.end == self.buffer.len() {
            // No line of candump is that long: forget it up to its end.
            self.end = 0;
            self.skipping = true;
        }
        match self.input.read(&mut self.buffer[self.end..]) {
            Ok(0) => self.at_end = true,
            Ok(got) => {
                self.end += got;
                self.bytes += got as u64;
            }
            Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
            Err(source) => return Err(self.failed(source)),
        }
        Ok(())
    }

    fn failed(&self, source: io::Error) -> Error {
        let (path, line) = (self.path.clone(), self.counts.lines);
        match self.kind {
            Some(kind) if source.raw_os_error().is_none() => {
                Error::Truncated { path, kind, bytes: self.bytes, line, why: source.to_string() }
            }
            _ => Error::Read { path, line, source },
        }
    }
}

/// Position of the first line feed, eight bytes at a time
#[inline]
fn find_newline(bytes: &[u8]) -> Option<usize> {
    const ONES: u64 = 0x0101_0101_0101_0101;
    let (chunks, tail) = bytes.as_chunks::<8>();
    for (index, chunk) in chunks.iter().enumerate() {
        let word = u64::from_le_bytes(*chunk) ^ (ONES * b'\n' as u64);
        let zero = word.wrapping_sub(ONES) & !word & (ONES << 7);
        if zero != 0 {
            return Some(8 * index + zero.trailing_zeros() as usize / 8);
        }
    }
    tail.iter().position(|&byte| byte == b'\n').map(|at| bytes.len() - tail.len() + at)
}
