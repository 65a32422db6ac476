//! Frames to snapshots: the rounds of the architecture notes, exactly and as a function of frames and stamps alone
//!
//! A round ends when every message that is due has arrived, when a message that already arrived in it arrives again, or
//! when a frame comes that by the learned rhythm belongs to the next cycle of the boards. Counters, duplicates,
//! overtaken frames, wrong lengths and steps of the clock are dealt with before a frame counts as an arrival.

mod accept;
mod close;
mod cycles;
mod layout;
mod order;
mod rounds;
mod snapshot;
mod stream;
#[cfg(test)]
mod tests;

use crate::decode::{DecodeTable, Outcome, Value};
use crate::error::Result;
use crate::frame::{MAX_LEN, Stamped};
use crate::sequence::{Sequence, SequenceCounts};
use cycles::{Cycles, Place};
use layout::{Compiled, GaugeSlots, Role};
pub use layout::{GaugeBinding, JointBinding, Layout, SignalBinding};
use rounds::Rhythm;
pub use snapshot::{Absence, JointReading, Reading, Signal, Snapshot};
use stream::Stream;

/// What the assembler met since the start
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct AssemblyCounts {
    /// Frames pushed
    pub frames: u64,
    /// Frames that no gauge or joint needs
    pub unbound: u64,
    /// Needed frames with another length than the DBC says
    pub wrong_length: u64,
    /// Frames whose counter did not advance
    pub repeated: u64,
    /// Identical frames in short succession, where there is no counter
    pub duplicates: u64,
    /// Frames older than one of the same message before them
    pub late: u64,
    /// Frames that came after their round had ended
    pub after_round: u64,
    /// Frames that came where none of their message is due, with no counter to tell which cycle they are of
    pub astray: u64,
    /// Steps of the stamps by more than a second backwards
    pub steps_back: u64,
    /// Steps of the stamps by more than a second forwards: a step of the clock, or a silent bus
    pub steps_forward: u64,
    /// Rounds that ended
    pub rounds: u64,
    /// Rounds in which every gauge and joint had a reading
    pub complete_rounds: u64,
    /// Messages that were waited for in vain
    pub missed: u64,
    /// Rounds not handed on: of two cycles at the start, or cut by a step of the stamps
    pub discarded_rounds: u64,
}

/// Last value of a signal
#[derive(Clone, Copy, Debug, Default)]
struct Held {
    seen: bool,
    value: f64,
    stamp_ns: i64,
    at_ns: i64,
}

impl Held {
    /// When it was sampled, if its frame is of the round of this instant
    fn sampled_ns(&self, delay_ns: Option<i64>, instant_ns: i64) -> i64 {
        delay_ns.map_or(instant_ns, |delay_ns| self.stamp_ns - delay_ns)
    }
}

/// Last frame of a message
#[derive(Clone, Debug)]
struct Previous {
    stamp_ns: Option<i64>,
    data: [u8; MAX_LEN],
}

/// Builds snapshots from frames; all memory is taken at construction
#[derive(Debug)]
pub struct Assembler {
    compiled: Compiled,
    stale_after_ns: i64,
    temperature_stale_after_ns: i64,
    sequences: Vec<Sequence>,
    cycles: Cycles,
    streams: Vec<Stream>,
    previous: Vec<Previous>,
    held: Vec<Held>,
    pending: Vec<Value>,
    rhythm: Rhythm,
    round: u64,
    open: bool,
    /// The next round to end is the rest of one that was cut
    discard: bool,
    latest_ns: Option<i64>,
    last_instant_ns: i64,
    last_stamp_ns: i64,
    /// The same of the round that ended last
    ended_stamp_ns: i64,
    out: [Snapshot; 2],
    ready: usize,
    /// What the open round would end in
    ahead: Snapshot,
    counts: AssemblyCounts,
}

impl Assembler {
    /// Compiles a layout
    pub fn new(layout: &Layout) -> Result<Self> {
        let compiled = layout.compile()?;
        let streams = compiled.stream_messages.len();
        let empty = Snapshot::empty(layout.gauges.len(), layout.joints.len());
        Ok(Self {
            stale_after_ns: layout.stale_after_ns,
            temperature_stale_after_ns: layout.temperature_stale_after_ns,
            sequences: compiled.sequence_bits.iter().map(|&bits| Sequence::new(bits)).collect(),
            cycles: Cycles::new(compiled.sequence_bits.len()),
            streams: vec![Stream::new(); streams],
            previous: vec![Previous { stamp_ns: None, data: [0; MAX_LEN] }; compiled.table.messages().len()],
            held: vec![Held::default(); compiled.roles.len()],
            pending: Vec::with_capacity(compiled.table.max_values_per_frame()),
            compiled,
            rhythm: Rhythm::new(streams),
            round: 0,
            open: false,
            discard: false,
            latest_ns: None,
            last_instant_ns: 0,
            last_stamp_ns: 0,
            ended_stamp_ns: i64::MIN,
            ahead: empty.clone(),
            out: [empty.clone(), empty],
            ready: 0,
            counts: AssemblyCounts::default(),
        })
    }

