//! Which signals a robot's gauges and joints are, compiled for the assembler

use crate::decode::{Binding, DecodeTable};
use crate::error::{Error, Result};
use crate::frame::CanId;
use crate::signal::{MuxCondition, SignalSpec};

/// A signal on an interface, with the factor into SI units
#[derive(Clone, PartialEq, Debug)]
pub struct SignalBinding {
    /// The signal
    pub spec: SignalSpec,
    /// Index into the configured list of interfaces
    pub interface: u8,
    /// SI units per DBC unit (1 for counts and degC)
    pub to_si: f64,
}

/// One gauge's signals
#[derive(Clone, PartialEq, Debug)]
pub struct GaugeBinding {
    /// Name for messages
    pub name: String,
    /// Raw reading in counts
    pub counts: SignalBinding,
    /// Other than 0: the reading is not used
    pub saturated: Option<SignalBinding>,
    /// Counts the frames of the gauge's message modulo its width
    pub sequence: Option<SignalBinding>,
    /// degC
    pub temperature: Option<SignalBinding>,
    /// Stamp minus sampling instant in ns, where the gauge has one of its own
    pub delay_ns: Option<i64>,
}

/// One joint's signals
#[derive(Clone, PartialEq, Debug)]
pub struct JointBinding {
    /// Name for messages
    pub name: String,
    /// rad after `to_si`
    pub position: SignalBinding,
    /// rad/s after `to_si`
    pub velocity: Option<SignalBinding>,
    /// Stamp minus sampling instant in ns, where the joint has one of its own
    pub delay_ns: Option<i64>,
}

/// All signals of a robot and how old they may be
#[derive(Clone, PartialEq, Debug)]
pub struct Layout {
    /// Gauges in the configuration's order
    pub gauges: Vec<GaugeBinding>,
    /// Joints in the configuration's order
    pub joints: Vec<JointBinding>,
    /// Readings of gauges and joints older than this are stale, ns
    pub stale_after_ns: i64,
    /// Temperatures (and saturation flags in messages of their own) older than this are stale, ns
    pub temperature_stale_after_ns: i64,
}

/// What a slot's value is for
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub(super) enum Role {
    /// Belongs to an awaited stream
    Streamed(u16),
    /// Held until stale, never awaited
    Held,
    /// Counter number
    Sequence(u16),
}

/// Slots of one gauge
#[derive(Clone, Copy, Debug)]
pub(super) struct GaugeSlots {
    pub(super) counts: u16,
    pub(super) stream: u16,
    /// Slot, and whether it comes with the counts
    pub(super) saturated: Option<(u16, bool)>,
    pub(super) temperature: Option<u16>,
    pub(super) delay_ns: Option<i64>,
}

/// Slots of one joint
#[derive(Clone, Copy, Debug)]
pub(super) struct JointSlots {
    pub(super) position: u16,
    pub(super) stream: u16,
    /// Slot and stream
    pub(super) velocity: Option<(u16, u16)>,
    pub(super) delay_ns: Option<i64>,
}

/// What makes frames of one message arrivals of the same stream: interface, identifier and multiplexer page
#[derive(Clone, PartialEq, Debug)]
struct StreamKey {
    interface: u8,
    id: CanId,
    mux: Vec<MuxCondition>,
}

/// A layout with every signal numbered
#[derive(Debug)]
pub(super) struct Compiled {
    pub(super) table: DecodeTable,
    pub(super) roles: Vec<Role>,
    pub(super) gauges: Vec<GaugeSlots>,
    pub(super) joints: Vec<JointSlots>,
    /// Message of each stream
    pub(super) stream_messages: Vec<usize>,
    /// Bits of each counter
    pub(super) sequence_bits: Vec<u8>,
    /// Whether each counter goes on by one a cycle: not one that counts the frames of several pages
    pub(super) counts_cycles: Vec<bool>,
}

struct Compiler<'a> {
    bindings: Vec<Binding<'a>>,
    roles: Vec<Role>,
    streams: Vec<StreamKey>,
    sequences: Vec<&'a SignalBinding>,
}

