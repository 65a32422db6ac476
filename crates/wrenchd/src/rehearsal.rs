//! The last round once more, while the frames of the next one are still coming: for the processor's caches only.
//!
//! Between rounds a computer does other things, and the code from frame to wrench leaves the caches; fetched again only when the last
//! frame is there, it takes longer than the arithmetic (measured: 29 us instead of 16 on a busy computer). So a second cycle, whose
//! results nobody gets, goes through the last round when the first frame of the next one has come, and outputs through all but
//! the sending of it.

use can::frame::Stamped;
use rig::cycle::{Cycle, Estimate};
use rig::{ModelFile, Rig, RigError};

/// Frames of a round that are rehearsed: more than these are taken as they come.
const FRAMES: usize = 64;

/// Rounds that come in less time leave none to rehearse: the last frame would have to wait, ns.
const ROOM_NS: i64 = 100_000;

/// A cycle beside the real one. Allocates at construction only.
#[derive(Debug)]
pub(crate) struct Rehearsal {
    cycle: Cycle,
    /// Frames since the last instant was complete.
    coming: Vec<Stamped>,
    /// Those of the instant before.
    last: Vec<Stamped>,
    /// Whether the last round has been rehearsed, or cannot be.
    done: bool,
}

impl Rehearsal {
    /// Of the cycle of this robot with its model.
    pub(crate) fn new(rig: &Rig, model: &ModelFile) -> Result<Self, RigError> {
        let frames = || Vec::with_capacity(FRAMES);
        Ok(Self { cycle: Cycle::new(rig, model)?, coming: frames(), last: frames(), done: true })
    }

    /// Notes a frame that came, and whether it completed an instant.
    pub(crate) fn note(&mut self, frame: &Stamped, completed: bool) {
        if self.coming.len() < FRAMES {
            self.coming.push(*frame);
        }
        if completed {
            std::mem::swap(&mut self.coming, &mut self.last);
            self.coming.clear();
            let took_ns = frame.stamp_ns.saturating_sub(self.last[0].stamp_ns);
            self.done = took_ns < ROOM_NS;
        }
    }

    /// Goes through the last round, once, when the next one has begun, if that leaves time for it; `out` gets what it came to.
    pub(crate) fn rehearse(&mut self, mut out: impl FnMut(&Estimate)) {
        if self.done || self.coming.is_empty() {
            return;
        }
        self.done = true;
        for frame in &self.last {
            // The same function as the real cycle's, down to its machine code.
            let out: &mut dyn FnMut(&Estimate) = &mut out;
            self.cycle.push(frame, out);
        }
    }
}
