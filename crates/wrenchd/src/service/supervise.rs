//! The main thread: signals, reload, watchdog, the status line; the cycle goes on without it.

use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rig::Status;
use tokio::signal::unix::{SignalKind, signal};
use tokio::time::{MissedTickBehavior, interval};

use super::clients::Clients;
use super::load::{Loaded, StartError};
use super::{Options, notify};
use crate::bus_errors::Said;
use crate::health::{Health, Totals};
use crate::network::ReloadRequest;
use crate::published::Why;
use crate::recorder::Recorder;
use crate::runner::{BoxedSource, Replacement, Runner};

/// How often the feed is looked at for a change of state.
const LOOK_PERIOD: Duration = Duration::from_millis(100);
/// How often the status line is logged.
const STATUS_PERIOD: Duration = Duration::from_secs(10);
/// No change of state is logged sooner after the last.
const CHANGE_PERIOD: Duration = Duration::from_secs(1);

/// All that the main thread holds.
pub(super) struct Supervisor {
    pub(super) options: Options,
    pub(super) loaded: Loaded,
    pub(super) runner: Runner,
    pub(super) recorder: Option<Recorder>,
    pub(super) health: Arc<Health>,
    pub(super) clients: Clients,
}

/// What is logged and when it last was.
struct Watch {
    /// Status and reason that were logged last.
    state: Option<(Status, Option<Why>)>,
    changed_at: Option<Instant>,
    /// What CAN controllers said that is not logged yet, what was logged last, and when.
    bus: Said,
    bus_logged: Said,
    bus_logged_at: Instant,
    reported_at: Instant,
    reported: Totals,
    /// Turns when the watchdog was last fed.
    fed_turns: u64,
    recorder_failed: bool,
}

enum Wish {
    Stop,
    Reload(Option<ReloadRequest>),
    Look,
    Feed,
}

impl Supervisor {
    /// Supervises until a signal or the end of the cycle.
    pub(super) fn run(mut self) -> Result<ExitCode, StartError> {
        let runtime = tokio::runtime::Builder::new_current_thread()
            .enable_all()
            .build()
            .map_err(StartError::Signals)?;
        runtime.block_on(async {
            self.clients.take_on();
            self.watch().await
        })?;
        notify::stopping();
        Ok(self.stop())
    }

    async fn watch(&mut self) -> Result<(), StartError> {
        let on = |kind| signal(kind).map_err(StartError::Signals);
        let (mut terminate, mut interrupt) = (on(SignalKind::terminate())?, on(SignalKind::interrupt())?);
        let mut hang_up = on(SignalKind::hangup())?;
        let mut look = interval(LOOK_PERIOD);
        let watchdog = notify::watchdog_period();
        let mut feed = interval(watchdog.unwrap_or(Duration::from_secs(3600)));
        look.set_missed_tick_behavior(MissedTickBehavior::Delay);
        feed.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut watch = Watch::new();
        notify::ready("started");
        while !self.runner.has_ended() {
            let wish = tokio::select! {
                _ = terminate.recv() => Wish::Stop,
                _ = interrupt.recv() => Wish::Stop,
                _ = hang_up.recv() => Wish::Reload(None),
                Some(request) = self.clients.reloads.recv() => Wish::Reload(Some(request)),
                _ = look.tick() => Wish::Look,
                _ = feed.tick() => Wish::Feed,
            };
            match wish {
                Wish::Stop => break,
                Wish::Reload(request) => {
                    let outcome = self.reload();
                    // Who asked may have gone.
                    let _ = request.map(|request| request.send(outcome));
                }
                Wish::Look => self.look(&mut watch),
                Wish::Feed => {
                    watch.feed(&self.health);
                }
            }
        }
        Ok(())
    }

    fn look(&mut self, watch: &mut Watch) {
        self.runner.free_retired();
        self.clients.beat();
        if let Some(record) = self.clients.shared.newest() {
            watch.state(record.status, record.outcome.err());
        }
        watch.bus(&self.health, &self.loaded.rig.config.bus.interfaces);
        watch.report(&self.health);
        if let Some(recorder) = self.recorder.as_ref().filter(|recorder| recorder.has_failed())
            && !watch.recorder_failed
        {
            watch.recorder_failed = true;
            tracing::error!("recording into {} has failed; the wrench goes on", recorder.path().display());
        }
    }

    /// Reads everything again and hands it to the cycle; what became of it, in words.
    pub(super) fn reload(&mut self) -> Result<String, String> {
        notify::reloading();
        let outcome = self.try_reload();
        match &outcome {
            Ok(words) => tracing::info!("{words}"),
            Err(words) => tracing::error!("{words}"),
        }
        notify::ready("reloaded");
        outcome
    }

    fn try_reload(&mut self) -> Result<String, String> {
        let (loaded, replacement) = self.replacement().map_err(|error| {
            let hash = &self.loaded.model_sha256;
            format!("not reloaded, the old configuration and model (sha256 {hash}) go on: {error}")
        })?;
        let robot = loaded.robot(&replacement.engine);
        if !self.runner.offer(Box::new(replacement)) {
            self.clients.give_up();
            return Err(
                "not reloaded: the reload before this one has not been taken yet; try again".to_owned()
            );
        }
        self.clients.take_on();
        self.clients.show(robot);
        self.loaded = loaded;
        let Loaded { rig, model_file, model_sha256, .. } = &self.loaded;
        Ok(format!(
            "reloaded config={} model={} model_sha256={model_sha256} mode={}",
            rig.config.file.display(),
            model_file.display(),
            super::load::mode_name(rig.config.publish.mode)
        ))
    }

