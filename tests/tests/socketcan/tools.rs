//! The tool on a live bus: what it records, decodes and counts, and the socket source's own tests.

use crate::live::Totals;
use crate::rig::{Arm, Form, Player};
use std::collections::BTreeMap;
use std::process::Command;
use std::time::Duration;
use wrenchd_tests::candump::{self, Line};
use wrenchd_tests::guest::{Guest, ensure_same_frames};
use wrenchd_tests::process::{self, Program};
use wrenchd_tests::programs::{programs, socket_tests, workspace};
use wrenchd_tests::python;
use wrenchd_tests::suite::{Need, Scenario};
use wrenchd_tests::{Check, Failure, ensure};

const NEEDS: &[Need] = &[Need::Programs, Need::Python];
const LIMIT: Duration = Duration::from_secs(120);
const STEP: Duration = Duration::from_secs(30);

pub(crate) const SCENARIOS: &[Scenario] = &[
    Scenario { name: "tools::what_is_recorded_can_be_used", needs: NEEDS, limit: LIMIT, run: record },
    Scenario { name: "tools::dump_decodes_a_live_link", needs: NEEDS, limit: LIMIT, run: dump },
    Scenario { name: "tools::the_socket_source", needs: &[Need::SocketTests], limit: LIMIT, run: socket },
];

fn wrenchctl() -> Check<Command> {
    Ok(Command::new(&programs()?.wrenchctl))
}

fn record(guest: &Guest) -> Check {
    let arm = Arm::new(guest, Form::Classical)?;
    let lines: Vec<Line> = arm.recording()?.into_iter().take(2800).collect();
    let played = arm.to_play(guest, &lines)?;
    let run = guest.dir().join("recorded");
    let mut command = wrenchctl()?;
    command.arg("record").arg("--config").arg(&arm.config).arg("--out").arg(&run);
    let near = guest.capture("vcan0")?;
    let recorder = guest.start_listening(&mut command, "vcan0")?;
    process::run(&mut Player::Wrenchctl.command(&played)?, STEP)?;
    // What has arrived at the witness has arrived at the recorder's socket, and it empties that before it ends.
    let near = near.stop()?;
    let said = recorder.stop(STEP)?.expect_code(0)?.stdout();
    ensure!(said.contains("2800 frames") && said.contains(" 0 dropped"), "record said: {said}");
    let recorded = candump::read(&run.join("can.log.gz"))?;
    ensure_same_frames(&lines, &recorded)?;
    ensure!(near.lines == recorded, "the recording has other frames or stamps than candump's");

    let stats = process::run(wrenchctl()?.arg("stats").arg(&run), STEP)?.stdout();
    ensure!(stats.contains("2800 frames") && stats.contains("0 dropped"), "stats said:\n{stats}");
    let mut validate = wrenchctl()?;
    validate.arg("validate").arg(&run).arg("--model").arg(&arm.model);
    let scores = process::run(&mut validate, STEP)?.stdout();
    ensure!(scores.contains("this model, still"), "validate said:\n{scores}");
    // A run is never overwritten.
    let mut again = wrenchctl()?;
    again.arg("record").arg("--config").arg(&arm.config).arg("--out").arg(&run);
    let refused = Program::start(&mut again)?.finish(STEP)?.expect_code(2)?;
    ensure!(refused.stderr().contains("recorded"), "it does not name the directory: {}", refused.stderr());
    Ok(())
}

/// `name=value` words of a line, values that are numbers.
fn signals(words: &str) -> BTreeMap<String, f64> {
    let signal = |word: &str| {
        let (name, value) = word.split_once('=')?;
        Some((name.to_owned(), value.parse().ok()?))
    };
    words.split_ascii_whitespace().filter_map(signal).collect()
}

fn dump(guest: &Guest) -> Check {
    let arm = Arm::new(guest, Form::Classical)?;
    let played = arm.to_play(guest, &arm.recording()?.into_iter().take(2100).collect::<Vec<_>>())?;
    let dumping = |interface: &str| -> Check<(Program, std::path::PathBuf)> {
        let mut command = wrenchctl()?;
        command.arg("dump").arg(interface).arg("--config").arg(&arm.config);
        Ok((
            guest.start_listening(&mut command, interface)?,
            guest.dir().join(format!("dumped-{interface}.log")),
        ))
    };
    let (near, far) = (guest.capture("vcan0")?, guest.capture("vcan1")?);
    let (near_dump, far_dump) = (dumping("vcan0")?, dumping("vcan1")?);
    let daemon = arm.daemon(guest, None)?;
    process::run(&mut Player::Wrenchctl.command(&played)?, STEP)?;
    Totals::stop(daemon)?;
    let wrench_dbc = workspace().join("config/wrench.dbc");
    for (captured, (dumped, _), dbc) in
        [(near.stop()?, near_dump, guest.dir().join("arm_a.dbc")), (far.stop()?, far_dump, wrench_dbc)]
    {
        let text = dumped.stop(STEP)?.expect_code(0)?.stdout();
        let decoded = python::decode(&dbc, &captured.path)?;
        let dumped: Vec<&str> = text.lines().collect();
        ensure!(
            dumped.len() == decoded.len(),
            "{} lines dumped, {} frames decoded",
            dumped.len(),
            decoded.len()
        );
        let mut compared = 0;
        for ((line, frame), captured) in dumped.iter().zip(&decoded).zip(&captured.lines) {
            let (raw, words) = parts(line)?;
            ensure!(Line::parse(&raw)? == *captured, "dumped {raw}, captured {captured}");
            ensure!(words.split(' ').next() == Some(&frame.message), "{line} is {}", frame.message);
            for (name, value) in signals(&words) {
                // What only this project's words say (standard deviations) the decoder gives as raw numbers.
                let Some(expected) = frame.signals.get(&name).filter(|_| !name.starts_with("Sigma")) else {
                    continue;
                };
                ensure!(
                    (value - expected).abs() <= 1e-9 * expected.abs().max(1.0),
                    "{line}: {name} is {expected}"
                );
                compared += 1;
            }
        }
        ensure!(compared > 500, "{compared} values compared");
    }
    Ok(())
}

/// A dumped line as candump has it, and the words behind it.
fn parts(line: &str) -> Check<(String, String)> {
    let words: Vec<&str> = line.splitn(4, ' ').collect();
    match words.as_slice() {
        [stamp, interface, frame, words] => Ok((format!("{stamp} {interface} {frame}"), (*words).to_owned())),
        _ => Err(Failure::new(format!("not decoded: {line}"))),
    }
}

/// The tests of the socket source, which need the links of this machine.
fn socket(_: &Guest) -> Check {
    let finished = process::run(Command::new(socket_tests()?).args(["--test-threads", "1"]), STEP)?;
    let said = finished.stdout();
    ensure!(said.contains("test result: ok. 4 passed; 0 failed; 0 ignored"), "it said:\n{said}");
    Ok(())
}
