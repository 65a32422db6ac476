//! From values to frames: what each message says in a cycle, and when its frame is through on its bus.

mod plan;

use can::assembly::Layout;
use can::frame::{Frame, Stamped};
use can::signal::SignalSpec;
use rand::RngExt;
use rand::rngs::StdRng;
use rig::binding::BitRates;

use crate::SimError;
use crate::truth::range_si;
use plan::{Content, Page, wire_ns};

/// Latest start of a cycle's first frame after its instant, ns.
const START_JITTER_NS: i64 = 10_000;
/// Jitter of each frame's end, ns.
const FRAME_JITTER_NS: i64 = 1_000;

#[derive(Clone, Debug)]
struct Port {
    spec: SignalSpec,
    to_si: f64,
    /// Lowest and highest value that the signal can say, in the product's unit.
    range: (f64, f64),
    content: Content,
    /// Which of the cycle's sampling instants it was sampled at.
    sample: usize,
}

/// One message, or one multiplexer page of one.
#[derive(Clone, Debug)]
struct Message {
    interface: u8,
    template: Frame,
    ports: Vec<Port>,
    /// Counters, as indices into the bus's.
    counters: Vec<usize>,
    /// Nothing but temperatures and flags.
    slow: bool,
    wire_ns: i64,
    /// Stamp minus the cycle's instant (ns), where a signal has a delay of its own; else when the bus is free.
    delay_ns: Option<i64>,
}

#[derive(Clone, Debug)]
struct Counter {
    interface: u8,
    spec: SignalSpec,
    count: u64,
}

/// All gauges and coordinates at one sampling instant of a cycle.
#[derive(Clone, Debug, Default)]
pub(crate) struct Sample {
    /// Readings as the converters give them, counts.
    pub(crate) counts: Vec<f64>,
    /// Whether a reading was beyond its range.
    pub(crate) saturated: Vec<bool>,
    /// rad
    pub(crate) positions_rad: Vec<f64>,
    /// rad/s
    pub(crate) velocities_rad_s: Vec<f64>,
    /// degC
    pub(crate) temperatures_c: Vec<f64>,
}

/// The messages of a configuration, ready to be filled.
#[derive(Clone, Debug)]
pub(crate) struct Bus {
    messages: Vec<Message>,
    counters: Vec<Counter>,
    /// Sampling instants minus the cycle's, ns; the first one is 0.
    offsets_ns: Vec<i64>,
    /// When each interface is free again, ns since the beginning.
    free_ns: Vec<i64>,
}

impl Bus {
    /// The messages of a layout on buses of these bit rates.
    ///
    /// # Errors
    /// A signal that cannot be put into a frame.
    pub(crate) fn new(layout: &Layout, rates: BitRates) -> Result<Self, SimError> {
        let mut bus =
            Self { messages: Vec::new(), counters: Vec::new(), offsets_ns: vec![0], free_ns: Vec::new() };
        for page in plan::pages(layout) {
            bus.add(&page, rates)?;
        }
        let interfaces = bus.messages.iter().map(|message| usize::from(message.interface) + 1).max();
        bus.free_ns = vec![i64::MIN; interfaces.unwrap_or(0)];
        Ok(bus)
    }

    fn add(&mut self, page: &Page<'_>, rates: BitRates) -> Result<(), SimError> {
        let (interface, members) = (page.interface, &page.members);
        let template = page.template()?;
        let delay_ns = members.iter().filter_map(|wish| wish.delay_ns).max();
        let (mut ports, mut counters) = (Vec::new(), Vec::new());
        for wish in members {
            let sampled_ns = match (delay_ns, wish.delay_ns) {
                (Some(stamp_ns), Some(own_ns)) => stamp_ns - own_ns,
                _ => 0,
            };
            let spec = wish.binding.spec.clone();
            match wish.content {
                Some(content) => ports.push(Port {
                    spec,
                    to_si: wish.binding.to_si,
                    range: range_si(wish.binding),
                    content,
                    sample: self.sample(sampled_ns),
                }),
                None => counters.push(self.counter(interface, spec)),
            }
        }
        counters.sort_unstable();
        counters.dedup();
        let fast = |port: &Port| !matches!(port.content, Content::Temperature(_) | Content::Saturated(_));
        self.messages.push(Message {
            interface,
            wire_ns: wire_ns(&template, rates),
            template,
            slow: !ports.iter().any(fast),
            ports,
            counters,
            delay_ns,
        });
        Ok(())
    }

