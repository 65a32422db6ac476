//! From the parser's structures to checked ones; the only file that knows the parser

use super::{MessageSpec, content};
use crate::error::{Error, Result};
use crate::field::{ByteOrder, Field};
use crate::frame::{CanId, MAX_LEN};
use crate::signal::{MuxCondition, SignalSpec, ValueKind};

/// Pseudo message in which editors keep signals that belong to none
const ORPHANAGE: &str = "VECTOR__INDEPENDENT_SIG_MSG";

/// Parses a DBC's text and checks each message and signal by itself
pub(super) fn messages(text: &str, file: &str) -> Result<Vec<MessageSpec>> {
    check_ids(text, file)?;
    let mut whole = String::with_capacity(text.len() + 1);
    whole.push_str(text);
    whole.push('\n'); // the grammar wants the last line ended
    let parsed = std::panic::catch_unwind(|| can_dbc::Dbc::try_from(whole.as_str())).map_err(|_| {
        Error::DbcSyntax { file: file.into(), line: 1, why: "the parser gave up on this file".into() }
    })?;
    let raw = parsed.map_err(|error| syntax_error(&error, file))?;
    let real = raw.messages.iter().filter(|message| message.name != ORPHANAGE);
    real.map(|message| convert_message(message, &raw, file)).collect()
}

/// The parser cuts standard identifiers to 16 bits without a word, so they are checked in the text itself
fn check_ids(text: &str, file: &str) -> Result<()> {
    for (index, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        if words.next() != Some("BO_") {
            continue;
        }
        let (Some(id), Some(name)) = (words.next(), words.next()) else { continue };
        let is_id = !id.is_empty() && id.bytes().all(|byte| byte.is_ascii_digit());
        if !is_id || name.starts_with(ORPHANAGE) {
            continue;
        }
        let fits = id.parse::<u32>().is_ok_and(|id| id <= 0x7FF || (id >> 29) == 0b100);
        if !fits {
            return Err(Error::DbcSyntax {
                file: file.into(),
                line: index + 1,
                why: format!(
                    "identifier {id} is neither a standard one (0..=2047) nor an extended one (2147483648 + 0..=536870911)"
                ),
            });
        }
    }
    Ok(())
}

fn syntax_error(error: &can_dbc::DbcError, file: &str) -> Error {
    let text = error.to_string();
    // Parser errors come as a drawing that begins with " --> line:column" and ends with "= what was expected".
    let line = text
        .split_once("--> ")
        .and_then(|(_, rest)| rest.split(':').next()?.trim().parse().ok())
        .unwrap_or(1);
    let excerpt = text.lines().find_map(|l| l.split_once(" | ").map(|(_, code)| code.trim()));
    let expected = text.rsplit_once("= ").map_or(text.as_str(), |(_, expected)| expected.trim());
    let why = match excerpt {
        Some(code) if !code.is_empty() => format!("{expected} at {code:?}"),
        _ => expected.to_string(),
    };
    Error::DbcSyntax { file: file.into(), line, why }
}

fn convert_id(id: can_dbc::MessageId) -> Option<CanId> {
    match id {
        can_dbc::MessageId::Standard(id) => CanId::standard(id.into()),
        can_dbc::MessageId::Extended(id) => CanId::extended(id),
    }
}

fn convert_message(message: &can_dbc::Message, dbc: &can_dbc::Dbc, file: &str) -> Result<MessageSpec> {
    let what = || format!("message {}", message.name);
    let id = convert_id(message.id)
        .ok_or_else(|| content(file, what(), "its identifier has more than 29 bits"))?;
    if message.size > MAX_LEN as u64 {
        let why = format!("{} bytes, but CAN FD carries at most 64; correct its length", message.size);
        return Err(content(file, what(), why));
    }
    let signals = message.signals.iter().map(|signal| convert_signal(signal, message, id, dbc, file));
    let cycle_ms = dbc
        .attribute_values_message
        .iter()
        .find(|value| value.message_id == message.id && value.name == "GenMsgCycleTime")
        .and_then(|value| match value.value {
            can_dbc::AttributeValue::Uint(ms) => Some(ms as f64),
            can_dbc::AttributeValue::Int(ms) => Some(ms as f64),
            can_dbc::AttributeValue::Double(ms) => Some(ms),
            can_dbc::AttributeValue::String(_) => None,
        })
        .filter(|&ms| ms.is_finite() && ms > 0.0);
    Ok(MessageSpec {
        id,
        name: message.name.clone(),
        len: message.size as u8,
        cycle_ms,
        signals: signals.collect::<Result<_>>()?,
    })
}

