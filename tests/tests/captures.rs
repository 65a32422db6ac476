//! The committed captures, read by the independent decoder.

use std::path::Path;
use wrenchd_tests::candump;
use wrenchd_tests::python::decode;

/// The CAN FD form of a recording carries the same values as the classical one, by its own DBC.
#[test]
fn the_fd_form_carries_the_same_values() {
    let captures = Path::new(env!("CARGO_MANIFEST_DIR")).join("captures");
    let lines = candump::read(&captures.join("accuracy/can.log.gz")).unwrap();
    let place = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let (classical_log, fd_log) = (place.join("classical.log"), place.join("fd.log"));
    candump::write(&classical_log, &lines).unwrap();
    candump::write(&fd_log, &candump::as_fd(&lines)).unwrap();

    let classical = decode(&captures.join("accuracy/arm_a.dbc"), &classical_log).unwrap();
    let fd = decode(&captures.join("arm_fd.dbc"), &fd_log).unwrap();
    assert_eq!(classical.len(), lines.len());
    let rounds: Vec<_> = fd.iter().filter(|frame| frame.message == "Round").collect();
    assert_eq!(rounds.len(), 1250);
    let values = |message: &str, signal: &str| -> Vec<f64> {
        classical.iter().filter(|frame| frame.message == message).map(|frame| frame.signals[signal]).collect()
    };
    for (message, signal) in [
        ("Joints12", "Position1"),
        ("Joints56", "Position6"),
        ("Strain12", "Counts1"),
        ("Strain78", "Sequence78"),
    ] {
        let packed: Vec<f64> = rounds.iter().map(|frame| frame.signals[signal]).collect();
        assert_eq!(packed, values(message, signal), "{message}.{signal}");
    }
    // Raw payload 17E01500 of the first frame, little-endian micro-radians.
    assert!((rounds[0].signals["Position1"] - 1.433_623).abs() < 1e-12, "{:?}", rounds[0]);
}
