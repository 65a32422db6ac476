//! The frames as `rig::wire` writes them, read with the DBC that is shipped for them.

use can::dbc::{Dbc, MessageSpec};
use rig::config::Config;
use rig::wire::{QualityFrame, SIGMA_UNKNOWN_RAW, Scale, TripleFrame, sigma_from_raw};

use super::examples;

fn dbc() -> Dbc {
    Dbc::read(&examples().join("wrench.dbc")).unwrap()
}

fn decoded(message: &MessageSpec, bytes: [u8; 8]) -> Vec<f64> {
    let mut data = [0; 64];
    data[..8].copy_from_slice(&bytes);
    message.signals.iter().map(|signal| signal.decode(&data).unwrap()).collect()
}

#[test]
fn force_and_torque_decode_with_the_shipped_dbc() {
    let config = Config::load(&examples().join("arm_fd.toml")).unwrap();
    let can = config.publish.can.unwrap();
    let dbc = dbc();
    let cases = [
        ("WrenchForce", can.force_id, can.force_n_per_bit, ["Fx", "Fy", "Fz"], "N"),
        ("WrenchTorque", can.torque_id, can.torque_nm_per_bit, ["Tx", "Ty", "Tz"], "Nm"),
    ];
    for (name, id, per_bit, components, unit) in cases {
        let message = dbc.message(name).unwrap();
        assert_eq!((message.id.number(), message.len), (id, 8));
        let names: Vec<_> = message.signals.iter().map(|signal| signal.name.as_str()).collect();
        assert_eq!(names, [components[0], components[1], components[2], "Sequence", "Status"]);
        assert!(message.signals[..3].iter().all(|signal| signal.unit == unit && signal.scale == per_bit));
        let scale = Scale(per_bit);
        let frame = TripleFrame::new([-3.0 * per_bit, 1234.0 * per_bit, 32767.0 * per_bit], scale, 250, 0x42);
        let expected: Vec<f64> = frame.value(scale).unwrap().into_iter().chain([250.0, 66.0]).collect();
        assert_eq!(decoded(message, frame.emit()), expected);
        let raw = -32768.0 * per_bit;
        assert_eq!(decoded(message, TripleFrame::invalid(1, 0).emit()), [raw, raw, raw, 1.0, 1.0]);
    }
}

#[test]
fn quality_decodes_to_logarithms() {
    let dbc = dbc();
    let message = dbc.message("WrenchQuality").unwrap();
    assert_eq!((message.id.number(), message.signals.len()), (0x402, 8));
    for raw in 0..SIGMA_UNKNOWN_RAW {
        let frame = QualityFrame { raw: [raw, 255 - raw, raw, 0, 254, raw / 2], sequence: raw, status: 0x10 };
        let values = decoded(message, frame.emit());
        for (value, raw) in values.iter().zip(frame.raw) {
            let sigma = 10f64.powf(*value);
            let expected = sigma_from_raw(raw).unwrap_or(sigma);
            assert!((sigma / expected - 1.0).abs() < 1e-12, "{raw}");
        }
        assert_eq!(values[6..], [f64::from(raw), 16.0]);
    }
}
