//! What the real-time cycle calls takes no memory: a log line to a frame, a frame to a snapshot, an event through middleware
#![allow(clippy::unwrap_used, clippy::panic)] // a test may
#![allow(unsafe_code)]

use std::alloc::{GlobalAlloc, Layout as MemoryLayout, System};
use std::cell::Cell;
use std::path::Path;
use std::time::Duration;

use wrenchd_can::assembly::{Assembler, GaugeBinding, JointBinding, Layout, SignalBinding};
use wrenchd_can::candump::{Interfaces, LogEvent, LogReader, MAX_LINE, StampDigits, format_line, parse_line};
use wrenchd_can::channel::channel;
use wrenchd_can::dbc::Dbc;
use wrenchd_can::fault::{FaultInjector, Faults};
use wrenchd_can::source::{Batch, Source};
use wrenchd_can::tap::tap;

thread_local! {
    static TAKEN: Cell<u64> = const { Cell::new(0) };
}

struct Counting;

// SAFETY: everything is handed to the system's allocator; the count is this thread's own and takes no memory.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: MemoryLayout) -> *mut u8 {
        TAKEN.with(|taken| taken.set(taken.get() + 1));
        // SAFETY: as the caller promised.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: MemoryLayout) {
        // SAFETY: as the caller promised.
        unsafe { System.dealloc(memory, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn taken(work: impl FnOnce()) -> u64 {
    let before = TAKEN.with(Cell::get);
    work();
    TAKEN.with(Cell::get) - before
}

#[test]
fn the_hot_path_takes_no_memory() {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let dbc = Dbc::read(&data.join("arm.dbc")).unwrap();
    let bind = |name: &str| SignalBinding { spec: dbc.signal(name).unwrap(), interface: 0, to_si: 1.0 };
    let gauge = |counts: &str| GaugeBinding {
        name: counts.into(),
        counts: bind(counts),
        saturated: Some(bind("Strain12.Saturated1")),
        sequence: (counts == "Strain12.Counts1").then(|| bind("Strain12.Sequence12")),
        temperature: Some(bind("GaugeTemperatures.Temperature1")),
        delay_ns: None,
    };
    let joint = JointBinding {
        name: "j".into(),
        position: bind("Joints12.Position1"),
        velocity: None,
        delay_ns: None,
    };
    let layout = Layout {
        gauges: vec![gauge("Strain12.Counts1"), gauge("Strain34.Counts3")],
        joints: vec![joint],
        stale_after_ns: 20_000_000,
        temperature_stale_after_ns: 5_000_000_000,
    };
    let mut reader = LogReader::open(&data.join("recorded.log"), Interfaces::fixed(&["can0"])).unwrap();
    let mut frames = Vec::new();
    while let Some(LogEvent::Frame(stamped)) = reader.next_event().unwrap() {
        frames.push(stamped);
    }
    let mut assembler = Assembler::new(&layout).unwrap();
    let (sender, source) = channel(1024);
    let faults = Faults {
        drop: 0.1,
        duplicate: 0.1,
        reorder: 0.1,
        reorder_frames: 3,
        corrupt: 0.1,
        foreign: 0.1,
        ..Default::default()
    };
    let (mut source, mut copies) = tap(FaultInjector::new(source, faults, 1), 4096);
    let mut batch = Batch::new(64);
    // The first use of a channel's waker may take memory; the cycle's does not.
    frames.iter().take(8).for_each(|frame| assert!(sender.send(*frame)));
    source.poll(&mut batch, Duration::ZERO).unwrap();
    let (mut snapshots, mut line) = (0, [0; MAX_LINE]);
    let count = taken(|| {
        for chunk in frames.chunks(8) {
            for stamped in chunk {
                let len = format_line(&mut line, stamped, "can0", StampDigits::Nanos);
                assert!(parse_line(&line[..len]).is_ok());
                assert!(sender.send(*stamped));
            }
            source.poll(&mut batch, Duration::ZERO).unwrap();
            for event in batch.events() {
                if let Some(stamped) = event.stamped() {
                    snapshots += assembler.push(stamped).len();
                }
            }
            while copies.next_copy().is_some() {}
        }
    });
    assert_eq!(count, 0);
    assert!(snapshots > 40, "{snapshots}");
}
