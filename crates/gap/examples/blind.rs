//! The blind benchmark: sessions with a known effect from the simulator, which knows nothing of what fits them.
//!
//! `cargo run --release -p wrenchd-gap --example blind [-- ARMS [SIZE...]]` prints one line a case and then the table: how often the
//! right effect comes first (or among those said to be indistinguishable from the first), at the right place, with what false
//! causes beside it. Sizes are RMS changes in noise floors on the gauge that shows the effect most; size 0 is nothing at all.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

use calibration::{Axes, Recording, calibrate};
use rig::{ModelFile, Rig, Run};
use sim::effects::{Effects, Kind, Spec};
use sim::motion::MotionLimits;
use sim::output::{Notes, write_run};
use sim::{Options, Preset, Scenario, Trajectory, Truth};
use wrenchd_gap::diagnosis::{Diagnosis, Verdict};

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Length of each of a session's four runs, s.
const RUN_S: f64 = 20.0;
/// What is outside the catalogue of a diagnosis.
const OUTSIDE: [Kind; 1] = [Kind::RandomWalk];
/// Sessions without any effect, per arm.
const NULLS: u64 = 6;

#[derive(Default, Clone)]
struct Score {
    cases: u32,
    first: u32,
    in_set: u32,
    place: u32,
    false_causes: u32,
    confidence: f64,
    shrink: Vec<f64>,
}

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let arms: u64 = args.next().map_or(Ok(1), |text| text.parse())?;
    let mut sizes = args.map(|text| text.parse()).collect::<std::result::Result<Vec<f64>, _>>()?;
    if sizes.is_empty() {
        sizes = vec![0.3, 1.0, 3.0, 10.0];
    }
    let config = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/arm.toml"));
    let rig = Rig::load_file(config)?;
    let folder = tempfile::tempdir()?;
    let mut table: BTreeMap<(String, String), Score> = BTreeMap::new();
    let began = Instant::now();
    for arm in 1..=arms {
        let truth = Truth::draw(&rig, arm, 0.002);
        let model = calibrated(&rig, &truth, arm)?;
        for null in 0..NULLS {
            case(&rig, &truth, &model, &[], 1000 * arm + null, folder.path(), &mut table)?;
        }
        for kind in Kind::ALL {
            for size in &sizes {
                let seed = 7919 * arm + *kind as u64;
                let spec = [(*kind, *size)];
                case(&rig, &truth, &model, &spec, seed, folder.path(), &mut table)?;
            }
        }
        for (index, pair) in Kind::ALL.chunks_exact(2).enumerate().filter(|(k, _)| k % 2 == arm as usize % 2)
        {
            let spec = [(pair[0], 3.0), (pair[1], 3.0)];
            case(&rig, &truth, &model, &spec, 31 * arm + index as u64, folder.path(), &mut table)?;
        }
    }
    print(&table, began.elapsed().as_secs_f64());
    Ok(())
}

fn calibrated(rig: &Rig, truth: &Truth, seed: u64) -> Result<ModelFile> {
    let scenario = Preset::Calibration.scenario(&rig.chain, seed)?;
    let folder = tempfile::tempdir()?;
    let dir = folder.path().join("calibration");
    let options = Options { seed, ..Options::default() };
    write_run(&dir, rig, truth, &scenario, options, &Notes::default(), &mut |_| true)?;
    let run = Run::load(&dir)?;
    let recording = Recording::read(&run, rig, |_| {})?;
    Ok(calibrate(rig, &[recording], Axes::Full, Vec::new(), "2026-01-01")?.model)
}

/// One session in four runs: bare, with a weight, the same again, with the weight elsewhere.
fn session(rig: &Rig, seed: u64) -> Result<Scenario> {
    let limits = MotionLimits::of(&rig.chain)?;
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut uniform = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as f64 / (1u64 << 31) as f64 * 2.0 - 1.0
    };
    let middle = limits.middle();
    let mut pose = || -> Vec<f64> {
        let around = limits.joints.iter().zip(&middle);
        around.map(|(joint, m)| m + 0.35 * (joint.upper_rad - joint.lower_rad) * uniform()).collect()
    };
    let mut trajectory = Trajectory::from_pose(pose());
    let mut poses: Vec<Vec<f64>> = Vec::new();
    for run in 0..4 {
        let end_s = RUN_S * f64::from(run + 1);
        trajectory.hold(1.0);
        let mut next = 0;
        loop {
            let goal = if run == 2 && next < poses.len() { poses[next].clone() } else { pose() };
            let before_s = trajectory.duration_s();
            let mut tried = trajectory.clone();
            tried.move_to(goal.clone(), &limits, 0.5);
            tried.hold(0.4);
            if tried.duration_s() > end_s {
                trajectory.hold(end_s - before_s);
                break;
            }
            trajectory = tried;
            if run == 1 {
                poses.push(goal);
            }
            next += 1;
        }
    }
    let mut scenario = Scenario::of_motion(trajectory);
    for (from, to, com_m) in [(1.0, 3.0, [0.0, 0.0, 0.05]), (3.0, 4.0, [0.08, 0.0, 0.03])] {
        scenario.loads.push(rig::run::LoadInterval {
            from_s: from * RUN_S,
            to_s: to * RUN_S,
            mass_kg: 0.5,
            com_m,
        });
    }
    Ok(scenario)
}

