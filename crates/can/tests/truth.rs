//! Against others: signals as cantools decodes them, lines as candump prints them, and a recorded arm
#![allow(clippy::unwrap_used, clippy::panic)] // a test may

use std::path::{Path, PathBuf};

use wrenchd_can::assembly::{Assembler, GaugeBinding, JointBinding, Layout, SignalBinding};
use wrenchd_can::candump::{
    Interfaces, Line, LogEvent, LogReader, MAX_LINE, StampDigits, format_line, parse_line,
};
use wrenchd_can::dbc::Dbc;
use wrenchd_can::decode::{Binding, DecodeTable, Outcome};
use wrenchd_can::frame::{CanId, Flags, Frame, Stamped};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data").join(name)
}

fn text(name: &str) -> String {
    std::fs::read_to_string(data(name)).unwrap()
}

fn bytes(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|at| u8::from_str_radix(&hex[at..at + 2], 16).unwrap()).collect()
}

fn same(a: f64, b: f64) -> bool {
    a == b || (a.is_nan() && b.is_nan()) || (a - b).abs() <= 1e-15 * a.abs().max(b.abs())
}

#[test]
fn signals_are_what_cantools_says() {
    let dbc = Dbc::read(&data("odd.dbc")).unwrap();
    let signals: Vec<_> = dbc.messages().iter().flat_map(|m| m.signals.clone()).collect();
    let bindings: Vec<_> = signals
        .iter()
        .enumerate()
        .map(|(slot, spec)| Binding { slot: slot as u16, spec, interface: 2, to_si: 1.0 })
        .collect();
    let table = DecodeTable::new(&bindings).unwrap();
    let mut seen = std::collections::HashSet::new();
    for line in text("cantools.txt").lines() {
        let mut words = line.split(' ');
        let raw = u32::from_str_radix(words.next().unwrap(), 16).unwrap();
        let id =
            if raw >> 31 == 1 { CanId::extended(raw & 0x1FFF_FFFF) } else { CanId::standard(raw) }.unwrap();
        let payload = bytes(words.next().unwrap());
        let frame =
            if payload.len() > 8 { Frame::fd(id, 1, &payload) } else { Frame::classical(id, &payload) }
                .unwrap();
        let mut decoded = Vec::new();
        let outcome = table.decode(&Stamped { stamp_ns: 0, interface: 2, frame }, |value| {
            let spec = &signals[usize::from(value.slot)];
            assert!(same(spec.decode(frame.padded()).unwrap(), value.si), "{}", spec.full_name());
            decoded.push((spec.name.clone(), value.si));
        });
        assert!(matches!(outcome, Outcome::Decoded(_)), "{line}");
        decoded.sort_by(|a, b| a.0.cmp(&b.0));
        let expected: Vec<_> = words
            .map(|word| word.split_once('=').unwrap())
            .map(|(name, value)| (name.to_string(), value.parse::<f64>().unwrap()))
            .collect();
        assert_eq!(decoded.len(), expected.len(), "{line}");
        for (got, want) in decoded.iter().zip(&expected) {
            assert!(got.0 == want.0 && same(got.1, want.1), "{line}: {got:?} is not {want:?}");
            seen.insert((raw, got.0.clone()));
        }
    }
    assert_eq!(seen.len(), signals.len(), "every signal was compared");
}

#[test]
fn a_multiplexed_signal_brings_its_selectors() {
    let dbc = Dbc::read(&data("odd.dbc")).unwrap();
    let deep = dbc.signal("Nested.Deep").unwrap();
    let mut payload = [0; 64];
    deep.insert(&mut payload[..8], -2.0).unwrap();
    assert_eq!(payload[..4], [1, 2, 0xFE, 0xFF]);
    payload[1] = 6;
    assert_eq!(deep.decode(&payload), Some(-2.0));
    payload[1] = 8;
    assert_eq!(deep.decode(&payload), None, "the inner selector has another page");
    payload[..2].copy_from_slice(&[2, 2]);
    assert_eq!(deep.decode(&payload), None, "the outer selector has another page");
    assert_eq!(dbc.message("Mixed").unwrap().cycle_ms, Some(20.0));
    let limited = dbc.signal("Mixed.Limited").unwrap();
    assert_eq!((limited.min, limited.max, limited.unit.as_str()), (Some(0.0), Some(50.0), "degC"));
}