    /// The decode table: which messages are needed, for filters and statistics
    pub fn table(&self) -> &DecodeTable {
        &self.compiled.table
    }

    /// What was met since the start
    pub fn counts(&self) -> AssemblyCounts {
        self.counts
    }

    /// Totals of all frame counters together
    pub fn sequence_counts(&self) -> SequenceCounts {
        self.sequences.iter().map(Sequence::counts).fold(SequenceCounts::default(), |a, b| SequenceCounts {
            advanced: a.advanced + b.advanced,
            missing: a.missing + b.missing,
            repeated: a.repeated + b.repeated,
            behind: a.behind + b.behind,
            jumps: a.jumps + b.jumps,
        })
    }

    /// Takes the next frame; the snapshots that it completes, oldest first: mostly none or one, two where a frame ends a
    /// round that waited in vain and completes the next by itself
    ///
    /// Bounded work (gauges + joints), no allocation.
    pub fn push(&mut self, stamped: &Stamped) -> &[Snapshot] {
        self.ready = 0;
        self.counts.frames += 1;
        self.pending.clear();
        let pending = &mut self.pending;
        match self.compiled.table.decode(stamped, |value| pending.push(value)) {
            Outcome::Unbound => self.counts.unbound += 1,
            Outcome::WrongLength(message) => {
                self.counts.wrong_length += 1;
                let of = self.compiled.stream_messages.iter();
                for (stream, _) in self.streams.iter_mut().zip(of).filter(|(_, of)| **of == message) {
                    stream.wrong_length(self.round);
                }
            }
            Outcome::Decoded(message) => {
                if self.accept(message, stamped) {
                    self.take(stamped.stamp_ns);
                }
            }
        }
        &self.out[..self.ready]
    }

    /// Puts an accepted frame's values into the round they belong to
    fn take(&mut self, stamp_ns: i64) {
        let mut first = None;
        let mut again = false;
        for value in &self.pending {
            if let Role::Streamed(number) = self.compiled.roles[usize::from(value.slot)] {
                let stream = &mut self.streams[usize::from(number)];
                stream.hit = true;
                again |= stream.arrived;
                first.get_or_insert(usize::from(number));
            }
        }
        let Some(first) = first else {
            self.cycles.settle(false);
            self.commit(stamp_ns);
            return;
        };
        self.rhythm.observe_pause(&mut self.streams[first], self.round, stamp_ns);
        let round = if self.open && !again { self.round } else { self.round + 1 };
        self.rhythm.observe_interval(&self.streams[first], round, stamp_ns);
        if !self.open && self.rhythm.fresh {
            self.realign();
        }
        let ended = if self.open { self.round.saturating_sub(1) } else { self.round };
        let missed = self.streams[first].last_round.is_none_or(|last| last < ended);
        if let Some(last) = self.belongs_to_an_ended_round(first, stamp_ns).filter(|_| ended > 0 && missed) {
            self.take_after_round(ended, last, stamp_ns);
            return;
        }
        let held_back = !again && missed && ended > 0;
        if self.cycles.place().is_none()
            && (self.is_astray(first, again, stamp_ns) || held_back && self.is_held_back(first, stamp_ns))
        {
            self.leave_out(again);
            return;
        }
        let later = self.open && (again || self.belongs_to_a_later_round(first, stamp_ns));
        if later {
            self.rhythm.ended(!again && !self.cycles.count(), &mut self.streams);
            self.close();
        } else if self.open && self.cycles.place() == Some(Place::Later) {
            self.rhythm.leave_out_what_came_before_the_pause(&mut self.streams, self.round);
        }
        if !self.open {
            self.open = true;
            self.round += 1;
            self.last_stamp_ns = stamp_ns;
            self.rhythm.open(&self.streams[first], stamp_ns);
        }
        let counted = self.cycles.place().is_some();
        if counted {
            self.rhythm.bear_out(&self.streams[first], stamp_ns);
        }
        let is_borne_out = !self.cycles.count() || self.rhythm.is_borne_out();
        for number in 0..self.streams.len() {
            if std::mem::take(&mut self.streams[number].hit) {
                let stream = &mut self.streams[number];
                let is_placed = is_borne_out && self.rhythm.is_well_in_place(stream, stamp_ns);
                if !counted && !stream.goes_on(self.round) && !is_placed {
                    stream.misplace(self.round);
                }
                stream.arrive(self.round, stamp_ns);
                self.rhythm.join(number, &mut self.streams, stamp_ns);
            }
        }
        self.last_stamp_ns = self.last_stamp_ns.max(stamp_ns);
        self.cycles.settle(true);
        self.commit(stamp_ns);
        if self.every_due_arrived() {
            self.rhythm.ended(false, &mut self.streams);
            self.close();
        }
    }

