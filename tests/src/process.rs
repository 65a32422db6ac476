//! Child programs: their output collected as it comes, and a deadline on every wait.

use crate::{Check, Failure, ensure};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// How often a wait looks again, where nothing wakes it.
const LOOK: Duration = Duration::from_millis(5);
/// After a program has ended: without a line for so long its output is held open by a child of its own. What it wrote waits in the
/// pipe; on a busy computer the thread that reads it may be held up for seconds.
const DRAIN: Duration = Duration::from_secs(10);

#[derive(Default)]
struct Output {
    /// Lines in order of arrival; `true` for standard output.
    lines: Vec<(bool, String)>,
    open: usize,
}

#[derive(Default)]
struct Shared {
    output: Mutex<Output>,
    changed: Condvar,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, Output> {
        self.output.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Waits until all outputs are closed, or held open and silent.
    fn drain(&self) {
        let mut seen = 0;
        loop {
            let mut lines = seen;
            let moved = self.wait(Instant::now() + DRAIN, |output| {
                lines = output.lines.len();
                output.open == 0 || lines > seen
            });
            if !moved || lines == seen {
                return;
            }
            seen = lines;
        }
    }

    /// Waits until `done` holds or the deadline has passed; says which.
    fn wait(&self, deadline: Instant, mut done: impl FnMut(&Output) -> bool) -> bool {
        let mut output = self.lock();
        loop {
            if done(&output) {
                return true;
            }
            let now = Instant::now();
            if now >= deadline {
                return false;
            }
            output =
                self.changed.wait_timeout(output, deadline - now).unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

/// A running program. Dropping it kills it.
pub struct Program {
    name: String,
    child: Child,
    shared: Arc<Shared>,
}

/// A program that has ended, with all it said.
pub struct Finished {
    name: String,
    status: ExitStatus,
    lines: Vec<(bool, String)>,
}

impl Program {
    /// Starts a command with no input and both outputs collected.
    pub fn start(command: &mut Command) -> Check<Self> {
        Self::start_with(command, Stdio::piped())
    }

    /// The same with its standard output in a file.
    pub fn start_into(command: &mut Command, out: File) -> Check<Self> {
        Self::start_with(command, out.into())
    }

    fn start_with(command: &mut Command, out: Stdio) -> Check<Self> {
        let name =
            Path::new(command.get_program()).file_name().unwrap_or_default().to_string_lossy().into_owned();
        let mut child =
            command.stdin(Stdio::null()).stdout(out).stderr(Stdio::piped()).spawn().map_err(|error| {
                Failure::new(format!("cannot start {:?}: {error}", command.get_program()))
            })?;
        let shared = Arc::new(Shared::default());
        if let Some(pipe) = child.stdout.take() {
            collect(pipe, true, &shared);
        }
        if let Some(pipe) = child.stderr.take() {
            collect(pipe, false, &shared);
        }
        Ok(Self { name, child, shared })
    }

    /// The process number.
    pub fn id(&self) -> u32 {
        self.child.id()
    }

    /// Waits for a line (of either output) that contains the text, and returns it. A program that ends before is a failure.
    pub fn wait_for(&mut self, text: &str, limit: Duration) -> Check<String> {
        self.wait_for_nth(text, 1, limit)
    }

    /// The same for the line that contains the text for the given time, counted from 1.
    pub fn wait_for_nth(&mut self, text: &str, number: usize, limit: Duration) -> Check<String> {
        let mut found = None;
        self.shared.wait(Instant::now() + limit, |output| {
            let mut all = output.lines.iter().filter(|(_, line)| line.contains(text));
            found = all.nth(number.saturating_sub(1)).map(|(_, line)| line.clone());
            found.is_some() || output.open == 0
        });
        match found {
            Some(line) => Ok(line),
            None => Err(Failure::new(format!(
                "{} did not say {text:?} within {} s; it said:\n{}",
                self.name,
                limit.as_secs_f64(),
                self.text()
            ))),
        }
    }

    /// All lines so far, of both outputs.
    pub fn text(&self) -> String {
        join(self.shared.lock().lines.iter())
    }

    /// True while the program runs.
    pub fn is_running(&mut self) -> Check<bool> {
        Ok(self.child.try_wait()?.is_none())
    }

    /// Sends a signal.
    pub fn signal(&self, signal: Signal) -> Check {
        let pid = i32::try_from(self.child.id())?;
        kill(Pid::from_raw(pid), signal)
            .map_err(|error| Failure::new(format!("cannot send {signal} to {}: {error}", self.name)))
    }

    /// Asks the program to end (SIGTERM) and waits for that.
    pub fn stop(self, limit: Duration) -> Check<Finished> {
        self.signal(Signal::SIGTERM)?;
        self.finish(limit)
    }

    /// Waits until the program has ended by itself; kills it and fails if it has not in time.
    pub fn finish(mut self, limit: Duration) -> Check<Finished> {
        let deadline = Instant::now() + limit;
        let status = loop {
            if let Some(status) = self.child.try_wait()? {
                break status;
            }
            if Instant::now() >= deadline {
                let _ = self.child.kill();
                let _ = self.child.wait();
                return Err(Failure::new(format!(
                    "{} did not end within {} s and was killed; it said:\n{}",
                    self.name,
                    limit.as_secs_f64(),
                    self.text()
                )));
            }
            std::thread::sleep(LOOK);
        };
        self.shared.drain();
        let lines = std::mem::take(&mut self.shared.lock().lines);
        Ok(Finished { name: self.name.clone(), status, lines })
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

impl Finished {
    /// The exit status; `None` when a signal ended the program.
    pub fn code(&self) -> Option<i32> {
        self.status.code()
    }

    /// Standard output.
    pub fn stdout(&self) -> String {
        join(self.lines.iter().filter(|(out, _)| *out))
    }

    /// Standard error.
    pub fn stderr(&self) -> String {
        join(self.lines.iter().filter(|(out, _)| !*out))
    }

    /// Both outputs in order of arrival.
    pub fn text(&self) -> String {
        join(self.lines.iter())
    }

    /// The same, or a failure with all the program said unless it exited with this status.
    pub fn expect_code(self, code: i32) -> Check<Self> {
        ensure!(
            self.code() == Some(code),
            "{} ended with {}, not with exit status {code}; it said:\n{}",
            self.name,
            self.status,
            self.text()
        );
        Ok(self)
    }
}

/// Runs a command to its end, which must come in time and with exit status 0.
pub fn run(command: &mut Command, limit: Duration) -> Check<Finished> {
    Program::start(command)?.finish(limit)?.expect_code(0)
}

fn join<'a>(lines: impl Iterator<Item = &'a (bool, String)>) -> String {
    let mut text = String::new();
    for (_, line) in lines {
        text.push_str(line);
        text.push('\n');
    }
    text
}

fn collect(pipe: impl Read + Send + 'static, out: bool, shared: &Arc<Shared>) {
    shared.lock().open += 1;
    let shared = Arc::clone(shared);
    std::thread::spawn(move || {
        each_line(pipe, |line| {
            shared.lock().lines.push((out, line));
            shared.changed.notify_all();
            true
        });
        shared.lock().open -= 1;
        shared.changed.notify_all();
    });
}

/// Calls `take` with each line, without its end, until the input ends or `take` wants no more.
pub(crate) fn each_line(input: impl Read, mut take: impl FnMut(String) -> bool) {
    let mut reader = BufReader::new(input);
    let mut line = Vec::new();
    while reader.read_until(b'\n', &mut line).is_ok_and(|length| length > 0) {
        let text = String::from_utf8_lossy(&line).trim_end_matches(['\n', '\r']).to_owned();
        if !take(text) {
            return;
        }
        line.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shell(script: &str) -> Command {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        command
    }

    #[test]
    fn outputs_are_told_apart_and_a_bad_status_is_said() {
        let finished = Program::start(&mut shell("echo out; echo err >&2; exit 3")).unwrap();
        let finished = finished.finish(Duration::from_secs(10)).unwrap();
        assert_eq!(finished.stdout(), "out\n");
        assert_eq!(finished.stderr(), "err\n");
        let failure = finished.expect_code(0).err().unwrap();
        assert!(failure.words().contains("exit status: 3") && failure.words().contains("err"), "{failure:?}");
    }

    #[test]
    fn a_program_that_hangs_is_killed_at_the_deadline() {
        let started = Instant::now();
        let failure = run(&mut shell("echo here; exec sleep 60"), Duration::from_millis(300)).err().unwrap();
        assert!(started.elapsed() < Duration::from_secs(20));
        assert!(failure.words().contains("did not end within 0.3 s"), "{failure:?}");
        assert!(failure.words().contains("here"), "{failure:?}");
    }

    #[test]
    fn a_line_is_waited_for_and_its_absence_is_a_failure() {
        let mut program =
            Program::start(&mut shell("sleep 0.1; echo ready; echo rest; exec sleep 60")).unwrap();
        assert_eq!(program.wait_for("read", Duration::from_secs(10)).unwrap(), "ready");
        let failure = program.wait_for("never", Duration::from_millis(100)).err().unwrap();
        assert!(failure.words().contains("rest"), "{failure:?}");
        assert_eq!(program.stop(Duration::from_secs(10)).unwrap().code(), None);
    }

    #[test]
    fn a_program_that_ends_early_ends_the_wait() {
        let started = Instant::now();
        let mut program = Program::start(&mut shell("echo bye")).unwrap();
        assert!(program.wait_for("ready", Duration::from_secs(60)).is_err());
        assert!(started.elapsed() < Duration::from_secs(30));
    }
}
