//! Frames of a list through the injector, and every fault in turn, as long tests want them

use std::time::Duration;

use super::{FaultInjector, Faults};
use crate::error::Result;
use crate::frame::Stamped;
use crate::source::{Batch, Event, Poll, Source};

/// Each kind of fault lasts so long at a time, ns: no multiple of what an arm does
const TURN_NS: i64 = 7_000_000_000;

/// Frames of a list as a source
struct Listed(std::vec::IntoIter<Stamped>);

impl Source for Listed {
    fn poll(&mut self, batch: &mut Batch, _timeout: Duration) -> Result<Poll> {
        batch.clear();
        while batch.room() > 0 {
            let Some(frame) = self.0.next() else { break };
            batch.push(Event::received(frame));
        }
        Ok(if batch.is_empty() { Poll::End } else { Poll::Ready })
    }
}

/// What an injector with this seed makes of frames, in the order in which they come then
pub fn broken(frames: Vec<Stamped>, faults: Faults, seed: u64) -> Vec<Stamped> {
    let mut injector = FaultInjector::new(Listed(frames.into_iter()), faults, seed);
    let (mut batch, mut out) = (Batch::new(64), Vec::new());
    while matches!(injector.poll(&mut batch, Duration::ZERO), Ok(Poll::Ready | Poll::Idle)) {
        out.extend(batch.events().iter().filter_map(Event::stamped).copied());
    }
    out
}

/// Frames (stamps in ns, from `begin_ns` on) through every fault in turn, seven seconds each, over and over, with rest between them
///
/// The same for the same seed; at most the frames of one turn are held.
pub fn in_turn(
    frames: impl Iterator<Item = Stamped>,
    begin_ns: i64,
    seed: u64,
) -> impl Iterator<Item = Stamped> {
    let mut frames = frames.peekable();
    let turns = (0..).zip(every_fault().into_iter().cycle());
    let broken_turns = turns.map_while(move |(turn, faults)| {
        let until_ns = begin_ns + (turn + 1) * TURN_NS;
        let mut whole = Vec::new();
        while let Some(frame) = frames.next_if(|frame| frame.stamp_ns < until_ns) {
            whole.push(frame);
        }
        (!whole.is_empty()).then(|| broken(whole, faults, seed.wrapping_add(turn.cast_unsigned())))
    });
    broken_turns.flatten()
}

/// Every fault that there is, as often as a bad bus has it, and rest between them
fn every_fault() -> [Faults; 12] {
    let none = Faults::default();
    let all = Faults {
        drop: 0.005,
        burst: 0.0005,
        burst_frames: 30,
        duplicate: 0.005,
        reorder: 0.005,
        reorder_frames: 9,
        corrupt: 0.005,
        shorten: 0.005,
        delay: 0.005,
        delay_ns: 5_000_000,
        stuck: 0.0005,
        stuck_frames: 30,
        foreign: 0.005,
    };
    [
        none,
        Faults { drop: 0.02, ..none },
        Faults { duplicate: 0.02, ..none },
        Faults { reorder: 0.02, reorder_frames: 9, ..none },
        Faults { shorten: 0.02, ..none },
        Faults { foreign: 0.02, ..none },
        none,
        Faults { corrupt: 0.02, ..none },
        Faults { delay: 0.02, delay_ns: 5_000_000, ..none },
        Faults { burst: 0.002, burst_frames: 100, ..none },
        Faults { stuck: 0.002, stuck_frames: 50, ..none },
        all,
    ]
}
