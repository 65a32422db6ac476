//! How many cycles of the boards passed from one round to the next, by the counters in their frames
//!
//! Stamps cannot tell a frame that was lost from one that was delayed; a counter can. Each counter's frames are numbered by
//! cycle; a round's cycle is the one on which most of its counters agree, so that neither a lost frame nor one board that began
//! anew misleads.

use crate::sequence::Step;

/// One counter
#[derive(Clone, Copy, Debug, Default)]
struct Counter {
    /// Cycle of its last frame; none before its first, and after it began anew
    cycle: Option<i64>,
    /// What its frame at hand adds; none where that is not known
    step: Option<i64>,
    /// Whether the frame at hand carries it
    hit: bool,
    /// Whether a frame of the open round carried it
    arrived: bool,
    /// Frames in a row that came after their round had ended
    behind: u8,
    /// Its last frame seemed to come after a gap
    skipped: bool,
}

/// After so many frames in a row behind their round a counter is numbered anew: boards whose clocks drift past each other
const MAX_IN_A_ROW: u8 = 3;

/// All counters of a robot
#[derive(Clone, Debug)]
pub(super) struct Cycles {
    counters: Vec<Counter>,
    /// Cycle of the last round that was handed on, if its counters said so
    last: Option<i64>,
    /// Cycle of the last round that ended with a counter
    ended: Option<i64>,
}

/// Where a counted frame belongs
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Place {
    /// To a round that has ended, so many before the last one
    Ended(i64),
    /// To the round that is open: by the counters in it or, where it has none yet, as the one after the last
    Open,
    /// To a later round
    Later,
}

impl Cycles {
    pub(super) fn new(counters: usize) -> Self {
        Self { counters: vec![Counter::default(); counters], last: None, ended: None }
    }

    /// What a counter says about the frame at hand
    pub(super) fn observe(&mut self, number: usize, step: Step) {
        let counter = &mut self.counters[number];
        counter.hit = true;
        counter.step = match step {
            Step::Next => Some(1),
            Step::Gap(missing) => i64::try_from(missing).ok().map(|missing| missing + 1),
            Step::Repeated | Step::Behind => Some(0),
            Step::First | Step::Jump => None,
        };
    }

    /// Where the frame at hand belongs; `None` where its counter does not say
    pub(super) fn place(&self) -> Option<Place> {
        let hit = self.counters.iter().find(|counter| counter.hit)?;
        let cycle = hit.cycle? + hit.step?;
        let ended = self.ended.unwrap_or(i64::MIN);
        Some(match self.open() {
            _ if cycle <= ended => Place::Ended(ended - cycle),
            Some(open) if cycle > open => Place::Later,
            _ => Place::Open,
        })
    }

    /// Cycle of the open round, or of the next: by the counters in it, or as the one after the last
    fn open(&self) -> Option<i64> {
        let counted =
            self.counters.iter().filter(|counter| counter.arrived).find_map(|counter| counter.cycle);
        counted.or(self.ended.map(|ended| ended + 1))
    }

    /// Whether there are counters that count
    pub(super) fn count(&self) -> bool {
        self.ended.is_some()
    }

    /// Whether a frame of the open round was counted
    pub(super) fn any_here(&self) -> bool {
        self.counters.iter().any(|counter| counter.arrived)
    }

    /// The frame at hand takes its place: in the open round, or not
    pub(super) fn settle(&mut self, open: bool) {
        let here = self.open();
        for counter in self.counters.iter_mut().filter(|counter| counter.hit) {
            counter.hit = false;
            counter.skipped = counter.step.is_some_and(|step| step > 1);
            counter.cycle = counter.cycle.zip(counter.step).map(|(cycle, step)| cycle + step);
            if open && counter.cycle.is_some() && counter.cycle <= self.ended {
                // It counts more slowly than the others, as a message sent in every other cycle does.
                counter.cycle = here;
            }
            counter.arrived |= open;
            counter.behind = if open { 0 } else { counter.behind + 1 };
            if counter.behind >= MAX_IN_A_ROW {
                counter.behind = 0;
                counter.cycle = None;
            }
        }
    }