    fn replacement(&mut self) -> Result<(Loaded, Replacement), StartError> {
        let loaded = Loaded::load(&self.options)?;
        let old = &self.loaded.rig;
        let same_messages = old.messages == loaded.rig.messages;
        let same_interfaces = old.config.bus.interfaces == loaded.rig.config.bus.interfaces;
        if !same_interfaces && self.recorder.is_some() {
            return Err(StartError::Recording { config: self.options.config.clone() });
        }
        let source: Option<BoxedSource> = if same_interfaces && (same_messages || self.recorder.is_some()) {
            None
        } else {
            Some(Box::new(loaded.open_source(false)?.0))
        };
        let engine = loaded.engine()?;
        let rate_hz = loaded.rig.config.publish.rate_hz;
        // Last: what it opens has to be taken on or given up.
        let outputs = self.clients.open(&loaded.rig.config)?;
        Ok((loaded, Replacement { engine, rate_hz, outputs, source }))
    }

    /// Stops the cycle, closes the recording, and says what was done.
    fn stop(self) -> ExitCode {
        let mut code = ExitCode::SUCCESS;
        if let Err(error) = self.runner.stop() {
            tracing::error!("the cycle ended: {error}");
            code = ExitCode::FAILURE;
        }
        if let Some(recorder) = self.recorder {
            let path = recorder.path().to_owned();
            match recorder.finish() {
                Ok(recorded) => {
                    tracing::info!(
                        frames = recorded.frames,
                        lost = recorded.lost,
                        "recorded {}",
                        path.display()
                    );
                }
                Err(error) => {
                    tracing::error!("the recording failed: {error}");
                    code = ExitCode::FAILURE;
                }
            }
        }
        let totals = self.health.totals();
        tracing::info!(
            frames = totals.frames,
            lost_frames = totals.lost_frames,
            rounds = totals.rounds,
            published = totals.published,
            valid = totals.valid,
            overruns = totals.overruns,
            sent = totals.sent,
            unsent = totals.unsent,
            "stopped"
        );
        code
    }
}

impl Watch {
    fn new() -> Self {
        Self {
            state: None,
            changed_at: None,
            bus: Said::default(),
            bus_logged: Said::default(),
            bus_logged_at: Instant::now(),
            reported_at: Instant::now(),
            reported: Totals::default(),
            fed_turns: 0,
            recorder_failed: false,
        }
    }

    /// Logs a change of status or reason, at most one a second.
    fn state(&mut self, status: Status, why: Option<Why>) {
        let soon = self.changed_at.is_some_and(|at| at.elapsed() < CHANGE_PERIOD);
        if self.state == Some((status, why)) || soon {
            return;
        }
        self.state = Some((status, why));
        self.changed_at = Some(Instant::now());
        match why {
            Some(why) => tracing::warn!(status = %status, "no wrench: {why}"),
            None if status == Status::GOOD => tracing::info!(status = %status, "the wrench is good"),
            None => tracing::warn!(status = %status, "the wrench is to be used with care"),
        }
        notify::status(&why.map_or_else(|| format!("wrench {status}"), |why| format!("no wrench: {why}")));
    }

    /// Logs what CAN controllers say: what is new at once, the same again as often as the status line.
    fn bus(&mut self, health: &Health, interfaces: &[String]) {
        self.bus = self.bus.and(health.bus.take());
        if self.bus_logged_at.elapsed() >= STATUS_PERIOD {
            self.bus_logged = Said::default();
        }
        if !self.bus.is_news_after(self.bus_logged) {
            return;
        }
        let said = std::mem::take(&mut self.bus);
        self.bus_logged = self.bus_logged.and(said);
        self.bus_logged_at = Instant::now();
        tracing::warn!("{}", said.words(interfaces));
    }

    /// Logs the status line when it is due.
    fn report(&mut self, health: &Health) {
        let passed = self.reported_at.elapsed();
        if passed < STATUS_PERIOD {
            return;
        }
        let totals = health.totals();
        let new = totals.since(&self.reported);
        self.reported_at = Instant::now();
        self.reported = totals;
        let rate_hz = new.published as f64 / passed.as_secs_f64();
        let valid = if new.published > 0 { 100.0 * new.valid as f64 / new.published as f64 } else { 0.0 };
        let latency_us = health.take_worst_latency_ns() / 1000;
        let lost = new.lost_frames;
        tracing::info!(
            rate_hz = format_args!("{rate_hz:.1}"),
            valid_percent = format_args!("{valid:.2}"),
            frames = new.frames,
            lost_frames = lost,
            bus_errors = new.bus_errors,
            incomplete_rounds = new.rounds.saturating_sub(new.complete_rounds),
            overruns = new.overruns,
            unsent = new.unsent,
            worst_latency_us = latency_us,
            "status"
        );
        notify::status(&format!(
            "{rate_hz:.0} Hz, {valid:.1} % valid, {lost} frames lost, {} overruns, worst latency {latency_us} us",
            new.overruns
        ));
    }

    /// Feeds the watchdog if the cycle has turned since the last time; whether it has.
    fn feed(&mut self, health: &Health) -> bool {
        let turns = health.totals().turns;
        let turned = turns != self.fed_turns;
        self.fed_turns = turns;
        if turned {
            notify::alive();
        }
        turned
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_standing_cycle_does_not_feed_the_watchdog() {
        let (mut watch, health) = (Watch::new(), Health::default());
        health.store(&Totals { turns: 5, ..Totals::default() });
        assert!(watch.feed(&health));
        assert!(!watch.feed(&health));
        health.store(&Totals { turns: 6, ..Totals::default() });
        assert!(watch.feed(&health));
    }
}
