//! Requests and records as bytes.

use model::estimator::Solution;
use rig::config::PublishRdt;

use crate::published::Dispatch;

/// Length of a request.
const REQUEST_BYTES: usize = 8;
/// What every request begins with.
const REQUEST_HEADER: u16 = 0x1234;
/// Length of a record.
pub(super) const RECORD_BYTES: usize = 36;
/// The status of a record without a wrench: clients take every bit as a fault, so it is the only one.
pub(super) const STATUS_INVALID: u32 = 0x8000_0000;

/// What a client asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// No more records.
    Stop,
    /// So many records (`None`: without end), each as soon as it is published.
    Stream(Option<u32>),
    /// Forget a latched fault: there is none to forget.
    ResetLatch,
    /// Tare.
    Bias,
}

impl Request {
    /// From a datagram; none where it is no request, or one that this box does not know.
    pub fn parse(data: &[u8]) -> Option<Self> {
        let data: &[u8; REQUEST_BYTES] = data.try_into().ok()?;
        let [h0, h1, c0, c1, n0, n1, n2, n3] = *data;
        if u16::from_be_bytes([h0, h1]) != REQUEST_HEADER {
            return None;
        }
        let count = u32::from_be_bytes([n0, n1, n2, n3]);
        Some(match u16::from_be_bytes([c0, c1]) {
            0 => Self::Stop,
            // Buffered streaming packs several records into a datagram; a buffer of one is allowed, and every record is new.
            2 | 3 => Self::Stream((count != 0).then_some(count)),
            0x41 => Self::ResetLatch,
            0x42 => Self::Bias,
            _ => return None,
        })
    }
}

/// How many counts are a newton, and a newton metre, for each component.
#[derive(Clone, Copy, Debug)]
pub(super) struct Scale([f64; 6]);

impl Scale {
    pub(super) fn new(rdt: &PublishRdt) -> Self {
        let (force, moment) = (f64::from(rdt.counts_per_n), f64::from(rdt.counts_per_nm));
        Self([force, force, force, moment, moment, moment])
    }

    /// A wrench in counts; one beyond their range is none.
    pub(super) fn counts(&self, solution: &Solution) -> Option<[i32; 6]> {
        let wrench = solution.wrench.to_vector();
        let counts: [f64; 6] = std::array::from_fn(|k| (wrench[k] * self.0[k]).round());
        let fits = counts.iter().all(|c| c.abs() <= f64::from(i32::MAX));
        fits.then(|| counts.map(|c| c as i32))
    }
}

/// Makes records; keeps the last wrench for those that have none.
#[derive(Clone, Copy, Debug)]
pub(super) struct Recorder {
    scale: Scale,
    last_counts: [i32; 6],
    status: u32,
}

impl Recorder {
    pub(super) fn new(rdt: &PublishRdt) -> Self {
        Self { scale: Scale::new(rdt), last_counts: [0; 6], status: STATUS_INVALID }
    }

    /// Takes in what was published, whether anybody listens or not. A wrench beyond the counts' range is none.
    pub(super) fn note(&mut self, record: &Dispatch) {
        match record.outcome.ok().and_then(|solution| self.scale.counts(&solution)) {
            Some(counts) => (self.last_counts, self.status) = (counts, 0),
            None => self.status = STATUS_INVALID,
        }
    }

