//! Middleware that breaks a stream on purpose, the same way for the same seed

mod turns;

use std::collections::VecDeque;
use std::time::Duration;

use crate::error::Result;
use crate::frame::{CanId, Flags, Frame, Stamped};
use crate::source::{Batch, Event, Poll, Source};

pub use turns::{broken, in_turn};

/// Most frames held back at a time
const HELD: usize = 256;

/// What happens to frames, each with a probability a frame (0..=1)
#[derive(Clone, Copy, PartialEq, Debug, Default)]
pub struct Faults {
    /// The frame is lost
    pub drop: f64,
    /// The frame and the next `burst_frames - 1` are lost
    pub burst: f64,
    /// Frames lost in a burst
    pub burst_frames: u32,
    /// The frame comes twice
    pub duplicate: f64,
    /// The frame comes after up to `reorder_frames` later ones, with its own stamp
    pub reorder: f64,
    /// Most frames that overtake
    pub reorder_frames: u32,
    /// One to three bits of the payload are turned
    pub corrupt: f64,
    /// The last byte of the payload is missing
    pub shorten: f64,
    /// The frame comes later, with a later stamp
    pub delay: f64,
    /// By how much, ns
    pub delay_ns: i64,
    /// From here on the message's payload stands still for `stuck_frames` frames
    pub stuck: f64,
    /// Frames of one message that stand still
    pub stuck_frames: u32,
    /// A frame that nobody configured comes before it
    pub foreign: f64,
}

/// How often each fault was done
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct FaultCounts {
    /// Frames seen
    pub frames: u64,
    /// Lost, bursts included
    pub dropped: u64,
    /// Doubled
    pub duplicated: u64,
    /// Overtaken
    pub reordered: u64,
    /// With turned bits
    pub corrupted: u64,
    /// With a byte missing
    pub shortened: u64,
    /// Delayed
    pub delayed: u64,
    /// With a payload that stood still
    pub stuck: u64,
    /// Invented
    pub foreign: u64,
}

/// Small, fast, seeded: splitmix64 (Steele, Lea, Flood 2014)
#[derive(Clone, Debug)]
struct Dice(u64);

impl Dice {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    fn chance(&mut self, probability: f64) -> bool {
        // 53 bits: uniform in [0, 1). Always thrown, so that one fault's probability does not shift the others.
        ((self.next() >> 11) as f64) / ((1u64 << 53) as f64) < probability
    }

    /// Uniform in 0..n; the bias for n far below 2^64 does not matter here
    fn below(&mut self, n: u64) -> u64 {
        if n == 0 { 0 } else { self.next() % n }
    }
}

#[derive(Clone, Copy, Debug)]
enum Release {
    /// After so many more frames
    Frames(u32),
    /// With the first frame stamped at or after this
    Stamp(i64),
}

#[derive(Clone, Copy, Debug)]
struct Stuck {
    interface: u8,
    id: CanId,
    frame: Frame,
    left: u32,
}

/// A source that breaks the one behind it
#[derive(Debug)]
pub struct FaultInjector<S> {
    inner: S,
    faults: Faults,
    dice: Dice,
    incoming: Batch,
    outgoing: VecDeque<Event>,
    held: Vec<(Release, Stamped)>,
    stuck: Option<Stuck>,
    burst_left: u32,
    counts: FaultCounts,
}

impl<S: Source> FaultInjector<S> {
    /// Breaks `inner` by `faults`, the same way for the same seed
    pub fn new(inner: S, faults: Faults, seed: u64) -> Self {
        Self {
            inner,
            faults,
            dice: Dice(seed),
            incoming: Batch::new(64),
            outgoing: VecDeque::with_capacity(4 * 64 + HELD),
            held: Vec::with_capacity(HELD),
            stuck: None,
            burst_left: 0,
            counts: FaultCounts::default(),
        }
    }

    /// How often each fault was done
    pub fn counts(&self) -> FaultCounts {
        self.counts
    }

    fn pass(&mut self, stamped: Stamped) {
        self.counts.frames += 1;
        let faults = self.faults;
        let dice = &mut self.dice;
        let (drop, burst) = (dice.chance(faults.drop), dice.chance(faults.burst));
        let (duplicate, reorder) = (dice.chance(faults.duplicate), dice.chance(faults.reorder));
        let (corrupt, shorten) = (dice.chance(faults.corrupt), dice.chance(faults.shorten));
        let (delay, stuck, foreign) =
            (dice.chance(faults.delay), dice.chance(faults.stuck), dice.chance(faults.foreign));
        if foreign {
            self.invent(&stamped);
        }
        if burst && self.burst_left == 0 {
            self.burst_left = faults.burst_frames.max(1);
        }
        if drop || self.burst_left > 0 {
            self.burst_left = self.burst_left.saturating_sub(1);
            self.counts.dropped += 1;
            self.release(stamped.stamp_ns);
            return;
        }
        let mut frame = self.hold_still(stamped, stuck);
        if corrupt {
            self.corrupt(&mut frame.frame);
        }
        if shorten {
            self.shorten(&mut frame.frame);
        }
        if delay && self.held.len() < HELD {
            self.counts.delayed += 1;
            frame.stamp_ns = frame.stamp_ns.saturating_add(faults.delay_ns);
            self.held.push((Release::Stamp(frame.stamp_ns), frame));
        } else if reorder && self.held.len() < HELD {
            self.counts.reordered += 1;
            let frames = 1 + self.dice.below(faults.reorder_frames.max(1).into()) as u32;
            // This frame itself counts as one of those that pass.
            self.held.push((Release::Frames(frames + 1), frame));
        } else {
            self.outgoing.push_back(Event::received(frame));
            if duplicate {
                self.counts.duplicated += 1;
                self.outgoing.push_back(Event::received(frame));
            }
        }
        self.release(stamped.stamp_ns);
    }

