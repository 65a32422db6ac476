//! What a person sees: a table refreshed in place on a terminal, a line a second elsewhere.

use std::fmt::Write as _;
use std::io::{self, IsTerminal, Write};

use can::assembly::Snapshot;
use nalgebra::Vector6;
use wrenchd::health::Totals;
use wrenchd::published::Published;

/// Gauges in one row.
const GAUGES_A_ROW: usize = 8;

/// The state at one moment.
pub(super) struct Shown<'a> {
    /// Since the beginning of the live part, s, and of how much.
    pub(super) elapsed_s: f64,
    pub(super) of_s: f64,
    /// The newest record.
    pub(super) record: &'a Published,
    /// The true wrench at its instant, N and Nm in E.
    pub(super) truth: Vector6<f64>,
    /// The wrench with every gauge taken at face value.
    pub(super) nominal: Option<Vector6<f64>>,
    /// The newest readings.
    pub(super) snapshot: Option<&'a Snapshot>,
    /// Records a second, lately.
    pub(super) rate_hz: f64,
    /// The daemon's counters.
    pub(super) totals: Totals,
}

/// Where the table goes.
pub(super) struct View {
    in_place: bool,
    lines: usize,
    gauge_names: Vec<String>,
}

impl View {
    /// On standard output, in place if that is a terminal.
    pub(super) fn new(gauge_names: Vec<String>) -> Self {
        Self { in_place: io::stdout().is_terminal(), lines: 0, gauge_names }
    }

    /// Seconds between two looks.
    pub(super) fn period_s(&self) -> f64 {
        if self.in_place { 0.1 } else { 1.0 }
    }

    /// Shows the state.
    pub(super) fn show(&mut self, shown: &Shown<'_>, out: &mut impl Write) -> io::Result<()> {
        if !self.in_place {
            writeln!(out, "{}", line(shown))?;
            return out.flush();
        }
        let text = self.table(shown);
        if self.lines > 0 {
            write!(out, "\x1b[{}A", self.lines)?;
        }
        self.lines = text.lines().count();
        for line in text.lines() {
            writeln!(out, "\x1b[2K{line}")?;
        }
        out.flush()
    }

    fn table(&self, shown: &Shown<'_>) -> String {
        let record = shown.record;
        let mut text = String::new();
        let _ = writeln!(text, "{:6.1} of {:.0} s", shown.elapsed_s, shown.of_s);
        let heads = ["fx N", "fy N", "fz N", "tx Nm", "ty Nm", "tz Nm"].map(|head| format!("{head:>9}"));
        let _ = writeln!(text, "{:<14}{}", "", heads.join(" "));
        let (estimate, sigma) = parts(record);
        let error =
            estimate.zip(sigma).map(|(estimate, sigma)| (estimate - shown.truth).component_div(&sigma));
        let rows = [
            ("estimated", estimate, [3, 4]),
            ("true", Some(shown.truth), [3, 4]),
            ("sigma", sigma, [3, 4]),
            ("error/sigma", error, [1, 1]),
            ("nominal axes", shown.nominal, [3, 4]),
        ];
        for (name, values, digits) in rows {
            let _ = writeln!(text, "{name:<14}{}", six(values.as_ref(), digits).join(" "));
        }
        let _ = writeln!(
            text,
            "status {}   age {:.1} ms   {:.0} wrenches/s   {} frames, {} lost",
            status(record),
            record.age_ns as f64 * 1e-6,
            shown.rate_hz,
            shown.totals.frames,
            shown.totals.lost_frames
        );
        if let Some(snapshot) = shown.snapshot {
            text.push_str(&self.gauges(snapshot));
        }
        text
    }

    /// Names and raw counts of the gauges.
    fn gauges(&self, snapshot: &Snapshot) -> String {
        let mut text = String::new();
        let rows = self.gauge_names.chunks(GAUGES_A_ROW).zip(snapshot.gauges.chunks(GAUGES_A_ROW));
        for (names, readings) in rows {
            let names: Vec<String> = names.iter().map(|name| format!("{name:>8.8}")).collect();
            let counts: Vec<String> = readings
                .iter()
                .map(|reading| match reading {
                    Ok(reading) => format!("{:>8.0}", reading.value),
                    Err(absence) => format!("{:>8.8}", absence.to_string()),
                })
                .collect();
            let _ = writeln!(text, "gauge  {}\ncounts {}", names.join(" "), counts.join(" "));
        }
        text
    }
}

/// Wrench and standard deviations of a record.
pub(super) fn parts(record: &Published) -> (Option<Vector6<f64>>, Option<Vector6<f64>>) {
    let solution = record.outcome.as_ref().ok();
    let sigma =
        solution.map(|solution| solution.covariance.diagonal().map(|variance| variance.max(0.0).sqrt()));
    (solution.map(|solution| solution.wrench.to_vector()), sigma)
}

fn status(record: &Published) -> String {
    match &record.outcome {
        Ok(_) => record.status.to_string(),
        Err(why) => format!("{}: {why}", record.status),
    }
}

fn six(values: Option<&Vector6<f64>>, digits: [usize; 2]) -> [String; 6] {
    std::array::from_fn(|k| {
        let digits = digits[k / 3];
        values.map_or_else(|| format!("{:>9}", "-"), |values| format!("{:>9.digits$}", values[k]))
    })
}

/// The state in one line, for logs and pipes.
fn line(shown: &Shown<'_>) -> String {
    let (estimate, sigma) = parts(shown.record);
    let error = estimate.zip(sigma).map(|(estimate, sigma)| (estimate - shown.truth).component_div(&sigma));
    let join =
        |values: Option<&Vector6<f64>>, digits| six(values, digits).map(|v| v.trim().to_owned()).join(" ");
    format!(
        "t={:.1}s estimated=[{}] true=[{}] error/sigma=[{}] nominal=[{}] status={} age={:.1}ms rate={:.0}/s lost={}",
        shown.elapsed_s,
        join(estimate.as_ref(), [3, 4]),
        join(Some(&shown.truth), [3, 4]),
        join(error.as_ref(), [1, 1]),
        join(shown.nominal.as_ref(), [3, 4]),
        status(shown.record),
        shown.record.age_ns as f64 * 1e-6,
        shown.rate_hz,
        shown.totals.lost_frames
    )
}
