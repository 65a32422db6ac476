//! Whether a frame is news: the clock's steps, overtaken frames, counters, duplicates

use super::{Assembler, Role};
use crate::frame::Stamped;
use crate::sequence::Step;

/// Stamps that differ by more than this from the latest are a step of the clock, or a silent bus
const STEP_NS: i64 = 1_000_000_000;

impl Assembler {
    /// Whether a frame is news: stamps, counters, duplicates
    pub(super) fn accept(&mut self, message: usize, stamped: &Stamped) -> bool {
        let stamp_ns = stamped.stamp_ns;
        self.follow_clock(stamp_ns);
        let duplicate_ns = self.rhythm.duplicate_ns();
        let previous = &mut self.previous[message];
        if previous.stamp_ns.is_some_and(|last| stamp_ns < last) {
            self.counts.late += 1;
            return false;
        }
        let mut counted = false;
        let (mut repeated, mut behind) = (false, false);
        for value in &self.pending {
            if let Role::Sequence(number) = self.compiled.roles[usize::from(value.slot)] {
                counted = true;
                let step = self.sequences[usize::from(number)].observe(value.raw);
                if self.compiled.counts_cycles[usize::from(number)] {
                    self.cycles.observe(usize::from(number), step);
                }
                match step {
                    Step::Repeated => repeated = true,
                    Step::Behind => behind = true,
                    Step::First | Step::Next | Step::Gap(_) | Step::Jump => {}
                }
            }
        }
        if repeated || behind {
            self.cycles.dismiss();
        }
        if repeated {
            self.counts.repeated += 1;
            self.mark_repeated();
            return false;
        }
        if behind {
            self.counts.late += 1;
            return false;
        }
        let data = stamped.frame.padded();
        let soon = previous.stamp_ns.is_some_and(|last| stamp_ns - last < duplicate_ns || stamp_ns == last);
        if !counted && soon && previous.data == *data {
            self.counts.duplicates += 1;
            return false;
        }
        previous.stamp_ns = Some(stamp_ns);
        previous.data = *data;
        true
    }

    fn mark_repeated(&mut self) {
        for value in &self.pending {
            if let Role::Streamed(stream) = self.compiled.roles[usize::from(value.slot)] {
                self.streams[usize::from(stream)].repeat(self.round);
            }
        }
    }

    /// After a step of the stamps the rounds begin anew; ages are kept across a step back
    fn follow_clock(&mut self, stamp_ns: i64) {
        let step_ns = self.latest_ns.map_or(0, |latest| stamp_ns.saturating_sub(latest));
        if step_ns.abs() <= STEP_NS {
            self.latest_ns = Some(self.latest_ns.map_or(stamp_ns, |latest| latest.max(stamp_ns)));
            return;
        }
        if step_ns < 0 {
            self.counts.steps_back += 1;
            for held in &mut self.held {
                held.at_ns = held.at_ns.saturating_add(step_ns);
                held.stamp_ns = held.stamp_ns.saturating_add(step_ns);
            }
        } else {
            self.counts.steps_forward += 1;
        }
        self.latest_ns = Some(stamp_ns);
        self.rhythm.lose_origin();
        self.ended_stamp_ns = i64::MIN;
        self.cycles.forget();
        for previous in &mut self.previous {
            previous.stamp_ns = None;
        }
        for stream in &mut self.streams {
            stream.forget_stamp();
        }
        if self.open {
            self.open = false;
            self.counts.discarded_rounds += 1;
            for stream in &mut self.streams {
                stream.end_round(self.round);
            }
        }
    }
}
