//! The cycle takes no memory: an allocator that counts what the marked thread asks for while it turns.
#![allow(unsafe_code, clippy::unwrap_used)]

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use common::{TestClock, Timetable, frames, model, rig, truth};
use rig::config::PublishMode;
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

/// One test: the count is the process's.
#[test]
fn the_cycle_takes_and_gives_back_no_memory() {
    assert!(counted(|| drop(std::hint::black_box(vec![1u8; 100]))) >= 2, "the counter counts");
    for mode in [PublishMode::Fixed, PublishMode::Event] {
        let rig = rig(mode);
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
        let engine = Engine::new(&rig, &model(&rig, &truth(&rig))).unwrap();
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
