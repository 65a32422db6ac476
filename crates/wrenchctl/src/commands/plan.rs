//! `wrenchctl plan`: the poses and weights to record next.

use std::io::Write;
use std::path::{Path, PathBuf};

use calibration::plan::{self, GaugeState, Goal, Plan, Weight};
use calibration::{Axes, Keep, Recording};
use rig::{ModelFile, Rig, Run};

use super::calibrate::{MOST_INSTANTS, files, load_runs, read};
use crate::output::{self, Side, Table};
use crate::{Error, Outcome};

/// What is known, what there is to hang, and what to reach.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Configuration of the robot
    #[arg(long, value_name = "CONFIG")]
    pub config: PathBuf,
    /// Model of the gauges as known so far
    #[arg(long, value_name = "MODEL")]
    pub model: Option<PathBuf>,
    /// Run directories that are already recorded: what they show need not be recorded again
    #[arg(value_name = "RUN")]
    pub runs: Vec<PathBuf>,
    /// Weights that can hang on the tip, as MASS@X,Y,Z;... in kg and m, tip frame [default: those of the runs, else 0.5 kg at three points]
    #[arg(long, value_name = "M@X,Y,Z;...", value_parser = weights, allow_hyphen_values = true)]
    pub weights: Option<Weights>,
    /// Number of poses
    #[arg(long, value_name = "N", default_value_t = 40, value_parser = clap::value_parser!(u32).range(1..=plan::LONGEST as i64))]
    pub count: u32,
    /// As many poses as the worst force deviation in the workspace needs to get below this, N
    #[arg(long, value_name = "N", value_parser = positive, conflicts_with = "count")]
    pub force_sigma_n: Option<f64>,
    /// Seed of the poses to choose from: the same seed gives the same plan
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub seed: u64,
    /// Also write the plan as JSON; - is standard output
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
}

/// The weights of one argument.
#[derive(Clone, Debug)]
pub struct Weights(Vec<Weight>);

fn weights(text: &str) -> Result<Weights, String> {
    let one = |entry: &str| {
        let (mass, place) = entry.split_once('@')?;
        let place: Option<Vec<f64>> = place.split(',').map(|part| part.trim().parse().ok()).collect();
        let weight = Weight { mass_kg: mass.trim().parse().ok()?, com_m: place?.try_into().ok()? };
        let possible = weight.mass_kg > 0.0 && weight.mass_kg.is_finite();
        (possible && weight.com_m.iter().all(|x| x.is_finite())).then_some(weight)
    };
    let entries = text.split(';').map(str::trim).filter(|entry| !entry.is_empty());
    let all = entries.map(|entry| {
        one(entry).ok_or_else(|| {
            format!("\"{entry}\" is no weight; give MASS@X,Y,Z in kg and m in the tip frame, such as 0.5@0,0,0.05;0.5@0.08,0,0.03")
        })
    });
    all.collect::<Result<_, _>>().map(Weights)
}

fn positive(text: &str) -> Result<f64, String> {
    let value = text.parse::<f64>().ok().filter(|value| *value > 0.0 && value.is_finite());
    value.ok_or_else(|| "give a positive number of newtons".to_owned())
}

/// Plans, and prints what to do.
pub fn run(args: Args) -> Result<Outcome, Error> {
    let rig = Rig::load_file(&args.config)?;
    let model = args.model.as_ref().map(|path| ModelFile::load(path, &rig)).transpose()?;
    let runs = if args.runs.is_empty() { Vec::new() } else { load_runs(&args.runs)? };
    let read_from: Vec<_> = files(&runs).into_iter().chain(rig.config.files()).chain(args.model).collect();
    output::refuse_to_overwrite([args.json.as_ref()], &read_from)?;
    let gauges = known(&rig, model.as_ref(), &runs)?;
    let weights = args.weights.map_or_else(|| usual_weights(&runs), |weights| weights.0);
    let goal = args.force_sigma_n.map_or(Goal::Count(args.count as usize), Goal::ForceSigma);
    let plan = plan::plan(&rig, &gauges, &weights, goal, args.seed)?;
    if let Some(path) = &args.json {
        output::write_json(path, &plan)?;
    }
    if args.json.as_deref() != Some(Path::new("-")) {
        let mut out = output::stdout();
        let assumed = model.is_none() && runs.is_empty();
        summary(&plan, assumed, &mut out)?;
        out.flush()?;
    }
    Ok(Outcome::Done)
}