    /// Whether the frame at hand, whose cycle nobody counted, can be of no round: it was held back, or another one was in its place
    fn is_astray(&self, first: usize, again: bool, stamp_ns: i64) -> bool {
        let begins = || !self.open || self.rhythm.begins_anew(first, &self.streams, stamp_ns);
        if again {
            return self.rhythm.is_soon(&self.streams[first], stamp_ns);
        }
        self.cycles.count() && begins() && self.rhythm.is_astray(first, &self.streams, stamp_ns)
    }

    /// Whether the frame at hand, whose cycle nobody counted, may be of the round before, which missed it: by its place, or because it was handed on
    /// late with a stamp of its own
    fn is_held_back(&mut self, first: usize, stamp_ns: i64) -> bool {
        let early = || self.open && self.rhythm.comes_early(first, &self.streams, self.round, stamp_ns);
        (stamp_ns < self.ended_stamp_ns || early()) && self.streams[first].hold_back(self.round)
    }

    /// Leaves the frame at hand out; where it is the second of its message in a round the first may be the wrong one, too
    fn leave_out(&mut self, again: bool) {
        self.counts.astray += 1;
        self.cycles.dismiss();
        for stream in &mut self.streams {
            if std::mem::take(&mut stream.hit) && again {
                stream.doubt(self.round);
            }
        }
    }

    /// Lets rounds begin elsewhere in the boards' cycle if they must: then counters were compared across cycles
    fn realign(&mut self) {
        if self.rhythm.realign(&mut self.streams, self.round) {
            self.discard = true;
            self.cycles.forget();
        }
    }

    /// Whether the frame at hand comes after its round has ended, by its counter or else by its place in the boards' rhythm; and if so,
    /// whether that round is the last
    fn belongs_to_an_ended_round(&self, first: usize, stamp_ns: i64) -> Option<bool> {
        let stream = &self.streams[first];
        let by_rhythm = || Some(-self.rhythm.cycles_ahead(stream, stamp_ns)? - i64::from(self.open));
        let before_last = match self.cycles.place() {
            // A counter may lag because its message does not come in every cycle.
            Some(Place::Ended(before_last)) if stream.in_every_round() || by_rhythm()? >= 0 => before_last,
            Some(_) => return None,
            None => by_rhythm()?,
        };
        (before_last >= 0).then_some(before_last == 0)
    }

    /// Whether the frame at hand belongs to a later round than the open one, by its counter or else by the boards' rhythm
    fn belongs_to_a_later_round(&self, first: usize, stamp_ns: i64) -> bool {
        let stream = &self.streams[first];
        match self.cycles.place() {
            // What came just before is of the same round; nobody counted that a whole one is missing.
            // A counter whose bits turned says so in the midst of a round, too.
            Some(Place::Later) if self.rhythm.is_in_place(stream, stamp_ns) => false,
            Some(Place::Later) => self.cycles.any_here() || self.rhythm.long_since(stamp_ns),
            Some(_) => false,
            // The next counter will tell whether the boards or the sender paused.
            None if self.cycles.count() => self.rhythm.begins_anew(first, &self.streams, stamp_ns),
            None => {
                let ahead = self.rhythm.cycles_ahead(stream, stamp_ns).is_some_and(|ahead| ahead > 0);
                ahead && !self.rhythm.paused(first, &self.streams, stamp_ns)
            }
        }
    }

    /// A frame whose round has ended: its values are held as of that round if it was the last, else forgotten
    fn take_after_round(&mut self, ended: u64, last: bool, stamp_ns: i64) {
        self.counts.after_round += 1;
        self.cycles.settle(false);
        if last {
            self.commit(stamp_ns);
        }
        for number in 0..self.streams.len() {
            let stream = &mut self.streams[number];
            if !std::mem::take(&mut stream.hit) {
                continue;
            }
            stream.fell_behind();
            if last {
                stream.arrive(ended, stamp_ns);
                self.stamp_readings(number, self.last_instant_ns);
            }
        }
    }

    fn commit(&mut self, stamp_ns: i64) {
        for value in &self.pending {
            self.held[usize::from(value.slot)] =
                Held { seen: true, value: value.si, stamp_ns, at_ns: stamp_ns };
        }
    }

    fn every_due_arrived(&self) -> bool {
        let mut any = false;
        for stream in &self.streams {
            if stream.arrived {
                any = true;
            } else if stream.due(self.round) {
                return false;
            }
        }
        any
    }
}