/// The runs of a session as directories on one log.
fn runs(folder: &Path, all: &Path) -> Result<Vec<PathBuf>> {
    let text = std::fs::read_to_string(all.join("run.toml"))?;
    let config = text.lines().find_map(|line| line.strip_prefix("config = ")).unwrap_or_default();
    let config = config.trim().trim_matches('"');
    let loads: String = text.split("\n[[load]]").skip(1).map(|load| format!("\n[[load]]{load}\n")).collect();
    let mut dirs = Vec::new();
    for run in 0..4 {
        let dir = folder.join(format!("run_{}", run + 1));
        std::fs::create_dir_all(&dir)?;
        let (from, to) = (RUN_S * f64::from(run), RUN_S * f64::from(run + 1));
        let repeat = if run == 2 { "repeat_of = \"run_2\"\n" } else { "" };
        let mut text = format!(
            "format = 1\nconfig = \"../all/{config}\"\nlog = \"../all/can.log.gz\"\npurpose = \"evaluation\"\nsession = \"s\"\n{repeat}{loads}"
        );
        for (from, to) in
            [(0.0, from), (to, 4.0 * RUN_S + 0.5)].into_iter().filter(|(from, to)| to - from > 0.6)
        {
            text.push_str(&format!("\n[[exclude]]\nfrom = {from:?}\nto = {to:?}\n"));
        }
        std::fs::write(dir.join("run.toml"), text)?;
        dirs.push(dir);
    }
    Ok(dirs)
}

fn case(
    rig: &Rig,
    truth: &Truth,
    model: &ModelFile,
    put_in: &[(Kind, f64)],
    seed: u64,
    folder: &Path,
    table: &mut BTreeMap<(String, String), Score>,
) -> Result<()> {
    let scenario = session(rig, seed)?;
    let specs: Vec<Spec> = put_in.iter().map(|(kind, size)| Spec::sized(*kind, None, *size)).collect();
    let effects = match Effects::new(rig, truth, &scenario, &specs, seed) {
        Ok(effects) => effects,
        Err(error) => {
            println!("skipped: {error}");
            return Ok(());
        }
    };
    let truth = Truth { effects, ..truth.clone() };
    let own = folder.join(format!("case_{}", table.values().map(|score| score.cases).sum::<u32>()));
    let all = own.join("all");
    std::fs::create_dir_all(&own)?;
    let options = Options { seed: seed ^ 0xABCD, ..Options::default() };
    write_run(&all, rig, &truth, &scenario, options, &Notes::default(), &mut |_| true)?;
    let runs: Vec<Run> =
        runs(&own, &all)?.iter().map(|dir| Run::load(dir)).collect::<std::result::Result<_, _>>()?;
    let read = |run: &Run| Recording::read(run, rig, |_| {});
    let recordings: Vec<Recording> = runs.iter().map(read).collect::<std::result::Result<_, _>>()?;
    let pairs: Vec<(&Run, &Recording)> = runs.iter().zip(&recordings).collect();
    let began = Instant::now();
    let session = wrenchd_gap::runs::session(rig, model, &pairs)?;
    let diagnosis = wrenchd_gap::diagnose(&session, |_, _| {});
    std::fs::remove_dir_all(&own)?;
    score(rig, &truth, put_in, &diagnosis, began.elapsed().as_secs_f64(), table);
    Ok(())
}

