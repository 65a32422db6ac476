//! Which message comes before which in the boards' cycle, as the rounds show it
//!
//! Places in time do not tell this where a burst puts messages microseconds apart: what moves one message's usual place a little
//! more than another's would change their order.

use super::stream::Stream;

/// After so many rounds in a row one message usually comes before another
const USUAL: u8 = 4;

/// For each pair of messages, in how many rounds in a row the first came before the second
#[derive(Clone, Debug, Default)]
pub(super) struct Order {
    messages: usize,
    rounds: Vec<u8>,
}

impl Order {
    pub(super) fn new(messages: usize) -> Self {
        Self { messages, rounds: vec![0; messages * messages] }
    }

    /// A message is about to take its place after those that have arrived in the open round
    pub(super) fn observe(&mut self, number: usize, streams: &[Stream]) {
        for (before, _) in streams.iter().enumerate().filter(|(_, stream)| stream.arrived) {
            let rounds = &mut self.rounds[before * self.messages + number];
            *rounds = rounds.saturating_add(1);
            self.rounds[number * self.messages + before] = 0;
        }
    }

    /// Whether one message usually comes before another
    pub(super) fn usual(&self, before: usize, after: usize) -> bool {
        self.rounds[before * self.messages + after] >= USUAL
    }

    /// Whether one message came before another when both came last
    pub(super) fn last(&self, before: usize, after: usize) -> bool {
        self.rounds[before * self.messages + after] > 0
    }

    pub(super) fn forget(&mut self) {
        self.rounds.fill(0);
    }
}
