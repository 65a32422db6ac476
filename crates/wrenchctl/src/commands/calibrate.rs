//! `wrenchctl calibrate`: recordings to a model.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use calibration::{Axes, Calibration, Keep, Recording};
use rig::binding::sha256_of;
use rig::model_file::Input;
use rig::{Rig, Run};

use crate::output::{self, Side, Table};
use crate::pages;
use crate::progress::Progress;
use crate::{Error, Outcome};

/// Instants that are held in memory at most, of all recordings together: some hundred MB.
pub const MOST_INSTANTS: usize = 1 << 20;

/// What to calibrate from.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Run directories; those of one session share the gauges' zeros
    #[arg(value_name = "RUN", required = true)]
    pub runs: Vec<PathBuf>,
    /// Model file to write
    #[arg(long, value_name = "MODEL")]
    pub out: PathBuf,
    /// What to find of each gauge: its whole compliance, or a baseline to compare with
    #[arg(long, value_enum, default_value_t = AxesArg::Full)]
    pub axes: AxesArg,
    /// Also write the result as JSON; - is standard output
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Also write a report to look at: one HTML page
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
}

/// What to find of each gauge.
#[derive(clap::ValueEnum, Debug, Clone, Copy, PartialEq, Eq)]
pub enum AxesArg {
    /// No crosstalk: z = k t_z + b
    Nominal,
    /// The published method: scale and actual sensing frame, no pitch, unweighted
    Five,
    /// The whole compliance vector, weighted by the noise
    Full,
}

/// Calibrates, writes the model and prints the crosstalk table.
pub fn run(args: Args) -> Result<Outcome, Error> {
    let runs = load_runs(&args.runs)?;
    let written = [Some(&args.out), args.json.as_ref(), args.report.as_ref()];
    output::one_at_most_to_stdout(written)?;
    output::refuse_to_overwrite(written, &files(&runs))?;
    let rig = Rig::load(runs[0].config.clone())?;
    let recordings = read(&runs, &rig, Keep::Spread(MOST_INSTANTS / runs.len()))?;
    let axes = match args.axes {
        AxesArg::Nominal => Axes::Nominal,
        AxesArg::Five => Axes::Five,
        AxesArg::Full => Axes::Full,
    };
    let inputs = inputs(&runs)?;
    let date = humantime::format_rfc3339_seconds(SystemTime::now()).to_string();
    let result = calibration::calibrate(&rig, &recordings, axes, inputs, &date[..10])?;
    let page = args
        .report
        .as_ref()
        .map(|_| pages::calibration::page(&result, &rig, &runs, &recordings))
        .transpose()?;
    output::write_file(&args.out, result.model.to_toml().as_bytes())?;
    if let (Some(path), Some(page)) = (&args.report, page) {
        output::write_file(path, page.html().as_bytes())?;
    }
    if let Some(path) = &args.json {
        output::write_json(path, &result.report)?;
    }
    for warning in &result.warnings {
        output::note(format_args!("{warning}"));
    }
    if !written.contains(&Some(&PathBuf::from("-"))) {
        let mut out = output::stdout();
        summary(&result, &args.out, &mut out)?;
        out.flush()?;
    }
    Ok(Outcome::Done)
}

/// Every file of these runs.
pub fn files(runs: &[Run]) -> Vec<PathBuf> {
    runs.iter().flat_map(Run::files).collect()
}

/// The runs in these directories, all of one robot.
pub fn load_runs(dirs: &[PathBuf]) -> Result<Vec<Run>, Error> {
    let runs = dirs.iter().map(|dir| Run::load(dir)).collect::<Result<Vec<_>, _>>()?;
    for (at, run) in runs.iter().enumerate() {
        let real = |run: &Run| std::fs::canonicalize(&run.log).ok();
        if runs[..at].iter().any(|other| real(other).is_some() && real(other) == real(run)) {
            let dir = run.dir.display();
            return Err(Error::usage(format!(
                "{dir}: its log is given twice and would count twice; give it once"
            )));
        }
    }
    let Some((first, others)) = runs.split_first() else {
        return Err(Error::usage("no run directory given"));
    };
    let rig = Rig::load(first.config.clone())?;
    for run in others {
        let other = Rig::load(run.config.clone())?;
        if let Some(difference) = other.fingerprint().difference(rig.fingerprint()) {
            let text = format!(
                "{} is a recording of another arm than {}: {difference}; give recordings of one arm",
                run.dir.display(),
                first.dir.display()
            );
            return Err(Error::usage(text));
        }
    }
    Ok(runs)
}

