//! `wrenchctl diagnose`: where simulation and measurement differ, which effect causes it, how far the gap shrinks.

use std::io::Write;
use std::path::{Path, PathBuf};

use calibration::{Keep, Recording};
use gap::Diagnosis;
use gap::diagnosis::Verdict;
use rig::{ModelFile, Rig, Run};

use super::calibrate::{load_runs, read};
use crate::output::{self, Side, Table};
use crate::pages;
use crate::progress::Progress;
use crate::{Error, Outcome};

/// Instants that are looked at at most, of all recordings together: each takes some 20 kB, for all that is tried on it.
const MOST_INSTANTS: usize = 1 << 17;

/// What to diagnose.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Run directories of one arm, or a comparison directory (comparison.toml with its table beside it)
    #[arg(value_name = "RUN|COMPARISON", required = true)]
    pub inputs: Vec<PathBuf>,
    /// The model whose prediction is the simulation of the runs
    #[arg(long, value_name = "MODEL")]
    pub model: Option<PathBuf>,
    /// Also write the result as JSON; - is standard output
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Also write a report to look at: one HTML page
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Also write the model with the found effects in it, as far as the daemon can compensate them
    #[arg(long, value_name = "MODEL2")]
    pub apply: Option<PathBuf>,
}

/// Diagnoses, and prints the short form.
pub fn run(args: Args) -> Result<Outcome, Error> {
    let written = [args.json.as_ref(), args.report.as_ref(), args.apply.as_ref()];
    output::one_at_most_to_stdout(written)?;
    output::refuse_to_overwrite(written, &read_from(&args)?)?;
    let session = match args.inputs.iter().find(|dir| gap::comparison::is_comparison(dir)) {
        Some(_) => gap::comparison::load(only_comparison(&args)?)?,
        None => runs(&args)?,
    };
    let diagnosis = {
        let progress = Progress::steps(0, "diagnosing");
        gap::diagnose(&session, |done, of| {
            progress.of(of);
            progress.at(done);
        })
    };
    if let Some(path) = &args.json {
        output::write_json(path, &diagnosis)?;
    }
    if let Some(path) = &args.report {
        let names: Vec<String> = args.inputs.iter().map(|dir| dir.display().to_string()).collect();
        output::write_file(path, pages::diagnosis::page(&diagnosis, &names.join(", ")).html().as_bytes())?;
    }
    if let Some(path) = &args.apply {
        apply(&args, path, &diagnosis)?;
    }
    if !written.contains(&Some(&PathBuf::from("-"))) {
        let mut out = output::stdout();
        summary(&diagnosis, &mut out)?;
        out.flush()?;
    }
    Ok(Outcome::Done)
}

/// Every file of the inputs, and the model.
fn read_from(args: &Args) -> Result<Vec<PathBuf>, Error> {
    let mut out: Vec<PathBuf> = args.model.iter().cloned().collect();
    for dir in &args.inputs {
        match gap::comparison::is_comparison(dir) {
            true => out.extend(gap::comparison::files(dir)?),
            false => out.extend(Run::load(dir)?.files()),
        }
    }
    Ok(out)
}

/// Writes the model with what was found; says what it cannot hold.
fn apply(args: &Args, path: &Path, diagnosis: &Diagnosis) -> Result<(), Error> {
    let Some(from) = &args.model else {
        let text =
            format!("--apply {}: a comparison has no model to change; leave --apply out", path.display());
        return Err(Error::usage(text));
    };
    let rig = Rig::load(load_runs(&args.inputs)?[0].config.clone())?;
    let (model, left) = gap::apply(&ModelFile::load(from, &rig)?, &rig, diagnosis);
    output::write_file(path, model.to_toml().as_bytes())?;
    for effect in left {
        let finding = diagnosis.findings.iter().find(|finding| finding.effect == effect);
        let words = finding.map_or("", |finding| finding.words.as_str());
        output::note(format_args!("{effect} is not in {}: a model cannot hold it; {words}", path.display()));
    }
    Ok(())
}

