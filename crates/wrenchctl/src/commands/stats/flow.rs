//! The frames of one identifier on one interface.

use can::frame::{CanId, MAX_LEN, Stamped, wire_len};
use can::sequence::{Sequence, Step};
use can::signal::SignalSpec;

use super::intervals::Intervals;
use crate::decoded::Decoder;

/// Without a counter an identical frame within this share of the mean interval is a duplicate.
const DUPLICATE_WITHIN: f64 = 0.25;

/// What one identifier's frames were like.
pub(super) struct Flow {
    pub(super) frames: u64,
    pub(super) first_ns: i64,
    pub(super) last_ns: i64,
    pub(super) intervals: Intervals,
    /// Least and most payload bytes
    pub(super) len: (usize, usize),
    /// Frames that the counter says never came; none without a counter
    pub(super) missing: Option<u64>,
    pub(super) duplicates: u64,
    /// Frames that came after a newer one, by counter or stamp
    pub(super) late: u64,
    /// Frames of another length than the DBC says; none without a DBC
    pub(super) wrong_length: Option<u64>,
    /// Times that a board began to count anew
    pub(super) restarts: u64,
    expected_len: Option<usize>,
    counter: Option<(SignalSpec, Sequence)>,
    last_data: [u8; MAX_LEN],
}

impl Flow {
    /// Nothing yet; the configuration knows lengths and counters.
    pub(super) fn new(decoder: Option<&Decoder>, id: CanId) -> Self {
        let message = decoder.and_then(|decoder| decoder.message(id));
        let expected_len = message.map(|message| wire_len(message.len.into()).unwrap_or(MAX_LEN));
        let counter = message.zip(decoder).and_then(|(message, decoder)| {
            let names = decoder.config.sensors.iter().filter_map(|sensor| sensor.sequence.as_ref());
            let name = names.into_iter().find(|name| name.message == message.name)?;
            let spec = message.signals.iter().find(|signal| signal.name == name.signal)?;
            Some((spec.clone(), Sequence::new(spec.bits)))
        });
        Self {
            frames: 0,
            first_ns: 0,
            last_ns: 0,
            intervals: Intervals::default(),
            len: (usize::MAX, 0),
            missing: counter.as_ref().map(|_| 0),
            duplicates: 0,
            late: 0,
            wrong_length: expected_len.map(|_| 0),
            restarts: 0,
            expected_len,
            counter,
            last_data: [0; MAX_LEN],
        }
    }

    /// Takes in the next frame.
    pub(super) fn frame(&mut self, stamped: &Stamped) {
        let frame = &stamped.frame;
        let first = self.frames == 0;
        self.frames += 1;
        self.len = (self.len.0.min(frame.len()), self.len.1.max(frame.len()));
        let wrong_length = self.expected_len.is_some_and(|len| len != frame.len());
        let interval_s = (stamped.stamp_ns - self.last_ns) as f64 * 1e-9;
        let same = !first && self.last_data == *frame.padded();
        let mut late = !first && interval_s < 0.0;
        if wrong_length {
            self.wrong_length = self.wrong_length.map(|count| count + 1);
        } else if let Some((spec, sequence)) = &mut self.counter {
            if spec.present(frame.padded()) {
                match sequence.observe(spec.field.extract(frame.padded())) {
                    Step::Gap(_) | Step::First | Step::Next => {}
                    Step::Repeated => self.duplicates += 1,
                    Step::Behind => late = true,
                    Step::Jump => self.restarts += 1,
                }
                self.missing = Some(sequence.counts().missing);
            }
        } else if same
            && self.intervals.count() > 0
            && interval_s < DUPLICATE_WITHIN * self.intervals.mean_s()
        {
            self.duplicates += 1;
        }
        self.late += u64::from(late);
        self.last_data = *frame.padded();
        if first {
            self.first_ns = stamped.stamp_ns;
            self.last_ns = stamped.stamp_ns;
        } else if interval_s >= 0.0 {
            self.intervals.add(interval_s);
            self.last_ns = stamped.stamp_ns;
        }
    }

    /// Frames per second over the time they span, Hz; none for a single frame.
    pub(super) fn rate_hz(&self) -> Option<f64> {
        let span_s = (self.last_ns - self.first_ns) as f64 * 1e-9;
        (span_s > 0.0).then(|| (self.frames - 1) as f64 / span_s)
    }
}
