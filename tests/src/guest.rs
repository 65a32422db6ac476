//! What a scenario works with inside the machine: its directory, the links, captures of them.

use crate::candump::Line;
use crate::process::{self, Program};
use crate::{Check, Failure, IoContext, ensure};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

const STEP_LIMIT: Duration = Duration::from_secs(20);
const LISTEN_LIMIT: Duration = Duration::from_secs(20);
/// Room for some 200 000 classical frames while the capturing program waits for the processor.
const CAPTURE_BUFFER: &str = "100663296";
/// The kernel's lists of who receives what.
const RECEIVER_LISTS: [&str; 6] =
    ["rcvlist_all", "rcvlist_eff", "rcvlist_err", "rcvlist_fil", "rcvlist_inv", "rcvlist_sff"];

/// A scenario's surroundings.
pub struct Guest {
    dir: PathBuf,
}

impl Guest {
    /// With a directory of one's own.
    pub fn new(dir: PathBuf) -> Self {
        Self { dir }
    }

    /// A directory of this scenario's own, empty at its start, kept when it fails.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// Runs `ip` with these arguments.
    pub fn ip(&self, arguments: &[&str]) -> Check {
        process::run(Command::new("ip").args(arguments), STEP_LIMIT).map(drop)
    }

    /// Takes a link down or up.
    pub fn set_link(&self, name: &str, up: bool) -> Check {
        self.ip(&["link", "set", name, if up { "up" } else { "down" }])
    }

    /// Deletes a link.
    pub fn delete_link(&self, name: &str) -> Check {
        self.ip(&["link", "delete", name])
    }

    /// Adds a vcan link, wide enough for CAN FD, and takes it up.
    pub fn add_link(&self, name: &str) -> Check {
        self.ip(&["link", "add", name, "mtu", "72", "type", "vcan"])?;
        self.set_link(name, true)
    }

    /// How many receivers the kernel has on a link.
    pub fn receivers(&self, interface: &str) -> Check<usize> {
        let mut count = 0;
        for list in RECEIVER_LISTS {
            let path = Path::new("/proc/net/can").join(list);
            let text = fs::read_to_string(&path).at("read", &path)?;
            count +=
                text.lines().filter(|line| line.split_ascii_whitespace().next() == Some(interface)).count();
        }
        Ok(count)
    }

    /// Starts a command and returns once it listens on the link.
    pub fn start_listening(&self, command: &mut Command, interface: &str) -> Check<Program> {
        self.listening(interface, || Program::start(command))
    }

    /// The same with its standard output in a file.
    pub fn start_listening_into(&self, command: &mut Command, interface: &str, out: File) -> Check<Program> {
        self.listening(interface, || Program::start_into(command, out))
    }

    /// How many frames a link has carried since it was added, by the kernel's count.
    pub fn carried(&self, interface: &str) -> Check<u64> {
        let path = Path::new("/proc/net/dev");
        let text = fs::read_to_string(path).at("read", path)?;
        // name: bytes packets ...
        let row = text.lines().find_map(|line| line.trim_start().strip_prefix(interface)?.strip_prefix(':'));
        let packets = row.and_then(|row| row.split_ascii_whitespace().nth(1)?.parse().ok());
        packets.ok_or_else(|| Failure::new(format!("no count of {interface} in {}:\n{text}", path.display())))
    }

