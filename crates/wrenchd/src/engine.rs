//! The daemon's cycle without clock, socket or thread: frames and time in, published records out.
//!
//! The daemon and the in-process demo run this same engine; only where frames and time come from differs.
//!
//! ```text
//! every frame, in order ........ Engine::push(frame, outlet)        event mode: publishes each estimate as it completes
//! the grid, or when due ........ Engine::tick(now, outlet)          fixed mode: publishes the newest estimate with its age
//!                                                                   event mode: says so when the bus is silent
//! the end ...................... Engine::stop(outlet)               one last invalid record
//! ```
//!
//! An [`Outlet`] is where records go. What must leave at once leaves first; only then is the clock read for the record's times.
//!
//! ```no_run
//! # fn demo(robot: &rig::Rig, stored: &rig::ModelFile, frames: &[can::frame::Stamped]) -> Result<(), rig::RigError> {
//! use wrenchd::engine::{Engine, Now, Told};
//!
//! let mut engine = Engine::new(robot, stored)?;
//! for frame in frames {
//!     let now = Now::simulated(frame.stamp_ns);
//!     engine.push(frame, &mut Told::new(now, |record| println!("{:?}", record.outcome)));
//!     engine.tick(now, &mut Told::new(now, |record| println!("{:?}", record.outcome)));
//! }
//! # Ok(())
//! # }
//! ```

use std::sync::Arc;

use can::frame::Stamped;
use rig::config::PublishMode;
use rig::cycle::{Cycle, Estimate};
use rig::tare::TareRefusal;
use rig::{ModelFile, Rig, RigError, Status};

use crate::board::Board;
use crate::command::{Command, Done, Order, Report};
use crate::published::{Dispatch, Published, Why};
use crate::rehearsal::Rehearsal;

/// In event mode a silent bus is told once as soon as it counts as silent, and then this often, ns: well within the 100 ms
/// after which clients of RDT take the box for gone.
pub const SILENCE_PERIOD_NS: i64 = 50_000_000;

/// A tare that has not ended so long after it was ordered is given up: no snapshots come, ns.
const TARE_LIMIT_NS: i64 = 2_000_000_000;

/// The time, on both clocks at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Now {
    /// `CLOCK_REALTIME`, the clock of the stamps, ns since the Unix epoch; it may step.
    pub realtime_ns: i64,
    /// `CLOCK_MONOTONIC`, ns; durations are measured on it.
    pub monotonic_ns: i64,
}

impl Now {
    /// Both clocks at the same time: for simulated time, which never steps.
    pub const fn simulated(time_ns: i64) -> Self {
        Self { realtime_ns: time_ns, monotonic_ns: time_ns }
    }

    /// The time so many nanoseconds from then.
    pub const fn later(self, by_ns: i64) -> Self {
        self.earlier(-by_ns)
    }

    /// The time so many nanoseconds ago.
    pub const fn earlier(self, by_ns: i64) -> Self {
        Self { realtime_ns: self.realtime_ns - by_ns, monotonic_ns: self.monotonic_ns - by_ns }
    }
}

/// Where records go, and the clock that they are timed by.
pub trait Outlet {
    /// Sends what must leave at once.
    fn send(&mut self, dispatch: &Dispatch);
    /// The time: of a record when it has left, of an estimate that is kept when it arrived.
    fn now(&mut self) -> Now;
    /// Takes the record of what has left.
    fn keep(&mut self, record: &Published);
    /// Goes through the work of sending, but for the sending: for the caches.
    fn rehearse(&mut self, _dispatch: &Dispatch) {}
}

/// An outlet that is told the time, and hands on each record.
#[derive(Debug)]
pub struct Told<F> {
    now: Now,
    out: F,
}

impl<F: FnMut(&Published)> Told<F> {
    /// At this time, to `out`.
    pub fn new(now: Now, out: F) -> Self {
        Self { now, out }
    }
}

impl<F: FnMut(&Published)> Outlet for Told<F> {
    fn send(&mut self, _: &Dispatch) {}

    fn now(&mut self) -> Now {
        self.now
    }

    fn keep(&mut self, record: &Published) {
        (self.out)(record);
    }
}

/// An estimate as it arrived.
#[derive(Clone, Debug)]
struct Newest {
    estimate: Estimate,
    /// From its instant to its arrival here, ns.
    age_ns: i64,
    /// When it arrived, on the monotonic clock, ns.
    arrived_ns: i64,
}

