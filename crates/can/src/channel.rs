//! An in-process bus for simulations and tests: bounded, never blocks its senders, counts what it had no room for
//!
//! Who reads may wait for a sender that was stopped in the midst of sending: not for real-time threads, whose frames come from sockets.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, TryRecvError, TrySendError, sync_channel};
use std::time::Duration;

use crate::error::Result;
use crate::frame::Stamped;
use crate::source::{Batch, Event, Poll, Source};

const INTERFACES: usize = 256;

/// Puts frames onto an in-process bus; the bus ends when all its senders are gone
#[derive(Clone, Debug)]
pub struct ChannelSender {
    frames: SyncSender<Stamped>,
    dropped: Arc<[AtomicU32]>,
}

/// Takes frames off an in-process bus
#[derive(Debug)]
pub struct ChannelSource {
    frames: Receiver<Stamped>,
    dropped: Arc<[AtomicU32]>,
}

/// A bus with room for this many frames
pub fn channel(capacity: usize) -> (ChannelSender, ChannelSource) {
    let (sender, receiver) = sync_channel(capacity.max(1));
    let dropped: Arc<[AtomicU32]> = (0..INTERFACES).map(|_| AtomicU32::new(0)).collect();
    (ChannelSender { frames: sender, dropped: dropped.clone() }, ChannelSource { frames: receiver, dropped })
}

impl ChannelSender {
    /// Sends a frame; false if it was dropped (and counted) because the bus is full, or nobody listens
    pub fn send(&self, stamped: Stamped) -> bool {
        match self.frames.try_send(stamped) {
            Ok(()) => true,
            Err(TrySendError::Full(_)) => {
                self.dropped[usize::from(stamped.interface)].fetch_add(1, Ordering::Relaxed);
                false
            }
            Err(TrySendError::Disconnected(_)) => false,
        }
    }
}

impl ChannelSource {
    fn tell_drops(&self, batch: &mut Batch) {
        for (interface, dropped) in self.dropped.iter().enumerate() {
            if batch.room() > 0 && dropped.load(Ordering::Relaxed) > 0 {
                let count = dropped.swap(0, Ordering::Relaxed);
                batch.push(Event::Dropped { interface: interface as u8, count });
            }
        }
    }
}

impl Source for ChannelSource {
    fn poll(&mut self, batch: &mut Batch, timeout: Duration) -> Result<Poll> {
        batch.clear();
        self.tell_drops(batch);
        if batch.is_empty() {
            match self.frames.recv_timeout(timeout) {
                Ok(stamped) => batch.push(Event::received(stamped)),
                Err(RecvTimeoutError::Timeout) => return Ok(Poll::Idle),
                Err(RecvTimeoutError::Disconnected) => return Ok(Poll::End),
            };
        }
        while batch.room() > 0 {
            match self.frames.try_recv() {
                Ok(stamped) => batch.push(Event::received(stamped)),
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => break,
            };
        }
        Ok(Poll::Ready)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::{CanId, Frame};

    fn frame(stamp_ns: i64) -> Stamped {
        Stamped {
            stamp_ns,
            interface: 1,
            frame: Frame::classical(CanId::standard(1).unwrap(), &[1]).unwrap(),
        }
    }

    #[test]
    fn full_bus_drops_and_says_so() {
        let (sender, mut source) = channel(2);
        assert!(sender.send(frame(1)) && sender.send(frame(2)) && !sender.send(frame(3)));
        let mut batch = Batch::new(8);
        assert_eq!(source.poll(&mut batch, Duration::ZERO).unwrap(), Poll::Ready);
        let expected =
            [Event::Dropped { interface: 1, count: 1 }, Event::Frame(frame(1)), Event::Frame(frame(2))];
        assert_eq!(batch.events(), expected);
        assert_eq!(source.poll(&mut batch, Duration::ZERO).unwrap(), Poll::Idle);
        assert!(sender.send(frame(4)));
        drop(sender);
        assert_eq!(source.poll(&mut batch, Duration::ZERO).unwrap(), Poll::Ready);
        assert_eq!(source.poll(&mut batch, Duration::ZERO).unwrap(), Poll::End);
    }
}
