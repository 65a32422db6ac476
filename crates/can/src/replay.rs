//! A recorded log as a source, with its own timing or as fast as it can be read

use std::time::Duration;

use crate::candump::{LogCounts, LogEvent, LogReader};
use crate::error::{Error, Result};
use crate::source::{Batch, Event, Poll, Source};

/// Time for a replay; programs give the system's, tests their own
pub trait Clock {
    /// Monotonic time in ns from any origin
    fn now_ns(&mut self) -> i64;
    /// Waits until that time at the latest, or shorter
    fn sleep_until_ns(&mut self, until_ns: i64);
}

/// How fast a log is replayed
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Pace {
    /// As fast as the consumer takes it
    Max,
    /// Recorded seconds per second; 1 = as recorded
    Speed(f64),
}

/// A log as a source; frames keep their recorded stamps
#[derive(Debug)]
pub struct Replay<C> {
    reader: LogReader,
    clock: C,
    pace: Pace,
    next: Option<Event>,
    /// Clock and stamp of the first frame
    origin_ns: Option<(i64, i64)>,
    /// When the last frame was due: a log whose stamps step back goes on without a pause
    due_ns: i64,
    ended: bool,
    /// Met behind frames that were still to be handed on
    failed: Option<Error>,
}

impl<C: Clock> Replay<C> {
    /// Begins a replay; a speed that is not positive replays as fast as possible
    pub fn new(reader: LogReader, pace: Pace, clock: C) -> Self {
        let pace = match pace {
            Pace::Speed(speed) if speed.is_finite() && speed > 0.0 => pace,
            _ => Pace::Max,
        };
        Self {
            reader,
            clock,
            pace,
            next: None,
            origin_ns: None,
            due_ns: i64::MIN,
            ended: false,
            failed: None,
        }
    }

    /// What the log had so far
    pub fn counts(&self) -> LogCounts {
        self.reader.counts()
    }

    /// The reader behind it
    pub fn reader(&self) -> &LogReader {
        &self.reader
    }

    /// The clock behind it
    pub fn clock(&self) -> &C {
        &self.clock
    }

    fn advance(&mut self) -> Result<()> {
        if self.next.is_some() || self.ended {
            return Ok(());
        }
        match self.reader.next_event()? {
            Some(event) => {
                self.schedule(&event);
                self.next = Some(event.into());
            }
            None => self.ended = true,
        }
        Ok(())
    }

    fn schedule(&mut self, event: &LogEvent) {
        let (Pace::Speed(speed), LogEvent::Frame(stamped)) = (self.pace, event) else { return };
        let now_ns = &mut self.clock;
        let (clock_ns, stamp_ns) = *self.origin_ns.get_or_insert_with(|| (now_ns.now_ns(), stamped.stamp_ns));
        let recorded_ns = stamped.stamp_ns.saturating_sub(stamp_ns) as f64;
        self.due_ns = self.due_ns.max(clock_ns.saturating_add((recorded_ns / speed) as i64));
    }
}

impl<C: Clock> Source for Replay<C> {
    fn poll(&mut self, batch: &mut Batch, timeout: Duration) -> Result<Poll> {
        batch.clear();
        if let Some(error) = self.failed.take() {
            self.ended = true;
            return Err(error);
        }
        self.advance()?;
        let timed = self.pace != Pace::Max;
        let mut now_ns = if timed { self.clock.now_ns() } else { i64::MAX };
        let limit_ns = now_ns.saturating_add(i64::try_from(timeout.as_nanos()).unwrap_or(i64::MAX));
        while self.next.is_some() && self.due_ns > now_ns && now_ns < limit_ns {
            self.clock.sleep_until_ns(self.due_ns.min(limit_ns));
            now_ns = self.clock.now_ns();
        }
        while batch.room() > 0 && self.due_ns <= now_ns {
            let Some(event) = self.next.take() else { break };
            batch.push(event);
            self.failed = self.advance().err();
        }
        Ok(match (batch.is_empty(), self.ended) {
            (false, _) => Poll::Ready,
            (true, true) => Poll::End,
            (true, false) => Poll::Idle,
        })
    }
}