fn convert_signal(
    signal: &can_dbc::Signal,
    message: &can_dbc::Message,
    id: CanId,
    dbc: &can_dbc::Dbc,
    file: &str,
) -> Result<SignalSpec> {
    let fault = |why: String| content(file, format!("signal {}.{}", message.name, signal.name), why);
    let kind = value_kind(signal, message.id, dbc);
    let float_bits = match kind {
        ValueKind::F32 => Some(32),
        ValueKind::F64 => Some(64),
        ValueKind::Signed | ValueKind::Unsigned => None,
    };
    if let Some(bits) = float_bits.filter(|&bits| bits != signal.size) {
        return Err(fault(format!(
            "a float of {bits} bits (SIG_VALTYPE_) that is declared {} bits long",
            signal.size
        )));
    }
    if signal.factor == 0.0 || !signal.factor.is_finite() || !signal.offset.is_finite() {
        let why = format!(
            "scale {} and offset {} give no value; the scale must not be 0",
            signal.factor, signal.offset
        );
        return Err(fault(why));
    }
    let field = field_of(signal, message).map_err(fault)?;
    let mux = mux_conditions(signal, message, dbc, 0).map_err(fault)?;
    let (min, max) = limits(signal);
    Ok(SignalSpec {
        message_id: id,
        message: message.name.clone(),
        name: signal.name.clone(),
        message_len: message.size as u8,
        start_bit: signal.start_bit as u16,
        bits: signal.size as u8,
        order: byte_order(signal),
        kind,
        scale: signal.factor,
        offset: signal.offset,
        min,
        max,
        unit: signal.unit.clone(),
        mux,
        field,
    })
}

fn byte_order(signal: &can_dbc::Signal) -> ByteOrder {
    match signal.byte_order {
        can_dbc::ByteOrder::LittleEndian => ByteOrder::Little,
        can_dbc::ByteOrder::BigEndian => ByteOrder::Big,
    }
}

fn value_kind(signal: &can_dbc::Signal, message: can_dbc::MessageId, dbc: &can_dbc::Dbc) -> ValueKind {
    let extended = dbc
        .signal_extended_value_type_list
        .iter()
        .find(|entry| entry.message_id == message && entry.signal_name == signal.name)
        .map(|entry| entry.signal_extended_value_type);
    match (extended, signal.value_type) {
        (Some(can_dbc::SignalExtendedValueType::IEEEfloat32Bit), _) => ValueKind::F32,
        (Some(can_dbc::SignalExtendedValueType::IEEEdouble64bit), _) => ValueKind::F64,
        (_, can_dbc::ValueType::Signed) => ValueKind::Signed,
        (_, can_dbc::ValueType::Unsigned) => ValueKind::Unsigned,
    }
}

fn field_of(signal: &can_dbc::Signal, message: &can_dbc::Message) -> std::result::Result<Field, String> {
    if !(1..=64).contains(&signal.size) {
        return Err(format!("{} bits, but a signal has 1 to 64", signal.size));
    }
    Field::new(signal.start_bit, signal.size, byte_order(signal))
        .filter(|field| field.end_byte() as u64 <= message.size)
        .ok_or_else(|| {
            format!(
                "{} bits from start bit {} leave the {} bytes of its message; correct start bit, length or byte order",
                signal.size, signal.start_bit, message.size
            )
        })
}

/// `[0|0]` and the like means no limits
fn limits(signal: &can_dbc::Signal) -> (Option<f64>, Option<f64>) {
    let number = |value: can_dbc::NumericValue| match value {
        can_dbc::NumericValue::Uint(value) => value as f64,
        can_dbc::NumericValue::Int(value) => value as f64,
        can_dbc::NumericValue::Double(value) => value,
    };
    let (min, max) = (number(signal.min), number(signal.max));
    if min < max { (Some(min), Some(max)) } else { (None, None) }
}

/// All selectors above a signal, outermost first
fn mux_conditions(
    signal: &can_dbc::Signal,
    message: &can_dbc::Message,
    dbc: &can_dbc::Dbc,
    depth: usize,
) -> std::result::Result<Vec<MuxCondition>, String> {
    use can_dbc::MultiplexIndicator as Mux;
    if depth > 8 {
        return Err("its selectors select each other; correct SG_MUL_VAL_".into());
    }
    let extended = dbc
        .extended_multiplex
        .iter()
        .find(|entry| entry.message_id == message.id && entry.signal_name == signal.name);
    let (selector, ranges) = match (extended, signal.multiplexer_indicator) {
        (Some(entry), _) => {
            let selector =
                message.signals.iter().find(|candidate| candidate.name == entry.multiplexor_signal_name);
            let ranges =
                entry.mappings.iter().map(|range| (range.min_value, range.max_value)).collect::<Vec<_>>();
            if let Some((low, high)) = ranges.iter().find(|(low, high)| low > high) {
                return Err(format!("its selector range {low}-{high} is backwards"));
            }
            (
                selector.ok_or_else(|| {
                    format!("its selector {} does not exist", entry.multiplexor_signal_name)
                })?,
                ranges,
            )
        }
        (None, Mux::MultiplexedSignal(value) | Mux::MultiplexorAndMultiplexedSignal(value)) => {
            let mut selectors =
                message.signals.iter().filter(|s| s.multiplexer_indicator == Mux::Multiplexor);
            let selector = selectors.next().ok_or("multiplexed, but its message has no selector (M)")?;
            if selectors.next().is_some() {
                return Err("multiplexed by one of several selectors; say which with SG_MUL_VAL_".into());
            }
            (selector, vec![(value, value)])
        }
        (None, Mux::Multiplexor | Mux::Plain) => return Ok(Vec::new()),
    };
    let mut conditions = mux_conditions(selector, message, dbc, depth + 1)?;
    let field = field_of(selector, message)?;
    conditions.push(MuxCondition { selector: selector.name.clone(), field, ranges });
    Ok(conditions)
}
