//! The reference arm in the simulator, a model that knows its true gauges, and a world with a clock of its own.
#![allow(dead_code, unreachable_pub)]

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::Duration;

use can::frame::Stamped;
use can::source::{Batch, Event, Poll, Source};
use rig::config::{Filter, PublishMode};
use rig::model_file::ModelFile;
use rig::{Config, Rig};
use sim::{Options, Preset, Scenario, Simulator, Trajectory, Truth};
use wrenchd::engine::Now;
use wrenchd::station::Clock;

pub fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config")
}

/// The reference arm, nothing sent on CAN.
pub fn rig(mode: PublishMode) -> Rig {
    rig_with(mode, Filter::default())
}

/// The same with a filter.
pub fn rig_with(mode: PublishMode, filter: Filter) -> Rig {
    let mut config = Config::load(&examples().join("arm.toml")).unwrap();
    config.publish.mode = mode;
    config.publish.can = None;
    config.filter = filter;
    Rig::load(config).unwrap()
}

pub fn truth(rig: &Rig) -> Truth {
    Truth::draw(rig, 7, 0.0)
}

/// What a perfect calibration would have found.
pub fn model(rig: &Rig, truth: &Truth) -> ModelFile {
    truth.known(rig)
}

/// The simulated arm holding a pose with a weight at its tip.
pub fn simulator(rig: &Rig, rate_hz: f64) -> Simulator {
    let scenario: Scenario = Preset::Holds.scenario(&rig.chain, 3).unwrap();
    let scenario = scenario.with_load(0.4, [0.01, 0.0, 0.05]).unwrap();
    let options = Options { rate_hz: Some(rate_hz), ..Options::default() };
    Simulator::new(rig, truth(rig), &scenario, options).unwrap()
}

/// The simulated arm holding one pose for an hour, with this weight (kg, m) at its tip.
pub fn holding(rig: &Rig, rate_hz: f64, load: (f64, [f64; 3])) -> Simulator {
    let mut trajectory = Trajectory::from_pose(vec![0.2, -0.9, 0.8, 0.3, -0.7, 0.4]);
    trajectory.hold(3600.0);
    let scenario = Scenario::of_motion(trajectory).with_load(load.0, load.1).unwrap();
    let options = Options { rate_hz: Some(rate_hz), ..Options::default() };
    Simulator::new(rig, truth(rig), &scenario, options).unwrap()
}

/// The first seconds of the simulation as frames.
pub fn frames(rig: &Rig, rate_hz: f64, seconds: f64) -> Vec<Stamped> {
    let end_ns = sim::START_NS + (seconds * 1e9) as i64;
    simulator(rig, rate_hz).take_while(|frame| frame.stamp_ns < end_ns).collect()
}

/// Time that passes only by waiting.
#[derive(Clone, Debug)]
pub struct TestClock(Arc<AtomicI64>);

impl TestClock {
    pub fn at(start_ns: i64) -> Self {
        Self(Arc::new(AtomicI64::new(start_ns)))
    }

    pub fn now_ns(&self) -> i64 {
        self.0.load(Ordering::Relaxed)
    }

    pub fn set(&self, now_ns: i64) {
        self.0.fetch_max(now_ns, Ordering::Relaxed);
    }
}

impl Clock for TestClock {
    fn now(&self) -> Now {
        Now::simulated(self.now_ns())
    }

    fn sleep_until_ns(&self, monotonic_ns: i64) {
        self.set(monotonic_ns);
    }
}

/// A bus on which each frame can be read once its stamp has passed.
#[derive(Debug)]
pub struct Timetable {
    pub frames: Vec<Stamped>,
    pub next: usize,
    pub clock: TestClock,
}

impl Timetable {
    pub fn new(frames: Vec<Stamped>, clock: TestClock) -> Self {
        Self { frames, next: 0, clock }
    }
}

impl Source for Timetable {
    fn poll(&mut self, batch: &mut Batch, timeout: Duration) -> can::Result<Poll> {
        batch.clear();
        let until_ns = self.clock.now_ns() + timeout.as_nanos() as i64;
        let due_ns = self.frames.get(self.next).map_or(i64::MAX, |frame| frame.stamp_ns);
        self.clock.set(due_ns.min(until_ns));
        while let Some(frame) = self.frames.get(self.next) {
            if frame.stamp_ns > self.clock.now_ns() || batch.room() == 0 {
                break;
            }
            batch.push(Event::received(*frame));
            self.next += 1;
        }
        Ok(if batch.is_empty() { Poll::Idle } else { Poll::Ready })
    }
}
