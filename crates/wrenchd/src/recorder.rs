//! A copy of every received frame into a candump log, written by a thread that the cycle never waits for.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use can::candump::{LogWriter, StampDigits};
use can::source::Event;
use can::tap::TapReader;

/// Events between the cycle and the recorder: two seconds of a full bus.
pub const QUEUE_EVENTS: usize = 16_384;

/// How often the recorder looks for frames.
const PERIOD: Duration = Duration::from_millis(5);

/// What was recorded.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct Recorded {
    /// Frames in the log.
    pub frames: u64,
    /// Events that the queue had no room for: they are missing in the log.
    pub lost: u64,
}

/// A recording that runs.
#[derive(Debug)]
pub struct Recorder {
    thread: JoinHandle<can::Result<Recorded>>,
    stop: Arc<AtomicBool>,
    path: PathBuf,
}

impl Recorder {
    /// Begins a log of what comes out of `copies`; stamps have nine digits, so that they survive exactly. `remark` stands
    /// at its head. The log appears when [`Recorder::finish`] is called: under its name, or where a recording has that already, under
    /// the name with the next number.
    pub fn start(path: &Path, interfaces: &[String], copies: TapReader, remark: &str) -> can::Result<Self> {
        let path = &unused(path);
        let mut writer = LogWriter::create(path, interfaces, StampDigits::Nanos)?;
        writer.remark(remark)?;
        let stop = Arc::new(AtomicBool::new(false));
        let stopped = stop.clone();
        let thread = std::thread::Builder::new()
            .name("recorder".into())
            .spawn(move || record(writer, copies, &stopped))
            .map_err(|source| can::Error::Write { path: path.to_owned(), source })?;
        Ok(Self { thread, stop, path: path.to_owned() })
    }

    /// Whether it has given up, which it does on the first error.
    pub fn has_failed(&self) -> bool {
        self.thread.is_finished()
    }

    /// The log.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Writes what is still waiting and closes the log. Called after the cycle has ended.
    pub fn finish(self) -> can::Result<Recorded> {
        self.stop.store(true, Ordering::Release);
        self.thread.join().unwrap_or_else(|_| {
            let source = std::io::Error::other("the recorder ended unexpectedly");
            Err(can::Error::Write { path: self.path, source })
        })
    }
}

/// The name, or with the first number that no file has: `can.1.log.gz` for `can.log.gz`. A restarted daemon has the same command line,
/// and what was recorded before is the very thing somebody wants to look at. Devices and pipes are written as they are.
fn unused(path: &Path) -> PathBuf {
    let mut numbered = path.to_owned();
    let mut number = 0_u32;
    while numbered.is_file() {
        number += 1;
        numbered = with_number(path, number);
    }
    numbered
}

/// With a number before the ending, and before the ending in front of one that says how it is compressed.
fn with_number(path: &Path, number: u32) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let dot = |name: &str| name.rfind('.').filter(|at| *at > 0).unwrap_or(name.len());
    let mut at = dot(&name);
    if matches!(name[at..].to_ascii_lowercase().as_str(), ".gz" | ".zst") {
        at = dot(&name[..at]);
    }
    path.with_file_name(format!("{}.{number}{}", &name[..at], &name[at..]))
}

fn record(mut writer: LogWriter, mut copies: TapReader, stop: &AtomicBool) -> can::Result<Recorded> {
    let mut lost_in_all = 0;
    loop {
        // Asked before the queue is emptied: what came before the stop is written.
        let last = stop.load(Ordering::Acquire);
        while let Some(event) = copies.next_copy() {
            write(&mut writer, &event)?;
        }
        let lost = copies.take_lost();
        if lost > 0 {
            lost_in_all += lost;
            writer.remark(&format!("{lost} events lost here: the recorder was too slow"))?;
        }
        if last {
            let frames = writer.frames();
            writer.finish()?;
            return Ok(Recorded { frames, lost: lost_in_all });
        }
        std::thread::sleep(PERIOD);
    }
}

fn write(writer: &mut LogWriter, event: &Event) -> can::Result<()> {
    match event {
        Event::Frame(stamped) | Event::BusError { stamped, .. } => writer.frame(stamped),
        Event::Dropped { interface, count } => writer.dropped(*interface, *count),
        Event::Down { interface } => writer.remark(&format!("interface number {interface} went down")),
        Event::Up { interface } => writer.remark(&format!("interface number {interface} is back")),
        Event::Malformed { .. } => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use can::channel::channel;
    use can::frame::{CanId, Frame, Stamped};
    use can::source::{Batch, Poll, Source};
    use can::tap::tap;

    #[test]
    fn stamps_survive_to_the_last_digit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("can.log");
        let (sender, source) = channel(64);
        let (mut tapped, copies) = tap(source, 64);
        let recorder = Recorder::start(&path, &["can0".into()], copies, "test").unwrap();
        let frame = Frame::classical(CanId::standard(0x123).unwrap(), &[1, 2]).unwrap();
        for stamp_ns in [1_700_000_000_123_456_789, 1_700_000_000_123_456_790] {
            assert!(sender.send(Stamped { stamp_ns, interface: 0, frame }));
        }
        assert_eq!(tapped.poll(&mut Batch::new(8), Duration::ZERO).unwrap(), Poll::Ready);
        assert!(!path.exists(), "the log appears when it is whole");
        assert_eq!(recorder.finish().unwrap(), Recorded { frames: 2, lost: 0 });
        let text = std::fs::read_to_string(&path).unwrap();
        let expected = "# test\n(1700000000.123456789) can0 123#0102\n(1700000000.123456790) can0 123#0102\n";
        assert_eq!(text, expected);
    }

    /// As after a restart with the same command line.
    #[test]
    fn what_was_recorded_before_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("can.log");
        let record = || {
            let (_sender, source) = channel(1);
            let recorder = Recorder::start(&path, &["can0".into()], tap(source, 1).1, "test").unwrap();
            let at = recorder.path().to_owned();
            recorder.finish().unwrap();
            at.strip_prefix(folder.path()).unwrap().to_str().unwrap().to_owned()
        };
        assert_eq!([record(), record(), record()], ["can.log", "can.1.log", "can.2.log"]);
        for (name, numbered) in
            [("can", "can.3"), ("a.log.gz", "a.3.log.gz"), ("a.b.ZST", "a.3.b.ZST"), (".gz", ".gz.3")]
        {
            assert_eq!(with_number(Path::new(name), 3), Path::new(numbered));
        }
    }

    #[test]
    fn a_full_disk_ends_the_recording_with_a_reason() {
        let (sender, source) = channel(4096);
        let (mut tapped, copies) = tap(source, 4096);
        let recorder = Recorder::start(Path::new("/dev/full"), &["can0".into()], copies, "test").unwrap();
        let frame = Frame::classical(CanId::standard(1).unwrap(), &[0; 8]).unwrap();
        for stamp_ns in 0..4096 {
            sender.send(Stamped { stamp_ns, interface: 0, frame });
        }
        tapped.poll(&mut Batch::new(4096), Duration::ZERO).unwrap();
        assert!(recorder.finish().unwrap_err().to_string().contains("/dev/full"));
    }
}