/// From frames to published records. Allocates at construction only; bounded work per call.
#[derive(Debug)]
pub struct Engine {
    cycle: Cycle,
    mode: PublishMode,
    stale_after_ns: i64,
    sequence: u64,
    newest: Option<Newest>,
    /// Event mode: when silence is to be told next, on the monotonic clock, ns.
    silence_due_ns: Option<i64>,
    /// Event mode: stamp of the frame that completed what was published last, ns; none once silence was told.
    completed_ns: Option<i64>,
    /// Event mode only.
    rehearsal: Option<Rehearsal>,
    board: Arc<Board>,
    /// The tare that is being taken: the command's number and when it came, on the monotonic clock, ns.
    taring: Option<(u64, i64)>,
    /// When the tare that is applied was taken.
    tared: Option<Now>,
    report: Option<Report>,
}

impl Engine {
    /// For a robot with its calibrated model.
    pub fn new(rig: &Rig, model: &ModelFile) -> Result<Self, RigError> {
        let mode = rig.config.publish.mode;
        let event = mode == PublishMode::Event;
        Ok(Self {
            cycle: Cycle::new(rig, model)?,
            mode,
            stale_after_ns: rig.layout.stale_after_ns,
            sequence: 0,
            newest: None,
            silence_due_ns: None,
            completed_ns: None,
            rehearsal: event.then(|| Rehearsal::new(rig, model)).transpose()?,
            board: Arc::new(Board::new(rig.sections.len())),
            taring: None,
            tared: None,
            report: None,
        })
    }

    /// Counts on from where another engine ended, so that receivers see no jump when one takes over, and with its payload
    /// and its tare (the tare only where the gauges are calibrated as there).
    pub fn continue_from(&mut self, other: &Self) {
        self.sequence = other.sequence;
        self.cycle.stage_mut().take_over(other.cycle.stage());
        self.tared = other.tared.filter(|_| self.cycle.stage().tared().is_some());
        if let Some((number, _)) = other.taring {
            self.report = Some(Report { number, outcome: Err(TareRefusal::Interrupted) });
        }
        self.board.write_orders(self.cycle.stage(), self.tared);
    }

    /// Gauges, tare and payload, readable from other threads.
    pub fn board(&self) -> &Arc<Board> {
        &self.board
    }

    /// Obeys a command, or begins to; [`Engine::take_report`] has the answer.
    pub fn command(&mut self, command: Command, now: Now) {
        let Command { number, order } = command;
        let stage = self.cycle.stage_mut();
        match order {
            Order::Tare => {
                stage.take_tare_outcome();
                stage.begin_tare();
                self.taring = Some((number, now.monotonic_ns));
                return;
            }
            Order::Untare => {
                stage.untare();
                self.taring = None;
                self.tared = None;
            }
            Order::Payload(body) => stage.set_payload(&body),
        }
        self.report = Some(Report { number, outcome: Ok(Done::Obeyed) });
        self.board.write_orders(self.cycle.stage(), self.tared);
    }

    /// The answer to the last command, once.
    pub fn take_report(&mut self) -> Option<Report> {
        self.report.take()
    }

    /// Ends a tare that the cycle has done or refused, or that waits in vain.
    fn note_tare(&mut self, now: Now) {
        let Some((number, since_ns)) = self.taring else { return };
        if now.monotonic_ns - since_ns > TARE_LIMIT_NS {
            self.cycle.stage_mut().refuse_tare(TareRefusal::Silent);
        }
        if let Some(outcome) = self.cycle.stage_mut().take_tare_outcome() {
            if outcome.is_ok() {
                self.tared = Some(now);
                self.board.write_orders(self.cycle.stage(), self.tared);
            }
            self.taring = None;
            self.report = Some(Report { number, outcome: outcome.map(Done::Tared) });
        }
    }

    /// Whether each estimate is published as it completes, or a grid publishes the newest.
    pub fn mode(&self) -> PublishMode {
        self.mode
    }

    /// The cycle, with what its assembler met.
    pub fn cycle(&self) -> &Cycle {
        &self.cycle
    }

    /// Takes the next frame, in the order received. In event mode each estimate that it completes is published.
    pub fn push(&mut self, frame: &Stamped, outlet: &mut impl Outlet) {
        let Self { cycle, mode, stale_after_ns, sequence, newest, silence_due_ns, completed_ns, .. } = self;
        let mut last = None;
        let out: &mut dyn FnMut(&Estimate) = &mut |estimate| {
            let dispatch = (*mode == PublishMode::Event).then(|| dispatch(next(sequence), estimate));
            if let Some(dispatch) = &dispatch {
                outlet.send(dispatch);
            }
            let now = outlet.now();
            let arrived = Newest {
                estimate: estimate.clone(),
                age_ns: (now.realtime_ns - estimate.instant_ns).max(0),
                arrived_ns: now.monotonic_ns,
            };
            if let Some(dispatch) = dispatch {
                outlet.keep(&record(dispatch, Some(&arrived), now));
                *silence_due_ns = Some(now.monotonic_ns + *stale_after_ns);
                *completed_ns = Some(frame.stamp_ns);
            }
            last = Some((estimate.outcome.is_ok(), now));
            *newest = Some(arrived);
        };
        cycle.push(frame, out);
        if let Some(rehearsal) = &mut self.rehearsal {
            rehearsal.note(frame, last.is_some());
        }
        if let Some((valid, now)) = last {
            self.board.write_gauges(self.cycle.stage(), valid);
            self.note_tare(now);
        }
    }