    /// The frame at hand is no news. Where its counter began anew, or had just seemed to skip some as bits that turned make it, nothing is known of
    /// its cycle until the others tell
    pub(super) fn dismiss(&mut self) {
        for counter in self.counters.iter_mut().filter(|counter| counter.hit) {
            counter.hit = false;
            if std::mem::take(&mut counter.skipped) || counter.step.is_none() {
                counter.cycle = None;
            }
        }
    }

    /// Nothing is known of where the counters stand against each other; the frame at hand is still to take its place
    pub(super) fn forget(&mut self) {
        self.last = None;
        self.ended = None;
        for counter in &mut self.counters {
            *counter = Counter { hit: counter.hit, ..Counter::default() };
        }
    }

    /// The open round's cycle: the one on which most of its counters agree
    fn agreed(&self) -> Option<i64> {
        let here = || self.counters.iter().filter(|counter| counter.arrived);
        let votes = |cycle: i64| here().filter(|counter| counter.cycle == Some(cycle)).count();
        here().filter_map(|counter| counter.cycle).max_by_key(|cycle| (votes(*cycle), *cycle))
    }

    /// Cycles from the last round that was handed on to the open one
    pub(super) fn passed(&self) -> Option<u32> {
        let passed = self.agreed()? - self.last?;
        u32::try_from(passed).ok().filter(|passed| *passed > 0)
    }

    /// Ends a round: cycles since the last that was handed on, if this one is
    pub(super) fn close(&mut self, handed_on: bool) -> Option<u32> {
        let (agreed, passed) = (self.agreed(), self.passed());
        if self.any_here() {
            // Where all began anew the numbers do, too.
            let cycle = agreed.unwrap_or(0);
            for counter in &mut self.counters {
                if counter.arrived || agreed.is_none() {
                    counter.cycle = counter.arrived.then_some(cycle);
                }
                counter.arrived = false;
            }
            self.ended = Some(cycle);
            if handed_on {
                self.last = Some(cycle);
            }
        } else if handed_on {
            self.last = None;
        }
        passed.filter(|_| handed_on)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round(cycles: &mut Cycles, steps: &[Option<Step>]) -> Option<u32> {
        for (number, step) in steps.iter().enumerate() {
            if let Some(step) = step {
                cycles.observe(number, *step);
                cycles.settle(true);
            }
        }
        cycles.close(true)
    }

    #[test]
    fn a_lost_frame_and_a_board_that_begins_anew_are_outvoted() {
        use Step::*;
        let mut cycles = Cycles::new(3);
        assert_eq!(round(&mut cycles, &[Some(First), Some(First), Some(First)]), None);
        assert_eq!(round(&mut cycles, &[Some(Next), Some(Next), Some(Next)]), Some(1));
        assert_eq!(round(&mut cycles, &[Some(Next), None, Some(Next)]), Some(1));
        assert_eq!(round(&mut cycles, &[Some(Next), Some(Gap(1)), Some(Jump)]), Some(1));
        assert_eq!(round(&mut cycles, &[Some(Gap(4)), Some(Gap(4)), Some(Gap(4))]), Some(5));
        assert_eq!(round(&mut cycles, &[None, None, Some(Next)]), Some(1));
        assert_eq!(round(&mut cycles, &[Some(Gap(1)), Some(Gap(2)), Some(Next)]), Some(1));
    }

    #[test]
    fn where_nothing_counts_nothing_is_said() {
        use Step::*;
        let mut none = Cycles::new(0);
        assert_eq!([round(&mut none, &[]), round(&mut none, &[])], [None, None]);
        let mut cycles = Cycles::new(2);
        round(&mut cycles, &[Some(First), Some(First)]);
        assert_eq!(round(&mut cycles, &[None, None]), None);
        assert_eq!(
            round(&mut cycles, &[Some(Gap(1)), Some(Gap(1))]),
            None,
            "the round before had no counter"
        );
        assert_eq!(round(&mut cycles, &[Some(Gap(1)), Some(Gap(1))]), Some(2));
        assert_eq!(round(&mut cycles, &[Some(Jump), Some(Jump)]), None);
        assert_eq!(round(&mut cycles, &[Some(Next), Some(Next)]), Some(1));
    }
}
