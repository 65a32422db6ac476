//! The daemon for a long time beside a bus that fails in every way in turn: what it says is never wrong, and it holds no more at the end than at
//! the beginning.
//!
//! `WRENCHD_TEST_SOAK_MINUTES=60 cargo test -p wrenchd-tests --test socketcan -- soak`, on a machine that has nothing else to do.

use crate::hostile::Held;
use can::fault::in_turn;
use can::frame::{Frame, Stamped};
use can::socket::SocketSender;
use rig::Rig;
use sim::motion::{MotionLimits, Sine, Sines};
use sim::{Options, Scenario as Motion, Simulator, Trajectory, Truth};
use std::collections::{BTreeMap, VecDeque};
use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};
use wrenchd_tests::guest::Guest;
use wrenchd_tests::process::Program;
use wrenchd_tests::programs::{programs, workspace};
use wrenchd_tests::suite::{Need, SOAK_VARIABLE, Scenario};
use wrenchd_tests::{Check, Failure, IoContext, ensure};

/// How often the daemon's memory and descriptors are looked at.
const LOOK_EVERY: Duration = Duration::from_secs(60);
/// What memory may grow by after the first look, kB: a page here and there, not a page a minute.
const GROWTH_KB: u64 = 1024;
/// The boards' rate, Hz.
const RATE_HZ: f64 = 125.0;
/// An instant is compared with what was true within so long of it, ns: stamps are late where the machine is.
const NEAR_NS: i64 = 20_000_000;
/// What is remembered of the frames sent, to tell which time of the simulation an instant is of.
const REMEMBERED: usize = 5000;

pub(crate) const SCENARIOS: &[Scenario] = &[Scenario {
    name: "soak::faults_in_turn_make_nothing_wrong_and_nothing_grow",
    needs: &[Need::Programs],
    limit: Duration::from_secs(4 * 3600),
    run: soak,
}];

/// The example arm on vcan0 with a model that knows its gauges.
struct Arm {
    rig: Rig,
    config: PathBuf,
    model: PathBuf,
    socket: PathBuf,
    truth: Truth,
}

impl Arm {
    fn new(dir: &Path) -> Check<Self> {
        for name in ["arm.urdf", "arm.dbc"] {
            let from = workspace().join("config").join(name);
            fs::copy(&from, dir.join(name)).at("copy", &from)?;
        }
        let given = workspace().join("config/arm.toml");
        let text = fs::read_to_string(&given).at("read", &given)?;
        // Everything of the example up to its outputs.
        let arm = text.split("\n[publish]").next().unwrap_or_default().replace("\"can0\"", "\"vcan0\"");
        let socket = dir.join("control.sock");
        let outputs = format!(
            "\n[publish]\nmode = \"event\"\n[publish.can]\ninterface = \"vcan1\"\n[publish.rdt]\nbind = \"127.0.0.1:49152\"\n\
             http = \"127.0.0.1:8049\"\n[publish.metrics]\nbind = \"127.0.0.1:9464\"\n[control]\nsocket = \"{}\"\n",
            socket.display()
        );
        let (config, model) = (dir.join("arm.toml"), dir.join("model.toml"));
        fs::write(&config, arm + &outputs).at("write", &config)?;
        let rig = Rig::load_file(&config)?;
        let truth = Truth::draw(&rig, 7, 0.0);
        fs::write(&model, truth.known(&rig).to_toml()).at("write", &model)?;
        Ok(Self { rig, config, model, socket, truth })
    }

    /// The arm swinging for so long under a weight, its frames without a fault.
    fn simulator(&self, seconds: f64) -> Check<Simulator> {
        let limits = MotionLimits::of(&self.rig.chain)?;
        let pose = vec![0.2, -0.9, 0.8, 0.3, -0.7, 0.4];
        let term = |k: usize| {
            vec![Sine { amplitude_rad: 0.5, frequency_hz: 0.1 + 0.023 * k as f64, phase_rad: k as f64 }]
        };
        let mut trajectory = Trajectory::from_pose(pose.clone());
        trajectory.hold(3.0);
        trajectory.swing(Sines::new(pose, (0..6).map(term).collect(), seconds, 5.0, &limits, 0.7));
        let motion = Motion::of_motion(trajectory).with_load(0.4, [0.01, 0.0, 0.05])?;
        let options = Options { rate_hz: Some(RATE_HZ), ..Options::default() };
        Ok(Simulator::new(&self.rig, self.truth.clone(), &motion, options)?)
    }
}

