//! What `IFACE|LOG` means: a log (plain, gzip, zstd, `-` for standard input), a run directory, or live interfaces.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use can::candump::{Interfaces, LogReader, ReadAhead};
use can::source::{Batch, Poll, Source};
use indicatif::{ProgressBar, ProgressStyle};
use rig::Run;

use crate::{Error, live};

/// How long a live poll waits, so that Ctrl-C and time limits are noticed.
const PATIENCE: Duration = Duration::from_millis(100);
/// Most events at a time.
const BATCH: usize = 256;

/// Where frames come from.
pub struct Input {
    kind: Kind,
}

enum Kind {
    Live {
        source: Box<dyn Source>,
        names: Vec<String>,
    },
    /// As fast as it can be read, on a thread of its own.
    Log {
        log: ReadAhead,
        bar: ProgressBar,
    },
}

impl Input {
    /// Opens a log file, the log of a run directory, or one or more interfaces (`can0` or `can0,can1`).
    pub fn open(name: &str) -> Result<Self, Error> {
        if let Some(log) = log_of(name)? {
            let (reader, bar) = open_log(&log, Interfaces::learned())?;
            return Ok(Self { kind: Kind::Log { log: ReadAhead::new(reader), bar } });
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
            Kind::Log { log, .. } => log.interfaces().name(index),
        }
    }

    /// Hands on batches of events until the end, until `each` says no, after `limit` of a live input, or at Ctrl-C.
    pub fn follow(
        &mut self,
        limit: Option<Duration>,
        mut each: impl FnMut(&Self, &Batch) -> Result<bool, Error>,
    ) -> Result<(), Error> {
        let interrupted = live::interrupted();
        let started = Instant::now();
        let mut batch = Batch::new(BATCH);
        while !interrupted.load(Ordering::Relaxed) {
            let over = self.is_live() && limit.is_some_and(|limit| started.elapsed() >= limit);
            if over || self.poll(&mut batch)? == Poll::End || !each(self, &batch)? {
                break;
            }
        }
        Ok(())
    }

    /// The next events; a live input comes back at least every 0.1 s.
    fn poll(&mut self, batch: &mut Batch) -> Result<Poll, Error> {
        Ok(match &mut self.kind {
            Kind::Live { source, .. } => source.poll(batch, PATIENCE)?,
            Kind::Log { log, bar } => {
                let poll = take(log, batch);
                if !matches!(poll, Ok(Poll::Ready)) {
                    bar.finish_and_clear();
                }
                poll?
            }
        })
    }
}

/// The log's next events, as many as there is room for and no waiting is needed for.
fn take(log: &mut ReadAhead, batch: &mut Batch) -> can::Result<Poll> {
    batch.clear();
    while batch.is_empty() || (batch.room() > 0 && !log.is_drained()) {
        match log.next_event()? {
            Some(event) => batch.push(event.into()),
            None => return Ok(Poll::End),
        };
    }
    Ok(Poll::Ready)
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
