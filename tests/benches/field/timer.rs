//! How late a thread wakes up that sleeps as the daemon's cycle does, beside cyclictest, at one time on one processor.

use std::path::Path;
use std::process::Command;
use std::time::Duration;

use nix::sched::{CpuSet, sched_getaffinity, sched_setaffinity};
use nix::unistd::Pid;
use wrenchd::grid::Grid;
use wrenchd::realtime::{self, SystemClock};
use wrenchd::station::Clock;
use wrenchd_tests::process::Program;
use wrenchd_tests::{Check, Failure, packages};

use crate::table::{Compared, Line};

const RATE_HZ: f64 = 1_000.0;
/// Of each program in a run: a thousandth of them is more than a few.
const WAKES: usize = 30_000;
const RUNS: usize = 5;
/// What share of the wake-ups is less late, by its name and the goal of its ratio.
const SHARES: [(f64, &str, &str); 3] = [
    (0.5, "late wake-up at 1 kHz, p50", ""),
    (0.99, "late wake-up at 1 kHz, p99", "<= 1.5"),
    (0.999, "late wake-up at 1 kHz, p99.9", "<= 1.5"),
];

pub(crate) fn jitter() -> Check<Vec<Line>> {
    let cyclictest = packages::require_program("cyclictest", "rt-tests")?;
    let mut costs: [[Vec<f64>; 2]; SHARES.len()] = Default::default();
    for _ in 0..RUNS {
        for (at, mut late) in at_once(&cyclictest)?.into_iter().enumerate() {
            late.sort_by(f64::total_cmp);
            SHARES.iter().zip(&mut costs).for_each(|((part, ..), costs)| costs[at].push(share(&late, *part)));
        }
    }
    let compared = |what, goal| Compared { what, peer: "cyclictest", unit: "us", goal };
    let lines = SHARES.iter().zip(&costs);
    Ok(lines.map(|((_, what, goal), [own, peer])| compared(what, goal).cost(own, peer)).collect())
}

/// What so large a share of the values is below.
fn share(sorted: &[f64], share: f64) -> f64 {
    sorted[((sorted.len() - 1) as f64 * share) as usize]
}

/// Lateness of each wake-up, us, of this program's thread and of cyclictest's. Both sleep on one processor at one priority, half a
/// millisecond apart, so that whatever else holds this computer up holds up both.
fn at_once(cyclictest: &Path) -> Check<[Vec<f64>; 2]> {
    let processor = last_processor()?;
    let (wakes, on) = (WAKES.to_string(), processor.to_string());
    let mut command = Command::new(cyclictest);
    command.args(["-q", "-m", "-t", "1", "-p", "50", "-i", "1000", "-h", "100000", "--secaligned=500"]);
    let peer = Program::start(command.args(["-l", &wakes, "-a", &on]))?;
    let own = std::thread::spawn(move || own(processor));
    let own = own.join().map_err(|_| Failure::new("the thread panicked"))??;
    Ok([own, histogram(&peer.finish(Duration::from_secs(120))?.expect_code(0)?.stdout())?])
}

fn last_processor() -> Check<usize> {
    let all = sched_getaffinity(Pid::from_raw(0))?;
    let usable = (0..CpuSet::count()).rev().find(|at| all.is_set(*at).unwrap_or(false));
    usable.ok_or_else(|| Failure::new("no processor to run on"))
}

/// As cyclictest does, the daemon goes on after a stall with the next point of its grid: it is late once.
fn own(processor: usize) -> Check<Vec<f64>> {
    let mut one = CpuSet::new();
    one.set(processor)?;
    sched_setaffinity(Pid::from_raw(0), &one)?;
    for refused in [realtime::first_in_first_out().err(), realtime::lock_memory().err()].into_iter().flatten()
    {
        println!("{refused}");
    }
    let _awake = realtime::no_deep_sleep().inspect_err(|refused| println!("{refused}"));
    let clock = SystemClock;
    let full_second_ns = (clock.now().monotonic_ns / 1_000_000_000 + 1) * 1_000_000_000;
    let mut grid = Grid::new(full_second_ns, RATE_HZ);
    let wake = |_| {
        let due_ns = grid.due_ns();
        clock.sleep_until_ns(due_ns);
        let woken_ns = clock.now().monotonic_ns;
        grid.advance(woken_ns);
        (woken_ns - due_ns) as f64 * 1e-3
    };
    Ok((0..WAKES).map(wake).collect())
}

/// The same of cyclictest, from its histogram of whole microseconds.
fn histogram(said: &str) -> Check<Vec<f64>> {
    let mut late = Vec::with_capacity(WAKES);
    for line in said.lines().filter(|line| !line.starts_with('#')) {
        let mut words = line.split_ascii_whitespace().map(str::parse::<usize>);
        if let (Some(Ok(us)), Some(Ok(count))) = (words.next(), words.next()) {
            late.extend(std::iter::repeat_n(us as f64 + 0.5, count));
        }
    }
    if late.is_empty() {
        return Err(Failure::new(format!("cyclictest said {said}")));
    }
    Ok(late)
}
