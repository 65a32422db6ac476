//! How many instructions the hot paths take, counted by valgrind: the same on a busy machine as on an idle one, where time says little.
//!
//! `cargo bench -p wrenchd-sim --bench instructions`; it fails where one is beyond its bound, which is a quarter above what was counted when
//! it was set. Who makes a path longer on purpose sets it anew.

use std::hint::black_box;
use std::path::Path;
use std::process::{Command, ExitCode};

use can::assembly::Assembler;
use can::candump::{Line, MAX_LINE, StampDigits, format_line, parse_line};
use can::frame::Stamped;
use rig::cycle::Cycle;
use rig::{Config, Rig};
use wrenchd_sim::{Options, Preset, START_NS, Simulator, Truth};

/// Instructions are those of so many rounds more: what is done beforehand falls out.
const FEW: usize = 100;
const MANY: usize = 600;

/// What is counted, of what, and the most instructions that it may take.
const PATHS: [(&str, &str, f64); 5] = [
    ("parse", "a frame, from a line of candump", 1050.0),
    ("decode", "a frame, to its signals", 250.0),
    ("assemble", "a round of frames, to a snapshot", 18_000.0),
    ("tick", "a round of frames, to a wrench", 180_000.0),
    ("answer", "the same without what is done between two frames", 135_000.0),
];

/// The function that holds what is counted of the answer: valgrind counts in there alone.
const ANSWER: &str = "*answer_now*";

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().collect();
    let outcome = match arguments.iter().position(|word| word == "--inside") {
        Some(at) => inside(&arguments[at + 1..]).map(|()| true),
        None => count_all(),
    };
    match outcome {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::from(2)
        }
    }
}

/// Counts every path; whether all are within their bounds.
fn count_all() -> Outcome<bool> {
    let mut within = true;
    for (path, what, most) in PATHS {
        let (few, many) = (count(path, FEW)?, count(path, MANY)?);
        let instructions = (many.0 - few.0) / (many.1 - few.1);
        let verdict = if instructions <= most { "within" } else { "BEYOND" };
        println!("{path:<9}{instructions:>9.0} instructions ({what}), {verdict} {most:.0}");
        within &= instructions <= most;
    }
    Ok(within)
}

/// Instructions of a run over so many rounds, and how many times the path was gone.
fn count(path: &str, rounds: usize) -> Outcome<(f64, f64)> {
    let mut command = Command::new("valgrind");
    command.args(["--tool=callgrind", "--callgrind-out-file=/dev/null"]);
    if path == "answer" {
        command.args(["--collect-atstart=no", &format!("--toggle-collect={ANSWER}")]);
    }
    let output = command
        .arg(std::env::current_exe()?)
        .args(["--inside", path, &rounds.to_string()])
        .output()
        .map_err(|error| format!("valgrind cannot be run ({error}): apt-get install valgrind"))?;
    let (said, told) = (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
    let after = |text: &str, word: &str| -> Option<f64> {
        text.split(word).nth(1)?.split_whitespace().next()?.parse().ok()
    };
    match (after(&told, "Collected :"), after(&said, "times")) {
        (Some(instructions), Some(times)) if output.status.success() => Ok((instructions, times)),
        _ => Err(format!("{path} under valgrind: {}\n{said}{told}", output.status).into()),
    }
}

/// Goes a path over so many rounds, and says how often.
fn inside(arguments: &[String]) -> Outcome<()> {
    let [path, rounds, ..] = arguments else { return Err("--inside PATH ROUNDS".into()) };
    let rig = Rig::load(Config::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/arm.toml"))?)?;
    let truth = Truth::draw(&rig, 7, 0.0);
    let scenario = Preset::Sweep.scenario(&rig.chain, 3)?;
    let rounds: usize = rounds.parse()?;
    let simulator = Simulator::new(&rig, truth.clone(), &scenario, Options::default())?;
    // The arm is simulated for as long whatever is counted, so that this falls out.
    let end_ns = |rounds: usize| START_NS + (simulator.instant_s(rounds as u64) * 1e9) as i64;
    let (most_ns, end_ns) = (end_ns(MANY), end_ns(rounds));
    let mut frames: Vec<Stamped> = simulator.take_while(|frame| frame.stamp_ns < most_ns).collect();
    frames.retain(|frame| frame.stamp_ns < end_ns);
    let times = match path.as_str() {
        "parse" => parse(&frames),
        "decode" => decode(&rig, &frames)?,
        "assemble" => assemble(&rig, &frames)?,
        "tick" => tick(&rig, &truth, &frames)?,
        "answer" => answer(&rig, &truth, &frames)?,
        other => return Err(format!("no path is called {other}").into()),
    };
    println!("times {times}");
    Ok(())
}

/// The text is made once and read fifty times, so that making it counts for little.
fn parse(frames: &[Stamped]) -> usize {
    let mut line = [0; MAX_LINE];
    let mut lines = Vec::new();
    for frame in frames {
        let length = format_line(&mut line, frame, "can0", StampDigits::Micros);
        lines.push(line[..length].to_vec());
    }
    let is_frame = |line: &&Vec<u8>| matches!(black_box(parse_line(line)), Ok(Line::Frame { .. }));
    (0..50).map(|_| lines.iter().filter(is_frame).count()).sum()
}

fn decode(rig: &Rig, frames: &[Stamped]) -> Outcome<usize> {
    let assembler = Assembler::new(&rig.layout)?;
    let mut sum = 0.0;
    for frame in frames {
        assembler.table().decode(frame, |value| sum += value.si);
    }
    black_box(sum);
    Ok(frames.len())
}

fn assemble(rig: &Rig, frames: &[Stamped]) -> Outcome<usize> {
    let mut assembler = Assembler::new(&rig.layout)?;
    Ok(frames.iter().map(|frame| black_box(assembler.push(frame)).len()).sum())
}

fn tick(rig: &Rig, truth: &Truth, frames: &[Stamped]) -> Outcome<usize> {
    let mut cycle = Cycle::new(rig, &truth.known(rig))?;
    let mut rounds = 0;
    for frame in frames {
        cycle.push(frame, |estimate| {
            black_box(estimate);
            rounds += 1;
        });
    }
    Ok(rounds)
}

/// As the daemon in event mode goes: after each frame there is time until the next.
fn answer(rig: &Rig, truth: &Truth, frames: &[Stamped]) -> Outcome<usize> {
    let mut cycle = Cycle::new(rig, &truth.known(rig))?;
    let mut rounds = 0;
    for frame in frames {
        answer_now(&mut cycle, frame, &mut rounds);
        cycle.prepare();
    }
    Ok(rounds)
}

#[inline(never)]
fn answer_now(cycle: &mut Cycle, frame: &Stamped, rounds: &mut usize) {
    cycle.push(frame, |estimate| {
        black_box(estimate);
        *rounds += 1;
    });
}