    /// Lets time pass. In fixed mode publishes one record: the newest estimate with its age, or invalid where there is
    /// none or it is stale. In event mode publishes only where silence has to be told.
    pub fn tick(&mut self, now: Now, outlet: &mut impl Outlet) {
        self.note_tare(now);
        match self.mode {
            PublishMode::Fixed => {
                let number = next(&mut self.sequence);
                let dispatch = match &self.newest {
                    None => self.nothing(number, Why::NothingYet),
                    Some(newest) if age_ns(newest, now) - newest.estimate.delay_ns > self.stale_after_ns => {
                        self.nothing(number, Why::Stale)
                    }
                    Some(newest) => dispatch(number, &newest.estimate),
                };
                self.publish(dispatch, outlet);
            }
            PublishMode::Event => {
                let due_ns = *self.silence_due_ns.get_or_insert(now.monotonic_ns + self.stale_after_ns);
                if now.monotonic_ns >= due_ns {
                    self.silence_due_ns = Some(now.monotonic_ns + SILENCE_PERIOD_NS);
                    self.completed_ns = None;
                    let why = if self.newest.is_some() { Why::Stale } else { Why::NothingYet };
                    let number = next(&mut self.sequence);
                    self.publish(self.nothing(number, why), outlet);
                }
            }
        }
    }

    /// Event mode: when [`Engine::tick`] has something to do if no frame comes, on the monotonic clock, ns.
    pub fn due_ns(&self) -> Option<i64> {
        if self.mode == PublishMode::Event { self.silence_due_ns } else { None }
    }

    /// Event mode: how long the bus may be silent after a frame of this stamp until that has to be told, ns, where stamps alone can
    /// tell: soon after the frame that completed what was published last. A clock that stepped makes them say nothing.
    pub fn left_ns(&self, stamp_ns: i64) -> Option<i64> {
        let passed_ns = stamp_ns.checked_sub(self.completed_ns?)?;
        (0..=self.stale_after_ns / 2).contains(&passed_ns).then_some(self.stale_after_ns - passed_ns)
    }

    /// Event mode: makes use of the time until the next frame, to be ready for it.
    pub fn rehearse(&mut self, outlet: &mut impl Outlet) {
        if let Some(rehearsal) = &mut self.rehearsal {
            rehearsal.rehearse(|estimate| outlet.rehearse(&dispatch(0, estimate)));
        }
        self.cycle.prepare();
    }

    /// Publishes the last record: invalid, nothing follows.
    pub fn stop(&mut self, outlet: &mut impl Outlet) {
        let number = next(&mut self.sequence);
        self.publish(self.nothing(number, Why::Stopping), outlet);
    }

    fn publish(&self, dispatch: Dispatch, outlet: &mut impl Outlet) {
        outlet.send(&dispatch);
        let now = outlet.now();
        outlet.keep(&record(dispatch, self.newest.as_ref(), now));
    }

    fn nothing(&self, sequence: u64, why: Why) -> Dispatch {
        let tared = if self.tared.is_some() { Status::TARED } else { Status::GOOD };
        Dispatch { sequence, status: Status::INVALID.with(Status::STALE).with(tared), outcome: Err(why) }
    }
}

fn next(sequence: &mut u64) -> u64 {
    let number = *sequence;
    *sequence = sequence.wrapping_add(1);
    number
}

/// Age of an estimate: as it arrived, by the stamps' clock, and since then by the clock that does not step.
fn age_ns(newest: &Newest, now: Now) -> i64 {
    newest.age_ns + (now.monotonic_ns - newest.arrived_ns)
}

fn dispatch(sequence: u64, estimate: &Estimate) -> Dispatch {
    Dispatch { sequence, status: estimate.status, outcome: estimate.outcome.map_err(Why::Refused) }
}

/// What was sent of this estimate, or for want of a fresher one, with its times.
fn record(dispatch: Dispatch, newest: Option<&Newest>, now: Now) -> Published {
    let Dispatch { sequence, status, outcome } = dispatch;
    Published {
        sequence,
        instant_ns: newest.map_or(0, |newest| newest.estimate.instant_ns),
        last_stamp_ns: newest.map_or(0, |newest| newest.estimate.last_stamp_ns),
        published_ns: now.realtime_ns,
        age_ns: newest.map_or(0, |newest| age_ns(newest, now)),
        round: newest.map_or(0, |newest| newest.estimate.round),
        status,
        outcome,
    }
}
