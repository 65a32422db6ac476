//! One turn of the cycle: frames from the source through the engine to the outputs.
//!
//! Everything here runs on the real-time thread: no allocation, lock, log, or call that waits beyond the given timeout.

use std::sync::Arc;
use std::time::Duration;

use can::source::{Batch, Event, Poll, Source};
use rig::config::PublishMode;

use crate::command::{Command, Report};
use crate::engine::{Engine, Now, Outlet};
use crate::feed::FeedWriter;
use crate::grid::Grid;
use crate::health::{Health, Totals};
use crate::output::Output;
use crate::published::{Dispatch, Published};

/// Most events taken in one turn: bounds its work.
pub const EVENTS_PER_TURN: usize = 2048;

/// No wait is longer, so that a stop, a reload and the watchdog are served.
const LONGEST_WAIT: Duration = Duration::from_millis(100);

/// Reads both clocks.
pub trait Clock {
    /// The time now.
    fn now(&self) -> Now;
    /// The time now, soon after a kernel stamp of the wall clock, ns since the Unix epoch.
    fn now_soon_after(&self, _stamp_ns: i64) -> Now {
        self.now()
    }
    /// The time now, a moment after `earlier`: between them the clocks have not stepped apart, so that one of them tells.
    fn now_after(&self, _earlier: Now) -> Now {
        self.now()
    }
    /// Waits until then on the monotonic clock, or shorter.
    fn sleep_until_ns(&self, monotonic_ns: i64);
}

/// Where records go: the real-time outputs, then everybody else's ring.
pub struct Sinks {
    /// Outputs served inside the cycle.
    pub outputs: Vec<Box<dyn Output>>,
    /// For those outside it.
    pub feed: FeedWriter,
    health: Arc<Health>,
    totals: Totals,
    /// Round of the last estimate published, so that each counts once in the latency.
    last_round: Option<u64>,
    /// What outputs and engines that were replaced had counted.
    replaced: Totals,
}

/// Source, engine and outputs of one cycle.
pub struct Station<S> {
    /// Where frames come from.
    pub source: S,
    engine: Engine,
    sinks: Sinks,
    batch: Batch,
    /// How far the last full batch ends before the time at which it was read, ns.
    unread_ns: i64,
    /// Event mode: how long the next turn may wait for frames.
    wait: Duration,
    grid: Option<Grid>,
    /// Fixed mode: when the last turn ended its wait, on the monotonic clock, ns.
    woken_ns: i64,
    rate_hz: f64,
}

/// The sinks with a clock.
struct Timed<'a, N> {
    sinks: &'a mut Sinks,
    now: N,
}

impl<N: FnMut() -> Now> Outlet for Timed<'_, N> {
    fn send(&mut self, dispatch: &Dispatch) {
        for output in &mut self.sinks.outputs {
            output.publish(dispatch);
        }
    }

    fn now(&mut self) -> Now {
        (self.now)()
    }

    fn keep(&mut self, record: &Published) {
        self.sinks.keep(record);
    }

    fn rehearse(&mut self, dispatch: &Dispatch) {
        for output in &mut self.sinks.outputs {
            output.rehearse(dispatch);
        }
    }
}

impl Sinks {
    /// To these outputs and this ring, counted in `health`.
    pub fn new(outputs: Vec<Box<dyn Output>>, feed: FeedWriter, health: Arc<Health>) -> Self {
        Self {
            outputs,
            feed,
            health,
            totals: Totals::default(),
            last_round: None,
            replaced: Totals::default(),
        }
    }

    /// All that is done with a record once it has left.
    fn keep(&mut self, record: &Published) {
        self.feed.write(record);
        self.totals.published += 1;
        self.totals.valid += u64::from(record.is_valid());
        if record.is_valid() {
            self.health.age.note(record.age_ns);
        }
        if record.round > 0 && self.last_round != Some(record.round) {
            self.last_round = Some(record.round);
            self.health.note_latency(record.published_ns - record.last_stamp_ns);
        }
    }

    fn count(&mut self, event: &Event) {
        match event {
            Event::Frame(_) => self.totals.frames += 1,
            Event::BusError { stamped, error } => {
                self.totals.bus_errors += 1;
                self.health.bus.note(stamped.interface, error);
            }
            Event::Dropped { count, .. } => self.totals.lost_frames += u64::from(*count),
            Event::Down { .. } => self.totals.downs += 1,
            Event::Up { .. } | Event::Malformed { .. } => {}
        }
    }

    fn output_counts(&self) -> (u64, u64) {
        let counts = self.outputs.iter().map(|output| output.counts());
        counts.fold((0, 0), |(sent, dropped), c| (sent + c.sent, dropped + c.dropped))
    }
}

impl<S: Source> Station<S> {
    /// Ready to turn; `rate_hz` is the grid's in fixed mode.
    pub fn new(source: S, engine: Engine, rate_hz: f64, sinks: Sinks) -> Self {
        Self {
            source,
            engine,
            sinks,
            batch: Batch::new(EVENTS_PER_TURN),
            unread_ns: 0,
            wait: Duration::ZERO,
            grid: None,
            woken_ns: 0,
            rate_hz,
        }
    }

    /// One turn. Fixed mode: waits for the grid's next point, takes in what has come, publishes. Event mode: waits for
    /// frames, publishes what they complete. Waits at most a tenth of a second; an error of the source is final.
    pub fn turn(&mut self, clock: &impl Clock) -> can::Result<Poll> {
        let poll = match self.engine.mode() {
            PublishMode::Fixed => self.turn_fixed(clock)?,
            PublishMode::Event => self.turn_event(clock)?,
        };
        self.sinks.totals.turns += 1;
        self.note();
        Ok(poll)
    }

