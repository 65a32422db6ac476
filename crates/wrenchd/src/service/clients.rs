//! The servers of what runs now: opened, taken on and given up together with a configuration.

use std::sync::Arc;
use std::time::Instant;

use rig::Config;
use tokio::sync::{mpsc, watch};
use tokio::task::JoinHandle;

use crate::desk::Desk;
use crate::feed::Feed;
use crate::health::Health;
use crate::network::ports::Ports;
use crate::network::{self, Pulse, ReloadRequest, Robot, Server, Shared};
use crate::output::{self, OpenError, Output};

/// Reloads that may wait at a time.
const RELOADS: usize = 4;

/// Everything that serves clients, and what it shares.
pub(super) struct Clients {
    pub(super) shared: Shared,
    ports: Ports,
    robot: watch::Sender<Arc<Robot>>,
    pulse: watch::Sender<Pulse>,
    /// Reloads that clients ask for.
    pub(super) reloads: mpsc::Receiver<ReloadRequest>,
    /// Opened, but not yet served.
    opened: Vec<Server>,
    tasks: Vec<JoinHandle<()>>,
}

impl Clients {
    pub(super) fn new(robot: Robot, feed: Feed, health: Arc<Health>, desk: Desk) -> Self {
        let (robot, seen) = watch::channel(Arc::new(robot));
        let (pulse, felt) = watch::channel(Pulse::new());
        let (ask, reloads) = mpsc::channel(RELOADS);
        let shared = Shared {
            feed,
            health,
            desk: Arc::new(desk),
            robot: seen,
            pulse: felt,
            reloads: ask,
            rdt: Arc::default(),
            started: Instant::now(),
        };
        Self {
            shared,
            ports: Ports::new(network::descriptors()),
            robot,
            pulse,
            reloads,
            opened: Vec::new(),
            tasks: Vec::new(),
        }
    }

    /// Opens all that a configuration asks for and returns what runs inside the cycle; on an error nothing has changed.
    /// [`Clients::take_on`] or [`Clients::give_up`] follows.
    pub(super) fn open(&mut self, config: &Config) -> Result<Vec<Box<dyn Output>>, OpenError> {
        let opened = output::open(config, &self.shared, &mut self.ports);
        let (outputs, servers) = opened.inspect_err(|_| self.ports.keep_old())?;
        self.opened = servers;
        Ok(outputs)
    }

    /// Serves what was opened last, in place of what was served before; for the inside of the runtime.
    pub(super) fn take_on(&mut self) {
        self.tasks.drain(..).for_each(|task| task.abort());
        self.ports.keep_used();
        self.tasks.extend(self.opened.drain(..).map(tokio::spawn));
    }

    /// Closes what was opened last.
    pub(super) fn give_up(&mut self) {
        self.opened.clear();
        self.ports.keep_old();
    }

    /// Shows clients what runs now.
    pub(super) fn show(&self, robot: Robot) {
        self.robot.send_replace(Arc::new(robot));
    }

    /// Measures rates and signs of life; to be called some times a second.
    pub(super) fn beat(&self) {
        let totals = self.shared.health.totals();
        self.pulse.send_modify(|pulse| pulse.beat(&totals));
    }
}
