//! The machine where the kernel has no vcan: user-mode Linux on this computer's files.

use super::{Job, init, text};
use crate::scratch::Scratch;
use crate::{Check, Failure, IoContext, ensure, packages, process};
use nix::sys::signal::{Signal, killpg};
use nix::sys::statvfs::{FsFlags, statvfs};
use nix::unistd::Pid;
use std::fs;
use std::io::PipeReader;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Memory of the machine. It is a file that grows as it is used.
const MEMORY_MIB: u64 = 1024;
/// A boot takes about a second; a loaded computer may take longer.
const BOOT_LIMIT: Duration = Duration::from_secs(120);
const COMPILE_LIMIT: Duration = Duration::from_secs(60);
const MODULES: &str = "/usr/lib/uml/modules";
const SHIM: &str = include_str!("xstate.c");

/// What the machine boots.
pub(super) enum Root<'a> {
    /// This computer's files, which it cannot write, with the tests' executable as its first process.
    HostFiles,
    /// A system of its own on a disk image, which is not written; what is written goes to the other file.
    Disk { image: &'a Path, written: &'a Path },
}

pub(super) struct Uml {
    linux: PathBuf,
    version: String,
    shim: PathBuf,
    memory_dir: PathBuf,
}

impl Uml {
    pub(super) fn prepare(scratch: &Scratch) -> Check<Self> {
        ensure!(
            cfg!(target_arch = "x86_64"),
            "there is none for this processor ({}). Load the kernel modules vcan and can-raw (sudo modprobe -a vcan \
             can-raw), on Debian from the package linux-image-{0}, and run the tests again",
            std::env::consts::ARCH
        );
        let [linux, _, cc]: [PathBuf; 3] =
            packages::require(&[&packages::UML, &packages::MODPROBE, &packages::CC])?
                .try_into()
                .map_err(|_| Failure::new("three programs are required and found"))?;
        let version = process::run(Command::new(&linux).arg("--version"), Duration::from_secs(20))?;
        let version = version.stdout().trim().to_owned();
        let modules = Path::new(MODULES).join(&version);
        ensure!(
            modules.is_dir(),
            "its modules are not in {}: reinstall the package {}",
            modules.display(),
            packages::UML.package
        );
        let scratch = scratch.path();
        for hidden in ["/proc", "/sys", "/dev", "/run"] {
            ensure!(
                !scratch.starts_with(hidden),
                "the build directory lies in {hidden}, which the machine mounts anew: set CARGO_TARGET_DIR elsewhere"
            );
        }
        let module_root = scratch.join(init::MODULE_ROOT).join("lib");
        fs::create_dir_all(&module_root).at("create", &module_root)?;
        let link = module_root.join("modules");
        std::os::unix::fs::symlink(MODULES, &link).at("create", &link)?;
        let (source, shim) = (scratch.join("xstate.c"), scratch.join("xstate.so"));
        fs::write(&source, SHIM).at("write", &source)?;
        let mut compile = Command::new(cc);
        compile.args(["-shared", "-fPIC", "-O2", "-o"]).args([&shim, &source]).arg("-ldl");
        process::run(&mut compile, COMPILE_LIMIT)?;
        Ok(Self { linux, version, shim, memory_dir: memory_dir(scratch)? })
    }

    pub(super) fn version(&self) -> &str {
        &self.version
    }

    /// The kernel's modules.
    pub(super) fn modules(&self) -> PathBuf {
        Path::new(MODULES).join(&self.version)
    }

