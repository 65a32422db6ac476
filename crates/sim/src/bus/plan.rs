//! Which signals go into which message, or into which multiplexer page of one.

use std::collections::BTreeMap;

use can::assembly::{Layout, SignalBinding};
use can::frame::{CanId, Frame, MAX_LEN};
use can::signal::MuxCondition;
use rig::binding::{BitRates, classical_bits, fd_bits};

use crate::SimError;

/// CAN FD frames switch to the data bit rate.
const FD_NIBBLE: u8 = 1;

/// What a signal says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Content {
    Counts(usize),
    Saturated(usize),
    Temperature(usize),
    Position(usize),
    Velocity(usize),
}

/// A signal that a frame has to carry.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wish<'a> {
    pub(super) binding: &'a SignalBinding,
    /// None: a counter of the message's frames.
    pub(super) content: Option<Content>,
    pub(super) delay_ns: Option<i64>,
}

/// What is sent in one frame: a message, or one multiplexer page of one.
#[derive(Clone, Debug)]
pub(super) struct Page<'a> {
    pub(super) interface: u8,
    mux: &'a [MuxCondition],
    pub(super) members: Vec<Wish<'a>>,
}

/// Interface, identifier, and the page by its selectors' names and values: sorted as frames win arbitration.
type Key<'a> = (u8, CanId, Vec<(&'a str, u64)>);

/// The frames that a layout needs, in the order in which they win arbitration.
pub(super) fn pages(layout: &Layout) -> Vec<Page<'_>> {
    let wishes = wishes(layout);
    let mut muxes: BTreeMap<Key<'_>, &[MuxCondition]> = BTreeMap::new();
    for wish in &wishes {
        muxes.entry(key(wish)).or_insert(&wish.binding.spec.mux);
    }
    let keys: Vec<Key<'_>> = muxes.keys().cloned().collect();
    let mut pages = Vec::with_capacity(keys.len());
    for ((interface, id, page), mux) in muxes {
        let has_pages = keys.iter().any(|key| key.0 == interface && key.1 == id && !key.2.is_empty());
        if page.is_empty() && has_pages {
            // What is outside the pages of a message goes with each of them.
            continue;
        }
        let belongs = |wish: &&Wish<'_>| {
            let (of, whose, its_page) = key(wish);
            of == interface && whose == id && (its_page.is_empty() || its_page == page)
        };
        pages.push(Page { interface, mux, members: wishes.iter().filter(belongs).copied().collect() });
    }
    pages
}

/// All signals of a layout; no content: a counter.
fn wishes(layout: &Layout) -> Vec<Wish<'_>> {
    let mut wishes = Vec::new();
    for (index, gauge) in layout.gauges.iter().enumerate() {
        let signals = [
            (Some(&gauge.counts), Some(Content::Counts(index)), gauge.delay_ns),
            (gauge.saturated.as_ref(), Some(Content::Saturated(index)), gauge.delay_ns),
            (gauge.sequence.as_ref(), None, None),
            (gauge.temperature.as_ref(), Some(Content::Temperature(index)), None),
        ];
        wishes.extend(signals.into_iter().filter_map(|(binding, content, delay_ns)| {
            binding.map(|binding| Wish { binding, content, delay_ns })
        }));
    }
    for (index, joint) in layout.joints.iter().enumerate() {
        let signals = [
            (Some(&joint.position), Content::Position(index)),
            (joint.velocity.as_ref(), Content::Velocity(index)),
        ];
        wishes.extend(signals.into_iter().filter_map(|(binding, content)| {
            binding.map(|binding| Wish { binding, content: Some(content), delay_ns: joint.delay_ns })
        }));
    }
    wishes
}

fn key<'a>(wish: &Wish<'a>) -> Key<'a> {
    let spec = &wish.binding.spec;
    let selector = |condition: &'a MuxCondition| {
        (condition.selector.as_str(), condition.ranges.first().map_or(0, |range| range.0))
    };
    (wish.binding.interface, spec.message_id, spec.mux.iter().map(selector).collect())
}

impl Page<'_> {
    /// The page's frame without content, its selectors set.
    pub(super) fn template(&self) -> Result<Frame, SimError> {
        let Some(first) = self.members.first() else {
            return Err(SimError::signal("the bus", "a message has no signals; correct the DBC"));
        };
        let spec = &first.binding.spec;
        let problem = |what: &str| SimError::signal(spec.full_name(), format!("{what}; correct the DBC"));
        let length = spec.wire_len();
        let zeros = [0; MAX_LEN];
        let frame = if length <= 8 {
            Frame::classical(spec.message_id, &zeros[..length])
        } else {
            Frame::fd(spec.message_id, FD_NIBBLE, &zeros[..length])
        };
        let mut frame = frame.ok_or_else(|| problem("its message has a length that no frame has"))?;
        for condition in self.mux {
            let value = condition.ranges.first().map_or(0, |range| range.0);
            if !condition.field.insert(frame.data_mut(), value) {
                return Err(problem("its selector is beyond the end of its message"));
            }
        }
        Ok(frame)
    }
}

/// Time that a frame takes on the bus, ns: half way between no stuff bits and the most.
pub(super) fn wire_ns(frame: &Frame, rates: BitRates) -> i64 {
    let extended = frame.id().is_extended();
    let bits =
        if frame.len() <= 8 { classical_bits(frame.len(), extended) } else { fd_bits(frame.len(), extended) };
    let mean = |(least, most): (u32, u32)| f64::from(least + most) / 2.0;
    let seconds = mean(bits.nominal) / rates.nominal_bps + mean(bits.data) / rates.data_bps;
    (seconds * 1e9).round() as i64
}
