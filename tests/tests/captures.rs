//! The committed captures, judged against the independent decoder and the gauges that were simulated.

use std::path::Path;
use std::process::Command;
use std::time::Duration;
use wrenchd_tests::candump;
use wrenchd_tests::process;
use wrenchd_tests::programs::programs;
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

/// The calibration capture gives the gauges back that its recording was made with, to within what it says of itself.
#[test]
fn the_calibration_capture_gives_its_gauges_back() {
    let captures = Path::new(env!("CARGO_MANIFEST_DIR")).join("captures");
    let place = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let mut command = Command::new(&programs().unwrap().wrenchctl);
    command.arg("calibrate").arg(captures.join("calibration")).arg("--out").arg(place.join("captured.toml"));
    let json = process::run(command.args(["--json", "-"]), Duration::from_secs(120)).unwrap().stdout();
    let found: serde_json::Value = serde_json::from_str(&json).unwrap();
    let table = std::fs::read_to_string(captures.join("gauges.csv")).unwrap();
    let (mut squares, mut count) = (0.0, 0.0);
    for (gauge, row) in found["sensors"].as_array().unwrap().iter().zip(table.lines().skip(1)) {
        let fields: Vec<&str> = row.split(',').collect();
        let true_values: Vec<f64> = fields[1..].iter().map(|field| field.parse().unwrap()).collect();
        assert_eq!(gauge["name"], fields[0]);
        for (name, true_value) in ["r", "ax", "ay", "lx", "ly", "pitch", "bias"].into_iter().zip(&true_values)
        {
            let error = (gauge[name].as_f64().unwrap() - true_value) / gauge["sigma"][name].as_f64().unwrap();
            assert!(error.abs() < 4.0, "{name} of {} is {error} sigma off", fields[0]);
            squares += error * error;
            count += 1.0;
        }
        let crosstalk = gauge["crosstalk_percent"].as_f64().unwrap();
        assert!((crosstalk - true_values[7]).abs() < 0.5, "crosstalk of {}: {crosstalk} %", fields[0]);
    }
    assert_eq!(count, 8.0 * 7.0);
    let rms = f64::sqrt(squares / count);
    assert!((0.6..1.5).contains(&rms), "errors are {rms} times the reported standard deviations");
}
