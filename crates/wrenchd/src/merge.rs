//! Middleware that brings frames of several interfaces into the order of their kernel stamps.
//!
//! A socket is read in batches, one interface after the other. Frames that wait together are sorted here; the order
//! within one interface is the order of reception and stays, also where the clock of the stamps stepped back.

use std::time::Duration;

use can::Result;
use can::source::{Batch, Event, Poll, Source};

/// A batch from one interface that is at least this long may have more behind it.
const FULL: usize = 64;

/// A source whose waiting events are drained and merged by stamp. All memory is taken at construction.
#[derive(Debug)]
pub struct Merge<S> {
    inner: S,
    part: Batch,
    pool: Vec<Event>,
    capacity: usize,
    order: Vec<(i64, u32)>,
}

impl<S> Merge<S> {
    /// Merges at most `capacity` events at a time from that many interfaces.
    pub fn new(inner: S, interfaces: usize, capacity: usize) -> Self {
        // A socket source keeps room for a drop count beside every frame.
        let part = (2 * FULL + 2) * interfaces.max(1);
        let capacity = capacity.max(part);
        Self {
            inner,
            part: Batch::new(part),
            pool: Vec::with_capacity(capacity),
            capacity,
            order: Vec::with_capacity(capacity),
        }
    }

    /// The source behind it.
    pub fn inner(&self) -> &S {
        &self.inner
    }

    /// Most events at a time: the size of a batch to poll with.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    fn sort(&mut self) {
        self.order.clear();
        // Latest stamp met on each interface: an event never goes before one received earlier on its own interface.
        let mut latest = [i64::MIN; 256];
        let mut latest_of_all = i64::MIN;
        for (place, event) in self.pool.iter().enumerate() {
            let key = match event {
                Event::Frame(stamped) | Event::BusError { stamped, .. } => {
                    let latest = &mut latest[usize::from(stamped.interface)];
                    *latest = stamped.stamp_ns.max(*latest);
                    *latest
                }
                Event::Dropped { interface, .. } | Event::Down { interface } | Event::Up { interface } => {
                    latest[usize::from(*interface)]
                }
                Event::Malformed { .. } => latest_of_all,
            };
            latest_of_all = latest_of_all.max(key);
            self.order.push((key, place as u32));
        }
        // Unstable sorting takes no memory; the place keeps equal stamps in order.
        self.order.sort_unstable();
    }
}

impl<S: Source> Source for Merge<S> {
    fn poll(&mut self, batch: &mut Batch, timeout: Duration) -> Result<Poll> {
        batch.clear();
        self.pool.clear();
        let room = self.capacity.min(batch.room());
        let mut wait = timeout;
        loop {
            match self.inner.poll(&mut self.part, wait)? {
                Poll::Ready => self.pool.extend_from_slice(self.part.events()),
                Poll::End if self.pool.is_empty() => return Ok(Poll::End),
                Poll::Idle | Poll::End => break,
            }
            let got = self.part.events().len();
            let left = room.saturating_sub(self.pool.len());
            if got < FULL || left < got + self.part.room() {
                break;
            }
            wait = Duration::ZERO;
        }
        self.sort();
        for (_, place) in &self.order {
            batch.push(self.pool[*place as usize]);
        }
        Ok(if batch.is_empty() { Poll::Idle } else { Poll::Ready })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use can::frame::{CanId, Frame, Stamped};

    /// Hands out prepared batches.
    struct Script(Vec<Vec<Event>>);

    impl Source for Script {
        fn poll(&mut self, batch: &mut Batch, _: Duration) -> Result<Poll> {
            batch.clear();
            if self.0.is_empty() {
                return Ok(Poll::End);
            }
            let events = self.0.remove(0);
            assert!(events.into_iter().all(|event| batch.push(event)));
            Ok(if batch.is_empty() { Poll::Idle } else { Poll::Ready })
        }
    }

    fn frame(interface: u8, stamp_ns: i64) -> Event {
        let frame = Frame::classical(CanId::standard(1).unwrap(), &[interface]).unwrap();
        Event::received(Stamped { stamp_ns, interface, frame })
    }

    fn poll(merge: &mut Merge<Script>) -> Vec<Event> {
        let mut batch = Batch::new(merge.capacity());
        merge.poll(&mut batch, Duration::ZERO).unwrap();
        batch.events().to_vec()
    }

    #[test]
    fn stamps_order_interfaces_and_reception_orders_each() {
        let dropped = Event::Dropped { interface: 1, count: 3 };
        let script = vec![
            vec![frame(0, 10), frame(0, 30), frame(0, 20), frame(1, 15), dropped, frame(1, 25), frame(1, 30)],
            vec![frame(0, 40)],
        ];
        let mut merge = Merge::new(Script(script), 2, 0);
        let expected =
            [frame(0, 10), frame(1, 15), dropped, frame(1, 25), frame(0, 30), frame(0, 20), frame(1, 30)];
        assert_eq!(poll(&mut merge), expected);
        assert_eq!(poll(&mut merge), [frame(0, 40)]);
        assert_eq!(merge.poll(&mut Batch::new(8), Duration::ZERO).unwrap(), Poll::End);
    }

    #[test]
    fn full_batches_are_drained_before_they_are_merged() {
        let burst = |from: i64| (from..from + 64).map(|stamp| frame(0, stamp));
        let script =
            vec![burst(0).chain([frame(1, 100)]).collect(), burst(64).collect(), vec![], vec![frame(0, 200)]];
        let mut merge = Merge::new(Script(script), 2, 1024);
        let stamps: Vec<i64> = poll(&mut merge).iter().filter_map(|e| Some(e.stamped()?.stamp_ns)).collect();
        assert_eq!(stamps.len(), 129);
        assert!(stamps.is_sorted() && stamps[100..103] == [100, 100, 101], "{stamps:?}");
    }

    #[test]
    fn a_flood_is_bounded() {
        let burst = |from: i64| (from..from + 64).map(|stamp| frame(0, stamp)).collect();
        let mut merge = Merge::new(Script((0..100).map(|n| burst(64 * n)).collect()), 1, 300);
        let mut seen = 0;
        while seen < 6400 {
            let got = poll(&mut merge);
            assert!(!got.is_empty() && got.len() <= 300);
            assert!(got.iter().enumerate().all(|(k, e)| e.stamped().unwrap().stamp_ns == (seen + k) as i64));
            seen += got.len();
        }
    }
}
