//! The first process inside user-mode Linux: it mounts, loads the CAN modules, runs the job and powers off. Where systemd is the first
//! process, a service of its own runs the job and has systemd power off.

use super::{Job, text};
use crate::process;
use crate::{Check, Failure, IoContext};
use nix::mount::{MsFlags, mount};
use nix::sys::reboot::{RebootMode, reboot};
use std::ffi::{OsStr, OsString};
use std::fs;
use std::os::unix::ffi::{OsStrExt, OsStringExt};
use std::path::Path;
use std::process::Command;
use std::time::Duration;

/// Inside, in memory: where programs put their temporary files.
pub(super) const TEMPORARY: &str = "/run/tmp";
/// The variable of the kernel's command line that names the scratch directory.
pub(super) const BOOT_VARIABLE: &str = "WRENCHD_TEST_BOOT";
/// The variable that names the scratch directory to systemd's service.
pub(super) const SERVICE_VARIABLE: &str = "WRENCHD_TEST_SERVICE";
/// What this process says on the console when the job's own output begins.
pub(super) const STARTED: &str = "== the machine is up ==";
/// What is said when it ends: how a system goes down is no news.
pub(super) const ENDED: &str = "== the machine goes down ==";
/// Where the job stands in the scratch directory, and what it ended with.
pub(super) const JOB_FILE: &str = "job";
pub(super) const STATUS_FILE: &str = "status";
/// Beneath the scratch directory: `lib/modules`, as modprobe wants it.
pub(super) const MODULE_ROOT: &str = "modules-root";
const STEP_LIMIT: Duration = Duration::from_secs(30);
const PRINTK: &str = "/proc/sys/kernel/printk";
/// How long real-time threads may run in each second. Time in which the host stops the machine counts as theirs: after a long stop the
/// kernel would keep the daemon from the processor for about as long, while the sender makes up for what it missed.
const REAL_TIME_SHARE: &str = "/proc/sys/kernel/sched_rt_runtime_us";

/// Does the first process's work (or that of systemd's service) and powers off, when this is the first process of a machine; returns at once
/// when it is not. To be called first in `main` by every program that is given to [`super::Machine::run`] as its own executable.
pub fn init_if_first_process() {
    if let Some(scratch) = std::env::var_os(SERVICE_VARIABLE) {
        let scratch = Path::new(&scratch);
        finish(scratch, serve(scratch));
        // Returns at once; systemd stops its services, and this process is one.
        let asked = process::run(Command::new("systemctl").args(["poweroff", "--no-block"]), STEP_LIMIT);
        std::process::exit(if asked.is_ok() { 0 } else { power_off() });
    }
    let Some(scratch) = std::env::var_os(BOOT_VARIABLE).filter(|_| std::process::id() == 1) else { return };
    let scratch = Path::new(&scratch);
    finish(scratch, boot(scratch));
    std::process::exit(power_off());
}

/// Writes down what the job ended with.
fn finish(scratch: &Path, outcome: Check<i32>) {
    let status = match outcome {
        Ok(status) => status.to_string(),
        Err(failure) => format!("the machine's first process failed: {}", failure.words()),
    };
    if let Err(error) = fs::write(scratch.join(STATUS_FILE), &status) {
        println!("{status}, and writing this down failed: {error}");
    }
    println!("{ENDED}");
    nix::unistd::sync();
    // Its farewell is no news.
    let _ = fs::write(PRINTK, "0\n");
}

/// Powering off does not return; where it fails, the kernel says so as its first process ends.
fn power_off() -> i32 {
    let Err(error) = reboot(RebootMode::RB_POWER_OFF);
    println!("cannot power off: {error}");
    1
}

fn attach(kind: &str, place: &Path, data: Option<&str>) -> Check {
    mount(Some(kind), place, Some(kind), MsFlags::empty(), data)
        .map_err(|error| Failure::new(format!("cannot mount {kind} on {}: {error}", place.display())))
}

/// The service's work: the scratch directory is to be written, all else of the computer's is not.
fn serve(scratch: &Path) -> Check<i32> {
    attach("hostfs", scratch, Some(text(scratch)?))?;
    fs::create_dir_all(TEMPORARY).at("create", Path::new(TEMPORARY))?;
    run(&Job::read(&scratch.join(JOB_FILE))?)
}