/// The session of the runs, with the model's prediction as the simulation.
fn runs(args: &Args) -> Result<gap::Session, Error> {
    let runs = load_runs(&args.inputs)?;
    let Some(path) = &args.model else {
        let text = "runs are compared with what a model predicts, and none is given; add --model MODEL (`wrenchctl calibrate` writes one)";
        return Err(Error::usage(text));
    };
    let rig = Rig::load(runs[0].config.clone())?;
    let model = ModelFile::load(path, &rig)?;
    let recordings = read(&runs, &rig, Keep::Stretches(MOST_INSTANTS / runs.len()))?;
    let mut recordings: Vec<(&Run, Recording)> = runs.iter().zip(recordings).collect();
    // History goes on from run to run.
    recordings.sort_by_key(|(_, recording)| recording.start_ns);
    let pairs: Vec<(&Run, &Recording)> =
        recordings.iter().map(|(run, recording)| (*run, recording)).collect();
    Ok(gap::runs::session(&rig, &model, &pairs)?)
}

fn only_comparison(args: &Args) -> Result<&PathBuf, Error> {
    let [only] = args.inputs.as_slice() else {
        let names: Vec<String> = args.inputs.iter().map(|dir| dir.display().to_string()).collect();
        let text = format!(
            "{}: one comparison at a time, and no runs beside it; put several recordings into one table, told apart by `recording`",
            names.join(" and ")
        );
        return Err(Error::usage(text));
    };
    if let Some(model) = &args.model {
        let text = format!(
            "--model {}: a comparison brings its own simulation (the simulated columns); leave --model out",
            model.display()
        );
        return Err(Error::usage(text));
    }
    Ok(only)
}

fn summary(diagnosis: &Diagnosis, out: &mut impl Write) -> Result<(), Error> {
    let verdict = match diagnosis.verdict {
        Verdict::NoGap => "no gap: nothing but noise",
        Verdict::Explained => "explained",
        Verdict::PartlyExplained => "partly explained",
        Verdict::Unexplained => "unexplained: no effect of the catalogue is the cause",
    };
    writeln!(out, "{verdict}")?;
    let (gap, raw) = (&diagnosis.gap, &diagnosis.gap.raw);
    if let (Some(before), Some(after), Some(unit)) = (raw.before, raw.after, &raw.unit) {
        writeln!(out, "gap on what was left out: {before:.4} -> {after:.4} {unit} RMS")?;
    }
    write!(out, "over scales: {:.3} -> {:.3}, floor {:.3}", gap.before, gap.after, gap.floor)?;
    if let (Some(shrink), Some([low, high])) = (gap.shrink, gap.shrink_ci95) {
        write!(out, "; shrinks by {:.1} % ({:.1}..{:.1} %)", 100.0 * shrink, 100.0 * low, 100.0 * high)?;
    }
    writeln!(out, "\n{}", diagnosis.hold_out)?;
    for (rank, finding) in diagnosis.findings.iter().enumerate() {
        writeln!(out, "{}. {}: {}", rank + 1, finding.effect, finding.words)?;
        let mut table = Table::new(&[Side::Left, Side::Right, Side::Right, Side::Left], 5);
        for (name, parameter) in &finding.parameters {
            let sigma = parameter.sigma.map_or_else(String::new, |sigma| format!("+- {}", short(sigma)));
            table.row([name.clone(), short(parameter.value), sigma, parameter.unit.clone()]);
        }
        write!(out, "{table}")?;
    }
    let mut sensors = Table::new(&[Side::Left, Side::Right, Side::Right, Side::Left], 2);
    sensors.row(["channel", "before", "after", ""]);
    for sensor in &diagnosis.location.sensors {
        sensors.row([
            sensor.name.clone(),
            short(sensor.before_raw),
            short(sensor.after_raw),
            sensor.unit.clone(),
        ]);
    }
    write!(out, "{sensors}")?;
    if !diagnosis.not_testable.is_empty() {
        let names: Vec<&str> = diagnosis.not_testable.iter().map(|entry| entry.effect.as_str()).collect();
        writeln!(out, "not testable here: {}", names.join(", "))?;
    }
    for note in &diagnosis.notes {
        writeln!(out, "note: {note}")?;
    }
    writeln!(out, "next: {}", diagnosis.next_experiment)?;
    Ok(())
}

/// Four digits, whatever the size.
fn short(value: f64) -> String {
    if value == 0.0 || (1e-3..1e5).contains(&value.abs()) {
        let digits = if value == 0.0 { 0 } else { (3 - value.abs().log10().floor() as i32).clamp(0, 6) };
        return format!("{value:.*}", digits as usize);
    }
    format!("{value:.3e}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_four_digits() {
        let shown = [0.0, 0.012346, 12.346, 1234.6, 123456.0, -0.00012346].map(short);
        assert_eq!(shown, ["0", "0.01235", "12.35", "1235", "1.235e5", "-1.235e-4"]);
    }
}
