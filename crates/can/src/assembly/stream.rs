//! One message's arrivals: when it is due, what is wrong with its frames, and whether they are of their round

use super::Absence;
use super::rounds::MAX_IN_A_ROW;

/// Most rounds between two frames of a message that are still waited for
const MAX_USUAL: u64 = 16;
/// After so many missed dues a message is not waited for until it returns
const MAX_MISSED: u8 = 3;

/// Arrivals of one message (of one multiplexer page of it)
#[derive(Clone, Debug)]
pub(super) struct Stream {
    /// Rounds from one arrival to the next, as the last arrivals have it
    pub(super) usual: u64,
    /// Last gaps in rounds, 0 = not yet known
    gaps: [u8; 4],
    next_gap: usize,
    /// Round of the last arrival
    pub(super) last_round: Option<u64>,
    missed: u8,
    awaited: bool,
    pub(super) arrived: bool,
    /// Last round in which its frame came without news
    repeated_round: Option<u64>,
    /// Last round in which its frame came with another length
    wrong_length_round: Option<u64>,
    /// Last round in which two of its frames came and only one can be right
    doubted_round: Option<u64>,
    /// Last round in which its frame seemed to be the round's before
    held_back_round: Option<u64>,
    /// Last round that got a frame of it which may as well be of a round before
    unplaced_round: Option<u64>,
    /// Whether the frame at hand belongs to it
    pub(super) hit: bool,
    pub(super) stamp_ns: Option<i64>,
    /// Usual stamp minus its round's origin
    pub(super) phase_ns: Option<i64>,
    /// Usual pause of the bus before it, logarithm of ns
    pub(super) pause_ln: Option<f64>,
    /// Arrivals in a row that by the phase were for a round that had ended
    pub(super) behind: u8,
}

impl Stream {
    pub(super) fn new() -> Self {
        Self {
            usual: 1,
            gaps: [0; 4],
            next_gap: 0,
            last_round: None,
            missed: 0,
            awaited: true,
            arrived: false,
            repeated_round: None,
            wrong_length_round: None,
            doubted_round: None,
            held_back_round: None,
            unplaced_round: None,
            hit: false,
            stamp_ns: None,
            phase_ns: None,
            pause_ln: None,
            behind: 0,
        }
    }

    /// Whether a round waits for it
    pub(super) fn due(&self, round: u64) -> bool {
        self.awaited
            && self.last_round.is_none_or(|last| round.saturating_sub(last).is_multiple_of(self.usual))
    }

    /// Whether its last reading is not older than its usual gap
    pub(super) fn holds(&self, round: u64) -> bool {
        self.last_round.is_some_and(|last| round.saturating_sub(last) < self.usual)
    }

    /// Whether it comes in every round, but for frames that are lost
    pub(super) fn in_every_round(&self) -> bool {
        self.gaps.contains(&1)
    }

    /// Its frame came again without news; a duplicate of this round's is none of its business
    pub(super) fn repeat(&mut self, round: u64) {
        if self.last_round != Some(round) {
            self.repeated_round = Some(round);
        }
    }

    pub(super) fn wrong_length(&mut self, round: u64) {
        self.wrong_length_round = Some(round);
    }

    /// Another frame of it came in this round
    pub(super) fn doubt(&mut self, round: u64) {
        self.doubted_round = Some(round);
    }

    /// Its frame seems to be the last round's; two rounds in a row it is not believed to be, for then its place has changed
    pub(super) fn hold_back(&mut self, round: u64) -> bool {
        let before = self.held_back_round.replace(round);
        before.is_none_or(|before| before + 1 < round)
    }

    /// Whether its place goes on from the last frame that was due: that one came, and was in its own round
    pub(super) fn goes_on(&self, round: u64) -> bool {
        self.last_round.is_none_or(|last| last + self.usual >= round && !self.is_unplaced())
    }

    /// The frame of this round may as well be of a round before: nothing but its order among frames that may be overtaken says which
    pub(super) fn misplace(&mut self, round: u64) {
        self.unplaced_round = Some(round);
    }

    /// Whether the last frame may as well be of a round before
    pub(super) fn is_unplaced(&self) -> bool {
        self.unplaced_round.is_some() && self.unplaced_round == self.last_round
    }

    /// Whether two frames of it came in this round and only one can be right
    pub(super) fn is_doubted(&self, round: u64) -> bool {
        self.doubted_round == Some(round)
    }

    /// Why it has no reading although frames come: in this round, or in the last if this one did not wait for it
    pub(super) fn fault(&self, round: u64) -> Option<Absence> {
        let recent = |seen: Option<u64>| seen.is_some_and(|seen| round.saturating_sub(seen) <= 1);
        if recent(self.wrong_length_round) {
            Some(Absence::WrongLength)
        } else if recent(self.repeated_round) {
            Some(Absence::Repeated)
        } else {
            None
        }
    }

    pub(super) fn arrive(&mut self, round: u64, stamp_ns: i64) {
        if let Some(last) = self.last_round.filter(|&last| last < round) {
            self.gaps[self.next_gap] = (round - last).min(MAX_USUAL) as u8;
            self.next_gap = (self.next_gap + 1) % self.gaps.len();
            self.usual = self.gaps.iter().copied().filter(|&gap| gap > 0).min().unwrap_or(1).into();
        }
        self.last_round = Some(round);
        self.repeated_round = None;
        self.wrong_length_round = None;
        self.missed = 0;
        self.awaited = true;
        self.stamp_ns = Some(stamp_ns);
    }

    /// Ends a round for it; true if it was waited for in vain
    pub(super) fn end_round(&mut self, round: u64) -> bool {
        let missed = !self.arrived && self.due(round);
        if missed {
            self.missed = self.missed.saturating_add(1);
            self.awaited = self.missed < MAX_MISSED;
        }
        self.arrived = false;
        missed
    }

    /// An arrival behind its round; always behind means that the phase is wrong
    pub(super) fn fell_behind(&mut self) {
        self.behind += 1;
        if self.behind >= MAX_IN_A_ROW {
            self.behind = 0;
            self.phase_ns = None;
        }
    }

    pub(super) fn forget_stamp(&mut self) {
        self.stamp_ns = None;
    }
}
