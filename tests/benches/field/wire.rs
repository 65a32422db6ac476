//! Frames through the kernel: taking them in, sending them (see [`sending`]), and answering them, each beside its peers in one boot of the CAN machine.
//!
//! Three times are told of an answer. *Out* is from the kernel's stamp of the last frame in to its stamp of the second frame out, which
//! completes the wrench (the echo's are two): what the program itself takes. *All* is the same to the last frame, the quality frame.
//! *Seen* is what a program of ordinary priority sees that sends that frame and waits for the answer.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use can::frame::{CanId, Frame};
use can::socket::{SocketOptions, SocketSender, SocketSource};
use can::source::{Batch, Event, Source};
use nix::sys::signal::Signal;
use socketcan::{CanSocket, Socket};
use wrenchd::station::EVENTS_PER_TURN;
use wrenchd_tests::candump;
use wrenchd_tests::guest::Guest;
use wrenchd_tests::machine::{self, Job, Machine};
use wrenchd_tests::process;
use wrenchd_tests::programs::{programs, workspace};
use wrenchd_tests::{Check, Failure, IoContext, ensure};

use crate::answers::{self, Took, last_of_a_round};
use crate::peers;
use crate::sending;
use crate::table::{Compared, Line};

const FRAMES: usize = 20_000;
/// Kernel memory for all of them.
const BUFFER: usize = 64 * 1024 * 1024;
/// A run of ours is over in a hundredth of a second, in which a busy computer may do something else.
const TAKING_RUNS: usize = 11;
const RUNS: usize = 5;
const ROUNDS: usize = 500;
const LIMIT: Duration = Duration::from_secs(900);
const STEP: Duration = Duration::from_secs(120);
/// The file with what was measured inside: a name and its values a line.
const MEASURED: &str = "measured";
const ECHO: &str = "WRENCHD_FIELD_ECHO";
const PYTHON: &str = "WRENCHD_FIELD_PYTHON";

/// Measures inside the machine; the lines of the table.
pub(crate) fn outside() -> Check<Vec<Line>> {
    let mut machine = Machine::prepare()?;
    println!("machine: {}", machine.description());
    let echo = peers::compile("echo.c", &[])?;
    let mut job = Job::new(std::env::current_exe()?).env(ECHO, echo).env(PYTHON, peers::interpreter()?);
    for (name, path) in programs()?.environment() {
        job = job.env(name, path);
    }
    let status = machine.run(job, LIMIT)?;
    ensure!(status == 0, "the benchmark inside ended with {status}");
    let path = machine.scratch().join(MEASURED);
    let text = std::fs::read_to_string(&path).at("read", &path)?;
    let take = |name: &str| -> Check<Vec<f64>> {
        let line = text.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(' '));
        let line = line.ok_or_else(|| Failure::new(format!("no {name} in {}", path.display())))?;
        Ok(line.split(' ').map(str::parse).collect::<Result<_, _>>()?)
    };
    let taken = |peer, goal| Compared { what: "taking frames in, time", peer, unit: "us a frame", goal };
    let out = |peer, goal| Compared { what: "last frame in to wrench out, p50", peer, unit: "us", goal };
    let all =
        |peer| Compared { what: "the same to its quality frame, a third one", peer, unit: "us", goal: "" };
    let seen = |peer, goal| Compared { what: "last frame sent to wrench seen, p50", peer, unit: "us", goal };
    let (c, py) = ("an echo in C", "python-can, cantools and Pinocchio");
    let mut lines = vec![
        taken("socketcan crate, single reads", "<= 1/14").cost(&take("ours")?, &take("single")?),
        taken("candump -L", "<= 1/40").cost(&take("ours")?, &take("candump")?),
        out(c, "<= 1.5").cost(&take("daemon-out")?, &take("echo.c-out")?),
        all(c).cost(&take("daemon-all")?, &take("echo.c-all")?),
        seen(c, "<= 1.5").cost(&take("daemon-seen")?, &take("echo.c-seen")?),
        out(py, "<= 1/5").cost(&take("alone-out")?, &take("echo.py-out")?),
        seen(py, "<= 1/5").cost(&take("alone-seen")?, &take("echo.py-seen")?),
    ];
    lines.extend(sending::lines(take)?);
    Ok(lines)
}

