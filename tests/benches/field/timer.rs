//! How late a thread wakes up that sleeps as the daemon's cycle does, beside cyclictest, in turns on the same computer.

use std::process::Command;
use std::time::Duration;

use wrenchd::realtime::{self, SystemClock};
use wrenchd::station::Clock;
use wrenchd_tests::{Check, Failure, packages, process};

use crate::table::{Compared, Line};

const PERIOD_NS: i64 = 1_000_000;
const WAKES: usize = 1_000;
/// Of each in turn, so short that both meet what else this computer does, and so many that a thousandth of a run's wake-ups is more
/// than a few.
const TURNS: usize = 15;
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
        let mut late: [Vec<f64>; 2] = Default::default();
        for _ in 0..TURNS {
            late[0].extend(std::thread::spawn(own).join().map_err(|_| Failure::new("the thread panicked"))?);
            late[1].extend(histogram(&mut Command::new(&cyclictest))?);
        }
        for (at, lateness) in late.iter_mut().enumerate() {
            lateness.sort_by(f64::total_cmp);
            SHARES
                .iter()
                .zip(&mut costs)
                .for_each(|((part, ..), costs)| costs[at].push(share(lateness, *part)));
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

/// Lateness of each wake-up, us.
fn own() -> Vec<f64> {
    for refused in [realtime::first_in_first_out().err(), realtime::lock_memory().err()].into_iter().flatten()
    {
        println!("{refused}");
    }
    let _awake = realtime::no_deep_sleep().inspect_err(|refused| println!("{refused}"));
    let clock = SystemClock;
    let mut due_ns = clock.now().monotonic_ns;
    (0..WAKES)
        .map(|_| {
            due_ns += PERIOD_NS;
            clock.sleep_until_ns(due_ns);
            (clock.now().monotonic_ns - due_ns) as f64 * 1e-3
        })
        .collect()
}

/// The same of cyclictest, from its histogram of whole microseconds.
fn histogram(command: &mut Command) -> Check<Vec<f64>> {
    let wakes = WAKES.to_string();
    command.args(["-q", "-m", "-t", "1", "-p", "50", "-i", "1000", "-l", &wakes, "-h", "100000"]);
    let said = process::run(command, Duration::from_secs(120))?.stdout();
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