    /// Hands on what was held back long enough
    fn release(&mut self, stamp_ns: i64) {
        let outgoing = &mut self.outgoing;
        self.held.retain_mut(|(release, stamped)| {
            let free = match release {
                Release::Frames(left) => {
                    *left -= 1;
                    *left == 0
                }
                Release::Stamp(at_ns) => stamp_ns >= *at_ns,
            };
            if free {
                outgoing.push_back(Event::received(*stamped));
            }
            !free
        });
    }

    fn hold_still(&mut self, mut stamped: Stamped, begin: bool) -> Stamped {
        let of = |stuck: &Stuck| stuck.interface == stamped.interface && stuck.id == stamped.frame.id();
        if let Some(stuck) = self.stuck.as_mut().filter(|stuck| of(stuck)) {
            stamped.frame = stuck.frame;
            stuck.left -= 1;
            self.counts.stuck += 1;
            if stuck.left == 0 {
                self.stuck = None;
            }
        } else if begin && self.stuck.is_none() {
            let Stamped { interface, frame, .. } = stamped;
            self.stuck =
                Some(Stuck { interface, id: frame.id(), frame, left: self.faults.stuck_frames.max(1) });
        }
        stamped
    }

    fn corrupt(&mut self, frame: &mut Frame) {
        let bits = 8 * frame.data_mut().len() as u64;
        if bits == 0 {
            return;
        }
        self.counts.corrupted += 1;
        for _ in 0..=self.dice.below(3) {
            let bit = self.dice.below(bits) as usize;
            frame.data_mut()[bit / 8] ^= 1 << (bit % 8);
        }
    }

    fn shorten(&mut self, frame: &mut Frame) {
        let Some((_, rest)) = frame.data().split_last() else { return };
        let shorter = if frame.flags().has(Flags::FD) {
            let len = (0..=rest.len()).rev().find(|&len| crate::frame::is_fd_len(len)).unwrap_or(0);
            Frame::fd(frame.id(), frame.flags().fd_nibble(), &rest[..len])
        } else {
            Frame::classical(frame.id(), rest)
        };
        if let Some(shorter) = shorter.filter(|_| frame.is_data()) {
            self.counts.shortened += 1;
            *frame = shorter;
        }
    }

    fn invent(&mut self, beside: &Stamped) {
        let bytes = self.dice.next().to_le_bytes();
        let id = CanId::extended((self.dice.next() & 0x1FFF_FFFF) as u32);
        if let Some(frame) = id.and_then(|id| Frame::classical(id, &bytes)) {
            self.counts.foreign += 1;
            self.outgoing.push_back(Event::Frame(Stamped { frame, ..*beside }));
        }
    }

    fn fetch(&mut self, timeout: Duration) -> Result<Poll> {
        let mut incoming = std::mem::replace(&mut self.incoming, Batch::hollow());
        let poll = self.inner.poll(&mut incoming, timeout);
        for event in incoming.events() {
            match event {
                Event::Frame(stamped) => self.pass(*stamped),
                other => self.outgoing.push_back(*other),
            }
        }
        self.incoming = incoming;
        if matches!(poll, Ok(Poll::End)) {
            for (_, stamped) in self.held.drain(..) {
                self.outgoing.push_back(Event::received(stamped));
            }
        }
        poll
    }
}

impl<S: Source> Source for FaultInjector<S> {
    fn poll(&mut self, batch: &mut Batch, timeout: Duration) -> Result<Poll> {
        batch.clear();
        let mut poll = Poll::Idle;
        if self.outgoing.is_empty() {
            poll = self.fetch(timeout)?;
        }
        while batch.room() > 0 {
            let Some(event) = self.outgoing.pop_front() else { break };
            batch.push(event);
        }
        Ok(match (batch.is_empty(), poll) {
            (false, _) => Poll::Ready,
            (true, Poll::End) => Poll::End,
            // All that came was lost: nothing yet.
            (true, _) => Poll::Idle,
        })
    }
}