fn boot(scratch: &Path) -> Check<i32> {
    let none = None::<&str>;
    attach("hostfs", scratch, Some(text(scratch)?))?;
    attach("proc", Path::new("/proc"), none)?;
    attach("sysfs", Path::new("/sys"), none)?;
    attach("tmpfs", Path::new("/run"), none)?;
    if !Path::new("/dev/null").exists() {
        attach("devtmpfs", Path::new("/dev"), none)?;
    }
    let shared = Path::new("/dev/shm");
    fs::create_dir_all(shared).at("create", shared)?;
    attach("tmpfs", shared, none)?;
    fs::create_dir_all(TEMPORARY).at("create", Path::new(TEMPORARY))?;

    let modules = scratch.join(MODULE_ROOT);
    let job = Job::read(&scratch.join(JOB_FILE))?;
    let path = job.environment.iter().find(|(name, _)| name == "PATH").map(|(_, value)| value.as_os_str());
    let mut modprobe = Command::new("modprobe");
    modprobe.arg("-d").arg(&modules).args(["-a", "can", "can-raw", "can-dev", "vcan", "sch_tbf"]);
    process::run(modprobe.env("PATH", path.unwrap_or_default()), STEP_LIMIT)?;
    run(&job)
}

/// Runs the job, with the console for itself.
fn run(job: &Job) -> Check<i32> {
    fs::write(REAL_TIME_SHARE, "-1\n").at("write", Path::new(REAL_TIME_SHARE))?;
    // From here on the console belongs to the job: only what kills the kernel may still be printed.
    fs::write(PRINTK, "1\n").at("write", Path::new(PRINTK))?;
    println!("{STARTED}");
    let status = job.command().status().at("start", &job.program)?;
    // As shells do: a signal's number above 128.
    Ok(status
        .code()
        .unwrap_or_else(|| 128 + std::os::unix::process::ExitStatusExt::signal(&status).unwrap_or(0)))
}

impl Job {
    /// Writes the job as fields that end in a NUL: program, number of arguments, arguments, names and values.
    pub(super) fn write(&self, path: &Path) -> Check {
        let mut bytes = Vec::new();
        let mut field = |value: &OsStr| {
            bytes.extend_from_slice(value.as_bytes());
            bytes.push(0);
        };
        field(self.program.as_os_str());
        field(OsStr::new(&self.arguments.len().to_string()));
        self.arguments.iter().for_each(|argument| field(argument));
        for (name, value) in &self.environment {
            field(name);
            field(value);
        }
        fs::write(path, bytes).at("write", path)
    }

    fn read(path: &Path) -> Check<Self> {
        let bytes = fs::read(path).at("read", path)?;
        let broken = || Failure::new(format!("{} is not a job", path.display()));
        let mut fields = bytes
            .strip_suffix(&[0])
            .ok_or_else(broken)?
            .split(|byte| *byte == 0)
            .map(|field| OsString::from_vec(field.to_vec()));
        let program = fields.next().ok_or_else(broken)?.into();
        let count: usize = fields.next().and_then(|field| field.to_str()?.parse().ok()).ok_or_else(broken)?;
        let arguments: Vec<OsString> = fields.by_ref().take(count).collect();
        let mut environment = Vec::new();
        while let Some(name) = fields.next() {
            environment.push((name, fields.next().ok_or_else(broken)?));
        }
        if arguments.len() == count { Ok(Self { program, arguments, environment }) } else { Err(broken()) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_is_read_as_it_was_written() {
        let path = std::env::temp_dir().join(format!("wrenchd-tests-job-{}", std::process::id()));
        let job = Job::new("/a b/c").arg("").arg("x\ny").env("A", "").env("B", "1=2");
        job.write(&path).unwrap();
        let read = Job::read(&path).unwrap();
        assert_eq!(
            (read.program, read.arguments, read.environment),
            (job.program, job.arguments, job.environment)
        );
        fs::write(&path, b"/p\x002\x00only one\x00").unwrap();
        assert!(Job::read(&path).is_err());
        fs::remove_file(&path).unwrap();
    }
}
