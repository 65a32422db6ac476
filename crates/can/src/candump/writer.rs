//! Writing a candump log, whole or not at all; compression by the name's ending

use std::io::{BufWriter, Write};
use std::path::Path;

use super::{MAX_LINE, StampDigits, format_line};
use crate::atomic::AtomicFile;
use crate::error::{Error, Result};
use crate::frame::Stamped;

enum Output {
    Plain(BufWriter<AtomicFile>),
    Gzip(flate2::write::GzEncoder<BufWriter<AtomicFile>>),
    Zstd(zstd::stream::write::Encoder<'static, BufWriter<AtomicFile>>),
}

/// A log that appears under its name at [`LogWriter::finish`]; dropped before that, nothing is left of it
pub struct LogWriter {
    output: Output,
    path: std::path::PathBuf,
    interfaces: Vec<String>,
    digits: StampDigits,
    frames: u64,
    total_drops: Vec<u64>,
}

impl std::fmt::Debug for LogWriter {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LogWriter")
            .field("path", &self.path)
            .field("frames", &self.frames)
            .finish_non_exhaustive()
    }
}

impl LogWriter {
    /// Begins a log; `.gz` and `.zst` compress; `interfaces` are names by index
    pub fn create<S: AsRef<str>>(path: &Path, interfaces: &[S], digits: StampDigits) -> Result<Self> {
        let file = BufWriter::with_capacity(64 * 1024, AtomicFile::create(path)?);
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        let output = if ending.eq_ignore_ascii_case("gz") {
            Output::Gzip(flate2::write::GzEncoder::new(file, flate2::Compression::new(6)))
        } else if ending.eq_ignore_ascii_case("zst") {
            let encoder = zstd::stream::write::Encoder::new(file, 3);
            Output::Zstd(encoder.map_err(|source| Error::Write { path: path.to_owned(), source })?)
        } else {
            Output::Plain(file)
        };
        Ok(Self {
            output,
            path: path.to_owned(),
            interfaces: interfaces.iter().map(|name| name.as_ref().to_string()).collect(),
            digits,
            frames: 0,
            total_drops: vec![0; interfaces.len()],
        })
    }

    fn bytes(&mut self, bytes: &[u8]) -> Result<()> {
        let written = match &mut self.output {
            Output::Plain(file) => file.write_all(bytes),
            Output::Gzip(file) => file.write_all(bytes),
            Output::Zstd(file) => file.write_all(bytes),
        };
        written.map_err(|source| Error::Write { path: self.path.clone(), source })
    }

    /// Adds a frame; one whose interface has no name is refused
    pub fn frame(&mut self, stamped: &Stamped) -> Result<()> {
        let Some(name) = self.interfaces.get(usize::from(stamped.interface)) else {
            let why = format!(
                "frame of interface number {}, but only {} are named",
                stamped.interface,
                self.interfaces.len()
            );
            return Err(Error::Write { path: self.path.clone(), source: std::io::Error::other(why) });
        };
        let mut line = [0; MAX_LINE];
        let len = format_line(&mut line, stamped, name, self.digits);
        self.frames += 1;
        self.bytes(&line[..len])
    }

    /// Notes that frames were dropped, in candump's words
    pub fn dropped(&mut self, interface: u8, count: u32) -> Result<()> {
        let index = usize::from(interface);
        let (Some(name), Some(total)) = (self.interfaces.get(index), self.total_drops.get_mut(index)) else {
            return Ok(());
        };
        *total += u64::from(count);
        let plural = if count == 1 { "" } else { "s" };
        let line = format!(
            "DROPCOUNT: dropped {count} CAN frame{plural} on '{name}' socket (total drops {total})\n"
        );
        self.bytes(line.as_bytes())
    }

    /// Adds a remark, one `#` line for each of its lines
    pub fn remark(&mut self, text: &str) -> Result<()> {
        for line in text.lines() {
            self.bytes(format!("# {line}\n").as_bytes())?;
        }
        Ok(())
    }

    /// Frames written so far
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Makes the log appear under its name, on disk
    pub fn finish(self) -> Result<()> {
        let failed = |source| Error::Write { path: self.path.clone(), source };
        let buffered = match self.output {
            Output::Plain(file) => file,
            Output::Gzip(file) => file.finish().map_err(failed)?,
            Output::Zstd(file) => file.finish().map_err(failed)?,
        };
        buffered.into_inner().map_err(|error| failed(error.into_error()))?.commit()
    }
}