fn soak(guest: &Guest) -> Check {
    let seconds = 60.0 * std::env::var(SOAK_VARIABLE)?.parse::<f64>()?;
    let arm = Arm::new(guest.dir())?;
    let mut command = Command::new(&programs()?.wrenchd);
    command.arg("--config").arg(&arm.config).arg("--model").arg(&arm.model);
    let daemon = guest.start_listening(&mut command, "vcan0")?;
    let (ended, sent) = (AtomicBool::new(false), Mutex::new(VecDeque::new()));
    let (held, tally) = std::thread::scope(|scope| {
        let judge = scope.spawn(|| judge(&arm, seconds, &sent, &ended));
        let watch = scope.spawn(|| watch(&daemon, &ended));
        let played = play(&arm, seconds, &sent);
        ended.store(true, Ordering::Relaxed);
        let panicked = |_| Failure::new("a thread panicked");
        let (tally, held) = (judge.join().map_err(panicked)?, watch.join().map_err(panicked)?);
        played?;
        Ok::<_, Failure>((held?, tally?))
    })?;
    daemon.stop(Duration::from_secs(30))?.expect_code(0)?;
    println!("  {seconds:.0} s: {tally:?}");
    tally.verdict(seconds)?;
    flat(&held)
}

/// When frames of which time of the simulation were sent: by the machine's clock and by the simulation's, ns.
type Sent = Mutex<VecDeque<(i64, i64)>>;

/// Sends what the arm says in its time, each turn with another fault.
fn play(arm: &Arm, seconds: f64, sent: &Sent) -> Check {
    let mut sender = SocketSender::open("vcan0")?;
    let begun = Instant::now();
    for frame in in_turn(arm.simulator(seconds)?, sim::START_NS, 0) {
        send(&mut sender, &frame, begun, sent);
    }
    Ok(())
}

/// Sends a frame once it is due, and remembers when that was.
fn send(sender: &mut SocketSender, frame: &Stamped, begun: Instant, sent: &Sent) {
    let due = Duration::from_nanos((frame.stamp_ns - sim::START_NS).max(0) as u64);
    let early = due.saturating_sub(begun.elapsed());
    if early > Duration::from_micros(300) {
        std::thread::sleep(early);
    }
    let frames: [Frame; 1] = [frame.frame];
    let now_ns = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_nanos() as i64);
    sender.send(&frames);
    let Ok(mut sent) = sent.lock() else { return };
    if sent.len() == REMEMBERED {
        sent.pop_front();
    }
    sent.push_back((now_ns, frame.stamp_ns));
}

/// What was said.
#[derive(Debug, Default)]
struct Tally {
    instants: u64,
    valid: u64,
    good: u64,
    wrong: u64,
    /// Instants by status.
    status: BTreeMap<String, u64>,
    worst: Vec<String>,
}

impl Tally {
    fn verdict(&self, seconds: f64) -> Check {
        ensure!(self.wrong == 0, "{} instants are wrong and valid: {}", self.wrong, self.worst.join("\n"));
        // A stream has not every instant, but most; faults make many of them invalid.
        ensure!(self.instants as f64 > 0.5 * RATE_HZ * seconds, "{} instants in {seconds} s", self.instants);
        ensure!(self.valid * 2 > self.instants, "{} of {} instants are valid", self.valid, self.instants);
        Ok(())
    }
}

