//! A frame whose bits turned wrongs all gauges that it carries, and two of them may hide each other from the spare ones.
//!
//! What comes of the hand changes the gauges of more than one frame. So where the wrench seems to change from one instant to the next, and the
//! gauges of a single frame say so while all others say under the *former* wrench what they said before, the change may be that frame's alone:
//! the wrench is uncertain by it. A change that stays is believed.

use std::collections::BTreeMap;

use model::estimator::{Solution, WrenchEstimator};
use model::spatial::{Tip, Wrench};

use crate::Rig;

/// A gauge says something new beyond so many standard deviations of a change.
const CHANGED_SIGMA: f64 = 8.0;

/// The others say nothing new within so many.
const SAME_SIGMA: f64 = 5.0;

/// A change that is seen again so many times was none of bits.
const BELIEVED_AFTER: u32 = 3;

/// What was said longer ago is no measure, ns.
const LONG_AGO_NS: i64 = 100_000_000;

/// What the last instant that was believed had.
#[derive(Clone, Copy, Debug)]
struct Last {
    instant_ns: i64,
    wrench: Wrench<Tip>,
}

/// Watches for changes that a single frame may have made. Allocates at construction only.
#[derive(Clone, Debug)]
pub(super) struct OneFrame {
    /// The message of each gauge.
    message_of: Vec<usize>,
    /// Messages that carry more than one gauge.
    shared: Vec<usize>,
    last: Option<Last>,
    /// What each gauge said then beyond the wrench of then, with its variance (counts, counts^2); none where it was not used.
    before: Vec<Option<(f64, f64)>>,
    /// The same now, under the wrench of then.
    now: Vec<Option<(f64, f64)>>,
    doubted: u32,
}

impl OneFrame {
    /// For the messages that carry a robot's gauges.
    pub(super) fn new(rig: &Rig) -> Self {
        let mut messages = BTreeMap::new();
        let message = |gauge: &can::assembly::GaugeBinding| {
            let next = messages.len();
            *messages.entry((gauge.counts.interface, gauge.counts.spec.message_id)).or_insert(next)
        };
        let message_of: Vec<usize> = rig.layout.gauges.iter().map(message).collect();
        let carries = |message: usize| message_of.iter().filter(|of| **of == message).count();
        let n = message_of.len();
        Self {
            shared: (0..messages.len()).filter(|message| carries(*message) > 1).collect(),
            message_of,
            last: None,
            before: vec![None; n],
            now: vec![None; n],
            doubted: 0,
        }
    }

    /// How far the wrench of the estimator's last estimate may be off for a single frame's sake: by what it changed (N, Nm).
    pub(super) fn doubt(
        &mut self,
        instant_ns: i64,
        estimator: &WrenchEstimator,
        solution: &Solution,
    ) -> Option<[f64; 6]> {
        if self.shared.is_empty() {
            return None;
        }
        let recent = |last: &Last| (0..LONG_AGO_NS).contains(&(instant_ns - last.instant_ns));
        let Some(last) = self.last.filter(recent) else {
            self.believe(instant_ns, estimator, solution);
            return None;
        };
        gather(&mut self.now, estimator, &last.wrench);
        let may_be = self.shared.iter().any(|message| self.is_of(*message));
        if !may_be || self.doubted >= BELIEVED_AFTER {
            self.believe(instant_ns, estimator, solution);
            return None;
        }
        self.doubted += 1;
        let changed = solution.wrench.to_vector() - last.wrench.to_vector();
        Some(std::array::from_fn(|k| changed[k].abs()))
    }

    /// Whether all that changed came in this message.
    fn is_of(&self, message: usize) -> bool {
        let mut is_new = false;
        for ((before, now), of) in self.before.iter().zip(&self.now).zip(&self.message_of) {
            let (Some((before, old)), Some((now, new))) = (before, now) else { continue };
            let sigmas = (now - before).abs() / (old + new).sqrt();
            if *of == message {
                is_new |= sigmas > CHANGED_SIGMA;
            } else if sigmas > SAME_SIGMA {
                return false;
            }
        }
        is_new
    }

    fn believe(&mut self, instant_ns: i64, estimator: &WrenchEstimator, solution: &Solution) {
        self.doubted = 0;
        self.last = Some(Last { instant_ns, wrench: solution.wrench });
        gather(&mut self.before, estimator, &solution.wrench);
    }
}

/// What each gauge says beyond this wrench, with the variance that is new at each instant.
fn gather(into: &mut [Option<(f64, f64)>], estimator: &WrenchEstimator, wrench: &Wrench<Tip>) {
    into.fill(None);
    for (gauge, off_counts, variance_counts2) in estimator.beyond(wrench) {
        into[gauge] = Some((off_counts, variance_counts2));
    }
}
