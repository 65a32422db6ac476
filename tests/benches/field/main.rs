//! The project against the field: each benchmark beside its peer in the same run, as ratios, kept in the README's table.
//!
//! `cargo bench -p wrenchd-tests --bench field [-- NAME...]` runs all of them, or these, and writes their lines of the table anew; others stay.
//! It installs the peers itself: Debian packages (as root or by sudo), and Python's into an environment under the build directory.

mod answers;
mod commands;
mod dynamics;
mod endurance;
mod native;
mod offline;
mod peers;
mod sending;
mod table;
mod timer;
mod wire;

use std::process::ExitCode;

use table::Line;
use wrenchd_tests::{Check, machine};

/// A group of benchmarks by its name on the command line.
struct Group {
    name: &'static str,
    run: fn() -> Check<Vec<Line>>,
}

const GROUPS: [Group; 9] = [
    Group { name: "tick", run: dynamics::tick },
    Group { name: "simulator", run: dynamics::simulator },
    Group { name: "linear", run: offline::linear },
    Group { name: "decoding", run: offline::decoding },
    Group { name: "timer", run: timer::jitter },
    Group { name: "wire", run: wire::outside },
    Group { name: "endurance", run: endurance::outside },
    Group { name: "commands", run: commands::all },
    Group { name: "scale", run: commands::scale },
];

fn main() -> ExitCode {
    machine::init_if_first_process();
    let outcome = match machine::inside() {
        Some(scratch) if std::env::var_os(endurance::INSIDE).is_some() => endurance::inside(&scratch),
        Some(scratch) => wire::inside(&scratch),
        None if std::env::var_os(dynamics::ALONE).is_some() => dynamics::alone(),
        None => run(&std::env::args().skip(1).filter(|word| !word.starts_with('-')).collect::<Vec<_>>()),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => {
            println!("{}", failure.words());
            ExitCode::FAILURE
        }
    }
}

fn run(names: &[String]) -> Check {
    let known = |name: &String| GROUPS.iter().any(|group| group.name == name);
    if let Some(name) = names.iter().find(|name| !known(name)) {
        let all = GROUPS.map(|group| group.name).join(", ");
        return Err(wrenchd_tests::Failure::new(format!("no benchmark {name}; there are {all}")));
    }
    for group in GROUPS.iter().filter(|group| names.is_empty() || names.iter().any(|name| name == group.name))
    {
        println!("== {}", group.name);
        let lines = (group.run)()?;
        lines.iter().for_each(|line| println!("{line}"));
        table::keep(&lines)?;
    }
    Ok(())
}
