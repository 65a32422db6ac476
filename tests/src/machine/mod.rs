//! A machine with SocketCAN: `vcan0` and `vcan1`, apart from the network that this computer is on.
//!
//! Where the kernel has vcan it is a fresh network namespace. Where it has not, it is user-mode Linux on this
//! computer's own files: the root file system is mounted read-only, `/run`, `/dev/shm` and `TMPDIR` are in memory, and
//! the scratch directory alone can be written. The clock is the computer's own.
//!
//! Another machine is a small Debian on which systemd has booted, for what is to be installed: see [`Machine::prepare_debian`].

mod debian;
mod init;
mod namespace;
mod uml;

use crate::process;
use crate::scratch::Scratch;
use crate::{Check, Failure, IoContext, packages};
use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

pub use init::init_if_first_process;

/// Names the scratch directory to the program inside; its presence says that one is inside.
const SCRATCH_VARIABLE: &str = "WRENCHD_TEST_SCRATCH";

/// A machine that is ready to run programs.
pub struct Machine {
    kind: Kind,
    description: String,
    scratch: Scratch,
}

enum Kind {
    Namespace(namespace::Namespace),
    Uml(uml::Uml),
    Debian { uml: uml::Uml, image: PathBuf },
}

/// A program to run inside, with all the environment it gets beside `PATH`, `HOME`, `TMPDIR` and `LANG`.
#[derive(Clone)]
pub struct Job {
    program: PathBuf,
    arguments: Vec<OsString>,
    environment: Vec<(OsString, OsString)>,
}

impl Job {
    /// This program, given by its path.
    pub fn new(program: impl Into<PathBuf>) -> Self {
        Self { program: program.into(), arguments: Vec::new(), environment: Vec::new() }
    }

    /// Adds an argument.
    #[must_use]
    pub fn arg(mut self, argument: impl Into<OsString>) -> Self {
        self.arguments.push(argument.into());
        self
    }

    /// Sets a variable.
    #[must_use]
    pub fn env(mut self, name: impl Into<OsString>, value: impl Into<OsString>) -> Self {
        self.environment.push((name.into(), value.into()));
        self
    }

    fn command(&self) -> Command {
        let mut command = Command::new(&self.program);
        command
            .args(&self.arguments)
            .env_clear()
            .envs(self.environment.iter().map(|(name, value)| (name, value)));
        command
    }
}

impl Machine {
    /// Finds out what this computer offers, installs what is missing, and says what the machine will be.
    pub fn prepare() -> Check<Self> {
        packages::require(&[&packages::IP, &packages::CANDUMP, &packages::UNSHARE])?;
        let scratch = Scratch::new()?;
        let host = fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default().trim().to_owned();
        let tools =
            packages::version(packages::CANDUMP.package).unwrap_or_else(|| "of unknown version".into());
        let (kind, what) = match namespace::Namespace::probe()? {
            Ok(namespace) => {
                let what = format!("network namespace of kernel {host} ({namespace})");
                (Kind::Namespace(namespace), what)
            }
            Err(why) => {
                let uml = uml::Uml::prepare(&scratch).map_err(|failure| {
                    Failure::new(format!(
                        "this kernel ({host}) gives no vcan ({why}), and user-mode Linux cannot stand in: {}",
                        failure.words()
                    ))
                })?;
                let what =
                    format!("user-mode Linux {}, as kernel {host} gives no vcan ({why})", uml.version());
                (Kind::Uml(uml), what)
            }
        };
        Ok(Self { kind, description: format!("{what}; can-utils {tools}"), scratch })
    }

    /// The machine with a booted systemd. Each [`Machine::run`] is a boot of it, and finds what was written in those before.
    pub fn prepare_debian() -> Check<Self> {
        let scratch = Scratch::new()?;
        let uml = uml::Uml::prepare(&scratch).map_err(|failure| {
            Failure::new(format!("systemd cannot be booted without user-mode Linux: {}", failure.words()))
        })?;
        let image = debian::image(&uml.modules())?;
        let description = format!("Debian with systemd, user-mode Linux {}", uml.version());
        Ok(Self { kind: Kind::Debian { uml, image }, description, scratch })
    }

    /// What it runs on: kernel, kind, versions.
    pub fn description(&self) -> &str {
        &self.description
    }

    /// The directory that inside and outside share; it goes with the machine.
    pub fn scratch(&self) -> &Path {
        self.scratch.path()
    }

    /// Runs a program inside to its end, its output going where this program's goes, and returns its exit status. When the status is not 0,
    /// what was left in the scratch directory stays there, and its path is said.
    pub fn run(&mut self, job: Job, limit: Duration) -> Check<i32> {
        let path = std::env::join_paths(packages::search_path())?;
        let temporary = match self.kind {
            Kind::Namespace(_) => self.scratch.path().join("tmp"),
            Kind::Uml(_) | Kind::Debian { .. } => PathBuf::from(init::TEMPORARY),
        };
        if matches!(self.kind, Kind::Namespace(_)) {
            fs::create_dir_all(&temporary).at("create", &temporary)?;
        }
        let job = job
            .env("PATH", path)
            .env("HOME", &temporary)
            .env("TMPDIR", &temporary)
            .env("LANG", "C.UTF-8")
            .env(SCRATCH_VARIABLE, self.scratch.path());
        let outcome = match &self.kind {
            Kind::Namespace(namespace) => namespace.run(&job, limit),
            Kind::Uml(uml) => uml.run(&job, limit, self.scratch.path(), &uml::Root::HostFiles),
            Kind::Debian { uml, image } => {
                let scratch = self.scratch.path();
                debian::write_start(scratch)?;
                uml.run(&job, limit, scratch, &uml::Root::Disk { image, written: &scratch.join("written") })
            }
        };
        if !matches!(outcome, Ok(0)) {
            self.scratch.keep();
            println!("what the machine left is in {}", self.scratch.path().display());
        }
        outcome
    }
}

/// The directory inside that outlives the machine, when this program runs inside one.
pub fn inside() -> Option<PathBuf> {
    std::env::var_os(SCRATCH_VARIABLE).map(PathBuf::from)
}

/// Takes from a command what tells a program that it is inside: it will prepare a machine of its own.
pub fn as_if_outside(command: &mut Command) {
    command.env_remove(SCRATCH_VARIABLE);
}

/// Brings up the links that every program inside finds, where they are not: lo, vcan0 and vcan1, wide enough for CAN FD.
pub fn bring_up_links() -> Check {
    let step =
        |words: &[&str]| process::run(Command::new("ip").args(words), Duration::from_secs(20)).map(drop);
    step(&["link", "set", "lo", "up"])?;
    for name in ["vcan0", "vcan1"] {
        if step(&["link", "show", name]).is_err() {
            step(&["link", "add", name, "mtu", "72", "type", "vcan"])?;
        }
        step(&["link", "set", name, "up"])?;
    }
    Ok(())
}

/// A path as text for a place where only text will do.
fn text(path: &Path) -> Check<&str> {
    path.to_str().ok_or_else(|| Failure::new(format!("the path {} is not UTF-8", path.display())))
}
