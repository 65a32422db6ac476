//! Where frames come from: one interface for sockets, logs, simulations, and the middleware between

use std::time::Duration;

use crate::bus_error::BusError;
use crate::candump::{LineFault, LogEvent};
use crate::error::Result;
use crate::frame::{Flags, Stamped};

/// One thing that a source has to tell
#[derive(Clone, Copy, PartialEq, Debug)]
pub enum Event {
    /// A data frame or remote request
    Frame(Stamped),
    /// An error frame: what the controller says about its bus
    BusError {
        /// The error frame itself
        stamped: Stamped,
        /// What it says
        error: BusError,
    },
    /// Frames were lost before this event: in the kernel, or by a full queue
    Dropped {
        /// Index of the interface
        interface: u8,
        /// Number of frames
        count: u32,
    },
    /// The interface went down or away; the source goes on waiting for it
    Down {
        /// Index of the interface
        interface: u8,
    },
    /// The interface is back
    Up {
        /// Index of the interface
        interface: u8,
    },
    /// A line of a log that is none
    Malformed {
        /// Line number from 1
        line: u64,
        /// What is wrong with it
        fault: LineFault,
    },
}

impl Event {
    /// A received frame as an event: error frames are decoded
    pub fn received(stamped: Stamped) -> Self {
        if stamped.frame.flags().has(Flags::ERROR) {
            Self::BusError { stamped, error: BusError::decode(&stamped.frame) }
        } else {
            Self::Frame(stamped)
        }
    }

    /// The frame of a [`Event::Frame`] or [`Event::BusError`]
    pub fn stamped(&self) -> Option<&Stamped> {
        match self {
            Self::Frame(stamped) | Self::BusError { stamped, .. } => Some(stamped),
            _ => None,
        }
    }
}

impl From<LogEvent> for Event {
    fn from(event: LogEvent) -> Self {
        match event {
            LogEvent::Frame(stamped) => Self::received(stamped),
            LogEvent::Dropped { interface, count } => Self::Dropped { interface, count },
            LogEvent::Malformed { line, fault } => Self::Malformed { line, fault },
        }
    }
}

/// A buffer of events whose memory is taken once
#[derive(Clone, Debug)]
pub struct Batch {
    events: Vec<Event>,
    capacity: usize,
}

impl Batch {
    /// Room for this many events, at least 8
    pub fn new(capacity: usize) -> Self {
        let capacity = capacity.max(8);
        Self { events: Vec::with_capacity(capacity), capacity }
    }

    /// A batch without memory, to stand in while the real one is lent
    pub(crate) const fn hollow() -> Self {
        Self { events: Vec::new(), capacity: 0 }
    }

    /// Adds an event; false, and nothing done, if there is no room
    pub fn push(&mut self, event: Event) -> bool {
        let room = self.events.len() < self.capacity;
        if room {
            self.events.push(event);
        }
        room
    }

    /// Forgets all events
    pub fn clear(&mut self) {
        self.events.clear();
    }

    /// The events in order
    pub fn events(&self) -> &[Event] {
        &self.events
    }

    /// How many more events there is room for
    pub fn room(&self) -> usize {
        self.capacity - self.events.len()
    }

    /// Whether there are none
    pub fn is_empty(&self) -> bool {
        self.events.is_empty()
    }
}

impl<'a> IntoIterator for &'a Batch {
    type Item = &'a Event;
    type IntoIter = std::slice::Iter<'a, Event>;

    fn into_iter(self) -> Self::IntoIter {
        self.events.iter()
    }
}

/// What a poll found
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Poll {
    /// The batch has at least one event
    Ready,
    /// Nothing within the time allowed
    Idle,
    /// Nothing, and nothing will ever come again
    End,
}

/// Something that frames come from
pub trait Source {
    /// Replaces the batch's events by the next ones; waits for the first at most `timeout`, never for more
    ///
    /// Work per call is bounded by the batch's capacity. An error is final; a bus that is down is not an error.
    fn poll(&mut self, batch: &mut Batch, timeout: Duration) -> Result<Poll>;
}

impl<S: Source + ?Sized> Source for Box<S> {
    fn poll(&mut self, batch: &mut Batch, timeout: Duration) -> Result<Poll> {
        (**self).poll(batch, timeout)
    }
}
