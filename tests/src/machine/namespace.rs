//! The machine where the kernel has vcan: a network namespace of its own, in a user namespace where one is not root.

use super::Job;
use crate::process::{self, Program};
use crate::{Check, Failure, packages};
use std::fmt;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const PROBE_LIMIT: Duration = Duration::from_secs(30);
/// Adds a link and opens a raw socket on it: all that the scenarios stand on.
const PROBE: &str = "ip link add vcan0 type vcan && ip link set vcan0 up && candump -T 10 vcan0";

pub(super) struct Namespace {
    unshare: PathBuf,
    options: &'static [&'static str],
}

impl Namespace {
    /// The namespace to use, or (inner error) why this kernel has none with vcan.
    pub(super) fn probe() -> Check<Result<Self, String>> {
        let [unshare] = packages::require(&[&packages::UNSHARE])?
            .try_into()
            .map_err(|_| Failure::new("unshare is required once and found once"))?;
        let root = nix::unistd::geteuid().is_root();
        if let Some(modprobe) = packages::find(packages::MODPROBE.program).filter(|_| root) {
            // Where there is such a module; where there is none the probe says so.
            let _ = process::run(Command::new(modprobe).args(["-q", "-a", "vcan", "can-raw"]), PROBE_LIMIT);
        }
        let own: &[&str] = &["--net"];
        let mapped: &[&str] = &["--user", "--map-root-user", "--net"];
        let attempts = if root { vec![own, mapped] } else { vec![mapped] };
        let mut why = String::new();
        for options in attempts {
            let namespace = Self { unshare: unshare.clone(), options };
            let mut command = namespace.command();
            command.args(["sh", "-c", PROBE]).env("PATH", std::env::join_paths(packages::search_path())?);
            let finished = Program::start(&mut command)?.finish(PROBE_LIMIT)?;
            if finished.code() == Some(0) {
                return Ok(Ok(namespace));
            }
            // The first attempt is the one that says most: without namespaces of its own, nobody gets any.
            if why.is_empty() {
                why = finished.stderr().lines().next().unwrap_or("the probe failed silently").to_owned();
            }
        }
        Ok(Err(why))
    }

    fn command(&self) -> Command {
        let mut command = Command::new(&self.unshare);
        // Whatever ends the tests ends what runs inside.
        command.args(self.options).args(["--fork", "--kill-child"]);
        command
    }

    pub(super) fn run(&self, job: &Job, limit: Duration) -> Check<i32> {
        let mut command = self.command();
        command.arg(&job.program).args(&job.arguments).env_clear();
        command.envs(job.environment.iter().map(|(name, value)| (name, value))).stdin(Stdio::null());
        let mut child = command.spawn()?;
        let deadline = Instant::now() + limit;
        loop {
            if let Some(status) = child.try_wait()? {
                return status.code().ok_or_else(|| Failure::new(format!("inside the namespace: {status}")));
            }
            if Instant::now() >= deadline {
                child.kill()?;
                child.wait()?;
                let limit = limit.as_secs();
                return Err(Failure::new(format!("nothing ended inside the namespace within {limit} s")));
            }
            std::thread::sleep(Duration::from_millis(20));
        }
    }
}

impl fmt::Display for Namespace {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "unshare {}", self.options.join(" "))
    }
}