    pub(super) fn run(&self, job: &Job, limit: Duration, scratch: &Path, root: &Root<'_>) -> Check<i32> {
        job.write(&scratch.join(init::JOB_FILE))?;
        let _ = fs::remove_file(scratch.join(init::STATUS_FILE));
        let mut running = Running::start(self.command(scratch, root)?)?;
        let console = running.follow(limit);
        let console_path = scratch.join("console.log");
        fs::write(&console_path, console.boot.join("\n") + "\n").at("write", &console_path)?;
        let status_path = scratch.join(init::STATUS_FILE);
        let status = fs::read_to_string(&status_path).unwrap_or_default();
        match (console.end, status.parse::<i32>()) {
            (End::PoweredOff, Ok(status)) => Ok(status),
            (end, _) => {
                let mut words = match end {
                    End::PoweredOff if status.is_empty() => {
                        "user-mode Linux ended before the program inside did".to_owned()
                    }
                    End::PoweredOff => status,
                    End::BootLimit => {
                        format!("user-mode Linux was not up after {} s and was killed", BOOT_LIMIT.as_secs())
                    }
                    End::Limit => format!(
                        "the program inside user-mode Linux had not ended after {} s and was killed",
                        limit.as_secs()
                    ),
                };
                words.push_str("; its console:\n  ");
                words.push_str(&console.boot.join("\n  "));
                Err(Failure::new(words))
            }
        }
    }

    fn command(&self, scratch: &Path, root: &Root<'_>) -> Check<Command> {
        // setpriv: whatever ends this process ends the machine.
        let mut command = match packages::find("setpriv") {
            Some(setpriv) => {
                let mut command = Command::new(setpriv);
                command.args(["--pdeathsig", "TERM", "--"]).arg(&self.linux);
                command
            }
            None => Command::new(&self.linux),
        };
        command.arg(format!("mem={MEMORY_MIB}M"));
        command.args(["con=null", "ssl=null", "con0=null,fd:1", "panic=-1", "umid=machine"]);
        command.args(root.arguments()?);
        command.arg(format!("{}={}", init::BOOT_VARIABLE, quoted(scratch)?));
        // It keeps a directory of its own in HOME.
        command
            .env("HOME", scratch)
            .env("TMPDIR", &self.memory_dir)
            .env("LD_PRELOAD", &self.shim)
            .process_group(0);
        Ok(command)
    }
}

impl Root<'_> {
    /// The kernel's command line: where its root file system is, and what is the first process there.
    fn arguments(&self) -> Check<Vec<String>> {
        let words = |words: &[&str]| words.iter().map(|word| (*word).to_owned()).collect::<Vec<String>>();
        match self {
            Self::HostFiles => {
                let mut all = words(&["root=/dev/root", "rootfstype=hostfs", "rootflags=/", "ro"]);
                all.push(format!("init={}", quoted(&std::env::current_exe()?)?));
                Ok(all)
            }
            Self::Disk { image, written } => {
                let (image, written) = (text(image)?, text(written)?);
                ensure!(
                    !(image.contains([',', ' ']) || written.contains([',', ' '])),
                    "a disk of user-mode Linux cannot lie in {image}: set CARGO_TARGET_DIR to a path without commas and blanks"
                );
                let mut all = words(&["root=/dev/ubda", "rw", "init=/lib/systemd/systemd"]);
                // What is written need not outlive this computer's power: waiting for its disk would take most of the time.
                all.push("rootflags=barrier=0".to_owned());
                // The console is the tests' own.
                all.extend(words(&["systemd.show_status=false", "systemd.log_target=journal"]));
                all.push(format!("ubd0={written},{image}"));
                Ok(all)
            }
        }
    }
}

/// A path as a word of a kernel command line, in which there cannot be a quote.
fn quoted(path: &Path) -> Check<String> {
    let path = text(path)?;
    ensure!(!path.contains('"'), "the path {path} holds a quotation mark");
    Ok(format!("\"{path}\""))
}