    /// Waits until the kernel has so many receivers on a link.
    pub fn wait_for_receivers(&self, interface: &str, count: usize) -> Check {
        let deadline = Instant::now() + LISTEN_LIMIT;
        while self.receivers(interface)? < count {
            ensure!(Instant::now() < deadline, "{interface} has fewer than {count} receivers");
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(())
    }

    fn listening(&self, interface: &str, start: impl FnOnce() -> Check<Program>) -> Check<Program> {
        let before = self.receivers(interface)?;
        let mut program = start()?;
        let deadline = Instant::now() + LISTEN_LIMIT;
        while self.receivers(interface)? <= before {
            ensure!(
                program.is_running()? && Instant::now() < deadline,
                "a program that should listen on {interface} does not; it said:\n{}",
                program.text()
            );
            std::thread::sleep(Duration::from_millis(5));
        }
        Ok(program)
    }

    /// Starts to capture a link into a file of the scenario's directory, with `candump -l`: unlike `-L` it does not write out
    /// every frame by itself, which in the machine costs more than all else that is done with a frame.
    pub fn capture(&self, interface: &str) -> Check<Capture> {
        let number = fs::read_dir(&self.dir).at("read", &self.dir)?.count();
        let dir = self.dir.join(format!("captured-{interface}-{number}"));
        fs::create_dir(&dir).at("create", &dir)?;
        let mut command = Command::new("candump");
        command.args(["-l", "-s", "2", "-d", "-r", CAPTURE_BUFFER, interface]).current_dir(&dir);
        let program = self.listening(interface, || Program::start(&mut command))?;
        Ok(Capture { program, dir })
    }
}

/// The file that candump made under a name of its own.
fn only_file(dir: &Path) -> Check<PathBuf> {
    let file = fs::read_dir(dir).at("read", dir)?.next().transpose().at("read", dir)?;
    file.map(|file| file.path())
        .ok_or_else(|| Failure::new(format!("candump made no file in {}", dir.display())))
}

/// A capture that runs.
pub struct Capture {
    program: Program,
    dir: PathBuf,
}

/// A capture that has ended.
pub struct Captured {
    /// Every frame, in order.
    pub lines: Vec<Line>,
    /// The file, a recording as `candump -L` wrote it.
    pub path: PathBuf,
}

impl Capture {
    /// Ends the capture once the link has been silent for a while. A frame that the kernel dropped is a failure.
    pub fn stop(self) -> Check<Captured> {
        // What has been sent has been queued; the capturing program still needs the processor to take it.
        let mut size = 0;
        loop {
            std::thread::sleep(Duration::from_millis(200));
            let now = fs::metadata(only_file(&self.dir)?).at("look at", &self.dir)?.len();
            if now == size {
                break;
            }
            size = now;
        }
        self.stop_at_once()
    }

    /// Ends the capture of a link that is never silent, wherever it is. A frame that the kernel dropped is a failure.
    pub fn stop_at_once(self) -> Check<Captured> {
        // candump says what it dropped among the frames, and on signals ends as it ends otherwise.
        let finished = self.program.stop(STEP_LIMIT)?;
        let said = finished.stderr();
        ensure!(said.lines().all(|line| line.starts_with("Enabling Logfile")), "candump said: {said}");
        let path = only_file(&self.dir)?;
        let text = fs::read_to_string(&path).at("read", &path)?;
        let dropped = text.lines().rfind(|line| line.contains("DROPCOUNT"));
        ensure!(
            dropped.is_none(),
            "the capture itself lost frames; the last of candump's remarks: {dropped:?}"
        );
        let lines = text.lines().map(Line::parse).collect::<Check<Vec<Line>>>()?;
        Ok(Captured { lines, path })
    }
}

/// Starts a command that puts frames onto a link, waits for its end, and fails unless it ends well.
pub fn send(command: &mut Command, limit: Duration) -> Check {
    process::run(command, limit).map(drop)
}

/// Fails unless the frames arrived are the frames sent: all of them, unchanged, in order.
pub fn ensure_same_frames(sent: &[Line], arrived: &[Line]) -> Check {
    for (at, (sent, arrived)) in sent.iter().zip(arrived).enumerate() {
        if sent.frame() != arrived.frame() {
            return Err(Failure::new(format!(
                "frame {at}: sent {}, arrived {}",
                sent.frame(),
                arrived.frame()
            )));
        }
    }
    ensure!(sent.len() == arrived.len(), "{} frames sent, {} arrived", sent.len(), arrived.len());
    Ok(())
}