/// What recordings or model say of the gauges. With both, the recordings say how well and the model what they sense.
fn known(rig: &Rig, model: Option<&ModelFile>, runs: &[Run]) -> Result<Vec<GaugeState>, Error> {
    let stored = model.map(plan::known).transpose()?;
    let Some(first) = runs.first() else { return Ok(stored.unwrap_or_else(|| plan::unknown(rig))) };
    let recorded = Rig::load(first.config.clone())?;
    if let Some(difference) = recorded.fingerprint().difference(rig.fingerprint()) {
        return Err(Error::usage(format!(
            "{} is a recording of another arm than {} describes: {difference}; give recordings of this arm",
            first.dir.display(),
            rig.config.file.display()
        )));
    }
    let recordings = read(runs, rig, Keep::Spread(MOST_INSTANTS / runs.len().max(1)))?;
    for odd in recordings.iter().filter_map(Recording::oddities) {
        output::note(format_args!("{odd}"));
    }
    // The date goes into a model that nobody stores.
    let found = calibration::calibrate(rig, &recordings, Axes::Full, Vec::new(), "")?;
    let gauges = plan::known(&found.model)?;
    Ok(match stored {
        Some(stored) => {
            gauges.into_iter().zip(&stored).map(|(gauge, as_stored)| gauge.sensing_as(as_stored)).collect()
        }
        None => gauges,
    })
}

/// Every weight that hung in the runs; where there are none, those that the manual advises.
fn usual_weights(runs: &[Run]) -> Vec<Weight> {
    let mut out: Vec<Weight> = Vec::new();
    for load in runs.iter().flat_map(|run| run.loads.intervals()) {
        let weight = Weight { mass_kg: load.mass_kg, com_m: load.com_m };
        if weight.mass_kg > 0.0 && !out.contains(&weight) {
            out.push(weight);
        }
    }
    if out.is_empty() {
        let points = [[0.0, 0.0, 0.05], [0.08, 0.0, 0.03], [0.0, 0.08, 0.03]];
        out.extend(points.map(|com_m| Weight { mass_kg: 0.5, com_m }));
    }
    out
}

fn summary(plan: &Plan, assumed: bool, out: &mut impl Write) -> Result<(), Error> {
    let sides: Vec<Side> = [Side::Right].into_iter().chain(plan.joints.iter().map(|_| Side::Right)).collect();
    let mut from = 0;
    for group in plan.poses.chunk_by(|a, b| a.load == b.load) {
        match group[0].load {
            Some(weight) => {
                let [x, y, z] = weight.com_m;
                writeln!(out, "with {} kg at {x}, {y}, {z} m:", weight.mass_kg)?;
            }
            None => writeln!(out, "with nothing on the tip:")?,
        }
        let mut table = Table::new(&sides, 2);
        table.row(
            ["rank".to_owned()].into_iter().chain(plan.joints.iter().map(|joint| format!("{joint}, rad"))),
        );
        for pose in group {
            let angles = pose.joints_rad.iter().map(|angle| format!("{angle:.3}"));
            table.row([pose.rank.to_string()].into_iter().chain(angles));
        }
        write!(out, "{table}")?;
        from += group.len();
    }
    writeln!(
        out,
        "{from} poses, each held for {} s; look at them for collisions first, only joint limits are kept",
        plan.hold_s
    )?;
    if assumed {
        writeln!(
            out,
            "the gauges are not known yet: usual noise and crosstalk are assumed, give --model or recordings for true figures"
        )?;
    }
    let mut table = Table::new(&[Side::Left, Side::Right, Side::Right, Side::Right, Side::Right], 2);
    table.row([
        "worst deviation in the workspace",
        "force, N",
        "torque, mNm",
        "calibration's part, N",
        "mNm",
    ]);
    let steps = [1, 2, 5, 10, 20, 50, 100, 200, 500].into_iter().filter(|k| *k < plan.progress.len());
    let after = steps.map(|k| (format!("after the best {k}"), &plan.progress[k - 1]));
    let ends = (format!("after all {from}"), &plan.after);
    let rows = [("before".to_owned(), &plan.before)].into_iter().chain(after).chain([ends]);
    for (name, accuracy) in rows.chain([("noise alone".to_owned(), &plan.noise_alone)]) {
        let part = (accuracy.calibration_force_sigma_n, 1e3 * accuracy.calibration_torque_sigma_nm);
        table.row([
            name,
            format!("{:.4}", accuracy.force_sigma_n),
            format!("{:.2}", 1e3 * accuracy.torque_sigma_nm),
            format!("{:.4}", part.0),
            format!("{:.2}", part.1),
        ]);
    }
    write!(out, "{table}")?;
    if !plan.not_helped.is_empty() {
        writeln!(out, "no such pose or weight shows:")?;
        for unseen in &plan.not_helped {
            writeln!(out, "  {}; {}", unseen.words, unseen.remedy)?;
        }
    }
    Ok(())
}
