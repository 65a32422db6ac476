//! How many frames a second one core takes from candump text to decoded signals, and to snapshots
//!
//! `cargo bench -p wrenchd-can`; the verdict is against 3 million frames a second.

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use wrenchd_can::candump::{Interfaces, LogEvent, LogReader};
use wrenchd_can::dbc::Dbc;
use wrenchd_can::decode::{Binding, DecodeTable};

const COPIES: usize = 2_000;
const RUNS: usize = 7;
const GOAL: f64 = 3e6;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/data");
    let text = std::fs::read(data.join("recorded.log"))?.repeat(COPIES);
    let dbc = Dbc::read(&data.join("arm.dbc"))?;
    let signals: Vec<_> = dbc.messages().iter().flat_map(|message| message.signals.clone()).collect();
    let bindings: Vec<_> = signals
        .iter()
        .enumerate()
        .map(|(slot, spec)| Binding { slot: slot as u16, spec, interface: 0, to_si: 1.0 })
        .collect();
    let table = DecodeTable::new(&bindings)?;
    let mut values = vec![0.0; signals.len()];
    let mut best = 0f64;
    for run in 0..RUNS {
        let input = Box::new(std::io::Cursor::new(text.clone()));
        let mut reader =
            LogReader::from_reader(input, Path::new("recorded.log"), Interfaces::fixed(&["can0"]))?;
        let begun = Instant::now();
        while let Some(event) = reader.next_event()? {
            if let LogEvent::Frame(stamped) = event {
                table.decode(&stamped, |value| values[usize::from(value.slot)] = value.si);
            }
        }
        let seconds = begun.elapsed().as_secs_f64();
        black_box(&values);
        let rate = reader.counts().frames as f64 / seconds;
        println!("run {run}: {:.2} M frames/s, {:.0} MB/s", rate / 1e6, text.len() as f64 / seconds / 1e6);
        best = best.max(rate);
    }
    let verdict = if best >= GOAL { "reached" } else { "missed" };
    println!(
        "text to signals: {:.2} M frames/s on one core, goal of {:.0} M {verdict}",
        best / 1e6,
        GOAL / 1e6
    );
    Ok(())
}
