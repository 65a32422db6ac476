//! What works on recordings: the calibration's linear stage, and decoding.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use can::candump::{Interfaces, LogEvent, LogReader};
use can::dbc::Dbc;
use can::decode::{Binding, DecodeTable};
use wrenchd_tests::programs::workspace;
use wrenchd_tests::{Check, Failure, ensure, process};

use crate::peers::{self, processor_s};
use crate::table::{Compared, Line};

const RUNS: usize = 5;
/// How often the recording is read here; once is long enough for the peer.
const COPIES: usize = 200;
const LINEAR_LIMIT: Duration = Duration::from_secs(1800);

/// The linear stage has a benchmark of its own, which also checks that all found the same: a million samples of eight gauges.
pub(crate) fn linear() -> Check<Vec<Line>> {
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(["bench", "--locked", "-p", "wrenchd-calibration", "--bench", "linear"]);
    command.current_dir(workspace()).env("PYTHON", peers::interpreter()?);
    let said = process::run(&mut command, LINEAR_LIMIT)?.stdout();
    let mut costs = [Vec::new(), Vec::new(), Vec::new()];
    // 0.123 s, numpy 4.56 s, Eigen 7.89 s
    for line in said.lines().filter(|line| line.contains(", Eigen ")) {
        let numbers = line.split([' ', ',']).filter_map(|word| word.parse::<f64>().ok());
        costs.iter_mut().zip(numbers).for_each(|(costs, number)| costs.push(number));
    }
    ensure!(costs.iter().all(|costs| costs.len() >= 3), "the benchmark said:\n{said}");
    let compared = |peer| Compared { what: "linear calibration, time", peer, unit: "s", goal: "<= 0.25" };
    let [here, numpy, eigen] = costs;
    Ok(vec![
        compared("numpy lstsq").cost(&here, &numpy),
        compared("Eigen Householder QR").cost(&here, &eigen),
    ])
}

/// From candump text to signals, on one core, per frame.
pub(crate) fn decoding() -> Check<Vec<Line>> {
    let data = workspace().join("crates/can/tests/data");
    let [dbc, log] = ["arm.dbc", "recorded.log"].map(|name| data.join(name));
    let text = std::fs::read(&log)?.repeat(COPIES);
    let few = std::env::temp_dir().join(format!("wrenchd-field-{}.log", std::process::id()));
    std::fs::write(&few, std::fs::read(&log)?.repeat(COPIES / 20))?;
    let mut costs = [Vec::new(), Vec::new()];
    for _ in 0..RUNS {
        let (frames, cost, sum) = decode(&dbc, &log, &text)?;
        costs[0].push(cost / frames * 1e9);
        let mut peer = Command::new(peers::interpreter()?);
        let (cost, peer_sum) = peers::run(peer.arg(peers::sources().join("decode.py")).args([&dbc, &few]))?;
        ensure!(
            (20.0 * peer_sum - sum).abs() <= 1e-6 * sum.abs(),
            "signals add up to {sum}, the peer's to {peer_sum}"
        );
        costs[1].push(cost / (frames / 20.0) * 1e9);
    }
    let _ = std::fs::remove_file(&few);
    let line = Compared {
        what: "decoding, speed on one core",
        peer: "python-can and cantools",
        unit: "ns a frame",
        goal: ">= 50",
    };
    let best = costs[0].iter().copied().fold(f64::INFINITY, f64::min);
    println!("{:.2} M frames a second at best; goal 3", 1e3 / best);
    Ok(vec![line.speed(&costs[0], &costs[1])])
}

/// Frames, seconds, and the sum of all signals.
fn decode(dbc: &Path, log: &Path, text: &[u8]) -> Check<(f64, f64, f64)> {
    let dbc = Dbc::read(dbc)?;
    let signals = dbc.messages().iter().flat_map(|message| &message.signals);
    let bindings: Vec<_> =
        (0..).zip(signals).map(|(slot, spec)| Binding { slot, spec, interface: 0, to_si: 1.0 }).collect();
    let table = DecodeTable::new(&bindings)?;
    let input = Box::new(std::io::Cursor::new(text.to_vec()));
    let mut reader = LogReader::from_reader(input, log, Interfaces::fixed(&["can0"]))?;
    let mut sum = 0.0;
    let begun = processor_s();
    while let Some(event) = reader.next_event()? {
        let LogEvent::Frame(stamped) = event else { continue };
        table.decode(&stamped, |value| sum += value.si);
    }
    let seconds = processor_s() - begun;
    match reader.counts().frames {
        0 => Err(Failure::new(format!("{} holds no frames", log.display()))),
        frames => Ok((frames as f64, seconds, sum)),
    }
}
