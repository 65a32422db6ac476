//! Faults that are put in on purpose, through the daemon's own cycle: simulator, frames, fault injector, cycle.
#![allow(clippy::unwrap_used, clippy::panic)] // a test may

#[path = "../common/mod.rs"]
mod common;
mod evidence;
mod gauge;
mod grid;
mod isolation;
mod long_run;
mod soak;
mod start;

/// Seeds that the environment asks for as `FIRST..END`, else these.
fn seeds(variable: &str, usual: std::ops::Range<u64>) -> std::ops::Range<u64> {
    let Ok(asked) = std::env::var(variable) else { return usual };
    let ends = asked.split_once("..").and_then(|(first, end)| Some((first.parse().ok()?, end.parse().ok()?)));
    let (first, end) =
        ends.unwrap_or_else(|| panic!("{variable}={asked}: give FIRST..END, such as 200..240"));
    first..end
}
