//! The real-time thread: turns a station until it is told to stop.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::sync_channel;
use std::thread::JoinHandle;

use can::source::{Poll, Source};
use rtrb::{Consumer, Producer, PushError, RingBuffer};

use crate::desk::Inbox;
use crate::engine::Engine;
use crate::output::Output;
use crate::realtime::{self, CycleClock};
use crate::station::Station;

/// Stack of the thread: some ten times what a turn uses, small enough to be locked.
const STACK_BYTES: usize = 512 * 1024;

/// Source of a daemon's cycle.
pub type BoxedSource = Box<dyn Source + Send>;

/// What a reload replaces.
pub struct Replacement {
    /// The engine of the new configuration and model.
    pub engine: Engine,
    /// Rate of the grid in fixed mode, Hz.
    pub rate_hz: f64,
    /// The outputs of the new configuration.
    pub outputs: Vec<Box<dyn Output>>,
    /// The source, where the interfaces changed.
    pub source: Option<BoxedSource>,
}

/// A running cycle, seen from the main thread.
pub struct Runner {
    thread: JoinHandle<can::Result<()>>,
    stop: Arc<AtomicBool>,
    offers: Producer<Box<Replacement>>,
    retired: Consumer<Box<Replacement>>,
}

impl Runner {
    /// Starts the thread, which obeys what comes into `inbox`, and returns once it has asked for its priority; with what it was refused, if anything.
    pub fn start(station: Station<BoxedSource>, mut inbox: Inbox) -> std::io::Result<(Self, Option<String>)> {
        let stop = Arc::new(AtomicBool::new(false));
        let (offers, mut offered) = RingBuffer::new(1);
        let (mut retire, retired) = RingBuffer::new(1);
        let (tell, told) = sync_channel(1);
        let stopped = stop.clone();
        let builder = std::thread::Builder::new().name("cycle".into()).stack_size(STACK_BYTES);
        let thread = builder.spawn(move || {
            // The receiver waits for exactly this message.
            let _ = tell.send(realtime::first_in_first_out().err());
            run(station, &stopped, &mut offered, &mut retire, &mut inbox)
        })?;
        let refused = told.recv().unwrap_or(None);
        Ok((Self { thread, stop, offers, retired }, refused))
    }

    /// Whether the thread has ended by itself, which it does on an error of the source only.
    pub fn has_ended(&self) -> bool {
        self.thread.is_finished()
    }

    /// Hands a replacement to the cycle, which takes it before its next turn; false if one is still waiting, or the cycle
    /// has ended.
    pub fn offer(&mut self, replacement: Box<Replacement>) -> bool {
        self.free_retired();
        !self.offers.is_abandoned() && self.offers.push(replacement).is_ok()
    }

    /// Frees what the cycle has put down.
    pub fn free_retired(&mut self) -> bool {
        self.retired.pop().is_ok()
    }

    /// Stops the cycle after a last record, and waits for its end.
    pub fn stop(self) -> can::Result<()> {
        self.stop.store(true, Ordering::Release);
        self.thread.join().unwrap_or_else(|_| {
            let source = std::io::Error::other("its thread ended unexpectedly; please report this");
            Err(can::Error::Socket { interface: "cycle".into(), what: "running", source, hint: None })
        })
    }
}

/// The loop itself. What other threads hand over comes through queues that are wait-free at both ends: nobody waits for a sender of
/// lower priority that this thread has stopped in the midst of its push.
fn run(
    mut station: Station<BoxedSource>,
    stop: &AtomicBool,
    offered: &mut Consumer<Box<Replacement>>,
    retire: &mut Producer<Box<Replacement>>,
    inbox: &mut Inbox,
) -> can::Result<()> {
    let clock = CycleClock::default();
    while !stop.load(Ordering::Acquire) {
        if let Ok(replacement) = offered.pop() {
            exchange(&mut station, replacement, retire);
        }
        if let Some(command) = inbox.take() {
            station.command(command, &clock);
        }
        let poll = station.turn(&clock)?;
        if let Some(report) = station.take_report() {
            inbox.answer(report);
        }
        if poll == Poll::End {
            break;
        }
    }
    station.stop(&clock);
    Ok(())
}

fn exchange(
    station: &mut Station<BoxedSource>,
    mut replacement: Box<Replacement>,
    retire: &mut Producer<Box<Replacement>>,
) {
    let Replacement { engine, rate_hz, outputs, source } = &mut *replacement;
    station.exchange(engine, *rate_hz, outputs);
    if let Some(source) = source {
        std::mem::swap(&mut station.source, source);
    }
    // There is room: the main thread empties this queue before each offer. If not, the old parts are leaked rather than
    // freed here.
    if let Err(PushError::Full(old)) = retire.push(replacement) {
        std::mem::forget(old);
    }
}
