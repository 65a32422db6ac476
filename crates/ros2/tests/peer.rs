//! The program against an independent implementation of zenoh (eclipse-zenoh from PyPI), which stands for ROS 2.
//!
//! In the daemon's place a thread speaks its control socket's language with its own types: a wrench, then none, then one again.
#![allow(clippy::unwrap_used, clippy::panic)]

use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use wrenchd::control::{Record, Reply, Request};
use wrenchd::view::{DaemonStatus, Gauge, Live};
use wrenchd_tests::process::Program;
use wrenchd_tests::python;

const PORT: u16 = 17_447;
const LIMIT: Duration = Duration::from_secs(120);
const START_NS: i64 = 1_790_000_000_123_456_789;
/// Records without a wrench.
const SILENT: std::ops::Range<u64> = 200..300;
const HASH: &str = "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77";

fn config(folder: &Path) -> PathBuf {
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/arm.toml");
    let text = std::fs::read_to_string(example).unwrap();
    let socket = folder.join("control.sock");
    let text = text.replace("/run/wrenchd/control.sock", socket.to_str().unwrap());
    let ros2 =
        format!("[publish.ros2]\ntopic = \"arm/wrench\"\ndomain = 7\nendpoint = \"tcp/127.0.0.1:{PORT}\"\n");
    let file = folder.join("arm.toml");
    std::fs::write(&file, format!("{text}\n{ros2}")).unwrap();
    for name in ["arm.urdf", "arm.dbc"] {
        std::fs::copy(
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(name),
            folder.join(name),
        )
        .unwrap();
    }
    file
}

/// The record of a number: in the third second there is no wrench.
fn record(sequence: u64) -> Record {
    let valid = !SILENT.contains(&sequence);
    Record {
        sequence,
        instant_ns: START_NS + sequence as i64 * 10_000_000,
        published_ns: START_NS + sequence as i64 * 10_000_000 + 700_000,
        status: if valid { 0 } else { 9 },
        reason: (!valid).then(|| "no snapshot within stale_after_s".to_owned()),
        wrench: valid.then(|| [1.5, -2.25, 3.0, 0.125, -0.5, sequence as f64]),
    }
}

fn status() -> Reply {
    let gauge = Gauge {
        name: "s1".into(),
        state: "used".into(),
        suspect: true,
        counts: 1.0,
        residual_sigma: 0.0,
        zero_shift_counts: 0.0,
    };
    let live = Live {
        sequence: 1,
        published_s: 0.0,
        age_s: 0.001,
        latency_s: 0.0,
        status: 48,
        status_names: vec!["uncertain".into(), "parity".into()],
        reason: None,
        wrench: Some([0.0; 6]),
        sigma: Some([0.01; 6]),
        covariance: None,
        singular_values_per_n: None,
        protection: Some([None; 6]),
        parity: None,
        gauges: vec![gauge],
        tare: None,
        payload: None,
    };
    let status = DaemonStatus {
        version: String::new(),
        config: String::new(),
        model: String::new(),
        model_sha256: "0".repeat(64),
        mode: "event".into(),
        rate_hz: 1000.0,
        uptime_s: 1.0,
        published_hz: 100.0,
        frames_hz: 700.0,
        latency_p99_s: None,
        totals: std::collections::BTreeMap::new(),
        live: Some(live),
    };
    Reply { ok: true, status: Some(Box::new(status)), ..Reply::default() }
}

/// Answers one client to its end.
fn attend(stream: UnixStream) -> std::io::Result<()> {
    let mut line = String::new();
    BufReader::new(stream.try_clone()?).read_line(&mut line)?;
    let mut stream = stream;
    let mut send = |text: String| stream.write_all((text + "\n").as_bytes());
    match Request::parse(line.as_bytes()) {
        Ok(Request::Records {}) => (0..u64::MAX).try_for_each(|sequence| {
            std::thread::sleep(Duration::from_millis(10));
            send(serde_json::to_string(&record(sequence))?)
        }),
        Ok(Request::Stream { .. }) => loop {
            send(serde_json::to_string(&status())?)?;
            std::thread::sleep(Duration::from_millis(500));
        },
        other => panic!("the program asked {other:?}"),
    }
}

fn serve(socket: &Path) {
    let listener = UnixListener::bind(socket).unwrap();
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            std::thread::spawn(move || attend(stream));
        }
    });
}

