//! `wrenchctl validate`: the wrench of recordings against their truth.

use std::io::Write;
use std::path::{Path, PathBuf};

use calibration::Keep;
use calibration::validate::{Row, Score, Validation};
use rig::{ModelFile, Rig};

use super::calibrate::{files, load_runs, read};
use crate::output::{self, Side, Table};
use crate::pages::validation::Collector;
use crate::{Error, Outcome};

/// What to score.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Run directories with a reference or known loads
    #[arg(value_name = "RUN", required = true)]
    pub runs: Vec<PathBuf>,
    /// Model file
    #[arg(long, value_name = "MODEL")]
    pub model: PathBuf,
    /// Take the motion from an offline smoother instead of the cycle's causal filter
    #[arg(long)]
    pub smooth: bool,
    /// Also write the scores as JSON; - is standard output
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Also write every published instant as CSV; - is standard output
    #[arg(long, value_name = "FILE")]
    pub csv: Option<PathBuf>,
    /// Also write a report to look at: one HTML page
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// Answer "no" (exit status 1) if the force RMS of still instants is above this, N
    #[arg(long, value_name = "N", value_parser = positive)]
    pub max_force_rms: Option<f64>,
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("give a positive number of newtons".to_owned()),
    }
}

/// Scores, and prints the table.
pub fn run(args: Args) -> Result<Outcome, Error> {
    let written = [args.csv.as_ref(), args.json.as_ref(), args.report.as_ref()];
    output::one_at_most_to_stdout(written)?;
    let runs = load_runs(&args.runs)?;
    let mut read_from = files(&runs);
    read_from.push(args.model.clone());
    output::refuse_to_overwrite(written, &read_from)?;
    let rig = Rig::load(runs[0].config.clone())?;
    let model = ModelFile::load(&args.model, &rig)?;
    let recordings = read(&runs, &rig, Keep::Everything)?;
    for odd in recordings.iter().filter_map(calibration::Recording::oddities) {
        output::note(format_args!("{odd}"));
    }
    let pairs: Vec<_> = runs.iter().zip(recordings).collect();
    let mut csv = args.csv.as_ref().map(|_| b"t,fx,fy,fz,tx,ty,tz,sfx,sfy,sfz,stx,sty,stz,status\n".to_vec());
    let mut collector = args.report.as_ref().map(|_| Collector::new(&rig, &pairs)).transpose()?;
    let result = calibration::validate::validate(&pairs, &rig, &model, args.smooth, |row| {
        if let Some(csv) = &mut csv {
            write_row(csv, row);
        }
        if let Some(collector) = &mut collector {
            collector.add(row);
        }
        Ok(())
    })?;
    if let (Some(path), Some(csv)) = (&args.csv, &csv) {
        output::write_file(path, csv)?;
    }
    if let Some(path) = &args.json {
        output::write_json(path, &result)?;
    }
    if let (Some(path), Some(collector)) = (&args.report, collector) {
        output::write_file(path, collector.page(&result, &model).html().as_bytes())?;
    }
    let to_stdout = |path: &Option<PathBuf>| path.as_deref() == Some(Path::new("-"));
    if ![&args.csv, &args.json, &args.report].into_iter().any(to_stdout) {
        let mut out = output::stdout();
        summary(&result, &mut out)?;
        out.flush()?;
    }
    let worst = result.still.force_rms_all_n.unwrap_or(f64::INFINITY);
    match args.max_force_rms {
        Some(limit) if worst > limit => {
            output::note(format_args!("force RMS of still instants {worst:.4} N is above {limit} N"));
            Ok(Outcome::No)
        }
        _ => Ok(Outcome::Done),
    }
}

/// One line of the CSV; where there is no wrench its columns say nan and the status says invalid.
fn write_row(csv: &mut Vec<u8>, row: &Row) {
    let nothing = ([f64::NAN; 6], [f64::NAN; 6]);
    let (wrench, sigma) = row.estimate.outcome.as_ref().map_or(nothing, |s| {
        let w = s.wrench.to_vector();
        (w.into(), std::array::from_fn(|k| s.covariance[(k, k)].sqrt()))
    });
    // Writing to memory cannot fail.
    let _ = write!(csv, "{:.6}", row.t_s);
    for value in wrench.iter().chain(&sigma) {
        let _ = write!(csv, ",{value:.6}");
    }
    let _ = writeln!(csv, ",{}", row.estimate.status.bits());
}

fn summary(result: &Validation, out: &mut impl Write) -> Result<(), Error> {
    let mut table = Table::new(&[Side::Left].into_iter().chain([Side::Right; 7]).collect::<Vec<_>>(), 2);
    table.row(["", "instants", "force RMS", "x", "y", "z", "torque RMS", "nees"]);
    table.row(["", "", "N", "N", "N", "N", "mNm", "force, torque"]);
    let mut add = |name: &str, score: &Score| {
        let number = |v: Option<f64>, factor: f64, digits: usize| {
            v.map_or_else(|| "-".to_owned(), |v| format!("{:.digits$}", v * factor))
        };
        let axis = |k: usize| number(score.force_rms_n.map(|f| f[k]), 1.0, 4);
        let nees = score
            .nees
            .map_or_else(String::new, |n| n.iter().map(|v| format!("{v:.2}")).collect::<Vec<_>>().join(" "));
        table.row([
            name.to_owned(),
            score.n.to_string(),
            number(score.force_rms_all_n, 1.0, 4),
            axis(0),
            axis(1),
            axis(2),
            number(score.torque_rms_all_nm, 1e3, 2),
            nees,
        ]);
    };
    add("this model, still", &result.still);
    add("  moving", &result.moving);
    add("  all", &result.all);
    add("five-parameter, still", &result.five_parameter.still);
    add("  moving", &result.five_parameter.moving);
    add("nominal axes, still", &result.nominal_axes.still);
    add("  moving", &result.nominal_axes.moving);
    write!(out, "{table}")?;
    let counts: Vec<String> = result.status.iter().map(|(name, n)| format!("{n} {name}")).collect();
    writeln!(out, "status: {}", counts.join(", "))?;
    Ok(())
}
