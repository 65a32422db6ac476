//! Whole turns: schedule, drain, publish, exchange, and the thread.

use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use can::channel::channel;
use rig::config::PublishMode;
use wrenchd::desk::desk;
use wrenchd::engine::Engine;
use wrenchd::feed::{FeedReader, feed};
use wrenchd::health::{Health, Totals};
use wrenchd::output::{Output, OutputCounts};
use wrenchd::published::{Dispatch, Published, Why};
use wrenchd::runner::Runner;
use wrenchd::station::{Sinks, Station};

use crate::common::{TestClock, Timetable, frames, model, rig, truth};

/// Keeps what it is given.
#[derive(Clone, Default)]
struct Kept(Arc<Mutex<Vec<Dispatch>>>);

impl Output for Kept {
    fn publish(&mut self, record: &Dispatch) {
        self.0.lock().unwrap().push(*record);
    }

    fn counts(&self) -> OutputCounts {
        OutputCounts { sent: self.0.lock().unwrap().len() as u64, dropped: 0 }
    }
}

struct World {
    station: Station<Timetable>,
    clock: TestClock,
    health: Arc<Health>,
    reader: FeedReader,
    kept: Kept,
}

fn engine(mode: PublishMode) -> Engine {
    let rig = rig(mode);
    Engine::new(&rig, &model(&rig, &truth(&rig))).unwrap()
}

fn world(mode: PublishMode, rate_hz: f64, seconds: f64) -> World {
    let frames = frames(&rig(mode), 1000.0, seconds);
    let clock = TestClock::at(sim::START_NS - 1_000_000);
    let (writer, feed) = feed(4096);
    let health = Arc::new(Health::default());
    let kept = Kept::default();
    let sinks = Sinks::new(vec![Box::new(kept.clone())], writer, health.clone());
    let station = Station::new(Timetable::new(frames, clock.clone()), engine(mode), rate_hz, sinks);
    World { station, clock, health, reader: feed.reader(), kept }
}

impl World {
    fn turn_until(&mut self, seconds: f64) {
        let end_ns = sim::START_NS + (seconds * 1e9) as i64;
        while self.clock.now_ns() < end_ns {
            self.station.turn(&self.clock).unwrap();
        }
    }

    fn records(&mut self) -> Vec<Published> {
        std::iter::from_fn(|| self.reader.next_record()).collect()
    }
}

#[test]
fn the_grid_publishes_on_time_and_counts_what_it_missed() {
    let mut world = world(PublishMode::Fixed, 500.0, 1.0);
    world.turn_until(0.5);
    let before = world.health.totals();
    assert_eq!(before.overruns, 0);
    // The computer was busy for 21 ms: of ten points the first is served late, nine are skipped.
    world.clock.set(world.clock.now_ns() + 21_000_000);
    world.turn_until(1.0);
    let totals = world.health.totals();
    assert_eq!(totals.overruns, 9);
    assert_eq!(totals.published + totals.overruns, 500 + 1, "every point of the grid was served or counted");
    let records = world.records();
    let sent: Vec<Dispatch> = records.iter().map(Published::dispatch).collect();
    assert_eq!(sent, *world.kept.0.lock().unwrap(), "outputs and feed get the same");
    assert_eq!((records.len() as u64, totals.sent), (totals.published, totals.published));
    assert!(records.iter().enumerate().all(|(k, r)| r.sequence == k as u64));
    let valid = records.iter().filter(|r| r.is_valid()).count() as u64;
    assert_eq!(valid, totals.valid);
    assert!(valid > totals.published - 10, "{valid}");
    let worst_age_ns = records.iter().filter(|r| r.is_valid()).map(|r| r.age_ns).max().unwrap();
    assert!(
        worst_age_ns < 4_000_000,
        "a 1 kHz bus is at most a round and its sending time old: {worst_age_ns}"
    );
    assert_eq!(totals.frames as usize, world.station.source.next);
}

#[test]
fn event_mode_loses_nothing_and_says_when_the_bus_falls_silent() {
    let mut world = world(PublishMode::Event, 1000.0, 0.5);
    world.turn_until(0.7);
    let records = world.records();
    let silent: Vec<&Published> = records.iter().filter(|r| r.outcome == Err(Why::Stale)).collect();
    assert_eq!(silent.len(), 5, "at 20, 70, 120, 170 and 220 ms of silence");
    assert!(silent[0].published_ns - sim::START_NS < 521_000_000);
    let spoken = records.len() - silent.len();
    assert!(spoken as u64 >= world.health.totals().complete_rounds && spoken >= 498);
    assert!(records.iter().enumerate().all(|(k, r)| r.sequence == k as u64));
    assert!(world.health.take_worst_latency_ns() < 1_000_000);
    assert_eq!(world.health.take_worst_latency_ns(), 0);
}

#[test]
fn an_exchange_keeps_counting() {
    let mut world = world(PublishMode::Fixed, 1000.0, 1.0);
    world.turn_until(0.2);
    let mut other = engine(PublishMode::Event);
    let mut outputs: Vec<Box<dyn Output>> = Vec::new();
    world.station.exchange(&mut other, 1000.0, &mut outputs);
    assert_eq!((other.mode(), outputs.len()), (PublishMode::Fixed, 1), "the old parts are handed back");
    let before = world.records().len() as u64;
    let Totals { sent, rounds, .. } = world.health.totals();
    world.turn_until(0.4);
    let after = world.records();
    assert_eq!(after[0].sequence, before);
    assert!(after.iter().filter(|r| r.is_valid()).count() > 190);
    let totals = world.health.totals();
    assert!(totals.rounds > rounds + 190 && totals.complete_rounds <= totals.rounds, "{totals:?}");
    assert_eq!(totals.sent, sent, "what the old output sent still counts, the new has none");
}

#[test]
fn the_thread_turns_and_stops_with_a_last_record() {
    let rig = rig(PublishMode::Fixed);
    let (sender, source) = channel(1 << 16);
    let (writer, feed) = feed(1 << 14);
    let health = Arc::new(Health::default());
    let engine = Engine::new(&rig, &model(&rig, &truth(&rig))).unwrap();
    let sinks = Sinks::new(Vec::new(), writer, health.clone());
    let mut reader = feed.reader();
    let (_desk, inbox) = desk();
    let source: Box<dyn can::source::Source + Send> = Box::new(source);
    let station = Station::new(source, engine, 1000.0, sinks);
    let (runner, refused) = Runner::start(station, inbox).unwrap();
    assert!(refused.is_none_or(|refused| refused.contains("SCHED_FIFO")));
    for frame in frames(&rig, 1000.0, 0.2) {
        assert!(sender.send(frame));
    }
    let begun = Instant::now();
    while health.totals().rounds < 198 && begun.elapsed() < Duration::from_secs(20) {
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(!runner.has_ended());
    runner.stop().unwrap();
    let records: Vec<Published> = std::iter::from_fn(|| reader.next_record()).collect();
    assert!(health.totals().rounds >= 198 && records.len() as u64 == health.totals().published);
    assert!(records.iter().enumerate().all(|(k, r)| r.sequence == k as u64));
    assert_eq!(records.last().unwrap().outcome, Err(Why::Stopping));
}