pub(crate) fn inside(scratch: &Path) -> Check {
    machine::bring_up_links()?;
    let guest = Guest::new(std::env::temp_dir());
    let mut text = String::new();
    let mut note = |name: &str, values: &[f64]| {
        let values: Vec<String> = values.iter().map(f64::to_string).collect();
        text += &format!("{name} {}\n", values.join(" "));
    };
    let mut taken: [Vec<f64>; 3] = Default::default();
    for _ in 0..TAKING_RUNS {
        taken[0].push(ours()?);
        taken[1].push(single()?);
        taken[2].push(by_candump(&guest)?);
    }
    ["ours", "single", "candump"].iter().zip(&taken).for_each(|(name, values)| note(name, values));
    sending::inside(&guest, &variable(PYTHON)?, &mut note)?;
    for name in answers::LINKS.as_flattened().iter().skip(2) {
        guest.add_link(name)?;
    }
    let arm = Arm::new(&std::env::temp_dir().join("arm"), "mode = \"event\"")?;
    let mut took: [Vec<Took>; 4] = Default::default();
    for _ in 0..RUNS {
        let [ours, echo] = answers::in_turns(&guest, [(arm.daemon()?, 3), (echo_c()?, 2)], &arm.rounds)?;
        // By themselves: Python's work would push all else out of the caches.
        let [alone] = answers::in_turns(&guest, [(arm.daemon()?, 3)], &arm.rounds)?;
        let [python] = answers::in_turns(&guest, [(arm.echo_py()?, 3)], &arm.rounds)?;
        took.iter_mut().zip([ours, echo, alone, python]).for_each(|(all, took)| all.push(took));
    }
    for (name, took) in ["daemon", "echo.c", "alone", "echo.py"].iter().zip(&took) {
        note(&format!("{name}-out"), &took.iter().map(|took| took.out_us).collect::<Vec<_>>());
        note(&format!("{name}-all"), &took.iter().map(|took| took.all_us).collect::<Vec<_>>());
        note(&format!("{name}-seen"), &took.iter().map(|took| took.seen_us).collect::<Vec<_>>());
    }
    let path = scratch.join(MEASURED);
    std::fs::write(&path, text).at("write", &path)
}

/// A frame that means nothing.
pub(crate) fn filler() -> Check<Frame> {
    let id = CanId::standard(0x101).ok_or_else(|| Failure::new("an identifier of 11 bits"))?;
    Frame::classical(id, &[1, 2, 3, 4, 5, 6, 7, 8]).ok_or_else(|| Failure::new("eight bytes"))
}

/// Puts all frames into the buffers of those who listen.
fn fill() -> Check {
    let mut sender = SocketSender::open("vcan0")?;
    let sent = sender.send(&vec![filler()?; FRAMES]);
    ensure!(sent == FRAMES, "{sent} of {FRAMES} frames were taken");
    Ok(())
}

fn per_frame_us(begun: Instant) -> f64 {
    begun.elapsed().as_secs_f64() * 1e6 / FRAMES as f64
}

fn ours() -> Check<f64> {
    let options = SocketOptions { receive_buffer: BUFFER, ..SocketOptions::default() };
    let mut source = SocketSource::open(&[("vcan0", options)])?;
    fill()?;
    let (mut batch, mut frames) = (Batch::new(EVENTS_PER_TURN), 0);
    let begun = Instant::now();
    while frames < FRAMES {
        source.poll(&mut batch, STEP)?;
        ensure!(!batch.is_empty(), "{frames} of {FRAMES} frames came");
        frames += batch.events().iter().filter(|event| matches!(event, Event::Frame(_))).count();
    }
    Ok(per_frame_us(begun))
}

