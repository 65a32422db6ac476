//! The figures as a table and as JSON.

use std::fmt;

use serde::Serialize;

use super::{Stats, WINDOW_NS};
use crate::decoded::Decoder;
use crate::input::Input;
use crate::output::{Side, Table};

/// Everything that `wrenchctl stats` found.
#[derive(Serialize)]
pub(super) struct Report {
    format: u32,
    input: String,
    duration_s: f64,
    frames: u64,
    error_frames: u64,
    dropped: u64,
    malformed_lines: u64,
    #[serde(skip)]
    first_fault: Option<String>,
    #[serde(skip_serializing_if = "is_zero")]
    frames_of_further_ids: u64,
    interfaces: Vec<Interface>,
    messages: Vec<Message>,
    #[serde(skip)]
    rates: String,
}

#[derive(Serialize)]
struct Interface {
    name: String,
    frames: u64,
    error_frames: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    last_error: Option<String>,
    dropped: u64,
    times_down: u64,
    /// Share of the time with no and with most stuff bits, per cent
    load_percent: Option<[f64; 2]>,
    busiest_load_percent: Option<[f64; 2]>,
}

#[derive(Serialize)]
struct Message {
    interface: String,
    id: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    name: Option<String>,
    bytes: [usize; 2],
    frames: u64,
    rate_hz: Option<f64>,
    interval_mean_s: Option<f64>,
    interval_min_s: Option<f64>,
    interval_max_s: Option<f64>,
    interval_std_s: Option<f64>,
    interval_p99_s: Option<f64>,
    missing: Option<u64>,
    duplicates: u64,
    late: u64,
    restarts: u64,
    wrong_length: Option<u64>,
}

#[allow(clippy::trivially_copy_pass_by_ref)] // what serde asks for
fn is_zero(count: &u64) -> bool {
    *count == 0
}

impl Report {
    /// The figures so far.
    pub(super) fn new(name: &str, stats: &Stats, input: &Input, decoder: Option<&Decoder>) -> Self {
        let interfaces: Vec<Interface> =
            stats.buses.iter().map(|(&i, bus)| interface(bus, input.interface(i))).collect();
        let messages = stats.flows.iter().map(|(&(index, id), flow)| {
            let interface = input.interface(index);
            let intervals = &flow.intervals;
            let some = |value: f64| (intervals.count() > 0).then_some(value);
            Message {
                interface: interface.to_owned(),
                id: id.to_string(),
                name: decoder.and_then(|decoder| decoder.name(interface, id)).map(str::to_owned),
                bytes: [flow.len.0, flow.len.1],
                frames: flow.frames,
                rate_hz: flow.rate_hz(),
                interval_mean_s: some(intervals.mean_s()),
                interval_min_s: some(intervals.extremes_s().0),
                interval_max_s: some(intervals.extremes_s().1),
                interval_std_s: some(intervals.std_s()),
                interval_p99_s: some(intervals.p99_s()),
                missing: flow.missing,
                duplicates: flow.duplicates,
                late: flow.late,
                restarts: flow.restarts,
                wrong_length: flow.wrong_length,
            }
        });
        let nominal = stats.rates.nominal_bps / 1e6;
        Self {
            format: 1,
            input: name.to_owned(),
            duration_s: stats.first_ns.map_or(0.0, |first_ns| (stats.last_ns - first_ns) as f64 * 1e-9),
            frames: interfaces.iter().map(|i| i.frames).sum(),
            error_frames: interfaces.iter().map(|i| i.error_frames).sum(),
            dropped: interfaces.iter().map(|i| i.dropped).sum(),
            malformed_lines: stats.malformed,
            first_fault: stats.first_fault.map(|(line, fault)| format!("line {line}: {fault}")),
            frames_of_further_ids: stats.untold,
            messages: messages.collect(),
            interfaces,
            rates: if stats.fd {
                format!("{nominal}/{} Mbit/s", stats.rates.data_bps / 1e6)
            } else {
                format!("{nominal} Mbit/s")
            },
        }
    }
}

