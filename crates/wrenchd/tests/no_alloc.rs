//! The cycle takes no memory: an allocator that counts what the marked thread asks for while it turns.
#![allow(unsafe_code, clippy::unwrap_used)]

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use common::{TestClock, Timetable, frames, model, rig_with, truth};
use rig::Rig;
use rig::config::{Filter, PublishMode};
use rig::model_file::{Arm, ArmDeviation, ArmJoint, EffectShape, ModelFile, SensorTerm};
use wrenchd::engine::Engine;
use wrenchd::feed::feed;
use wrenchd::health::Health;
use wrenchd::merge::Merge;
use wrenchd::station::{Sinks, Station};

struct Counting;

static COUNTED: AtomicU64 = AtomicU64::new(0);

thread_local! {
    static ARMED: Cell<bool> = const { Cell::new(false) };
}

fn count() {
    if ARMED.try_with(Cell::get).unwrap_or(false) {
        COUNTED.fetch_add(1, Ordering::Relaxed);
    }
}

// SAFETY: every call is handed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promise is handed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        // SAFETY: the caller's promise is handed on.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: the caller's promise is handed on.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Allocations and releases of this thread while `work` runs.
fn counted(work: impl FnOnce()) -> u64 {
    let before = COUNTED.load(Ordering::Relaxed);
    ARMED.with(|armed| armed.set(true));
    work();
    ARMED.with(|armed| armed.set(false));
    COUNTED.load(Ordering::Relaxed) - before
}

/// The model of an arm that was calibrated too: soft joints, terms of every kind, uncertainty that arm and gauges share.
fn with_arm_and_terms(mut model: ModelFile, rig: &Rig) -> ModelFile {
    let effects = [
        EffectShape::Temperature { lag_s: 55.0, reference_c: 24.0 },
        EffectShape::Power { order: 2 },
        EffectShape::Creep { tau_s: 30.0 },
        EffectShape::Hysteresis { width: 0.06 },
    ];
    for sensor in &mut model.sensors {
        sensor.scale_counts = 500_000.0;
        let term = |(k, effect): (usize, &EffectShape)| SensorTerm {
            effect: *effect,
            coefficient_counts: 50.0,
            coefficient_sigma_counts: 5.0,
            start_sigma: 0.1,
            covariance: (0..8 + k).map(|i| if i == 7 + k { 25.0 } else { 0.0 }).collect(),
        };
        sensor.terms = effects.iter().enumerate().map(term).collect();
    }
    let joint = |joint: &model::chain::Joint| ArmJoint {
        name: joint.name.clone(),
        flexibility_rad_per_nm: if joint.coordinate.is_some() { 1e-4 } else { 0.0 },
        ..ArmJoint::default()
    };
    let deviation = ArmDeviation {
        gravity_turn_rad: [1e-5, 0.0, 0.0],
        joints: vec![[1e-6; 12]; rig.chain.joints.len()],
        gauges: vec![vec![0.0; 11]; model.sensors.len()],
    };
    model.arm = Some(Arm {
        joints: rig.chain.joints.iter().map(joint).collect(),
        deviations: vec![deviation; 4],
        ..Arm::default()
    });
    model
}

/// One test: the count is the process's.
#[test]
fn the_cycle_takes_and_gives_back_no_memory() {
    assert!(counted(|| drop(std::hint::black_box(vec![1u8; 100]))) >= 2, "the counter counts");
    let none = Filter::default();
    let both = Filter { cutoff_hz: Some(50.0), delay_s: Some(0.01) };
    let trials = [
        (PublishMode::Fixed, none.clone(), false),
        (PublishMode::Event, none.clone(), false),
        (PublishMode::Fixed, none, true),
        (PublishMode::Event, both, false),
    ];
    for (mode, filter, as_built) in trials {
        let rig = rig_with(mode, filter);
        let nominal = model(&rig, &truth(&rig));
        let model = if as_built { with_arm_and_terms(nominal, &rig) } else { nominal };
        let mut frames = frames(&rig, 1000.0, 1.5);
        // Faults on the way: a lost frame now and then, a duplicate, a frame of nobody's.
        let mut number = 0;
        frames.retain(|_| {
            number += 1;
            number % 97 != 0
        });
        let again = frames[500];
        frames.insert(501, again);
        let clock = TestClock::at(sim::START_NS - 30_000_000);
        let (writer, feed) = feed(256);
        let health = Arc::new(Health::default());
        let engine = Engine::new(&rig, &model).unwrap();
        let source = Merge::new(Timetable::new(frames, clock.clone()), 1, 512);
        let (source, mut copies) = can::tap::tap(source, 1 << 15);
        let mut reader = feed.reader();
        let mut station =
            Station::new(source, engine, 1000.0, Sinks::new(Vec::new(), writer, health.clone()));
        // From the very first turn to silence and the end.
        let used = counted(|| {
            while clock.now_ns() < sim::START_NS + 1_700_000_000 {
                station.turn(&clock).unwrap();
            }
            station.stop(&clock);
        });
        let totals = health.totals();
        assert!(totals.valid > 1000 && totals.rounds > 1400, "{mode:?}: {totals:?}");
        assert!(reader.newest().is_some() && copies.next_copy().is_some());
        assert_eq!(used, 0, "{mode:?}: allocations and releases in {} turns", totals.turns);
    }
}
