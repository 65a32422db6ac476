//! Everything that talks to the world from outside the cycle: what it shares, its sockets, and HTTP.
//!
//! It all runs on the main thread, reads the feed, the board and the counters, and gives orders through the desk; however slow
//! or hostile a client is, the cycle does not notice.

pub mod http;
#[allow(unsafe_code)]
mod inherited;
pub(crate) mod ports;

pub(crate) use inherited::descriptors;

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::time::{Duration, Instant};

use tokio::sync::{mpsc, oneshot, watch};

use crate::board::Board;
use crate::desk::Desk;
use crate::feed::Feed;
use crate::health::{Health, Totals};
use crate::output::rdt;
use crate::published::Published;
use crate::realtime::SystemClock;
use crate::station::Clock;
use crate::view::{DaemonStatus, Live};

/// Something that serves clients until it is dropped.
pub type Server = Pin<Box<dyn Future<Output = ()> + Send>>;

/// Asks for a reload; what became of it comes back, in words.
pub(crate) type ReloadRequest = oneshot::Sender<Result<String, String>>;

/// The cycle is taken to stand still when it has published nothing for so long: it speaks even of silence more often, on any grid but
/// the slowest ([`Robot::patience`]).
const STANDSTILL: Duration = Duration::from_secs(1);

/// What runs, as far as clients may know it.
#[derive(Debug)]
pub(crate) struct Robot {
    pub(crate) config: String,
    pub(crate) model: String,
    pub(crate) model_sha256: String,
    pub(crate) mode: &'static str,
    pub(crate) rate_hz: f64,
    /// Names of the gauges, in the board's order.
    pub(crate) gauges: Vec<String>,
    pub(crate) board: Arc<Board>,
}

impl Robot {
    /// For how long the cycle may publish nothing: two periods of a grid that is slow.
    fn patience(&self) -> Duration {
        let periods_s = if self.mode == "fixed" { 2.0 / self.rate_hz } else { 0.0 };
        Duration::try_from_secs_f64(periods_s).map_or(Duration::MAX, |periods| periods.max(STANDSTILL))
    }
}

/// How fast it goes, measured over about a second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pulse {
    pub(crate) published_hz: f64,
    pub(crate) frames_hz: f64,
    /// Since when nothing has been published, if so.
    published_at: Instant,
    measured_at: Instant,
    measured: Totals,
    published: u64,
}

impl Pulse {
    pub(crate) fn new() -> Self {
        let now = Instant::now();
        Self {
            published_hz: 0.0,
            frames_hz: 0.0,
            published_at: now,
            measured_at: now,
            measured: Totals::default(),
            published: 0,
        }
    }

    /// Looks at the counters again.
    pub(crate) fn beat(&mut self, totals: &Totals) {
        let now = Instant::now();
        if totals.published != self.published {
            (self.published, self.published_at) = (totals.published, now);
        }
        let passed = now - self.measured_at;
        if passed >= Duration::from_secs(1) {
            let new = totals.since(&self.measured);
            self.published_hz = new.published as f64 / passed.as_secs_f64();
            self.frames_hz = new.frames as f64 / passed.as_secs_f64();
            (self.measured, self.measured_at) = (*totals, now);
        }
    }

    /// How long the cycle has stood still, if it does, having published so many records by now. It may have published some that this has
    /// not noticed yet: this thread may have stood still itself, over a reload.
    fn standstill(&self, published: u64, patience: Duration) -> Option<Duration> {
        let passed = self.published_at.elapsed();
        (published == self.published && passed > patience).then_some(passed)
    }
}

/// What every server can look at and do.
#[derive(Clone, Debug)]
pub struct Shared {
    pub(crate) feed: Feed,
    pub(crate) health: Arc<Health>,
    pub(crate) desk: Arc<Desk>,
    pub(crate) robot: watch::Receiver<Arc<Robot>>,
    pub(crate) pulse: watch::Receiver<Pulse>,
    pub(crate) reloads: mpsc::Sender<ReloadRequest>,
    pub(crate) rdt: Arc<rdt::Stream>,
    pub(crate) started: Instant,
}

impl Shared {
    /// The newest record as clients may take it, the one place where they do: of a cycle that stands still the last wrench is none.
    pub(crate) fn newest(&self) -> Option<Published> {
        let record = self.feed.newest()?;
        let (published, patience) = (self.health.totals().published, self.robot.borrow().patience());
        let standing = self.pulse.borrow().standstill(published, patience);
        Some(standing.map_or(record, |passed| record.left_behind(passed.as_nanos() as i64)))
    }

    /// The newest record as clients see it.
    pub(crate) fn live(&self) -> Option<Live> {
        let robot = self.robot.borrow().clone();
        let now = SystemClock.now().monotonic_ns;
        self.newest().map(|record| Live::new(&record, &robot.board, &robot.gauges, now))
    }

    /// The newest record if it has a wrench; else why not.
    pub(crate) fn healthy(&self) -> Result<Published, String> {
        let record = self.newest().ok_or("nothing has been published yet")?;
        record.outcome.map_or_else(|why| Err(why.to_string()), |_| Ok(record))
    }

    /// The daemon as a whole.
    pub(crate) fn status(&self) -> DaemonStatus {
        let (robot, pulse) = (self.robot.borrow().clone(), *self.pulse.borrow());
        DaemonStatus {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            config: robot.config.clone(),
            model: robot.model.clone(),
            model_sha256: robot.model_sha256.clone(),
            mode: robot.mode.to_owned(),
            rate_hz: robot.rate_hz,
            uptime_s: self.started.elapsed().as_secs_f64(),
            published_hz: pulse.published_hz,
            frames_hz: pulse.frames_hz,
            latency_p99_s: self.health.latency.read().quantile_s(0.99),
            totals: self.health.named().map(|counter| (counter.name.to_owned(), counter.value)).collect(),
            live: self.live(),
        }
    }

    /// Reads configuration and model again; what became of it, in words.
    pub(crate) async fn reload(&self) -> Result<String, String> {
        let (answer, answered) = oneshot::channel();
        let gone = |_| "the daemon is stopping".to_owned();
        self.reloads.send(answer).await.map_err(|_| gone(()))?;
        answered.await.map_err(|_| gone(()))?
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pulse_that_was_not_taken_for_long_is_no_standstill() {
        let published_at = Instant::now().checked_sub(2 * STANDSTILL).unwrap();
        let pulse = Pulse { published_at, published: 7, ..Pulse::new() };
        assert!(pulse.standstill(7, STANDSTILL).is_some_and(|passed| passed >= 2 * STANDSTILL));
        assert_eq!(pulse.standstill(8, STANDSTILL), None, "it goes on");
        assert_eq!(Pulse { published_at: Instant::now(), ..pulse }.standstill(7, STANDSTILL), None);
    }

    #[test]
    fn a_slow_grid_is_no_standstill() {
        let patience = |mode, rate_hz| {
            let (config, model, model_sha256) = Default::default();
            let board = Arc::new(Board::new(0));
            Robot { config, model, model_sha256, mode, rate_hz, gauges: Vec::new(), board }.patience()
        };
        assert_eq!(patience("fixed", 1000.0), STANDSTILL);
        assert_eq!(patience("fixed", 0.25), Duration::from_secs(8));
        assert_eq!(patience("fixed", 1e-300), Duration::MAX);
        assert_eq!(patience("event", 0.25), STANDSTILL);
    }
}