/// A directory for the memory file: it needs room, and files that may be mapped as code.
fn memory_dir(scratch: &Path) -> Check<PathBuf> {
    let mut tried = Vec::new();
    let own = std::env::var_os("TMPDIR").map(PathBuf::from);
    let candidates = [own.as_deref(), Some(Path::new("/dev/shm")), Some(Path::new("/tmp")), Some(scratch)];
    for dir in candidates.into_iter().flatten() {
        let fit = statvfs(dir).map_err(|error| error.to_string()).and_then(|fs| {
            let mib = |blocks: u64| u128::from(blocks) * u128::from(fs.fragment_size()) / (1 << 20);
            let free_mib = mib(fs.blocks_available());
            // A tmpfs without a limit says that it has no blocks.
            let unlimited = fs.blocks() == 0;
            if fs.flags().contains(FsFlags::ST_NOEXEC) {
                Err("mounted noexec".to_owned())
            } else if !unlimited && free_mib < u128::from(MEMORY_MIB) + 64 {
                Err(format!("{free_mib} MiB free"))
            } else if nix::unistd::access(dir, nix::unistd::AccessFlags::W_OK).is_err() {
                Err("not writable".to_owned())
            } else {
                Ok(())
            }
        });
        match fit {
            Ok(()) => return Ok(dir.to_owned()),
            Err(why) => tried.push(format!("{} ({why})", dir.display())),
        }
    }
    Err(Failure::new(format!(
        "no directory can hold its memory of {MEMORY_MIB} MiB as an executable file: {}. Set TMPDIR to one that can",
        tried.join(", ")
    )))
}

enum End {
    PoweredOff,
    BootLimit,
    Limit,
}

struct Console {
    /// What was said before the job began.
    boot: Vec<String>,
    end: End,
}

/// A machine that runs. Dropping it kills all its processes.
struct Running {
    child: Child,
    console: Receiver<String>,
}

impl Running {
    fn start(mut command: Command) -> Check<Self> {
        let (reader, writer) = std::io::pipe()?;
        let child =
            command.stdin(Stdio::null()).stdout(writer.try_clone()?).stderr(writer).spawn().map_err(
                |error| Failure::new(format!("cannot start {:?}: {error}", command.get_program())),
            )?;
        // The command holds the writing end; the pipe ends with the machine only once that is closed.
        drop(command);
        Ok(Self { child, console: lines(reader) })
    }

    /// Prints what the job says as it says it, until the machine has powered off or a limit has passed.
    fn follow(&mut self, limit: Duration) -> Console {
        let mut boot = Vec::new();
        let mut deadline = Instant::now() + BOOT_LIMIT;
        let (mut up, mut ended) = (false, false);
        loop {
            match self.console.recv_timeout(deadline.saturating_duration_since(Instant::now())) {
                Ok(line) if line == init::ENDED => ended = true,
                Ok(_) if ended => {}
                Ok(line) if up => println!("{line}"),
                Ok(line) if line == init::STARTED => {
                    up = true;
                    deadline = Instant::now() + limit;
                }
                Ok(line) => boot.push(line),
                Err(RecvTimeoutError::Timeout) => {
                    self.kill();
                    return Console { boot, end: if up { End::Limit } else { End::BootLimit } };
                }
                Err(RecvTimeoutError::Disconnected) => {
                    let _ = self.child.wait();
                    return Console { boot, end: End::PoweredOff };
                }
            }
        }
    }

    fn kill(&mut self) {
        let Ok(group) = i32::try_from(self.child.id()) else { return };
        let group = Pid::from_raw(group);
        if !matches!(self.child.try_wait(), Ok(None)) {
            return;
        }
        // On SIGTERM it takes its processes with it; SIGKILL is for what is left.
        let _ = killpg(group, Signal::SIGTERM);
        let patience = Instant::now() + Duration::from_secs(2);
        while Instant::now() < patience && matches!(self.child.try_wait(), Ok(None)) {
            std::thread::sleep(Duration::from_millis(20));
        }
        let _ = killpg(group, Signal::SIGKILL);
        let _ = self.child.wait();
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        self.kill();
    }
}

fn lines(reader: PipeReader) -> Receiver<String> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || process::each_line(reader, |line| sender.send(line).is_ok()));
    receiver
}