impl Layout {
    pub(super) fn compile(&self) -> Result<Compiled> {
        if self.stale_after_ns <= 0 || self.temperature_stale_after_ns <= 0 {
            return Err(fault("stale_after_s", "must be more than 0"));
        }
        let mut compiler =
            Compiler { bindings: Vec::new(), roles: Vec::new(), streams: Vec::new(), sequences: Vec::new() };
        let gauges = self.gauges.iter().map(|gauge| compiler.gauge(gauge)).collect::<Result<Vec<_>>>()?;
        let joints = self.joints.iter().map(|joint| compiler.joint(joint)).collect::<Result<Vec<_>>>()?;
        let table = DecodeTable::new(&compiler.bindings)?;
        let stream_messages = compiler
            .streams
            .iter()
            .map(|key| table.find(key.interface, key.id).expect("every stream has a binding in the table"))
            .collect();
        let sequence_bits = compiler.sequences.iter().map(|binding| binding.spec.bits).collect();
        let counts_cycles =
            compiler.sequences.iter().map(|binding| compiler.counts_cycles(binding)).collect();
        Ok(Compiled {
            table,
            roles: compiler.roles,
            gauges,
            joints,
            stream_messages,
            sequence_bits,
            counts_cycles,
        })
    }
}

fn fault(what: &str, why: impl Into<String>) -> Error {
    Error::Binding { what: what.into(), why: why.into() }
}

impl<'a> Compiler<'a> {
    fn slot(&mut self, binding: &'a SignalBinding, role: Role) -> Result<u16> {
        if binding.to_si == 0.0 || !binding.to_si.is_finite() {
            return Err(fault(
                &binding.spec.full_name(),
                format!("unit factor {} is no factor", binding.to_si),
            ));
        }
        let slot = u16::try_from(self.roles.len())
            .map_err(|_| fault(&binding.spec.full_name(), "more than 65535 signals are bound; bind fewer"))?;
        self.roles.push(role);
        let SignalBinding { spec, interface, to_si } = binding;
        self.bindings.push(Binding { slot, spec, interface: *interface, to_si: *to_si });
        Ok(slot)
    }

    fn stream(&mut self, binding: &SignalBinding) -> u16 {
        let key = StreamKey {
            interface: binding.interface,
            id: binding.spec.message_id,
            mux: binding.spec.mux.clone(),
        };
        let known = self.streams.iter().position(|candidate| *candidate == key);
        known.unwrap_or_else(|| {
            self.streams.push(key);
            self.streams.len() - 1
        }) as u16
    }

    fn streamed(&mut self, binding: &'a SignalBinding) -> Result<(u16, u16)> {
        let stream = self.stream(binding);
        Ok((self.slot(binding, Role::Streamed(stream))?, stream))
    }

    fn gauge(&mut self, gauge: &'a GaugeBinding) -> Result<GaugeSlots> {
        let (counts, stream) = self.streamed(&gauge.counts)?;
        let same_frame = |other: &SignalBinding| {
            let counts = &gauge.counts;
            other.interface == counts.interface
                && other.spec.message_id == counts.spec.message_id
                && (other.spec.mux.is_empty() || other.spec.mux == counts.spec.mux)
        };
        let saturated = match &gauge.saturated {
            Some(flag) if same_frame(flag) => Some((self.slot(flag, Role::Held)?, true)),
            Some(flag) => Some((self.slot(flag, Role::Held)?, false)),
            None => None,
        };
        let temperature = match &gauge.temperature {
            Some(binding) => Some(self.slot(binding, Role::Held)?),
            None => None,
        };
        if let Some(sequence) = &gauge.sequence {
            if !same_frame(sequence) {
                let why = format!(
                    "its sequence {} counts another message than {}; name the counter in the gauge's own message",
                    sequence.spec.full_name(),
                    gauge.counts.spec.full_name()
                );
                return Err(fault(&format!("gauge {}", gauge.name), why));
            }
            self.sequence(sequence)?;
        }
        Ok(GaugeSlots { counts, stream, saturated, temperature, delay_ns: gauge.delay_ns })
    }

    fn counts_cycles(&self, counter: &SignalBinding) -> bool {
        let own = |key: &&StreamKey| key.interface == counter.interface && key.id == counter.spec.message_id;
        !counter.spec.mux.is_empty() || self.streams.iter().filter(own).count() <= 1
    }

    fn sequence(&mut self, sequence: &'a SignalBinding) -> Result<()> {
        let known =
            self.sequences.iter().any(|s| s.interface == sequence.interface && s.spec == sequence.spec);
        if !known {
            let number = self.sequences.len() as u16;
            self.slot(sequence, Role::Sequence(number))?;
            self.sequences.push(sequence);
        }
        Ok(())
    }

    fn joint(&mut self, joint: &'a JointBinding) -> Result<JointSlots> {
        let (position, stream) = self.streamed(&joint.position)?;
        let velocity = match &joint.velocity {
            Some(binding) => Some(self.streamed(binding)?),
            None => None,
        };
        Ok(JointSlots { position, stream, velocity, delay_ns: joint.delay_ns })
    }
}
