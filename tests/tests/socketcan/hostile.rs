//! A hostile network beside an arm that moves: every wrench is what it is in peace, nobody gets what is not his, and nothing stays behind.

use crate::live::{Live, Load};
use crate::rig::{Arm, Form, Player};
use std::fs;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream, UdpSocket};
use std::process::Command;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use wrenchd_tests::candump;
use wrenchd_tests::guest::Guest;
use wrenchd_tests::process::Program;
use wrenchd_tests::suite::{Need, Scenario};
use wrenchd_tests::{Check, Failure, ensure, python};

const STEP: Duration = Duration::from_secs(60);
const PERIOD_NS: i64 = 8_000_000;
const ROUNDS: usize = 2500;
const RDT: &str = "127.0.0.1:49152";
const RDT_HTTP: &str = "127.0.0.1:8049";
const METRICS: &str = "127.0.0.1:9464";
/// A client asks again so often that it keeps its stream, and counts as served if it has had so many records in all.
const RENEWAL: Duration = Duration::from_millis(500);
const RECORDS: u64 = 250;
/// What the places for connections and their buffers may take, kB.
const GROWTH_KB: u64 = 32_000;

pub(crate) const SCENARIOS: &[Scenario] = &[Scenario {
    name: "hostile::a_hostile_network_changes_no_wrench",
    needs: &[Need::Programs, Need::Python],
    limit: Duration::from_secs(300),
    run: attacked,
}];

fn attacked(guest: &Guest) -> Check {
    let arm = Arm::new(guest, Form::Classical)?;
    arm.configure(&format!(
        "\n[publish.rdt]\nbind = \"{RDT}\"\nhttp = \"{RDT_HTTP}\"\nallow = [\"127.0.0.1/32\", \"127.0.0.3/32\"]\n\
         \n[publish.metrics]\nbind = \"{METRICS}\"\n"
    ))?;
    let pieces = candump::rounds(&arm.recording()?);
    let lines = candump::repeated(pieces.get(..200).unwrap_or(&pieces), ROUNDS, PERIOD_NS);
    let live = Live::run_beside(guest, &arm, Player::Wrenchctl, Load::Moderate, &lines, |daemon, play| {
        // Once it answers, it has all that it needs in peace.
        wait_until_served()?;
        let before = Held::of(daemon)?;
        let ended = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let client = scope.spawn(|| read_records(&ended));
            let outcome = under_attack(&arm, play);
            ended.store(true, Ordering::Relaxed);
            let records = client.join().map_err(|_| Failure::new("the client panicked"))??;
            ensure!(records >= RECORDS, "the stream's holder had {records} records");
            outcome
        })?;
        nothing_stays(daemon, &before)
    })?;
    let offline = arm.offline(guest, &live.recording, &arm.model)?;
    let pairs = live.beside_offline(&offline)?;
    ensure!(pairs.len() >= ROUNDS * 9 / 10, "{} wrenches of {ROUNDS} rounds", pairs.len());
    Ok(())
}

/// Plays while somebody does all the harm that he can at a low priority: the machine has one processor, which is not the daemon's to share out.
fn under_attack(arm: &Arm, play: &dyn Fn() -> Check) -> Check {
    let ports = [RDT_HTTP, METRICS].map(|address| address.rsplit(':').next().unwrap_or_default());
    let mut attack = Command::new("nice");
    let script = python::script("hostile.py")?;
    attack.args(["-n", "19"]).arg(script.get_program()).args(script.get_args());
    attack.arg(ports.join(",")).arg("49152").arg(arm.config.with_file_name("control.sock"));
    let mut attack = Program::start(&mut attack)?;
    attack.wait_for("begun", STEP)?;
    play()?;
    let said = attack.stop(STEP)?.expect_code(0)?.stdout();
    println!("  {}", said.trim().replace('\n', ", "));
    let kinds = [
        "datagrams",
        "connections",
        "answers",
        "orders",
        "unread requests",
        "hoarded connections",
        "control connections",
    ];
    for kind in kinds {
        ensure!(said.contains(&format!("\n{kind} ")), "there were no {kind}:\n{said}");
    }
    Ok(())
}

/// Keeps a stream by the rules until told to stop; how many records came.
fn read_records(ended: &AtomicBool) -> Check<u64> {
    let socket = UdpSocket::bind("127.0.0.1:0")?;
    socket.connect(RDT)?;
    socket.set_read_timeout(Some(Duration::from_millis(100)))?;
    let (mut asked, mut records) = (None::<Instant>, 0);
    while !ended.load(Ordering::Relaxed) {
        if asked.is_none_or(|asked| asked.elapsed() > RENEWAL) {
            socket.send(&[0x12, 0x34, 0, 2, 0, 0, 0, 0])?;
            asked = Some(Instant::now());
        }
        let mut data = [0; 100];
        if let Ok(length) = socket.recv(&mut data) {
            ensure!(length == 36, "a record of {length} bytes");
            records += 1;
        }
    }
    Ok(records)
}

/// What the daemon holds of the system's.
#[derive(Debug)]
pub(crate) struct Held {
    pub(crate) descriptors: Vec<String>,
    pub(crate) memory_kb: u64,
}

impl Held {
    pub(crate) fn of(daemon: &Program) -> Check<Self> {
        let process = format!("/proc/{}", daemon.id());
        let status = fs::read_to_string(format!("{process}/status"))?;
        let memory = status.lines().find_map(|line| line.strip_prefix("VmRSS:")?.split_whitespace().next());
        let memory = memory.ok_or_else(|| Failure::new(format!("no VmRSS in {process}/status")))?;
        let descriptors = fs::read_dir(format!("{process}/fd"))?.flatten();
        let descriptors = descriptors.filter_map(|entry| fs::read_link(entry.path()).ok());
        let descriptors = descriptors.map(|path| path.display().to_string()).collect();
        Ok(Self { descriptors, memory_kb: memory.parse()? })
    }
}

/// Connections end with the attack, memory has stayed, and who asks for health gets an answer.
fn nothing_stays(daemon: &Program, before: &Held) -> Check {
    let deadline = Instant::now() + STEP;
    let after = loop {
        let now = Held::of(daemon)?;
        if now.descriptors.len() <= before.descriptors.len() {
            break now;
        }
        ensure!(Instant::now() < deadline, "{before:?} before, {now:?} after");
        std::thread::sleep(Duration::from_millis(200));
    };
    println!(
        "  {} kB and {} descriptors before, {} kB and {} after",
        before.memory_kb,
        before.descriptors.len(),
        after.memory_kb,
        after.descriptors.len()
    );
    ensure!(after.memory_kb < before.memory_kb + GROWTH_KB, "{before:?} before, {after:?} after");
    let answer = health()?;
    ensure!(answer.starts_with("HTTP/1.1 200") || answer.starts_with("HTTP/1.1 503"), "{answer}");
    Ok(())
}

fn wait_until_served() -> Check {
    let deadline = Instant::now() + STEP;
    while let Err(failure) = health() {
        ensure!(Instant::now() < deadline, "nobody answers for the daemon's health: {}", failure.words());
        std::thread::sleep(Duration::from_millis(100));
    }
    Ok(())
}

fn health() -> Check<String> {
    let address: SocketAddr = METRICS.parse()?;
    let mut client = TcpStream::connect_timeout(&address, STEP)?;
    client.set_read_timeout(Some(STEP))?;
    client.write_all(b"GET /health HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n")?;
    let mut answer = String::new();
    client.read_to_string(&mut answer)?;
    Ok(answer)
}