fn score(
    rig: &Rig,
    truth: &Truth,
    put_in: &[(Kind, f64)],
    diagnosis: &Diagnosis,
    seconds: f64,
    table: &mut BTreeMap<(String, String), Score>,
) {
    let outside = put_in.iter().any(|(kind, _)| OUTSIDE.contains(kind));
    let key = match put_in {
        [] => ("nothing".to_owned(), "0".to_owned()),
        [(kind, size)] => (kind.id().to_owned(), size.to_string()),
        _ => ("pairs".to_owned(), "3".to_owned()),
    };
    let score = table.entry(key.clone()).or_default();
    score.cases += 1;
    let true_ids: Vec<&str> = put_in.iter().map(|(kind, _)| kind.id()).collect();
    let found: Vec<&str> = diagnosis.findings.iter().map(|finding| finding.effect.as_str()).collect();
    let named = |id: &str| {
        let stands_for = |finding: &wrenchd_gap::diagnosis::Finding| {
            finding.effect == id || finding.indistinguishable_from.iter().any(|like| like == id)
        };
        diagnosis.findings.iter().any(stands_for)
    };
    let first = diagnosis.findings.first();
    let is_first = first.is_some_and(|finding| true_ids.contains(&finding.effect.as_str()));
    let in_set = !true_ids.is_empty() && true_ids.iter().all(|id| named(id));
    score.first += u32::from(is_first);
    score.in_set += u32::from(in_set);
    score.place += u32::from(in_set && put_in.len() == 1 && at_place(rig, truth, diagnosis));
    let strangers = found.iter().filter(|id| {
        let like =
            diagnosis.findings.iter().filter(|f| f.effect == **id).flat_map(|f| &f.indistinguishable_from);
        !true_ids.contains(id) && !like.into_iter().any(|like| true_ids.contains(&like.as_str()))
    });
    score.false_causes += strangers.count() as u32;
    score.confidence += first.map_or(0.0, |finding| finding.confidence);
    score.shrink.extend(diagnosis.gap.shrink);
    let verdict = match diagnosis.verdict {
        Verdict::NoGap => "no gap",
        Verdict::Explained => "explained",
        Verdict::PartlyExplained => "partly",
        Verdict::Unexplained => "unexplained",
    };
    let mark = if in_set || (true_ids.is_empty() || outside) && found.is_empty() { "" } else { "  <--" };
    println!(
        "{:18} {:4} {verdict:11} {:6.2} -> {:5.2} ({:.2}) shrink {:5.2} in {seconds:4.1} s: {}{mark}",
        key.0,
        key.1,
        diagnosis.gap.before,
        diagnosis.gap.after,
        diagnosis.gap.floor,
        diagnosis.gap.shrink.unwrap_or(f64::NAN),
        diagnosis
            .findings
            .iter()
            .map(|f| format!("{}{:?} (or {:?})", f.effect, places(f), f.indistinguishable_from))
            .collect::<Vec<_>>()
            .join(", "),
    );
}

fn places(finding: &wrenchd_gap::diagnosis::Finding) -> &[String] {
    let lists = [&finding.links, &finding.joints, &finding.sensors];
    lists.into_iter().filter(|list| !list.is_empty()).min_by_key(|list| list.len()).map_or(&[], |list| list)
}

/// Whether the first finding sits where the effect was put in.
fn at_place(rig: &Rig, truth: &Truth, diagnosis: &Diagnosis) -> bool {
    let (Some(effect), Some(first)) = (truth.effects.list.first(), diagnosis.findings.first()) else {
        return false;
    };
    match effect.place {
        sim::effects::Place::Gauge(gauge) => first.sensors.contains(&rig.layout.gauges[gauge].name),
        sim::effects::Place::Joint(joint) => {
            first.joints.iter().any(|name| *name == rig.chain.coordinate_names()[joint])
        }
        sim::effects::Place::Link(link) => first.links.contains(&rig.chain.joints[link].child_link),
        sim::effects::Place::Arm => true,
    }
}

fn print(table: &BTreeMap<(String, String), Score>, seconds: f64) {
    println!(
        "\n| effect | size | cases | right first | right or said to be alike | right place too | false causes | shrink, median |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- | --- |");
    for ((effect, size), score) in table {
        let mut shrink = score.shrink.clone();
        shrink.sort_by(f64::total_cmp);
        let median = shrink.get(shrink.len() / 2).map_or_else(|| "-".to_owned(), |s| format!("{s:.2}"));
        println!(
            "| {effect} | {size} | {} | {} | {} | {} | {} | {median} |",
            score.cases, score.first, score.in_set, score.place, score.false_causes
        );
    }
    println!(
        "\n| all single effects at size | cases | right first | right or alike | right place too | false causes | mean confidence |"
    );
    println!("| --- | --- | --- | --- | --- | --- | --- |");
    let mut by_size: BTreeMap<String, Score> = BTreeMap::new();
    let outside: Vec<&str> = OUTSIDE.iter().map(|kind| kind.id()).collect();
    for ((effect, size), score) in table.iter().filter(|((effect, _), _)| !outside.contains(&effect.as_str()))
    {
        if effect == "nothing" || effect == "pairs" {
            continue;
        }
        let sum = by_size.entry(size.clone()).or_default();
        sum.cases += score.cases;
        sum.first += score.first;
        sum.in_set += score.in_set;
        sum.place += score.place;
        sum.false_causes += score.false_causes;
        sum.confidence += score.confidence;
    }
    for (size, s) in by_size {
        let share = |count: u32| 100.0 * f64::from(count) / f64::from(s.cases.max(1));
        println!(
            "| {size} | {} | {:.0} % | {:.0} % | {:.0} % | {} | {:.2} |",
            s.cases,
            share(s.first),
            share(s.in_set),
            share(s.place),
            s.false_causes,
            s.confidence / f64::from(s.cases.max(1))
        );
    }
    println!("\n{seconds:.0} s");
}
