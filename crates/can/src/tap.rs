//! Middleware that copies all that passes into a bounded queue for another thread, never holding up the stream
//!
//! The queue is wait-free at both ends: a reader that was stopped in the midst of a copy, for a thread of a higher priority, keeps nobody waiting.

use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use rtrb::{Consumer, Producer, RingBuffer};

use crate::error::Result;
use crate::source::{Batch, Event, Poll, Source};

/// A source whose events are also copied to a [`TapReader`]
#[derive(Debug)]
pub struct Tap<S> {
    inner: S,
    copies: Producer<Event>,
    lost: Arc<AtomicU64>,
}

/// The other end of a [`Tap`]; it asks, it never waits, so that the tapped thread never has to wake it
#[derive(Debug)]
pub struct TapReader {
    copies: Consumer<Event>,
    lost: Arc<AtomicU64>,
}

/// Taps a source with a queue for this many events
pub fn tap<S: Source>(inner: S, capacity: usize) -> (Tap<S>, TapReader) {
    let (sender, receiver) = RingBuffer::new(capacity.max(1));
    let lost = Arc::new(AtomicU64::new(0));
    (Tap { inner, copies: sender, lost: lost.clone() }, TapReader { copies: receiver, lost })
}

impl<S> Tap<S> {
    /// The source behind it
    pub fn inner(&self) -> &S {
        &self.inner
    }
}

impl<S: Source> Source for Tap<S> {
    fn poll(&mut self, batch: &mut Batch, timeout: Duration) -> Result<Poll> {
        let poll = self.inner.poll(batch, timeout)?;
        for event in batch.events() {
            if self.copies.push(*event).is_err() {
                self.lost.fetch_add(1, Ordering::Relaxed);
            }
        }
        Ok(poll)
    }
}

impl TapReader {
    /// The next copy, if there is one
    pub fn next_copy(&mut self) -> Option<Event> {
        self.copies.pop().ok()
    }

    /// Events that the queue had no room for since the last call
    pub fn take_lost(&mut self) -> u64 {
        self.lost.swap(0, Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::channel;
    use crate::frame::{CanId, Frame, Stamped};

    #[test]
    fn copies_all_that_fits_and_counts_the_rest() {
        let (sender, source) = channel(8);
        let (mut tapped, mut reader) = tap(source, 2);
        let id = CanId::standard(7).unwrap();
        for stamp_ns in 0..3 {
            sender.send(Stamped { stamp_ns, interface: 0, frame: Frame::classical(id, &[]).unwrap() });
        }
        let mut batch = Batch::new(8);
        assert_eq!(tapped.poll(&mut batch, Duration::ZERO).unwrap(), Poll::Ready);
        assert_eq!(batch.events().len(), 3, "the stream itself loses nothing");
        let copies: Vec<_> = std::iter::from_fn(|| reader.next_copy()).collect();
        assert_eq!(copies, batch.events()[..2]);
        assert_eq!((reader.take_lost(), reader.take_lost()), (1, 0));
    }
}