    /// The record of this number since the stream's start, from what was noted last.
    pub(super) fn record(&self, number: u32, record: &Dispatch) -> [u8; RECORD_BYTES] {
        let mut data = [0; RECORD_BYTES];
        let head = [number, record.sequence as u32, self.status];
        let words = head.map(u32::to_be_bytes).into_iter().chain(self.last_counts.map(i32::to_be_bytes));
        for (place, word) in data.chunks_exact_mut(4).zip(words) {
            place.copy_from_slice(&word);
        }
        data
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::published::Why;
    use model::spatial::Wrench;
    use nalgebra::{Matrix6, Vector6};
    use proptest::prelude::*;
    use rig::Status;

    fn published(sequence: u64, force_x_n: Option<f64>) -> Dispatch {
        let solution = |x| Solution {
            wrench: Wrench::from_vector(&Vector6::new(x, -1.0, 0.5, 0.001, -0.002, 0.25)),
            covariance: Matrix6::identity(),
            singular_values_per_n: [1.0; 6],
            parity_chi2: 0.0,
            parity_dof: 2,
            protection: [1.0; 6],
        };
        let outcome = force_x_n.map(solution).ok_or(Why::Stale);
        Dispatch { sequence, status: Status::DEGRADED, outcome }
    }

    fn words(data: &[u8; RECORD_BYTES]) -> Vec<i64> {
        let word = |k: usize| [data[4 * k], data[4 * k + 1], data[4 * k + 2], data[4 * k + 3]];
        let unsigned = (0..3).map(|k| i64::from(u32::from_be_bytes(word(k))));
        unsigned.chain((3..9).map(|k| i64::from(i32::from_be_bytes(word(k))))).collect()
    }

    #[test]
    fn requests_are_what_the_manual_says_and_nothing_else() {
        let parse = |text: &[u8]| Request::parse(text);
        assert_eq!(parse(&[0x12, 0x34, 0, 2, 0, 0, 0, 0]), Some(Request::Stream(None)));
        assert_eq!(parse(&[0x12, 0x34, 0, 2, 0, 0, 1, 0]), Some(Request::Stream(Some(256))));
        assert_eq!(parse(&[0x12, 0x34, 0, 3, 0, 0, 0, 1]), Some(Request::Stream(Some(1))));
        assert_eq!(parse(&[0x12, 0x34, 0, 0, 0, 0, 0, 0]), Some(Request::Stop));
        assert_eq!(parse(&[0x12, 0x34, 0, 0x41, 0, 0, 0, 0]), Some(Request::ResetLatch));
        assert_eq!(parse(&[0x12, 0x34, 0, 0x42, 0, 0, 0, 0]), Some(Request::Bias));
        assert_eq!(parse(&[0x34, 0x12, 0, 2, 0, 0, 0, 0]), None);
        assert_eq!(parse(&[0x12, 0x34, 0, 9, 0, 0, 0, 0]), None);
        for length in 0..40 {
            assert_eq!(parse(&vec![0x12; length]), None);
        }
    }

    #[test]
    fn a_record_is_36_bytes_with_the_last_wrench_where_there_is_none() {
        let mut recorder = Recorder::new(&PublishRdt { counts_per_nm: 2_000_000, ..PublishRdt::default() });
        let mut next = |number, record: Dispatch| {
            recorder.note(&record);
            words(&recorder.record(number, &record))
        };
        let invalid = i64::from(STATUS_INVALID);
        assert_eq!(
            next(1, published(6, None)),
            [1, 6, invalid, 0, 0, 0, 0, 0, 0],
            "nothing was ever measured"
        );
        let counts = [12_345_679, -1_000_000, 500_000, 2000, -4000, 500_000];
        let good = next(u32::MAX, published(0x1_0000_0007, Some(12.345_678_6)));
        assert_eq!(good, [&[i64::from(u32::MAX), 7, 0][..], &counts].concat());
        let kept = [&[2, 8, invalid][..], &counts].concat();
        assert_eq!(next(2, published(8, None)), kept);
        for beyond in [2147.5, -1e300, f64::NAN, f64::INFINITY] {
            assert_eq!(next(2, published(8, Some(beyond))), kept, "{beyond}");
        }
        assert_eq!(next(3, published(9, Some(2147.0)))[2..4], [0, 2_147_000_000]);
    }

    proptest! {
        #[test]
        fn every_request_is_read_as_it_was_written(command in 0u16..0x50, count: u32, more in 1usize..9) {
            let data = [&0x1234u16.to_be_bytes()[..], &command.to_be_bytes(), &count.to_be_bytes()].concat();
            let expected = match command {
                0 => Some(Request::Stop),
                2 | 3 => Some(Request::Stream(Some(count).filter(|count| *count > 0))),
                0x41 => Some(Request::ResetLatch),
                0x42 => Some(Request::Bias),
                _ => None,
            };
            prop_assert_eq!(Request::parse(&data), expected);
            prop_assert_eq!(Request::parse(&data[..8 - more]), None);
            prop_assert_eq!(Request::parse(&[&data[..], &data[..more]].concat()), None);
        }

        /// What a client computes from a record is what was published, to half a count.
        #[test]
        fn records_round_trip(force_x_n in -2000.0..2000.0f64, number: u32, sequence: u64, per_n in 1u32..1_000_000) {
            let rdt = PublishRdt { counts_per_n: per_n, ..PublishRdt::default() };
            let mut recorder = Recorder::new(&rdt);
            let record = published(sequence, Some(force_x_n));
            recorder.note(&record);
            let words = words(&recorder.record(number, &record));
            prop_assert_eq!(&words[..3], &[i64::from(number), i64::from(sequence as u32), 0][..]);
            let told_n = words[3] as f64 / f64::from(per_n);
            prop_assert!((told_n - force_x_n).abs() <= 0.501 / f64::from(per_n), "{} {}", told_n, force_x_n);
        }
    }
}
