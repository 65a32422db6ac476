//! Published records from the cycle to any number of readers: a ring that its writer never waits for.
//!
//! One writer, wait-free; each reader goes at its own pace and is told how many records it missed.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use crate::published::Published;
use crate::seqlock::Words;

type Slot = Words<{ Published::WORDS }>;

#[derive(Debug)]
struct Ring {
    slots: Box<[Slot]>,
    /// Records written.
    written: AtomicU64,
}

/// The writing end.
#[derive(Debug)]
pub struct FeedWriter {
    ring: Arc<Ring>,
    written: u64,
}

/// Hands out readers.
#[derive(Clone, Debug)]
pub struct Feed {
    ring: Arc<Ring>,
}

/// A reading end with a place of its own.
#[derive(Clone, Debug)]
pub struct FeedReader {
    ring: Arc<Ring>,
    next: u64,
    missed: u64,
}

/// A ring of so many records, at least 2.
pub fn feed(capacity: usize) -> (FeedWriter, Feed) {
    let slots = (0..capacity.max(2)).map(|_| Slot::default()).collect();
    let ring = Arc::new(Ring { slots, written: AtomicU64::new(0) });
    (FeedWriter { ring: ring.clone(), written: 0 }, Feed { ring })
}

impl FeedWriter {
    /// Adds a record in place of the oldest. Bounded work, no allocation, no lock, no system call.
    pub fn write(&mut self, record: &Published) {
        let slot = &self.ring.slots[(self.written % self.ring.slots.len() as u64) as usize];
        self.written += 1;
        slot.write(self.written, record.to_words());
        self.ring.written.store(self.written, Ordering::Release);
    }
}

impl Feed {
    /// The newest record, whoever has read it before; none before the first.
    pub fn newest(&self) -> Option<Published> {
        loop {
            let number = self.ring.written.load(Ordering::Acquire).checked_sub(1)?;
            // Overwritten while it was read: there is a newer one.
            if let Some(record) = self.ring.read(number) {
                return Some(record);
            }
        }
    }

    /// A reader of what is published from now on.
    pub fn reader(&self) -> FeedReader {
        FeedReader { next: self.ring.written.load(Ordering::Acquire), ring: self.ring.clone(), missed: 0 }
    }
}

impl FeedReader {
    /// The next record in order, if there is one; what was overwritten before it was read is counted.
    pub fn next_record(&mut self) -> Option<Published> {
        loop {
            let written = self.ring.written.load(Ordering::Acquire);
            if self.next >= written {
                return None;
            }
            let oldest = written.saturating_sub(self.ring.slots.len() as u64);
            if self.next < oldest {
                self.missed += oldest - self.next;
                self.next = oldest;
            }
            let record = self.read(self.next);
            self.next += 1;
            match record {
                Some(record) => return Some(record),
                // Overwritten while it was read: the writer is a whole ring ahead.
                None => self.missed += 1,
            }
        }
    }

    /// The newest record, skipping those before it (not counted as missed).
    pub fn newest(&mut self) -> Option<Published> {
        let written = self.ring.written.load(Ordering::Acquire);
        self.next = self.next.max(written.saturating_sub(1));
        self.next_record()
    }

    /// Records that were overwritten before this reader came to them.
    pub fn missed(&self) -> u64 {
        self.missed
    }

    fn read(&self, number: u64) -> Option<Published> {
        self.ring.read(number)
    }
}

impl Ring {
    fn read(&self, number: u64) -> Option<Published> {
        let slot = &self.slots[(number % self.slots.len() as u64) as usize];
        slot.read()
            .filter(|(version, _)| *version == number + 1)
            .map(|(_, words)| Published::from_words(&words))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::published::Why;
    use rig::Status;

    fn record(sequence: u64) -> Published {
        Published {
            sequence,
            instant_ns: sequence as i64,
            last_stamp_ns: sequence as i64,
            published_ns: sequence as i64,
            age_ns: sequence as i64,
            round: sequence,
            status: Status::INVALID,
            outcome: Err(Why::Stale),
        }
    }

    #[test]
    fn each_reader_sees_all_in_order_and_knows_what_it_missed() {
        let (mut writer, feed) = feed(4);
        let (mut fast, mut slow) = (feed.reader(), feed.reader());
        for sequence in 0..10 {
            writer.write(&record(sequence));
            assert_eq!(fast.next_record(), Some(record(sequence)));
            assert_eq!(fast.next_record(), None);
        }
        let seen: Vec<u64> = std::iter::from_fn(|| slow.next_record()).map(|r| r.sequence).collect();
        assert_eq!((seen, slow.missed(), fast.missed()), (vec![6, 7, 8, 9], 6, 0));
        assert_eq!(feed.reader().next_record(), None, "a new reader starts with what comes");
        writer.write(&record(10));
        writer.write(&record(11));
        assert_eq!((slow.newest().unwrap().sequence, slow.missed()), (11, 6));
        assert_eq!(slow.newest(), None);
        assert_eq!([feed.newest(), feed.newest()], [Some(record(11)); 2]);
    }

    #[test]
    fn no_torn_record_is_ever_seen() {
        const RECORDS: u64 = 200_000;
        let (mut writer, feed) = feed(3);
        let mut reader = feed.reader();
        let writing = std::thread::spawn(move || (0..RECORDS).for_each(|n| writer.write(&record(n))));
        let (mut seen, mut last) = (0, None);
        loop {
            let ended = writing.is_finished();
            while let Some(got) = reader.next_record() {
                assert_eq!(got, record(got.sequence), "torn");
                assert!(last.is_none_or(|last| last < got.sequence), "out of order");
                last = Some(got.sequence);
                seen += 1;
            }
            if ended {
                break;
            }
        }
        writing.join().unwrap();
        assert_eq!((last, seen + reader.missed()), (Some(RECORDS - 1), RECORDS));
    }
}
