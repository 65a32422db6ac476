//! The flat decode table: from (interface, identifier) to signal values without search for standard identifiers

use crate::error::{Error, Result};
use crate::field::Field;
use crate::frame::{CanId, Stamped};
use crate::signal::{MuxCondition, SignalSpec, ValueKind, as_number};

const NONE: u16 = u16::MAX;
const STANDARD_IDS: usize = 0x800;

/// A wish to decode one signal of one interface into a slot
#[derive(Clone, Copy, Debug)]
pub struct Binding<'a> {
    /// The caller's number for the value
    pub slot: u16,
    /// The signal
    pub spec: &'a SignalSpec,
    /// Index into the configured list of interfaces
    pub interface: u8,
    /// SI units per DBC unit
    pub to_si: f64,
}

/// A message that at least one binding needs
#[derive(Clone, Debug, PartialEq)]
pub struct BoundMessage {
    /// Index into the configured list of interfaces
    pub interface: u8,
    /// Identifier
    pub id: CanId,
    /// Name in the DBC
    pub name: String,
    /// Payload bytes of its frames on the wire
    pub wire_len: u8,
    first_op: u32,
    end_op: u32,
}

/// One signal of a frame
#[derive(Clone, Copy, Debug)]
struct Op {
    field: Field,
    kind: ValueKind,
    slot: u16,
    first_mux: u32,
    end_mux: u32,
    scale: f64,
    offset: f64,
    to_si: f64,
}

/// What became of a frame
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Outcome {
    /// No binding needs it; remote requests and error frames are never needed
    Unbound,
    /// A needed message whose payload has another length than the DBC says: nothing was decoded
    WrongLength(usize),
    /// Decoded: index into [`DecodeTable::messages`]
    Decoded(usize),
}

/// One decoded value
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Value {
    /// Slot of its binding
    pub slot: u16,
    /// The signal's bits
    pub raw: u64,
    /// Physical value in SI units
    pub si: f64,
}

/// Compiled bindings
#[derive(Clone, Debug)]
pub struct DecodeTable {
    /// By interface and standard identifier: index of the message
    standard: Vec<u16>,
    /// Sorted by interface and identifier
    extended: Vec<(u8, u32, u16)>,
    messages: Vec<BoundMessage>,
    ops: Vec<Op>,
    mux: Vec<MuxCondition>,
}

impl DecodeTable {
    /// Compiles bindings; refuses messages that two DBCs describe differently
    pub fn new(bindings: &[Binding<'_>]) -> Result<Self> {
        let interfaces = bindings.iter().map(|b| usize::from(b.interface) + 1).max().unwrap_or(0);
        let mut order: Vec<&Binding<'_>> = bindings.iter().collect();
        order.sort_by_key(|b| (b.interface, b.spec.message_id.with_flag()));
        let mut table = Self {
            standard: vec![NONE; interfaces * STANDARD_IDS],
            extended: Vec::new(),
            messages: Vec::new(),
            ops: Vec::with_capacity(bindings.len()),
            mux: Vec::new(),
        };
        for binding in order {
            table.add(binding)?;
        }
        table.extended.sort_unstable();
        Ok(table)
    }

    fn add(&mut self, binding: &Binding<'_>) -> Result<()> {
        let spec = binding.spec;
        let wire_len = spec.wire_len() as u8;
        let known =
            self.messages.last().filter(|m| (m.interface, m.id) == (binding.interface, spec.message_id));
        match known {
            Some(message) if message.wire_len != wire_len || message.name != spec.message => {
                return Err(Error::Binding {
                    what: spec.full_name(),
                    why: format!(
                        "identifier {} is message {} with {} bytes elsewhere, here {} with {wire_len}; use one DBC an interface",
                        message.id, message.name, message.wire_len, spec.message
                    ),
                });
            }
            Some(_) => {}
            None => self.add_message(binding, wire_len)?,
        }
        let first_mux = self.mux.len() as u32;
        self.mux.extend(spec.mux.iter().cloned());
        self.ops.push(Op {
            field: spec.field,
            kind: spec.kind,
            slot: binding.slot,
            first_mux,
            end_mux: self.mux.len() as u32,
            scale: spec.scale,
            offset: spec.offset,
            to_si: binding.to_si,
        });
        if let Some(message) = self.messages.last_mut() {
            message.end_op = self.ops.len() as u32;
        }
        Ok(())
    }

    fn add_message(&mut self, binding: &Binding<'_>, wire_len: u8) -> Result<()> {
        let spec = binding.spec;
        let id = spec.message_id;
        let index = u16::try_from(self.messages.len()).ok().filter(|&index| index != NONE);
        let index = index.ok_or_else(|| Error::Binding {
            what: spec.full_name(),
            why: "more than 65534 messages are bound; bind fewer".into(),
        })?;
        if id.is_extended() {
            self.extended.push((binding.interface, id.number(), index));
        } else {
            self.standard[usize::from(binding.interface) * STANDARD_IDS + id.number() as usize] = index;
        }
        let op = self.ops.len() as u32;
        self.messages.push(BoundMessage {
            interface: binding.interface,
            id,
            name: spec.message.clone(),
            wire_len,
            first_op: op,
            end_op: op,
        });
        Ok(())
    }

    /// The messages that are decoded; [`Outcome`] has indices into this
    pub fn messages(&self) -> &[BoundMessage] {
        &self.messages
    }

    /// Identifiers that an interface must let through, for kernel filters
    pub fn wanted(&self, interface: u8) -> impl Iterator<Item = CanId> + '_ {
        self.messages.iter().filter(move |m| m.interface == interface).map(|m| m.id)
    }

    /// Largest number of values that one frame can give
    pub fn max_values_per_frame(&self) -> usize {
        self.messages.iter().map(|m| (m.end_op - m.first_op) as usize).max().unwrap_or(0)
    }

    /// Index of the message of an identifier
    #[inline]
    pub fn find(&self, interface: u8, id: CanId) -> Option<usize> {
        if id.is_extended() {
            let key = (interface, id.number());
            let at = self.extended.binary_search_by_key(&key, |&(i, n, _)| (i, n)).ok()?;
            return Some(self.extended[at].2.into());
        }
        let index = *self.standard.get(usize::from(interface) * STANDARD_IDS + id.number() as usize)?;
        (index != NONE).then_some(index.into())
    }

    /// Decodes one frame: calls `each` with every bound signal that it carries; no allocation, work bounded by the
    /// number of bindings to the message
    #[inline]
    pub fn decode(&self, stamped: &Stamped, mut each: impl FnMut(Value)) -> Outcome {
        let frame = &stamped.frame;
        if !frame.is_data() {
            return Outcome::Unbound;
        }
        let Some(index) = self.find(stamped.interface, frame.id()) else { return Outcome::Unbound };
        let message = &self.messages[index];
        if frame.len() != usize::from(message.wire_len) {
            return Outcome::WrongLength(index);
        }
        let data = frame.padded();
        for op in &self.ops[message.first_op as usize..message.end_op as usize] {
            if op.first_mux != op.end_mux {
                let conditions = &self.mux[op.first_mux as usize..op.end_mux as usize];
                if !conditions.iter().all(|condition| condition.holds(data)) {
                    continue;
                }
            }
            let raw = op.field.extract(data);
            let si = (as_number(op.kind, op.field.bits(), raw) * op.scale + op.offset) * op.to_si;
            each(Value { slot: op.slot, raw, si });
        }
        Outcome::Decoded(index)
    }
}