#[test]
fn lines_are_what_candump_prints() {
    let id = |number| CanId::standard(number).unwrap();
    let long = |number| CanId::extended(number).unwrap();
    let frames = [
        Frame::classical(id(0x123), &[]),
        Frame::classical(id(0x123), &[0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88]),
        Frame::classical(long(0x123), &[0xAB]),
        Frame::classical(long(0x1FFF_FFFF), &[0xDE, 0xAD, 0xBE, 0xEF]),
        Frame::remote(id(0x7FF), 0),
        Frame::remote(id(0x001), 8),
        Frame::remote(id(0x001), 5),
        Frame::fd(id(0x123), 4, &[]),
        Frame::fd(id(0x123), 5, &[0x11, 0x22, 0x33]),
        Frame::fd(
            long(0x1234_5678),
            7,
            &[0, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77, 0x88, 0x99, 0xAA, 0xBB],
        ),
        Frame::fd(id(0x123), 5, &[0; 64]),
        Frame::error(4, &[0, 4, 0, 0, 0, 0, 0, 0]),
        Frame::classical(id(0x123), &[0, 0x11, 0x22, 0x33, 0x44, 0x55, 0x66, 0x77]),
        Frame::remote(id(0x001), 8),
    ];
    let text = text("candump.log");
    let lines: Vec<_> = text.lines().collect();
    assert_eq!(lines.len(), 2 * frames.len(), "plain, and with the direction behind it (-x)");
    for (line, expected) in lines.iter().zip(frames.iter().chain(&frames)) {
        let Ok(Line::Frame { stamp_ns, interface, frame }) = parse_line(line.as_bytes()) else {
            panic!("{line}")
        };
        assert_eq!((interface, Some(frame)), (&b"vcan0"[..], *expected), "{line}");
        let mut written = [0; MAX_LINE];
        let stamped = Stamped { stamp_ns, interface: 0, frame };
        let len = format_line(&mut written, &stamped, "vcan0", StampDigits::Micros);
        assert_eq!(
            std::str::from_utf8(&written[..len]).unwrap(),
            format!("{}\n", line.trim_end_matches(" T"))
        );
    }
    assert!(frames[11].unwrap().flags().has(Flags::ERROR));
}

#[test]
fn a_recorded_arm_gives_whole_rounds() {
    let dbc = Dbc::read(&data("arm.dbc")).unwrap();
    let bind = |name: String| SignalBinding { spec: dbc.signal(&name).unwrap(), interface: 0, to_si: 1.0 };
    let gauges = (1..=8).map(|n| {
        let pair = (n + 1) / 2 * 2;
        let message = format!("Strain{}{pair}", pair - 1);
        GaugeBinding {
            name: format!("s{n}"),
            counts: bind(format!("{message}.Counts{n}")),
            saturated: Some(bind(format!("{message}.Saturated{n}"))),
            sequence: Some(bind(format!("{message}.Sequence{}{pair}", pair - 1))),
            temperature: Some(bind(format!("GaugeTemperatures.Temperature{n}"))),
            delay_ns: None,
        }
    });
    let joints = (1..=6).map(|n| {
        let pair = (n + 1) / 2 * 2;
        let position = bind(format!("Joints{}{pair}.Position{n}", pair - 1));
        JointBinding { name: format!("joint_{n}"), position, velocity: None, delay_ns: None }
    });
    let layout = Layout {
        gauges: gauges.collect(),
        joints: joints.collect(),
        stale_after_ns: 20_000_000,
        temperature_stale_after_ns: 5_000_000_000,
    };
    let mut assembler = Assembler::new(&layout).unwrap();
    let mut reader = LogReader::open(&data("recorded.log"), Interfaces::fixed(&["can0"])).unwrap();
    let mut snapshots = Vec::new();
    while let Some(event) = reader.next_event().unwrap() {
        let LogEvent::Frame(stamped) = event else { panic!("{event:?}") };
        snapshots.extend_from_slice(assembler.push(&stamped));
    }
    assert!(snapshots.len() == 55 && snapshots.iter().all(|s| s.complete), "{:?}", assembler.counts());
    // (1790000000.000400) can0 101#EB44FCAF4E050000: 0xFC44EB signed is -244501; 201#92C3F0FF.. is -998510 urad
    let first = &snapshots[0];
    assert_eq!(first.instant_ns, 1_790_000_000_000_400_000);
    assert_eq!(first.gauges[0].unwrap().value, -244_501.0);
    assert_eq!(first.joints[0].position.unwrap().value, -998_510.0 * 1e-6);
    assert_eq!(snapshots[1].temperatures[0].unwrap().value, 24.0);
    assert!(
        snapshots
            .windows(2)
            .all(|pair| (pair[1].instant_ns - pair[0].instant_ns - 20_000_000).abs() < 100_000)
    );
}