/// Reads the logs of the runs, each with its own configuration, and of each what is to be kept; tells a watching person how far it is.
pub fn read(runs: &[Run], rig: &Rig, keep: Keep) -> Result<Vec<Recording>, Error> {
    let mut recordings = Vec::with_capacity(runs.len());
    for run in runs {
        let own = Rig::load(run.config.clone())?;
        let rig = if runs.len() == 1 { rig } else { &own };
        let size = std::fs::metadata(&run.log).map_or(0, |m| m.len());
        let progress = Progress::bytes(size, &run.log.display().to_string());
        recordings.push(Recording::read_some(run, rig, keep, |bytes| progress.at(bytes))?);
    }
    Ok(recordings)
}

fn inputs(runs: &[Run]) -> Result<Vec<Input>, Error> {
    let mut out = Vec::new();
    for run in runs {
        let mut files = vec![run.log.clone(), run.dir.join("run.toml"), run.config.file.clone()];
        files.push(run.config.robot.urdf.clone());
        files.push(run.config.bus.dbc.clone());
        for file in files {
            let sha256 = File::open(&file).and_then(sha256_of).map_err(|source| {
                Error::usage(format!("{}: cannot be read: {source}; make it readable", file.display()))
            })?;
            out.push(Input { file: file.display().to_string(), sha256 });
        }
    }
    Ok(out)
}

fn summary(result: &Calibration, path: &Path, out: &mut impl Write) -> Result<(), Error> {
    let mut table = Table::new(&[Side::Left].into_iter().chain([Side::Right; 9]).collect::<Vec<_>>(), 2);
    table.row(["sensor", "r", "a_x", "a_y", "l_x", "l_y", "pitch", "crosstalk", "noise", "residual"]);
    table.row(["", "counts/Nm", "deg", "deg", "mm", "mm", "mm", "%", "counts", "counts"]);
    let show = |value: Option<f64>, factor: f64, digits: usize| {
        value.map_or_else(|| "-".to_owned(), |v| format!("{:.digits$}", v * factor))
    };
    let degrees = 180.0 / std::f64::consts::PI;
    for s in &result.report.sensors {
        table.row([
            s.name.clone(),
            show(s.r, 1.0, 0),
            show(s.ax, degrees, 2),
            show(s.ay, degrees, 2),
            show(s.lx, 1e3, 2),
            show(s.ly, 1e3, 2),
            show(s.pitch, 1e3, 2),
            show(s.crosstalk_percent, 1.0, 1),
            format!("{:.0}", s.noise_floor_counts),
            format!("{:.0}", s.residual_rms_counts),
        ]);
    }
    writeln!(out, "actual sensing frames from {} still instants", result.report.samples)?;
    write!(out, "{table}")?;
    let unseen: Vec<_> = result.report.sensors.iter().flat_map(|s| &s.unobservable).collect();
    if !unseen.is_empty() {
        writeln!(out, "not determined by these recordings:")?;
        for u in unseen {
            writeln!(out, "  {}: never excited; {}", u.words, u.remedy)?;
        }
    }
    if !result.report.arm_unobservable.is_empty() {
        writeln!(
            out,
            "of the arm not told by these recordings (the wrench's uncertainty has what matters of it):"
        )?;
        for untold in &result.report.arm_unobservable {
            writeln!(out, "  {untold}")?;
        }
    }
    writeln!(out, "model written to {}", path.display())?;
    Ok(())
}
