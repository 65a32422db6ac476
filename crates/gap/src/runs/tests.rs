use calibration::{Axes, Recording, calibrate};
use rig::{ModelFile, Rig, Run};
use sim::effects::{Effects, Kind, Spec};
use sim::motion::MotionLimits;
use sim::output::{Notes, write_run};
use sim::scenario::CalibrationPlan;
use sim::{Options, Scenario, Trajectory, Truth};

use crate::diagnosis::{Diagnosis, Verdict};

fn rig() -> Rig {
    Rig::load_file(concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/arm.toml").as_ref()).unwrap()
}

/// What a simulated run says, read back as any other.
fn recorded(rig: &Rig, truth: &Truth, scenario: &Scenario, seed: u64, begin_s: i64) -> (Run, Recording) {
    let folder = tempfile::tempdir().unwrap();
    let dir = folder.path().join(format!("run_{begin_s}"));
    let start_ns = sim::START_NS + begin_s * 1_000_000_000;
    let options = Options { seed, start_ns, ..Options::default() };
    let notes = Notes { session: Some("one".to_owned()), repeat_of: None };
    write_run(&dir, rig, truth, scenario, options, &notes, &mut |_| true).unwrap();
    let run = Run::load(&dir).unwrap();
    let recording = Recording::read(&run, rig, |_| {}).unwrap();
    (run, recording)
}

fn model(rig: &Rig, truth: &Truth) -> ModelFile {
    let plan = CalibrationPlan {
        bare_poses: 25,
        poses_per_weight: 15,
        pushed_poses: 15,
        hold_s: 0.6,
        ..CalibrationPlan::default()
    };
    let scenario = plan.scenario(&MotionLimits::of(&rig.chain).unwrap(), 4);
    let (_, recording) = recorded(rig, truth, &scenario, 4, 0);
    calibrate(rig, &[recording], Axes::Full, Vec::new(), "2026-01-01").unwrap().model
}

fn motion(rig: &Rig, seed: f64, load_kg: f64) -> Scenario {
    let limits = MotionLimits::of(&rig.chain).unwrap();
    let mut trajectory = Trajectory::from_pose(limits.middle());
    trajectory.hold(0.5);
    for k in 0..6 {
        let middle = limits.middle();
        let pose = middle
            .iter()
            .enumerate()
            .map(|(j, q)| q + 0.6 * (seed + (1 + j) as f64 * f64::from(k)).sin())
            .collect();
        trajectory.move_to(pose, &limits, 0.2);
        trajectory.hold(0.3);
    }
    Scenario::of_motion(trajectory).with_load(load_kg, [0.02, 0.0, 0.05]).unwrap()
}

fn diagnosed(rig: &Rig, truth: &Truth, model: &ModelFile, spec: Option<Spec>) -> Diagnosis {
    let scenarios = [motion(rig, 0.3, 0.0), motion(rig, 1.1, 0.5), motion(rig, 2.3, 0.5)];
    let effects = Effects::new(rig, truth, &scenarios[1], spec.as_slice(), 1).unwrap();
    let truth = Truth { effects, ..truth.clone() };
    let mut begin_s = 0;
    let runs: Vec<(Run, Recording)> = scenarios
        .iter()
        .enumerate()
        .map(|(k, scenario)| {
            begin_s += 60;
            recorded(rig, &truth, scenario, 20 + k as u64, begin_s)
        })
        .collect();
    let pairs: Vec<(&Run, &Recording)> = runs.iter().map(|(run, recording)| (run, recording)).collect();
    let session = super::session(rig, model, &pairs).unwrap();
    crate::diagnose(&session, |_, _| {})
}

#[test]
fn a_gain_that_was_put_in_is_found_at_its_gauge_and_nothing_in_nothing() {
    let rig = rig();
    let truth = Truth::draw(&rig, 2, 0.0);
    let model = model(&rig, &truth);
    let none = diagnosed(&rig, &truth, &model, None);
    assert!(none.findings.is_empty(), "{:?}", none.findings);
    assert_eq!(none.verdict, Verdict::NoGap);

    let name = rig.layout.gauges[2].name.clone();
    let spec = Spec::sized(Kind::Gain, Some(name.clone()), 5.0);
    let found = diagnosed(&rig, &truth, &model, Some(spec));
    let first = &found.findings[0];
    assert_eq!((first.effect.as_str(), &first.sensors), ("gain", &vec![name]), "{:?}", found.findings);
    assert!(
        found.gap.shrink.unwrap() > 0.9 && found.verdict == Verdict::Explained,
        "{:?} {:?}",
        found.gap,
        found.findings
    );

    // The model that was told of it predicts what the gauge says.
    let (told, left) = crate::apply(&model, &rig, &found);
    assert!(left.is_empty(), "{left:?}");
    let relative = first.parameters["relative"].value;
    let ratio = told.sensors[2].working().norm() / model.sensors[2].working().norm();
    assert!((ratio - 1.0 - relative).abs() < 1e-9, "{ratio} {relative}");
    ModelFile::parse("told.toml".as_ref(), &told.to_toml()).unwrap();
}
