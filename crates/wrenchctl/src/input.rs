//! What `IFACE|LOG` means: a log (plain, gzip, zstd, `-` for standard input), a run directory, or live interfaces.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Duration;

use can::candump::{Interfaces, LogReader};
use can::replay::{Clock, Pace, Replay};
use can::source::{Batch, Poll, Source};
use indicatif::{ProgressBar, ProgressStyle};
use rig::Run;

use crate::{Error, live};

/// How long a live poll waits, so that Ctrl-C and time limits are noticed.
const PATIENCE: Duration = Duration::from_millis(100);

/// Where frames come from.
pub struct Input {
    kind: Kind,
}

enum Kind {
    Live { source: Box<dyn Source>, names: Vec<String> },
    Log { replay: Replay<NoClock>, bar: ProgressBar },
}

/// A log read as fast as possible asks for no time.
#[derive(Debug)]
struct NoClock;

impl Clock for NoClock {
    fn now_ns(&mut self) -> i64 {
        0
    }
    fn sleep_until_ns(&mut self, _until_ns: i64) {}
}

impl Input {
    /// Opens a log file, the log of a run directory, or one or more interfaces (`can0` or `can0,can1`).
    pub fn open(name: &str) -> Result<Self, Error> {
        if let Some(log) = log_of(name)? {
            let (reader, bar) = open_log(&log, Interfaces::learned())?;
            return Ok(Self { kind: Kind::Log { replay: Replay::new(reader, Pace::Max, NoClock), bar } });
        }
        let names: Vec<String> = name.split(',').map(str::to_owned).collect();
        match live::open(&names) {
            Ok(source) => Ok(Self { kind: Kind::Live { source, names } }),
            Err(Error::Can(can::Error::NoInterface { interface })) => Err(Error::usage(format!(
                "\"{interface}\" is neither a log file nor a CAN interface of this machine; give the path of a candump log, or an interface that `ip link show type can` (or `type vcan`) lists"
            ))),
            Err(error) => Err(error),
        }
    }

    /// Whether it goes on until it is stopped.
    pub fn is_live(&self) -> bool {
        matches!(self.kind, Kind::Live { .. })
    }

    /// Name of an interface by its index.
    pub fn interface(&self, index: u8) -> &str {
        match &self.kind {
            Kind::Live { names, .. } => names.get(usize::from(index)).map_or("?", String::as_str),
            Kind::Log { replay, .. } => replay.reader().interfaces().name(index),
        }
    }

    /// The next events; a live input comes back at least every 0.1 s.
    pub fn poll(&mut self, batch: &mut Batch) -> Result<Poll, Error> {
        Ok(match &mut self.kind {
            Kind::Live { source, .. } => source.poll(batch, PATIENCE)?,
            Kind::Log { replay, bar } => {
                let poll = replay.poll(batch, Duration::ZERO);
                if !matches!(poll, Ok(Poll::Ready)) {
                    bar.finish_and_clear();
                }
                poll?
            }
        })
    }
}

/// The log that is meant, or none where the name is an interface's.
pub fn log_of(name: &str) -> Result<Option<PathBuf>, Error> {
    let path = Path::new(name);
    if path.is_dir() {
        return Ok(Some(Run::load(path)?.log));
    }
    // Interfaces have no slash, and none is called .log, .gz or .zst.
    let like_file = name.contains('/') || path.extension().is_some() || name == "-" || path.exists();
    Ok(like_file.then(|| path.to_owned()))
}

/// Opens a log with a bar on standard error that shows how far it is read, where a person watches.
pub fn open_log(path: &Path, interfaces: Interfaces) -> Result<(LogReader, ProgressBar), Error> {
    if path == Path::new("-") {
        let input = Box::new(std::io::stdin());
        return Ok((LogReader::from_reader(input, path, interfaces)?, ProgressBar::hidden()));
    }
    let size = std::fs::metadata(path).ok().filter(std::fs::Metadata::is_file).map(|file| file.len());
    let (Some(size), Ok(file)) = (size, File::open(path)) else {
        // It says why.
        return Ok((LogReader::open(path, interfaces)?, ProgressBar::hidden()));
    };
    let bar = bytes_bar(size);
    let reader = LogReader::from_reader(Box::new(bar.wrap_read(file)), path, interfaces)?;
    Ok((reader, bar))
}

fn bytes_bar(size: u64) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:40} {bytes} of {total_bytes}, {eta} left")
        .unwrap_or_else(|_| ProgressStyle::default_bar());
    ProgressBar::new(size).with_style(style)
}
