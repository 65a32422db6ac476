//! The daemon's cycle on this computer itself, without CAN: frames come through a queue of this process and nothing goes out by a
//! socket. What is left is what the daemon does; what system calls cost in user-mode Linux is not.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime};

use can::channel::channel;
use can::frame::{Frame, Stamped};
use rig::{ModelFile, Rig};
use wrenchd::engine::Engine;
use wrenchd::feed::feed;
use wrenchd::health::Health;
use wrenchd::realtime::CycleClock;
use wrenchd::station::{Sinks, Station};
use wrenchd_tests::{Check, Failure, ensure, scratch};

use crate::peers;
use crate::wire::Arm;

const ROUNDS: usize = 10_000;
const PERIOD: Duration = Duration::from_millis(1);
const RATE_HZ: f64 = 1000.0;
/// What was sent is taken in by then.
const SETTLED: Duration = Duration::from_millis(300);

/// Share of a processor that the cycle's thread takes at 1000 Hz, fixed mode, while `turn` is sent again and again.
pub(crate) fn share(turn: &[Vec<Frame>]) -> Check<f64> {
    let folder = scratch::target_dir()?.join("field/arm");
    let arm = Arm::new(&folder, "mode = \"fixed\"\nrate_hz = 1000.0")?;
    let broken = |error: &dyn std::fmt::Display| Failure::new(error.to_string());
    let rig = Rig::load_file(&arm.config).map_err(|error| broken(&error))?;
    let model = ModelFile::load(&arm.model, &rig).map_err(|error| broken(&error))?;
    let engine = Engine::new(&rig, &model).map_err(|error| broken(&error))?;
    let (bus, source) = channel(1 << 14);
    let (writer, _feed) = feed(1024);
    let health = Arc::new(Health::default());
    let mut station = Station::new(source, engine, RATE_HZ, Sinks::new(Vec::new(), writer, health.clone()));
    let stop = AtomicBool::new(false);
    let spent_s = std::thread::scope(|scope| {
        let cycle = scope.spawn(|| {
            // Not under SCHED_FIFO: on one processor it would spin while it waits for the queue's other end, which cannot run.
            let (clock, begun_s) = (CycleClock::default(), peers::processor_s());
            while !stop.load(Ordering::Relaxed) {
                station.turn(&clock)?;
            }
            Ok::<f64, Failure>(peers::processor_s() - begun_s)
        });
        let begun = Instant::now();
        for number in 0..ROUNDS {
            std::thread::sleep((begun + PERIOD * number as u32).saturating_duration_since(Instant::now()));
            let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
            for frame in &turn[number % turn.len()] {
                bus.send(Stamped { stamp_ns: since.as_nanos() as i64, interface: 0, frame: *frame });
            }
        }
        std::thread::sleep(SETTLED);
        stop.store(true, Ordering::Relaxed);
        let spent_s = cycle.join().map_err(|_| Failure::new("the cycle panicked"))??;
        Ok::<f64, Failure>(spent_s)
    })?;
    let totals = health.totals();
    ensure!(totals.rounds + 2 >= ROUNDS as u64, "of {ROUNDS} rounds: {totals:?}");
    // On a computer that is too busy to serve every point of the grid a turn takes in several rounds: as if all had been served so.
    Ok(spent_s / totals.turns as f64 * RATE_HZ)
}
