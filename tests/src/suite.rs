//! The scenarios of one test target: prepared for outside, run by the target's own executable inside the machine, reported as cargo's tests are.

use crate::guest::Guest;
use crate::machine::{self, Job, Machine};
use crate::{Check, Failure, IoContext, package, programs, python};
use std::fs;
use std::path::Path;
use std::process::{Command, ExitCode};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// What must be there before a scenario can run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Need {
    /// [`programs::programs`]
    Programs,
    /// [`python::interpreter`]
    Python,
    /// [`programs::socket_tests`]
    SocketTests,
    /// [`package::package`]
    Package,
}

/// Where the scenarios of a target run.
pub struct Stage {
    /// Prepares the machine.
    pub prepare: fn() -> Check<Machine>,
    /// Run before each scenario: the one before may have failed and left something undone.
    pub before_each: fn() -> Check,
    /// What is kept of a scenario that failed, beside its own files.
    pub evidence: fn(&Path) -> Check,
    /// What is run in a boot of its own, before all scenarios.
    pub first: Option<&'static Scenario>,
}

impl Stage {
    /// A machine with vcan0 and vcan1.
    pub const CAN: Self = Self {
        prepare: Machine::prepare,
        before_each: machine::bring_up_links,
        evidence: |_| Ok(()),
        first: None,
    };
}

/// Tells the program inside that it is to run what comes before all scenarios.
const FIRST_VARIABLE: &str = "WRENCHD_TEST_FIRST";

/// For how many minutes the daemon is watched beside a bus that fails; some seconds where it is not set.
pub const SOAK_VARIABLE: &str = "WRENCHD_TEST_SOAK_MINUTES";

/// One scenario.
pub struct Scenario {
    /// Its name, as in a test's path.
    pub name: &'static str,
    /// What it needs beside the machine.
    pub needs: &'static [Need],
    /// How long it may take.
    pub limit: Duration,
    /// The scenario itself.
    pub run: fn(&Guest) -> Check,
}

/// What the command line asks for, in cargo test's terms.
#[derive(Debug, Default, PartialEq)]
struct Request {
    list: bool,
    exact: bool,
    filters: Vec<String>,
    skips: Vec<String>,
}

impl Request {
    fn parse(arguments: impl Iterator<Item = String>) -> Self {
        let mut request = Self::default();
        let mut arguments = arguments;
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--list" => request.list = true,
                "--exact" => request.exact = true,
                "--skip" => request.skips.extend(arguments.next()),
                // Options of the usual harness that take a value, and mean nothing here.
                "--test-threads" | "--format" | "--color" | "--logfile" | "-Z" => drop(arguments.next()),
                option if option.starts_with('-') => {}
                filter => request.filters.push(filter.to_owned()),
            }
        }
        request
    }

    fn wants(&self, name: &str) -> bool {
        let matches =
            |filter: &String| if self.exact { name == filter } else { name.contains(filter.as_str()) };
        (self.filters.is_empty() || self.filters.iter().any(matches)) && !self.skips.iter().any(matches)
    }
}

/// The `main` of a test target: outside it prepares the machine and runs itself inside; inside it runs the scenarios.
pub fn main(stage: &Stage, groups: &[&[Scenario]]) -> ExitCode {
    machine::init_if_first_process();
    let request = Request::parse(std::env::args().skip(1));
    let scenarios = || groups.iter().copied().flatten();
    let chosen: Vec<&Scenario> = scenarios().filter(|scenario| request.wants(scenario.name)).collect();
    let left_out = scenarios().count() - chosen.len();
    if request.list {
        chosen.iter().for_each(|scenario| println!("{}: test", scenario.name));
        return ExitCode::SUCCESS;
    }
    if let Some(scratch) = machine::inside() {
        return match stage.first.filter(|_| std::env::var_os(FIRST_VARIABLE).is_some()) {
            Some(first) => inside(stage, &[first], 0, &scratch),
            None => inside(stage, &chosen, left_out, &scratch),
        };
    }
    if chosen.is_empty() {
        summary(0, 0, left_out, Duration::ZERO);
        return ExitCode::SUCCESS;
    }
    match outside(stage, &chosen) {
        Ok(0) => ExitCode::SUCCESS,
        Ok(_) => ExitCode::FAILURE,
        Err(failure) => {
            println!("\nFAILED: the machine: {}", failure.words());
            ExitCode::FAILURE
        }
    }
}

fn outside(stage: &Stage, chosen: &[&Scenario]) -> Check<i32> {
    let all = || stage.first.iter().chain(chosen);
    let mut machine = (stage.prepare)()?;
    println!("machine: {}", machine.description());
    let job = job(|need| all().any(|scenario| scenario.needs.contains(&need)))?;
    let spare = Duration::from_secs(30);
    if let Some(first) = stage.first {
        let status = machine.run(job.clone().env(FIRST_VARIABLE, "1"), first.limit + spare)?;
        if status != 0 {
            return Ok(status);
        }
    }
    machine.run(job, chosen.iter().map(|scenario| scenario.limit).sum::<Duration>() + spare)
}