/// Follows the control socket's stream and holds every instant of it against the truth.
fn judge(arm: &Arm, seconds: f64, sent: &Sent, ended: &AtomicBool) -> Check<Tally> {
    let mut world = arm.simulator(seconds)?;
    let mut stream = UnixStream::connect(&arm.socket).at("connect to", &arm.socket)?;
    stream.set_read_timeout(Some(Duration::from_secs(20)))?;
    stream.write_all(b"{\"command\": \"stream\", \"rate_hz\": 200}\n")?;
    let (mut tally, mut last) = (Tally::default(), None);
    for line in BufReader::new(stream).lines() {
        let answer: serde_json::Value = serde_json::from_str(&line?)?;
        let said = &answer["status"]["live"];
        if ended.load(Ordering::Relaxed) {
            break;
        }
        let sequence = said["sequence"].as_u64();
        if said.is_null() || sequence == last {
            continue;
        }
        last = sequence;
        take(&mut tally, said, sent, &mut world);
    }
    Ok(tally)
}

/// One instant: farther from the truth than five of its deviations and the protection level, at any time near it, is wrong.
fn take(tally: &mut Tally, said: &serde_json::Value, sent: &Sent, world: &mut Simulator) {
    tally.instants += 1;
    let names = said["status_names"].to_string();
    tally.good += u64::from(names.contains("good"));
    *tally.status.entry(names).or_default() += 1;
    let six = |name: &str| -> Option<[f64; 6]> {
        let numbers: Vec<f64> =
            said[name].as_array()?.iter().map(|number| number.as_f64().unwrap_or(f64::INFINITY)).collect();
        numbers.try_into().ok()
    };
    let (Some(wrench), Some(sigma), Some(protection)) = (six("wrench"), six("sigma"), six("protection"))
    else {
        return;
    };
    let seconds = |name: &str| said[name].as_f64().unwrap_or(0.0);
    let instant_ns = ((seconds("published_s") - seconds("age_s")) * 1e9) as i64;
    tally.valid += 1;
    let Ok(sent) = sent.lock() else { return };
    let near = sent.iter().filter(|(at_ns, _)| (at_ns - instant_ns).abs() < NEAR_NS);
    let mut near: Vec<i64> = near.map(|(_, of_ns)| *of_ns).collect();
    drop(sent);
    // One of each round is enough.
    near.dedup_by_key(|of_ns| (*of_ns - sim::START_NS) / 8_000_000);
    let excess = |of_ns: i64| {
        let truth = world.truth_at_ns(of_ns).to_vector();
        (0..6).map(|k| (wrench[k] - truth[k]).abs() / (5.0 * sigma[k] + protection[k])).fold(0.0, f64::max)
    };
    let least = near.into_iter().map(excess).fold(f64::INFINITY, f64::min);
    if least > 1.0 {
        tally.wrong += 1;
        if tally.worst.len() < 5 {
            tally.worst.push(format!("{least:.2} times what it may be: {said}"));
        }
    }
}

/// The daemon's memory and descriptors now and then.
fn watch(daemon: &Program, ended: &AtomicBool) -> Check<Vec<Held>> {
    let mut held = Vec::new();
    // Once it has begun, and everybody is connected.
    let mut next = Instant::now() + Duration::from_secs(10);
    while !ended.load(Ordering::Relaxed) {
        std::thread::sleep(Duration::from_millis(200));
        if Instant::now() >= next {
            next += LOOK_EVERY;
            let now = Held::of(daemon)?;
            println!("  minute {}: {} kB, {} descriptors", held.len(), now.memory_kb, now.descriptors.len());
            held.push(now);
        }
    }
    held.push(Held::of(daemon)?);
    Ok(held)
}

fn flat(held: &[Held]) -> Check {
    let (Some(first), Some(last)) = (held.first(), held.last()) else {
        return Err(Failure::new("nothing was looked at"));
    };
    let (before, after) = (first.memory_kb, last.memory_kb);
    println!(
        "  {before} kB and {} descriptors at first, {after} kB and {} at last",
        first.descriptors.len(),
        last.descriptors.len()
    );
    ensure!(after <= before + GROWTH_KB, "memory went from {before} to {after} kB");
    ensure!(last.descriptors.len() <= first.descriptors.len(), "descriptors: {first:?}, then {last:?}");
    Ok(())
}