/// Numbers of a wrench's line behind its key: publisher's number, time, identity, sec, nanosec, frame, wrench.
fn words<'a>(line: &'a str, key: &str) -> Option<Vec<&'a str>> {
    let rest = line.strip_prefix(&format!("message {key} "))?;
    Some(rest.split(' ').collect())
}

/// Number of the record that a wrench's line is of.
fn number(words: &[&str]) -> u64 {
    words[11].parse::<f64>().unwrap() as u64
}

#[test]
fn a_ros_2_node_gets_the_wrench_its_silence_and_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let config = config(folder.path());
    serve(&folder.path().join("control.sock"));
    let mut peer = Program::start(python::script("ros2_peer.py").unwrap().arg(PORT.to_string())).unwrap();
    peer.wait_for("listening", LIMIT).unwrap();
    let program =
        Program::start(Command::new(env!("CARGO_BIN_EXE_wrenchd-ros2")).arg("--config").arg(&config))
            .unwrap();
    // The wrench has gone, its reason was told, and it has come back.
    peer.wait_for("invalid + stale: no snapshot within stale_after_s", LIMIT).unwrap();
    peer.wait_for(" 350.0", LIMIT).unwrap();
    drop(program);
    let said = peer.text();
    drop(peer);
    let key = format!("7/arm/wrench/geometry_msgs::msg::dds_::WrenchStamped_/{HASH}");
    let wrenches: Vec<Vec<&str>> = said.lines().filter_map(|line| words(line, &key)).collect();
    assert!(wrenches.len() > 100, "{said}");
    for wrench in &wrenches {
        let expected = record(number(wrench));
        assert!(expected.wrench.is_some(), "silent without a wrench: {wrench:?}");
        assert_eq!(wrench[1], expected.published_ns.to_string());
        let at_ns = wrench[3].parse::<i64>().unwrap() * 1_000_000_000 + wrench[4].parse::<i64>().unwrap();
        assert_eq!((at_ns, wrench[5]), (expected.instant_ns, "tool0"));
        assert_eq!(wrench[6..11], ["1.5", "-2.25", "3.0", "0.125", "-0.5"]);
        assert_eq!((wrench[2].len(), wrench[2]), (32, wrenches[0][2]), "one publisher");
    }
    // Their numbers count the wrenches, so that a subscriber sees what it missed: nothing, unless this machine stood still for long.
    let counted = |wrench: &[&str]| wrench[0].parse::<u64>().unwrap();
    let wrenches_before =
        |sequence: u64| sequence - sequence.saturating_sub(SILENT.start).min(SILENT.end - SILENT.start);
    let mut missed = 0;
    for (wrench, next) in wrenches.iter().zip(&wrenches[1..]) {
        let step = counted(next) - counted(wrench);
        assert_eq!(
            step,
            wrenches_before(number(next)) - wrenches_before(number(wrench)),
            "{wrench:?}, then {next:?}"
        );
        missed += step - 1;
    }
    assert!(missed * 20 <= wrenches.len() as u64, "{missed} of {} are missing", wrenches.len());
    for part in [
        "diagnostic_msgs::msg::dds_::DiagnosticArray_/RIHS01_5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e",
        " 1 16 wrenchd: wrench uncertain + parity\n",
        " 2 0 wrenchd: wrench invalid + stale: no snapshot within stale_after_s\n",
        "/0/0/NN/%/%/wrenchd\n",
        &format!(
            "/0/1/MP/%/%/wrenchd/%arm%wrench/geometry_msgs::msg::dds_::WrenchStamped_/{HASH}/::,10:,:,:,,\n"
        ),
        "token PUT @ros2_lv/7/",
    ] {
        assert!(said.contains(part), "{part}\n{said}");
    }
}

#[test]
fn without_its_tables_it_says_which_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("arm.toml");
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/arm.toml");
    config(folder.path());
    std::fs::copy(example, &file).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_wrenchd-ros2"));
    let ended = Program::start(command.arg("--config").arg(&file)).unwrap().finish(LIMIT).unwrap();
    let said = ended.expect_code(2).unwrap().stderr();
    assert!(said.contains("has no [publish.ros2] table"), "{said}");
}

/// With the disk of its log full the exit status still tells; a panic would be 101.
#[test]
fn a_message_that_cannot_be_written_changes_no_exit_status() {
    let full = std::fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_wrenchd-ros2"));
    let status = command.args(["--config", "/nowhere/arm.toml"]).stderr(full).status().unwrap();
    assert_eq!(status.code(), Some(2));
}
