//! MCAP files as others read them: the mcap packages from PyPI.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Duration;

use wrenchd_tests::{process, python};

fn captures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/captures")
}

fn wrenchctl(args: &[&str]) -> Output {
    let output = Command::new(env!("CARGO_BIN_EXE_wrenchctl")).args(args).output().unwrap();
    assert!(output.status.success(), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

/// The wrenches of a CSV of `validate`: time from the first frame (s) and wrench.
fn validated(file: &Path) -> Vec<(f64, [f64; 6])> {
    let text = std::fs::read_to_string(file).unwrap();
    let rows = text
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(|word| word.parse::<f64>().ok()).collect::<Vec<_>>());
    let row = |row: Vec<Option<f64>>| {
        let wrench: Option<Vec<f64>> =
            row[1..7].iter().map(|value| value.filter(|value| value.is_finite())).collect();
        Some((row[0]?, <[f64; 6]>::try_from(wrench?).ok()?))
    };
    rows.filter_map(row).collect()
}

#[test]
fn the_mcap_package_reads_wrench_and_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let text = |path: &Path| path.to_str().unwrap().to_owned();
    let (model, out, csv) = (path("model.toml"), path("run.mcap"), path("run.csv"));
    let run = captures().join("accuracy");
    wrenchctl(&["calibrate", &text(&captures().join("calibration")), "--out", &text(&model)]);
    wrenchctl(&["validate", &text(&run), "--model", &text(&model), "--csv", &text(&csv)]);
    let config = text(&run.join("arm.toml"));
    wrenchctl(&["mcap", &text(&run), "--config", &config, "--model", &text(&model), "--out", &text(&out)]);
    let mut reader = python::script("read_mcap.py").unwrap();
    let said = process::run(reader.arg(&out), Duration::from_secs(120)).unwrap().stdout();
    assert!(said.starts_with("profile ros2\n"), "{}", &said[..300]);
    let messages = |topic: &str| -> Vec<Vec<String>> {
        let of = |line: &str| {
            Some(line.strip_prefix(&format!("message {topic} "))?.split(' ').map(str::to_owned).collect())
        };
        said.lines().filter_map(of).collect()
    };
    // Every frame of the log, in its order.
    let dumped = String::from_utf8(wrenchctl(&["dump", &text(&run)]).stdout).unwrap();
    let frames = messages("/can/can0");
    let logged: Vec<&str> = dumped.lines().filter(|line| line.starts_with('(')).collect();
    assert!(frames.len() > 5000 && frames.len() == logged.len(), "{} of {}", frames.len(), logged.len());
    for (frame, line) in frames.iter().zip(logged) {
        let (stamp, rest) = line.split_once(") can0 ").unwrap();
        assert_eq!((frame[2].as_str(), frame[3].as_str()), ("can0", rest.trim_end()), "{line}");
        assert!(frame[1].starts_with(&stamp[1..].replace('.', "")), "{frame:?} {line}");
        assert_eq!(frame[4..], ["False", "False", "False"]);
    }
    // Every wrench that validate computes.
    let (wrenches, expected) = (messages("/wrench"), validated(&csv));
    assert!(
        wrenches.len() > 500 && wrenches.len() == expected.len(),
        "{} of {}",
        wrenches.len(),
        expected.len()
    );
    let first_ns: i64 = frames[0][1].parse().unwrap();
    for (wrench, (t_s, expected)) in wrenches.iter().zip(expected) {
        assert_eq!(wrench[2], "tool0");
        assert!(
            ((wrench[1].parse::<i64>().unwrap() - first_ns) as f64 * 1e-9 - t_s).abs() < 1e-5,
            "{wrench:?} {t_s}"
        );
        for (word, value) in wrench[3..].iter().zip(expected) {
            assert!(
                (word.parse::<f64>().unwrap() - value).abs() < 2e-6 * (1.0 + value.abs()),
                "{wrench:?} {expected:?}"
            );
        }
    }
    let said = messages("/diagnostics");
    assert!(
        said.first().is_some_and(|first| first[3] == "2")
            && said.iter().any(|said| said[3..] == ["0", "good"]),
        "{said:?}"
    );
}

/// The example arm over CAN FD, simulated.
#[test]
fn the_mcap_package_reads_can_fd_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/arm_fd.toml");
    let config = config.to_str().unwrap();
    let (known, run, model, out) = (path("known"), path("run"), path("model.toml"), path("run.mcap"));
    wrenchctl(&["simulate", "--config", config, "--motion", "calibration", "--rate", "10", "--out", &known]);
    wrenchctl(&["simulate", "--config", config, "--motion", "holds", "--rate", "10", "--out", &run]);
    wrenchctl(&["calibrate", &known, "--axes", "nominal", "--out", &model]);
    let mcap = ["mcap", &run, "--config", config, "--model", &model, "--out"];
    let said = String::from_utf8(wrenchctl(&[&mcap[..], &[&out]].concat()).stdout).unwrap();
    assert!(said.contains("of them CAN FD") && !said.contains("left out"), "{said}");
    let dumped = String::from_utf8(wrenchctl(&["dump", &run]).stdout).unwrap();
    let logged: Vec<&str> = dumped.lines().filter(|line| line.contains("##")).collect();
    let mut reader = python::script("read_mcap.py").unwrap();
    let said = process::run(reader.arg(&out), Duration::from_secs(120)).unwrap().stdout();
    assert!(said.contains(" ros2_socketcan_msgs/msg/FdFrame ros2msg cdr "), "{}", &said[..600]);
    let frames: Vec<Vec<&str>> = said
        .lines()
        .filter(|line| line.starts_with("message /can/") && line.contains("##"))
        .map(|line| line.split(' ').collect())
        .collect();
    assert!(frames.len() > 100 && frames.len() == logged.len(), "{} of {}", frames.len(), logged.len());
    for (frame, line) in frames.iter().zip(logged) {
        let (stamp, rest) = line[1..].split_once(") ").unwrap();
        let (interface, rest) = rest.split_once(' ').unwrap();
        // The nibble behind ## has the frame's flags, for which the message has no place.
        let (id, data) = rest.trim_end().split_once("##").unwrap();
        assert_eq!((frame[1], frame[4]), (format!("/can/{interface}/fd").as_str(), interface), "{line}");
        assert_eq!(frame[5], format!("{id}##{}", &data[1..]), "{line}");
        assert!(frame[3].starts_with(&stamp.replace('.', "")), "{frame:?} {line}");
        assert_eq!(frame[6..], ["False", "False"]);
    }
    // To a pipe, which cannot seek, the same bytes.
    let piped = wrenchctl(&[&mcap[..], &["-"]].concat());
    assert!(piped.stdout == std::fs::read(&out).unwrap(), "{} bytes", piped.stdout.len());
    assert!(String::from_utf8_lossy(&piped.stderr).contains("of them CAN FD"));
    // The system's own reason.
    let full = Command::new(env!("CARGO_BIN_EXE_wrenchctl")).args(mcap).arg("/dev/full").output().unwrap();
    let why = String::from_utf8_lossy(&full.stderr);
    assert_eq!(full.status.code(), Some(2), "{why}");
    assert!(why.contains("/dev/full") && why.contains("No space left"), "{why}");
}