fn interface(bus: &super::Bus, name: &str) -> Interface {
    let span_s = bus.first_ns.map_or(0.0, |first_ns| (bus.last_ns - first_ns) as f64 * 1e-9);
    let window_s = WINDOW_NS as f64 * 1e-9;
    // From the beginning of the first frame to the end of the last.
    let (least, most) = (bus.busy_s.0 / (span_s + bus.first_s.0), bus.busy_s.1 / (span_s + bus.first_s.1));
    let busiest = if bus.window_s.1 > bus.busiest_s.1 { bus.window_s } else { bus.busiest_s };
    Interface {
        name: name.to_owned(),
        frames: bus.frames,
        error_frames: bus.errors,
        last_error: bus.last_error.clone(),
        dropped: bus.dropped,
        times_down: bus.downs,
        load_percent: (span_s > 0.0).then_some([100.0 * least, 100.0 * most]),
        busiest_load_percent: (span_s >= window_s)
            .then_some([100.0 * busiest.0 / window_s, 100.0 * busiest.1 / window_s]),
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "{}: {:.3} s, {} frames, {} error frames, {} dropped, {} malformed lines",
            self.input, self.duration_s, self.frames, self.error_frames, self.dropped, self.malformed_lines
        )?;
        if let Some(fault) = &self.first_fault {
            writeln!(f, "first malformed line: {fault}")?;
        }
        for bus in &self.interfaces {
            write!(f, "{}: {} frames", bus.name, bus.frames)?;
            if let Some([least, most]) = bus.load_percent {
                write!(f, ", load {least:.1} to {most:.1} % at {}", self.rates)?;
            }
            if let Some([least, most]) = bus.busiest_load_percent {
                write!(f, ", busiest 0.1 s {least:.1} to {most:.1} %")?;
            }
            if let Some(error) = &bus.last_error {
                write!(f, ", {} error frames, the last: {error}", bus.error_frames)?;
            }
            if bus.dropped > 0 {
                write!(f, ", {} dropped", bus.dropped)?;
            }
            if bus.times_down > 0 {
                write!(f, ", {} times down", bus.times_down)?;
            }
            writeln!(f)?;
        }
        if !self.messages.is_empty() {
            write!(f, "{}", self.table())?;
        }
        if self.frames_of_further_ids > 0 {
            writeln!(f, "and {} frames of further identifiers", self.frames_of_further_ids)?;
        }
        Ok(())
    }
}

impl Report {
    fn table(&self) -> Table {
        let named = self.messages.iter().any(|message| message.name.is_some());
        let text = if named { 3 } else { 2 };
        let sides: Vec<Side> =
            (0..text + 12).map(|column| if column < text { Side::Left } else { Side::Right }).collect();
        let mut table = Table::new(&sides, 0);
        let numbers = [
            "bytes",
            "frames",
            "rate Hz",
            "mean ms",
            "min ms",
            "max ms",
            "std ms",
            "p99 ms",
            "missing",
            "repeated",
            "late",
            "bad length",
        ];
        let head = ["bus", "id", "message"].into_iter().take(text).chain(numbers);
        table.row(head);
        let ms = |value: Option<f64>| value.map_or_else(|| "-".into(), |value| format!("{:.3}", 1e3 * value));
        let count = |value: Option<u64>| value.map_or_else(|| "-".into(), |value| value.to_string());
        for message in &self.messages {
            let [least, most] = message.bytes;
            let mut row = vec![message.interface.clone(), message.id.clone()];
            if named {
                row.push(message.name.clone().unwrap_or_default());
            }
            row.extend([
                if least == most { least.to_string() } else { format!("{least}..{most}") },
                message.frames.to_string(),
                message.rate_hz.map_or_else(|| "-".into(), |rate_hz| format!("{rate_hz:.2}")),
                ms(message.interval_mean_s),
                ms(message.interval_min_s),
                ms(message.interval_max_s),
                ms(message.interval_std_s),
                ms(message.interval_p99_s),
                count(message.missing),
                message.duplicates.to_string(),
                message.late.to_string(),
                count(message.wrong_length),
            ]);
            table.row(row);
        }
        table
    }
}
