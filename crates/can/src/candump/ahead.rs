//! A log read ahead: a thread of its own turns lines into events while the caller works on those before

use std::sync::mpsc::{Receiver, Sender, SyncSender, channel, sync_channel};

use super::{Interfaces, LogCounts, LogEvent, LogReader};
use crate::error::Result;

/// Stretches that wait for the caller at most: memory is bounded, and neither side waits for a short pause of the other.
const WAITING: usize = 4;

/// A log whose next events are made on another thread; the same events in the same order as the [`LogReader`]'s
#[derive(Debug)]
pub struct ReadAhead {
    full: Receiver<Stretch>,
    empty: Sender<Vec<LogEvent>>,
    now: Stretch,
    next: usize,
    ended: bool,
}

/// Events of one filled buffer, and how far the log was read after them.
#[derive(Debug, Default)]
struct Stretch {
    events: Vec<LogEvent>,
    counts: LogCounts,
    bytes: u64,
    interfaces: Interfaces,
    /// What comes after these events: nothing more, or an error.
    end: Option<Result<()>>,
}

impl ReadAhead {
    /// Goes on from where the reader is
    pub fn new(reader: LogReader) -> Self {
        let (fill, full) = sync_channel(WAITING);
        let (empty, spare) = channel();
        let interfaces = reader.interfaces().clone();
        // It ends with the log, or when nobody takes its stretches any more.
        std::thread::spawn(move || read(reader, &fill, &spare));
        Self { full, empty, now: Stretch { interfaces, ..Stretch::default() }, next: 0, ended: false }
    }

    /// The next event, or `None` at the end
    #[inline]
    pub fn next_event(&mut self) -> Result<Option<LogEvent>> {
        loop {
            if let Some(event) = self.now.events.get(self.next) {
                self.next += 1;
                return Ok(Some(*event));
            }
            if !self.advance()? {
                return Ok(None);
            }
        }
    }

    /// Interface names by index, as far as the log was read
    pub fn interfaces(&self) -> &Interfaces {
        &self.now.interfaces
    }

    /// What the log had up to the end of the present stretch
    pub fn counts(&self) -> LogCounts {
        self.now.counts
    }

    /// Uncompressed bytes up to there
    pub fn bytes(&self) -> u64 {
        self.now.bytes
    }

    /// Whether the events in hand are all taken: the next one may have to be waited for
    pub fn is_drained(&self) -> bool {
        self.next >= self.now.events.len()
    }

    /// Takes the next stretch; false at the log's end.
    fn advance(&mut self) -> Result<bool> {
        if let Some(end) = self.now.end.take() {
            self.ended = true;
            end?;
        }
        let Some(next) = (!self.ended).then(|| self.full.recv().ok()).flatten() else {
            self.ended = true;
            return Ok(false);
        };
        let mut done = std::mem::replace(&mut self.now, next).events;
        done.clear();
        // Nobody needs it any more once the log is read.
        let _ = self.empty.send(done);
        self.next = 0;
        Ok(true)
    }
}

fn read(mut reader: LogReader, fill: &SyncSender<Stretch>, spare: &Receiver<Vec<LogEvent>>) {
    loop {
        let mut events = spare.try_recv().unwrap_or_default();
        let end = match reader.next_events(&mut events) {
            Ok(true) => None,
            Ok(false) => Some(Ok(())),
            Err(error) => Some(Err(error)),
        };
        let ended = end.is_some();
        let (counts, bytes, interfaces) = (reader.counts(), reader.bytes(), reader.interfaces().clone());
        if fill.send(Stretch { events, counts, bytes, interfaces, end }).is_err() || ended {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn reader(text: &[u8]) -> LogReader {
        let input = Box::new(std::io::Cursor::new(text.to_vec()));
        LogReader::from_reader(input, Path::new("some.log"), Interfaces::learned()).unwrap()
    }

    #[test]
    fn the_same_events_in_the_same_order() {
        let mut text = String::new();
        for k in 0..40_000 {
            text += &format!("({k}.000001) can{} {:03X}#{k:08X}\n", k / 9_000, k % 0x7FF);
            if k % 7_001 == 0 {
                text += "no line at all\n";
            }
        }
        let (mut plain, mut ahead) = (reader(text.as_bytes()), ReadAhead::new(reader(text.as_bytes())));
        while let Some(event) = plain.next_event().unwrap() {
            assert_eq!(ahead.next_event().unwrap(), Some(event));
        }
        assert_eq!(ahead.next_event().unwrap(), None);
        assert_eq!(ahead.next_event().unwrap(), None, "the end stays the end");
        assert_eq!((ahead.counts(), ahead.bytes()), (plain.counts(), plain.bytes()));
        assert_eq!(ahead.interfaces().names(), ["can0", "can1", "can2", "can3", "can4"]);
    }

    #[test]
    fn an_error_comes_behind_the_events_before_it() {
        let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        for k in 0..20_000 {
            std::io::Write::write_all(&mut gzip, format!("({k}.5) can0 123#{k:08X}\n").as_bytes()).unwrap();
        }
        let mut whole = gzip.finish().unwrap();
        whole.truncate(whole.len() / 2);
        let mut ahead = ReadAhead::new(reader(&whole));
        let mut events = 0;
        let error = loop {
            match ahead.next_event() {
                Ok(Some(_)) => events += 1,
                Ok(None) => panic!("it is cut off"),
                Err(error) => break error,
            }
        };
        assert!(events > 100 && error.to_string().contains("cut off"), "{events} {error}");
        assert_eq!(ahead.next_event().unwrap(), None);
    }

    #[test]
    fn left_alone_it_ends() {
        drop(ReadAhead::new(reader(&b"(1.5) can0 123#\n".repeat(300_000))));
    }
}