    fn sample(&mut self, offset_ns: i64) -> usize {
        self.offsets_ns.iter().position(|known| *known == offset_ns).unwrap_or_else(|| {
            self.offsets_ns.push(offset_ns);
            self.offsets_ns.len() - 1
        })
    }

    fn counter(&mut self, interface: u8, spec: SignalSpec) -> usize {
        let known = self.counters.iter().position(|c| c.interface == interface && c.spec == spec);
        known.unwrap_or_else(|| {
            self.counters.push(Counter { interface, spec, count: 0 });
            self.counters.len() - 1
        })
    }

    /// Sampling instants minus the cycle's, ns; the first one is 0.
    pub(crate) fn offsets_ns(&self) -> &[i64] {
        &self.offsets_ns
    }

    /// The interface that frames at this rate (Hz) would fill beyond its bit rate, and how full it would be.
    pub(crate) fn overfull(&self, rate_hz: f64) -> Option<(u8, f64)> {
        let load = |interface: u8| {
            let fast = self.messages.iter().filter(|m| m.interface == interface && !m.slow);
            fast.map(|message| message.wire_ns as f64 * 1e-9 * rate_hz).sum::<f64>()
        };
        (0..self.free_ns.len()).map(|index| (index as u8, load(index as u8))).find(|(_, load)| *load > 1.0)
    }

    /// The frames of the cycle at `cycle_ns` (ns since the Unix epoch), added to `frames`; `slow` ones where asked.
    pub(crate) fn cycle(
        &mut self,
        cycle_ns: i64,
        samples: &[Sample],
        slow: bool,
        rng: &mut StdRng,
        frames: &mut Vec<Stamped>,
    ) {
        for free_ns in &mut self.free_ns {
            *free_ns = (*free_ns).max(cycle_ns + rng.random_range(0..START_JITTER_NS));
        }
        for wave in [false, true] {
            for message in self.messages.iter().filter(|message| message.slow == wave && (slow || !wave)) {
                let jitter_ns = rng.random_range(0..FRAME_JITTER_NS);
                let free_ns = &mut self.free_ns[usize::from(message.interface)];
                let stamp_ns = match message.delay_ns {
                    Some(delay_ns) => cycle_ns + delay_ns + jitter_ns,
                    None => {
                        *free_ns += message.wire_ns + jitter_ns;
                        *free_ns
                    }
                };
                let frame = fill(message, &mut self.counters, samples);
                frames.push(Stamped { stamp_ns, interface: message.interface, frame });
            }
        }
    }
}

/// A message's next frame.
fn fill(message: &Message, counters: &mut [Counter], samples: &[Sample]) -> Frame {
    let mut frame = message.template;
    let data = frame.data_mut();
    for port in &message.ports {
        let sample = &samples[port.sample];
        let value = match port.content {
            Content::Counts(index) => sample.counts[index],
            Content::Saturated(index) => f64::from(u8::from(sample.saturated[index])),
            Content::Temperature(index) => sample.temperatures_c[index],
            Content::Position(index) => sample.positions_rad[index],
            Content::Velocity(index) => sample.velocities_rad_s[index],
        };
        // What is beyond the signal's range is at its end, as a converter has it.
        let value = value.clamp(port.range.0, port.range.1);
        if let Ok(raw) = port.spec.raw(value / port.to_si) {
            // The template has its message's length, and the DBC was checked to keep signals inside it.
            let _inside = port.spec.field.insert(data, raw);
        }
    }
    for index in &message.counters {
        let counter = &mut counters[*index];
        let _inside = counter.spec.field.insert(data, counter.count);
        counter.count = counter.count.wrapping_add(1);
    }
    frame
}