/// This executable, to be run inside with all that is needed there.
fn job(needed: impl Fn(Need) -> bool) -> Check<Job> {
    let mut job = Job::new(std::env::current_exe()?);
    for argument in std::env::args_os().skip(1) {
        job = job.arg(argument);
    }
    if let Some(minutes) = std::env::var_os(SOAK_VARIABLE) {
        job = job.env(SOAK_VARIABLE, minutes);
    }
    if needed(Need::Programs) {
        for (name, path) in programs::programs()?.environment() {
            job = job.env(name, path);
        }
    }
    if needed(Need::SocketTests) {
        let (name, path) = programs::socket_tests_environment(programs::socket_tests()?);
        job = job.env(name, path);
    }
    if needed(Need::Python) {
        let (name, path) = python::environment(python::interpreter()?);
        job = job.env(name, path);
    }
    if needed(Need::Package) {
        let (name, path) = package::environment(package::package()?);
        job = job.env(name, path);
    }
    Ok(job)
}

fn inside(stage: &Stage, chosen: &[&Scenario], left_out: usize, scratch: &Path) -> ExitCode {
    let started = Instant::now();
    println!("\nrunning {} tests", chosen.len());
    let mut failures = Vec::new();
    for scenario in chosen {
        let begun = Instant::now();
        let outcome = attempt(stage, scenario, scratch);
        let word = if outcome.is_ok() { "ok" } else { "FAILED" };
        println!("test {} ... {word} ({:.1} s)", scenario.name, begun.elapsed().as_secs_f64());
        if let Err(failure) = outcome {
            failures.push((scenario.name, failure));
        }
    }
    for (name, failure) in &failures {
        println!("\n---- {name} ----\n{}", failure.words().trim_end());
    }
    summary(chosen.len() - failures.len(), failures.len(), left_out, started.elapsed());
    if failures.is_empty() { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}

fn summary(passed: usize, failed: usize, left_out: usize, took: Duration) {
    let verdict = if failed == 0 { "ok" } else { "FAILED" };
    println!(
        "\n{passed} passed, {failed} failed\n\ntest result: {verdict}. {passed} passed; {failed} failed; 0 ignored; 0 measured; \
         {left_out} filtered out; finished in {:.2}s\n",
        took.as_secs_f64()
    );
}

/// Runs a scenario on a thread of its own, within its limit, in a directory of its own.
fn attempt(stage: &Stage, scenario: &Scenario, scratch: &Path) -> Check {
    (stage.before_each)()?;
    let place = scenario.name.replace("::", "-");
    let dir = std::env::temp_dir().join(&place);
    fs::create_dir_all(&dir).at("create", &dir)?;
    let (sender, receiver) = channel();
    let (run, guest) = (scenario.run, Guest::new(dir.clone()));
    let thread = std::thread::Builder::new().name(scenario.name.to_owned()).spawn(move || {
        let outcome = run(&guest);
        // Nobody listens once the limit has passed.
        let _ = sender.send(outcome);
    })?;
    let outcome = match receiver.recv_timeout(scenario.limit) {
        Ok(outcome) => {
            let _ = thread.join();
            outcome
        }
        Err(RecvTimeoutError::Timeout) => {
            Err(Failure::new(format!("did not end within {} s", scenario.limit.as_secs())))
        }
        Err(RecvTimeoutError::Disconnected) => Err(Failure::new("panicked; see above")),
    };
    if outcome.is_err() {
        if let Err(failure) = (stage.evidence)(&dir) {
            println!("what else there is to see was not kept: {}", failure.words());
        }
        let kept = scratch.join(&place);
        let _ = Command::new("cp").arg("-r").arg(&dir).arg(&kept).status();
        println!("files of {} are in {}", scenario.name, kept.display());
    }
    let _ = fs::remove_dir_all(&dir);
    outcome
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(line: &str) -> Request {
        Request::parse(line.split_ascii_whitespace().map(str::to_owned))
    }

    #[test]
    fn filters_choose_as_cargo_test_does() {
        assert!(request("").wants("bus::up"));
        assert!(request("up").wants("bus::up"));
        assert!(!request("down --nocapture").wants("bus::up"));
        assert!(request("--test-threads 1 --color always").wants("bus::up"));
        assert!(!request("--exact up").wants("bus::up"));
        assert!(request("--exact bus::up").wants("bus::up"));
        assert!(!request("--skip up").wants("bus::up"));
        assert!(request("--list").list);
    }
}
