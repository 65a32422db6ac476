//! The whole daemon but its CAN sockets: a simulated arm on an in-process bus, real clients on real sockets.

mod control;
mod http;
mod picture;
mod rdt;
mod reload;
mod standstill;

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use can::channel::{ChannelSender, ChannelSource, channel};
use rig::config::PublishMode;
use sim::Simulator;
use tempfile::TempDir;

use super::Options;
use super::load::Loaded;
use super::supervise::Supervisor;
use crate::common::{examples, holding, model, rig, truth};
use crate::realtime::SystemClock;
use crate::runner::BoxedSource;
use crate::station::Clock;

/// What hangs at the arm's tip, kg, and where, m.
const LOAD: (f64, [f64; 3]) = (0.4, [0.01, 0.0, 0.05]);

/// Rounds a second of the simulated bus.
const RATE_HZ: f64 = 250.0;

/// The example's files in a folder, in event mode, the control socket beside them and nothing sent on CAN; `more` is added.
pub(super) fn files(folder: &Path, more: &str) -> Options {
    for name in ["arm.urdf", "arm.dbc"] {
        fs::copy(examples().join(name), folder.join(name)).unwrap();
    }
    let text = fs::read_to_string(examples().join("arm.toml")).unwrap();
    let (before, rest) = text.split_once("[publish.can]").unwrap();
    let after = rest.split_once("# Records for Net F/T").unwrap().1;
    let text = format!("{before}#{after}\n{more}").replace("mode = \"fixed\"", "mode = \"event\"");
    // A busy computer's pauses are not what is tested here.
    assert!(text.contains("# stale_after_s = 0.02"));
    let text = text.replace("# stale_after_s = 0.02", "stale_after_s = 0.5");
    let text = text.replace("/run/wrenchd", &folder.display().to_string());
    fs::write(folder.join("arm.toml"), text).unwrap();
    let robot = rig(PublishMode::Event);
    fs::write(folder.join("model.toml"), model(&robot, &truth(&robot)).to_toml()).unwrap();
    Options { config: folder.join("arm.toml"), model: Some(folder.join("model.toml")), record: None }
}

/// A supervisor with a running cycle on an in-process bus.
fn supervisor(folder: &Path) -> (Supervisor, ChannelSender) {
    started(&files(folder, ""))
}

fn started(options: &Options) -> (Supervisor, ChannelSender) {
    started_through(options, |source| Box::new(source))
}

/// With something between the bus and the cycle.
fn started_through(
    options: &Options,
    through: impl FnOnce(ChannelSource) -> BoxedSource,
) -> (Supervisor, ChannelSender) {
    let (sender, source) = channel(1 << 14);
    let loaded = Loaded::load(options).unwrap();
    (super::start(options, loaded, |_, _| Ok((through(source), None))).unwrap(), sender)
}

/// A daemon that runs; it ends when it is dropped.
struct Daemon {
    folder: TempDir,
    /// The bus is silent while this is down.
    sends: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Daemon {
    fn start(more: &str) -> Self {
        Self::start_on(more, holding(&rig(PublishMode::Event), RATE_HZ, LOAD))
    }

    fn start_on(more: &str, arm: Simulator) -> Self {
        Self::start_through(more, arm, |source| Box::new(source))
    }

    fn start_through(more: &str, arm: Simulator, through: impl FnOnce(ChannelSource) -> BoxedSource) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let (supervisor, sender) = started_through(&files(folder.path(), more), through);
        let (stop, sends) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(true)));
        let bus = std::thread::spawn({
            let (stop, sends) = (stop.clone(), sends.clone());
            move || play(arm, &sender, &stop, &sends)
        });
        let main = std::thread::spawn(move || assert_eq!(supervisor.run().unwrap(), ExitCode::SUCCESS));
        Self { folder, sends, stop, threads: vec![bus, main] }
    }

    fn silence(&self, silent: bool) {
        self.sends.store(!silent, Ordering::Relaxed);
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            let ended = thread.join();
            assert!(ended.is_ok() || std::thread::panicking(), "the daemon failed");
        }
    }
}

/// Sends the arm's frames in their time; the bus ends with this.
fn play(arm: Simulator, sender: &ChannelSender, stop: &AtomicBool, sends: &AtomicBool) {
    let begun_ns = SystemClock.now().realtime_ns;
    for mut frame in arm {
        frame.stamp_ns += begun_ns - sim::START_NS;
        let wait_ns = frame.stamp_ns - SystemClock.now().realtime_ns;
        std::thread::sleep(Duration::from_nanos(u64::try_from(wait_ns).unwrap_or(0)));
        if stop.load(Ordering::Relaxed) {
            return;
        }
        if sends.load(Ordering::Relaxed) {
            sender.send(frame);
        }
    }
}

/// A TCP address that nobody has.
fn free_tcp() -> SocketAddr {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

/// A UDP address that nobody has.
fn free_udp() -> SocketAddr {
    UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap()
}

/// Waits until it holds, at most half a minute.
fn wait_for(what: &str, mut holds: impl FnMut() -> bool) {
    let begun = Instant::now();
    while !holds() {
        assert!(begun.elapsed() < Duration::from_secs(30), "waited in vain: {what}");
        std::thread::sleep(Duration::from_millis(10));
    }
}

/// All that is answered to a GET.
fn http_get(address: SocketAddr, path: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    stream
        .write_all(format!("GET {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n").as_bytes())
        .unwrap();
    let mut text = String::new();
    stream.read_to_string(&mut text).unwrap();
    text
}

/// The answer to one line on the control socket.
fn control_line(daemon: &Daemon, line: &str) -> String {
    let mut stream = UnixStream::connect(daemon.path("control.sock")).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(20))).unwrap();
    stream.write_all(format!("{line}\n").as_bytes()).unwrap();
    let mut answer = String::new();
    BufReader::new(stream).read_line(&mut answer).unwrap();
    answer
}
