//! The live part: simulated boards on an in-process bus, and the daemon's own cycle behind it, each on a thread.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant, SystemTime};

use can::channel::{ChannelSender, channel};
use can::source::{Poll, Source};
use can::tap::{TapReader, tap};
use rig::{ModelFile, Rig};
use sim::{Mechanics, Simulator};
use wrenchd::engine::{Engine, Now};
use wrenchd::feed::{FeedReader, feed};
use wrenchd::health::{Health, Totals};
use wrenchd::station::{Clock, Sinks, Station};

use crate::Error;

/// Frames that the in-process bus holds: a second of a full CAN bus.
const BUS_FRAMES: usize = 8192;

/// Records and frames that wait for the view: it looks a hundred times a second.
const RECORDS: usize = 4096;
const COPIES: usize = 1 << 15;

/// From the start of the threads to the first simulated instant.
pub(super) const LEAD_NS: i64 = 200_000_000;

/// How long the boards' thread sleeps at least: frames of that time go out together.
const NAP: Duration = Duration::from_micros(500);

/// The system's time, without steps.
#[derive(Clone, Copy, Debug)]
pub(super) struct SystemClock {
    origin: Instant,
    origin_ns: i64,
}

impl SystemClock {
    /// Begins now.
    pub(super) fn new() -> Self {
        let epoch = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let origin_ns = i64::try_from(epoch.as_nanos()).unwrap_or(0);
        Self { origin: Instant::now(), origin_ns }
    }
}

impl Clock for SystemClock {
    fn now(&self) -> Now {
        let elapsed_ns = i64::try_from(self.origin.elapsed().as_nanos()).unwrap_or(i64::MAX / 2);
        Now { realtime_ns: self.origin_ns + elapsed_ns, monotonic_ns: elapsed_ns }
    }

    fn sleep_until_ns(&self, monotonic_ns: i64) {
        let until = Duration::from_nanos(monotonic_ns.max(0).unsigned_abs());
        thread::sleep(until.saturating_sub(self.origin.elapsed()));
    }
}

/// A running arm, bus and daemon.
pub(super) struct Live {
    /// What the daemon publishes.
    pub(super) records: FeedReader,
    /// What it received, for the view.
    pub(super) frames: TapReader,
    /// True motion, loads and wrench at any instant.
    pub(super) mechanics: Mechanics,
    health: Arc<Health>,
    stop: Arc<AtomicBool>,
    boards: JoinHandle<()>,
    daemon: JoinHandle<can::Result<()>>,
}

impl Live {
    /// Starts the threads.
    pub(super) fn start(
        rig: &Rig,
        model: &ModelFile,
        simulator: Simulator,
        clock: SystemClock,
    ) -> Result<Self, Error> {
        let (bus, source) = channel(BUS_FRAMES);
        let (source, frames) = tap(source, COPIES);
        let (writer, feed) = feed(RECORDS);
        let health = Arc::new(Health::default());
        let sinks = Sinks::new(Vec::new(), writer, health.clone());
        let engine = Engine::new(rig, model)?;
        let station = Station::new(source, engine, rig.config.publish.rate_hz, sinks);
        let stop = Arc::new(AtomicBool::new(false));
        let (records, mechanics) = (feed.reader(), simulator.mechanics());
        let boards = spawn("boards", {
            let stop = stop.clone();
            move || play(simulator, &bus, clock, &stop)
        })?;
        let daemon = spawn("daemon", {
            let stop = stop.clone();
            move || serve(station, clock, &stop)
        })?;
        Ok(Self { records, frames, mechanics, health, stop, boards, daemon })
    }

    /// The daemon's counters.
    pub(super) fn totals(&self) -> Totals {
        self.health.totals()
    }

    /// Whether the daemon's cycle has ended by itself.
    pub(super) fn has_ended(&self) -> bool {
        self.daemon.is_finished()
    }

    /// Stops all threads.
    pub(super) fn stop(self) -> Result<(), Error> {
        self.stop.store(true, Ordering::Relaxed);
        let gone =
            |_| Error::usage("a thread of the demo ended unexpectedly; please report this with its seed");
        self.boards.join().map_err(gone)?;
        Ok(self.daemon.join().map_err(gone)??)
    }
}

fn spawn<T: Send + 'static>(
    name: &str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<JoinHandle<T>, Error> {
    let spawned = thread::Builder::new().name(name.into()).spawn(work);
    spawned
        .map_err(|error| Error::usage(format!("no thread for the demo's {name}: {error}; is memory left?")))
}

/// Puts every frame onto the bus at its stamp or a moment later.
fn play(simulator: Simulator, bus: &ChannelSender, clock: SystemClock, stop: &AtomicBool) {
    for stamped in simulator {
        while clock.now().realtime_ns < stamped.stamp_ns {
            if stop.load(Ordering::Relaxed) {
                return;
            }
            let wait_ns = stamped.stamp_ns - clock.now().realtime_ns;
            let wait = Duration::from_nanos(u64::try_from(wait_ns).unwrap_or(0));
            thread::sleep(wait.clamp(NAP, Duration::from_millis(50)));
        }
        if stop.load(Ordering::Relaxed) {
            return;
        }
        bus.send(stamped);
    }
}

/// The daemon's cycle, turn by turn.
fn serve<S: Source>(mut station: Station<S>, clock: SystemClock, stop: &AtomicBool) -> can::Result<()> {
    while !stop.load(Ordering::Relaxed) {
        if station.turn(&clock)? == Poll::End {
            break;
        }
    }
    station.stop(&clock);
    Ok(())
}