    fn turn_fixed(&mut self, clock: &impl Clock) -> can::Result<Poll> {
        let grid = self.grid.get_or_insert_with(|| {
            self.woken_ns = clock.now().monotonic_ns;
            Grid::new(self.woken_ns, self.rate_hz)
        });
        let due_ns = grid.due_ns();
        clock.sleep_until_ns(due_ns.min(self.woken_ns + LONGEST_WAIT.as_nanos() as i64));
        let woken = clock.now();
        self.woken_ns = woken.monotonic_ns;
        if woken.monotonic_ns < due_ns {
            return Ok(Poll::Idle);
        }
        self.sinks.health.lateness.note(woken.monotonic_ns - due_ns);
        self.sinks.totals.overruns += grid.advance(woken.monotonic_ns);
        let poll = self.take_in(Duration::ZERO, |_| woken)?;
        let Self { engine, sinks, .. } = self;
        engine.tick(woken, &mut Timed { sinks, now: || clock.now_after(woken) });
        Ok(poll)
    }

    fn turn_event(&mut self, clock: &impl Clock) -> can::Result<Poll> {
        let arrived = |stamp_ns| clock.now_soon_after(stamp_ns);
        let mut poll = self.take_in(self.wait, arrived)?;
        if let Some(left_ns) = self.left_ns() {
            self.wait = nanoseconds(left_ns);
            let Self { engine, sinks, .. } = self;
            engine.rehearse(&mut Timed { sinks, now: || clock.now() });
            return Ok(poll);
        }
        // Silence is told only as of a time up to which everything was read that had come, however late this thread is.
        let now = clock.now();
        if poll != Poll::End && self.engine.due_ns().is_some_and(|due_ns| now.monotonic_ns >= due_ns) {
            poll = self.take_in(Duration::ZERO, arrived)?;
        }
        let Self { engine, sinks, .. } = self;
        engine.tick(now.earlier(self.unread_ns), &mut Timed { sinks, now: || clock.now() });
        self.wait = nanoseconds(engine.due_ns().map_or(0, |due_ns| due_ns - now.monotonic_ns));
        Ok(poll)
    }

    /// Event mode: time until silence has to be told, ns, where the stamps of what was read tell: then no clock need be asked.
    fn left_ns(&self) -> Option<i64> {
        let last = self.batch.events().iter().rev().find_map(Event::stamped);
        last.filter(|_| self.batch.room() > 0).and_then(|last| self.engine.left_ns(last.stamp_ns))
    }

    /// Takes in what has come, or what comes first within this time; `arrived` tells the time of an estimate by its last frame's stamp.
    fn take_in(&mut self, wait: Duration, arrived: impl Fn(i64) -> Now) -> can::Result<Poll> {
        let poll = self.source.poll(&mut self.batch, wait)?;
        self.unread_ns = 0;
        if poll != Poll::Ready {
            return Ok(poll);
        }
        let Self { engine, sinks, batch, .. } = self;
        for event in batch.events() {
            sinks.count(event);
            if let Event::Frame(stamped) = event {
                engine.push(stamped, &mut Timed { sinks, now: || arrived(stamped.stamp_ns) });
            }
        }
        if self.batch.room() == 0 {
            let last_ns = self.batch.events().iter().rev().find_map(|event| Some(event.stamped()?.stamp_ns));
            self.unread_ns = last_ns.map_or(0, |last_ns| (arrived(last_ns).realtime_ns - last_ns).max(0));
        }
        Ok(poll)
    }

    /// Obeys a command, or begins to.
    pub fn command(&mut self, command: Command, clock: &impl Clock) {
        self.engine.command(command, clock.now());
    }

    /// The answer to the last command, once.
    pub fn take_report(&mut self) -> Option<Report> {
        self.engine.take_report()
    }

    /// Publishes the last record.
    pub fn stop(&mut self, clock: &impl Clock) {
        let Self { engine, sinks, .. } = self;
        engine.stop(&mut Timed { sinks, now: || clock.now() });
        self.note();
    }

    /// Exchanges engine, rate and outputs for others; the sequence counts on. What was replaced is left in the arguments,
    /// to be freed elsewhere.
    pub fn exchange(&mut self, engine: &mut Engine, rate_hz: f64, outputs: &mut Vec<Box<dyn Output>>) {
        engine.continue_from(&self.engine);
        self.note();
        self.sinks.replaced = self.sinks.totals;
        std::mem::swap(&mut self.engine, engine);
        std::mem::swap(&mut self.sinks.outputs, outputs);
        self.sinks.last_round = None;
        self.rate_hz = rate_hz;
        self.grid = None;
        self.wait = Duration::ZERO;
    }

    fn note(&mut self) {
        let rounds = self.engine.cycle().assembler().counts();
        let (sent, dropped) = self.sinks.output_counts();
        let Sinks { totals, health, replaced, .. } = &mut self.sinks;
        (totals.sent, totals.unsent) = (replaced.sent + sent, replaced.unsent + dropped);
        totals.rounds = replaced.rounds + rounds.rounds;
        totals.complete_rounds = replaced.complete_rounds + rounds.complete_rounds;
        health.store(totals);
    }
}

/// A wait of so long, no longer than any wait may be; none where it is over.
fn nanoseconds(wait_ns: i64) -> Duration {
    Duration::from_nanos(u64::try_from(wait_ns).unwrap_or(0)).min(LONGEST_WAIT)
}
