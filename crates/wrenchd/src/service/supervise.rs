//! The main thread: signals, reload, watchdog, the status line; the cycle goes on without it.

use std::process::ExitCode;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rig::Status;
use tokio::signal::unix::{SignalKind, signal};
use tokio::time::{MissedTickBehavior, interval};

use super::load::{Loaded, StartError};
use super::{Options, notify};
use crate::feed::FeedReader;
use crate::health::{Health, Totals};
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
    pub(super) reader: FeedReader,
}

/// What is logged and when it last was.
struct Watch {
    /// Status and reason that were logged last.
    state: Option<(Status, Option<Why>)>,
    changed_at: Option<Instant>,
    reported_at: Instant,
    reported: Totals,
    /// Turns when the watchdog was last fed.
    fed_turns: u64,
    recorder_failed: bool,
}

enum Wish {
    Stop,
    Reload,
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
        runtime.block_on(self.watch())?;
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
                _ = hang_up.recv() => Wish::Reload,
                _ = look.tick() => Wish::Look,
                _ = feed.tick() => Wish::Feed,
            };
            match wish {
                Wish::Stop => break,
                Wish::Reload => self.reload(),
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
        if let Some(record) = self.reader.newest() {
            watch.state(record.status, record.outcome.err());
        }
        watch.report(&self.health);
        if let Some(recorder) = self.recorder.as_ref().filter(|recorder| recorder.has_failed())
            && !watch.recorder_failed
        {
            watch.recorder_failed = true;
            tracing::error!("recording into {} has failed; the wrench goes on", recorder.path().display());
        }
    }

    fn reload(&mut self) {
        notify::reloading();
        match self.replacement() {
            Ok((loaded, replacement)) => {
                if self.runner.offer(Box::new(replacement)) {
                    let hash = &loaded.model_sha256;
                    tracing::info!(
                        config = %loaded.rig.config.file.display(),
                        model = %loaded.model_file.display(),
                        model_sha256 = hash,
                        mode = super::load::mode_name(loaded.rig.config.publish.mode),
                        "reloaded"
                    );
                    self.loaded = loaded;
                } else {
                    tracing::error!(
                        "not reloaded: the reload before this one has not been taken yet; try again"
                    );
                }
            }
            Err(error) => {
                let hash = &self.loaded.model_sha256;
                tracing::error!(
                    "not reloaded, the old configuration and model (sha256 {hash}) go on: {error}"
                );
            }
        }
        notify::ready("reloaded");
    }

    fn replacement(&self) -> Result<(Loaded, Replacement), StartError> {
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
        let outputs = crate::output::open(&loaded.rig.config)?;
        let engine = loaded.engine()?;
        let rate_hz = loaded.rig.config.publish.rate_hz;
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
    use crate::common::{examples, model, rig, simulator, truth};
    use crate::feed::feed;
    use crate::published::Published;
    use crate::station::{Sinks, Station};
    use can::channel::{ChannelSender, channel};
    use rig::config::PublishMode;
    use sim::Simulator;
    use std::fs;
    use std::path::Path;

    /// A daemon in event mode without interfaces, its files in `folder`.
    fn daemon(folder: &Path) -> (Supervisor, ChannelSender) {
        for name in ["arm.urdf", "arm.dbc"] {
            fs::copy(examples().join(name), folder.join(name)).unwrap();
        }
        let text = fs::read_to_string(examples().join("arm.toml")).unwrap();
        let (before, rest) = text.split_once("[publish.can]").unwrap();
        let after = rest.split_once("# Records for Net F/T").unwrap().1;
        let text = format!("{before}#{after}").replace("mode = \"fixed\"", "mode = \"event\"");
        fs::write(folder.join("arm.toml"), text).unwrap();
        let robot = rig(PublishMode::Event);
        fs::write(folder.join("model.toml"), model(&robot, &truth(&robot)).to_toml()).unwrap();
        let (config, model) = (folder.join("arm.toml"), Some(folder.join("model.toml")));
        let options = Options { config, model, record: None };
        let loaded = Loaded::load(&options).unwrap();
        let (sender, source) = channel(1 << 14);
        let (writer, feed) = feed(1 << 12);
        let health = Arc::new(Health::default());
        let sinks = Sinks::new(Vec::new(), writer, health.clone());
        let station = Station::new(Box::new(source) as BoxedSource, loaded.engine().unwrap(), 1000.0, sinks);
        let reader = feed.reader();
        let (runner, _) = Runner::start(station).unwrap();
        (Supervisor { options, loaded, runner, recorder: None, health, reader }, sender)
    }

    /// What is published of the next 700 frames, a tenth of a second.
    fn published(supervisor: &mut Supervisor, sender: &ChannelSender, arm: &mut Simulator) -> Vec<Published> {
        let frames: Vec<_> = arm.take(700).collect();
        let before = supervisor.health.totals().frames;
        assert!(frames.iter().all(|frame| sender.send(*frame)));
        let begun = Instant::now();
        while supervisor.health.totals().frames < before + frames.len() as u64 {
            assert!(begun.elapsed() < Duration::from_secs(20), "the cycle stands still");
            std::thread::sleep(Duration::from_millis(1));
        }
        let records: Vec<_> = std::iter::from_fn(|| supervisor.reader.next_record()).collect();
        assert!(records.windows(2).all(|pair| pair[1].sequence == pair[0].sequence + 1));
        records
    }

    fn force_n(records: &[Published]) -> f64 {
        let forces: Vec<f64> =
            records.iter().filter_map(|record| Some(record.outcome.ok()?.wrench.force_n.norm())).collect();
        assert!(forces.len() > 90, "{} of {} are valid", forces.len(), records.len());
        forces.iter().sum::<f64>() / forces.len() as f64
    }

    #[test]
    fn a_bad_model_changes_nothing_and_a_good_one_is_taken_on() {
        let folder = tempfile::tempdir().unwrap();
        let (mut daemon, sender) = daemon(folder.path());
        let mut arm = simulator(&daemon.loaded.rig, 1000.0);
        let weight_n = 0.4 * 9.80665;
        assert!((force_n(&published(&mut daemon, &sender, &mut arm)) / weight_n - 1.0).abs() < 0.05);
        let (hash, file) = (daemon.loaded.model_sha256.clone(), folder.path().join("model.toml"));
        let good = fs::read_to_string(&file).unwrap();
        for bad in [&good[..good.len() / 2], &good.replace("section_8", "section_7"), ""] {
            fs::write(&file, bad).unwrap();
            daemon.reload();
            assert_eq!(daemon.loaded.model_sha256, hash);
        }
        fs::remove_file(&file).unwrap();
        daemon.reload();
        let last = published(&mut daemon, &sender, &mut arm);
        assert!((force_n(&last) / weight_n - 1.0).abs() < 0.05, "the old model goes on");
        // A model of the same arm with other biases gives another wrench: it was really exchanged.
        let (robot, mut shifted) = (rig(PublishMode::Event), truth(&rig(PublishMode::Event)));
        for gauge in &mut shifted.gauges {
            gauge.bias_counts += 3e6;
        }
        fs::write(&file, model(&robot, &shifted).to_toml()).unwrap();
        daemon.reload();
        assert_ne!(daemon.loaded.model_sha256, hash);
        let begun = Instant::now();
        while !daemon.runner.free_retired() {
            assert!(begun.elapsed() < Duration::from_secs(20), "the cycle does not take it");
            std::thread::sleep(Duration::from_millis(1));
        }
        let next = published(&mut daemon, &sender, &mut arm);
        assert!(next[0].sequence > last[last.len() - 1].sequence, "the sequence counts on");
        let forces: Vec<f64> =
            next.iter().filter_map(|r| Some(r.outcome.ok()?.wrench.force_n.norm())).collect();
        // The first instants after a start are uncertain by themselves; then the biases tell.
        let far = forces.iter().skip(50).filter(|force_n| (*force_n / weight_n - 1.0).abs() > 0.5).count();
        assert!(far > 40 && far == forces.len() - 50, "{far} of {} show the other biases", forces.len());
        let Supervisor { runner, health, .. } = daemon;
        runner.stop().unwrap();
        assert_eq!(health.totals().lost_frames, 0);
    }

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
