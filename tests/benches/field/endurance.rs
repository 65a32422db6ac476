//! Ten minutes of an arm whose boards send at 1000 Hz: what the daemon loses, and what it needs of memory and processor, in the CAN machine;
//! and ten seconds of its cycle on this computer itself, where a system call costs what it costs elsewhere.

use std::fs;
use std::path::Path;
use std::time::{Duration, Instant};

use can::frame::Frame;
use can::socket::SocketSender;
use nix::unistd::{SysconfVar, sysconf};
use wrenchd_tests::candump;
use wrenchd_tests::guest::Guest;
use wrenchd_tests::machine::{self, Job, Machine};
use wrenchd_tests::process::{Finished, Program};
use wrenchd_tests::programs::{programs, workspace};
use wrenchd_tests::{Check, Failure, IoContext, ensure};

use crate::native;
use crate::table::{Line, short};
use crate::wire::{Arm, frame};

const ROUNDS: usize = 600_000;
const PERIOD: Duration = Duration::from_millis(1);
/// Rounds to and fro in a held pose, after which the gauges' counts of frames (8 bits) are back where they were.
const TURN: usize = 256;
/// Caches, histograms and the allocator's arenas are warm by then.
const WARM: usize = ROUNDS / 10;
const LIMIT: Duration = Duration::from_secs(1800);
const STEP: Duration = Duration::from_secs(60);
const MEASURED: &str = "endured";
pub(crate) const INSIDE: &str = "WRENCHD_FIELD_ENDURANCE";

pub(crate) fn outside() -> Check<Vec<Line>> {
    let mut machine = Machine::prepare()?;
    let mut job = Job::new(std::env::current_exe()?).env(INSIDE, "1");
    for (name, path) in programs()?.environment() {
        job = job.env(name, path);
    }
    let status = machine.run(job, LIMIT)?;
    ensure!(status == 0, "the benchmark inside ended with {status}");
    let path = machine.scratch().join(MEASURED);
    let text = fs::read_to_string(&path).at("read", &path)?;
    let lines = text.lines().filter_map(|line| line.split_once('\t'));
    let mut lines: Vec<Line> = lines.map(|(what, value)| Line::alone(what, value.into())).collect();
    let share = native::share(&turn()?)?;
    let what = "the cycle at 1000 Hz outside the CAN machine, frames by a queue, share of a processor";
    lines.push(Line::alone(what, format!("{} %", short(100.0 * share))));
    Ok(lines)
}

pub(crate) fn inside(scratch: &Path) -> Check {
    machine::bring_up_links()?;
    let guest = Guest::new(std::env::temp_dir());
    let arm = Arm::new(&std::env::temp_dir().join("arm"), "mode = \"fixed\"\nrate_hz = 1000.0")?;
    let rounds = turn()?;
    let daemon = guest.start_listening(&mut arm.daemon()?, "vcan0")?;
    let mut sender = SocketSender::open("vcan0")?;
    let mut memory_kb = Vec::new();
    let (begun, spent_s) = (Instant::now(), processor_s(&daemon)?);
    for number in 0..ROUNDS {
        std::thread::sleep((begun + PERIOD * number as u32).saturating_duration_since(Instant::now()));
        let round = &rounds[number % TURN];
        let sent = sender.send(round);
        ensure!(sent == round.len(), "{sent} frames of round {number} were taken");
        if number >= WARM && number % WARM == 0 {
            memory_kb.push(resident_kb(&daemon)?);
        }
    }
    let took_s = begun.elapsed().as_secs_f64();
    let share = (processor_s(&daemon)? - spent_s) / took_s;
    let ended = daemon.stop(STEP)?.expect_code(0)?;
    let count = |name| total(&ended, name);
    ensure!(count("rounds")? + 1 >= ROUNDS as u64, "of {ROUNDS} rounds:\n{}", ended.text());
    let grown_kb = memory_kb.last().zip(memory_kb.first()).map_or(0, |(last, first)| last - first);
    let most_mb = memory_kb.iter().max().map_or(f64::NAN, |most| *most as f64 / 1e3);
    let said = [
        format!(
            "{ROUNDS} rounds at 1000 Hz in the CAN machine, as they came\t{:.1} Hz",
            ROUNDS as f64 / took_s
        ),
        format!(
            "the same, frames lost and overruns counted\t{} and {}",
            count("lost_frames")?,
            count("overruns")?
        ),
        format!(
            "the same, memory, and its growth in the last nine tenths\t{} MB, {grown_kb} kB",
            short(most_mb)
        ),
        format!(
            "the same, share of the processor, a hint (its kernel looks 100 times a second)\t{} %",
            short(100.0 * share)
        ),
    ];
    let path = scratch.join(MEASURED);
    fs::write(&path, said.join("\n")).at("write", &path)
}

/// Rounds that follow each other without end.
fn turn() -> Check<Vec<Vec<Frame>>> {
    let lines = candump::read(&workspace().join("tests/captures/accuracy/can.log.gz"))?;
    let pieces = candump::rounds(&lines);
    let there = pieces.get(..TURN / 2 + 1).ok_or_else(|| Failure::new("the recording is too short"))?;
    let lines = candump::repeated(there, TURN, 1_000_000);
    lines.chunks(candump::ROUND.len()).map(|round| round.iter().map(frame).collect()).collect()
}

/// The last number of this name that the daemon said.
fn total(ended: &Finished, name: &str) -> Check<u64> {
    let (text, start) = (ended.text(), format!("{name}="));
    let last =
        text.split_ascii_whitespace().filter_map(|word| word.strip_prefix(&start)?.parse().ok()).next_back();
    last.ok_or_else(|| Failure::new(format!("the daemon did not say {name}:\n{text}")))
}

fn resident_kb(daemon: &Program) -> Check<i64> {
    let path = format!("/proc/{}/status", daemon.id());
    let text = fs::read_to_string(&path).at("read", Path::new(&path))?;
    let line = text.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let number = line.and_then(|line| line.split_ascii_whitespace().next()?.parse().ok());
    number.ok_or_else(|| Failure::new(format!("no VmRSS in {path}")))
}

/// Time of the processor that the daemon has had, its own and the kernel's for it, s. User-mode Linux has no exact accounting: whoever runs when the
/// tick comes is taken to have run all the time since the last one, and a cycle on timers keeps step with ticks.
fn processor_s(daemon: &Program) -> Check<f64> {
    let path = format!("/proc/{}/stat", daemon.id());
    let text = fs::read_to_string(&path).at("read", Path::new(&path))?;
    // After the name, which may hold anything, state is the first field; the two times are the 12th and 13th.
    let fields = text.rsplit_once(')').map_or("", |(_, fields)| fields).split_ascii_whitespace();
    let ticks: f64 = fields.skip(11).take(2).filter_map(|field| field.parse::<f64>().ok()).sum();
    let rate = sysconf(SysconfVar::CLK_TCK)?.unwrap_or(100);
    Ok(ticks / rate as f64)
}
