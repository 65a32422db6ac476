//! What comes from a bus or is recorded from one: logs, DBC files, frames.

use std::io::Cursor;
use std::path::Path;
use std::sync::OnceLock;

use can::candump::{Interfaces, Line, LogEvent, LogReader, MAX_LINE, StampDigits, format_line, parse_line};
use can::dbc::Dbc;
use can::frame::{CanId, Frame, MAX_LEN, Stamped};
use can::signal::SignalSpec;
use rig::cycle::Estimate;
use rig::{Cycle, ModelFile, Rig, Status};

use super::files::{CONFIG, DBC, URDF};

/// A log is read to its end, every line is counted once, and a frame that is written again is the same frame.
pub(crate) fn candump(data: &[u8]) -> bool {
    let path = Path::new("fuzz.log");
    let input = Box::new(Cursor::new(data.to_vec()));
    let Ok(mut reader) = LogReader::from_reader(input, path, Interfaces::learned()) else { return false };
    let (mut frames, mut malformed) = (0, 0);
    loop {
        match reader.next_event() {
            Ok(Some(LogEvent::Frame(stamped))) => {
                frames += 1;
                comes_back(&stamped, reader.interfaces().name(stamped.interface));
            }
            Ok(Some(LogEvent::Malformed { line, fault })) => {
                malformed += 1;
                assert!(line == reader.counts().lines && !fault.to_string().is_empty());
            }
            Ok(Some(LogEvent::Dropped { .. })) => {}
            Ok(None) => break,
            Err(error) => {
                assert!(error.to_string().contains("fuzz.log"), "{error}");
                return false;
            }
        }
    }
    let counts = reader.counts();
    assert_eq!((counts.frames, counts.malformed), (frames, malformed));
    assert!(counts.lines >= frames + malformed + counts.foreign);
    frames > 0
}

fn comes_back(stamped: &Stamped, interface: &str) {
    let mut line = [0; MAX_LINE];
    let length = format_line(&mut line, stamped, interface, StampDigits::Nanos);
    let name: Vec<u8> = interface.bytes().take(32).collect();
    match parse_line(&line[..length]) {
        Ok(Line::Frame { stamp_ns, interface, frame }) => {
            assert_eq!((stamp_ns, interface, frame), (stamped.stamp_ns, &name[..], stamped.frame));
        }
        other => panic!("{:?} is read as {other:?}", String::from_utf8_lossy(&line[..length])),
    }
}

/// A DBC that is accepted decodes any payload, and what can be encoded decodes to the same value.
pub(crate) fn dbc(data: &[u8]) -> bool {
    let text = String::from_utf8_lossy(data);
    let dbc = match Dbc::parse(&text, "fuzz.dbc") {
        Ok(dbc) => dbc,
        Err(error) => {
            assert!(error.to_string().contains("fuzz.dbc"), "{error}");
            return false;
        }
    };
    let payload: [u8; MAX_LEN] =
        std::array::from_fn(|at| data.get(at * 7 % data.len().max(1)).copied().unwrap_or_default());
    for message in dbc.messages() {
        assert!(dbc.message_by_id(message.id).is_some_and(|found| found.name == message.name));
        for signal in &message.signals {
            encode_and_decode(signal, payload);
        }
    }
    // The arm's own signals out of a strange DBC.
    let _ = Rig::from_texts(CONFIG.clone(), URDF, data);
    !dbc.messages().is_empty()
}

fn encode_and_decode(signal: &SignalSpec, mut payload: [u8; MAX_LEN]) {
    let Some(value) = signal.decode(&payload) else { return };
    if signal.insert(&mut payload, value).is_err() {
        return;
    }
    let again = signal.decode(&payload).expect("what was put in is there");
    // A count, or what f64 (f32) cannot tell apart near the offset and the value.
    let slack = signal.scale.abs() * 1.001 + 1e-6 * (value.abs() + signal.offset.abs());
    assert!((again - value).abs() <= slack, "{}: {value} comes back as {again}", signal.full_name());
}

/// The arm that frames are fed to.
fn arm() -> &'static (Rig, ModelFile) {
    static ARM: OnceLock<(Rig, ModelFile)> = OnceLock::new();
    ARM.get_or_init(|| {
        let rig = Rig::from_texts(CONFIG.clone(), URDF, DBC.as_bytes()).expect("the example arm");
        let text = include_str!("../corpus/model/arm.toml");
        let model = ModelFile::parse(Path::new("arm.toml"), text).expect("the example's model");
        (rig, model)
    })
}

/// A frame in 13 bytes: when (since the last, or anywhere in time), which message, how long, payload.
fn next_frame(bytes: &[u8; 13], stamp_ns: &mut i64, known: &[CanId]) -> Stamped {
    let [low, high, kind, which, length, data @ ..] = bytes;
    let step = i64::from(i16::from_le_bytes([*low, *high]));
    *stamp_ns = match kind & 3 {
        0 | 1 => stamp_ns.saturating_add(step * 1_000),
        2 => stamp_ns.saturating_add(step * 1_000_000_000),
        _ => (step << 48).max(0),
    };
    let id = match known.get(usize::from(*which) % (known.len() + 1)) {
        Some(id) => *id,
        None => CanId::standard(u32::from(*which)).expect("one byte is a standard identifier"),
    };
    let fd = *kind & 4 != 0;
    let payload = &data[..usize::from(length % 9).min(data.len())];
    let frame = match kind >> 3 & 7 {
        0 => Frame::remote(id, 8),
        1 => Frame::error(id.number(), payload),
        _ if fd => Frame::fd(id, 1, payload),
        _ => Frame::classical(id, if *length < 128 { payload } else { data }),
    };
    let interface = u8::from(*kind >> 6 == 3);
    Stamped { stamp_ns: *stamp_ns, interface, frame: frame.expect("of at most 8 bytes") }
}

/// Whatever frames come, whenever: a wrench that is published is finite with a true variance, and its status says what it is.
pub(crate) fn frames(data: &[u8]) -> bool {
    let (rig, model) = arm();
    let mut cycle = Cycle::new(rig, model).expect("the example's cycle");
    let mut known: Vec<CanId> = cycle.assembler().table().wanted(0).collect();
    known.sort();
    let mut stamp_ns = 1_790_000_000_000_000_000;
    let mut valid = false;
    let (frames, _) = data.as_chunks::<13>();
    for bytes in frames {
        let frame = next_frame(bytes, &mut stamp_ns, &known);
        cycle.push(&frame, |estimate| valid |= is_honest(estimate));
    }
    valid
}

/// Whether there is a wrench.
pub(crate) fn is_honest(estimate: &Estimate) -> bool {
    assert_eq!(estimate.outcome.is_err(), estimate.status.has(Status::INVALID), "{estimate:?}");
    let Ok(solution) = &estimate.outcome else { return false };
    assert!(solution.wrench.to_vector().iter().all(|x| x.is_finite()), "{estimate:?}");
    let variances = solution.covariance.diagonal();
    assert!(variances.iter().all(|v| v.is_finite() && *v > 0.0), "{estimate:?}");
    true
}