fn single() -> Check<f64> {
    let socket = CanSocket::open("vcan0")?;
    nix::sys::socket::setsockopt(&socket, nix::sys::socket::sockopt::RcvBufForce, &BUFFER)?;
    socket.set_read_timeout(STEP)?;
    fill()?;
    let begun = Instant::now();
    for _ in 0..FRAMES {
        std::hint::black_box(socket.read_frame()?);
    }
    Ok(per_frame_us(begun))
}

/// candump is held while its buffer is filled.
fn by_candump(guest: &Guest) -> Check<f64> {
    let path = guest.dir().join("by_candump");
    let mut command = Command::new("candump");
    let (count, buffer) = (FRAMES.to_string(), BUFFER.to_string());
    command.args(["-L", "-n", &count, "-r", &buffer, "vcan0"]);
    let file = File::create(&path).at("create", &path)?;
    let program = guest.start_listening_into(&mut command, "vcan0", file)?;
    program.signal(Signal::SIGSTOP)?;
    fill()?;
    let begun = Instant::now();
    program.signal(Signal::SIGCONT)?;
    program.finish(STEP)?.expect_code(0)?;
    Ok(per_frame_us(begun))
}

/// The arm of the tests' captures on vcan0, whose wrenches go out on vcan1.
pub(crate) struct Arm {
    pub(crate) config: PathBuf,
    pub(crate) model: PathBuf,
    rounds: Vec<Vec<Frame>>,
}

pub(crate) fn frame(line: &candump::Line) -> Check<Frame> {
    let line = format!("(0.000000) can0 {}", line.frame());
    match can::candump::parse_line(line.as_bytes()) {
        Ok(can::candump::Line::Frame { frame, .. }) => Ok(frame),
        _ => Err(Failure::new(format!("no frame: {line}"))),
    }
}

impl Arm {
    /// In a folder of its own, which is made anew, with these lines of what is published.
    pub(crate) fn new(folder: &Path, publish: &str) -> Check<Self> {
        let captures = workspace().join("tests/captures");
        let _ = std::fs::remove_dir_all(folder);
        process::run(Command::new("cp").arg("-r").arg(captures.join("accuracy")).arg(folder), STEP)?;
        let (config, model) = (folder.join("arm.toml"), folder.join("model.toml"));
        let text = std::fs::read_to_string(&config).at("read", &config)?.replace("\"can0\"", "\"vcan0\"");
        let tables = format!("\n[publish]\n{publish}\n\n[publish.can]\ninterface = \"vcan1\"\n");
        std::fs::write(&config, text + &tables).at("write", &config)?;
        let mut calibrate = Command::new(&programs()?.wrenchctl);
        calibrate.arg("calibrate").arg(captures.join("calibration")).arg("--out").arg(&model);
        process::run(&mut calibrate, STEP)?;
        let lines = candump::read(&folder.join("can.log.gz"))?;
        let rounds = candump::rounds(&lines).into_iter().take(ROUNDS);
        let rounds = rounds
            .map(|round| round.iter().map(frame).collect::<Check<Vec<_>>>())
            .collect::<Check<Vec<_>>>()?;
        Ok(Self { config, model, rounds })
    }

    pub(crate) fn daemon(&self) -> Check<Command> {
        let mut command = Command::new(&programs()?.wrenchd);
        command.arg("--config").arg(&self.config).arg("--model").arg(&self.model);
        Ok(command)
    }

    fn echo_py(&self) -> Check<Command> {
        let mut command = Command::new(variable(PYTHON)?);
        let folder = self.config.parent().unwrap_or(Path::new("."));
        command.arg(peers::sources().join("echo.py"));
        command.args([folder.join("arm_a.urdf"), folder.join("arm_a.dbc")]);
        command.args(answers::LINKS[0]).arg(last_of_a_round());
        Ok(command)
    }
}

fn echo_c() -> Check<Command> {
    let mut command = Command::new(variable(ECHO)?);
    command.args(answers::LINKS[1]).arg(last_of_a_round());
    Ok(command)
}

fn variable(name: &str) -> Check<PathBuf> {
    std::env::var_os(name).map(PathBuf::from).ok_or_else(|| Failure::new(format!("{name} is not set")))
}
