//! Presets, and run directories: whole, readable by the product, the same for the same seed.
#![allow(clippy::unwrap_used)]

mod common;

use std::path::{Path, PathBuf};

use can::candump::{Interfaces, LogEvent, LogReader};
use can::frame::Stamped;
use common::{config_file, rig, snapshots};
use rig::{Rig, Run};
use serde_json::Value;
use wrenchd_sim::motion::MotionLimits;
use wrenchd_sim::output::{Notes, write_run};
use wrenchd_sim::scenario::CalibrationPlan;
use wrenchd_sim::{JointState, Options, Preset, Scenario, Simulator, Truth};

/// A small calibration: every kind of block, few poses.
fn small(rig: &Rig) -> Scenario {
    let plan =
        CalibrationPlan { bare_poses: 2, poses_per_weight: 2, pushed_poses: 2, ..CalibrationPlan::default() };
    plan.scenario(&MotionLimits::of(&rig.chain).unwrap(), 4)
}

fn write(dir: &Path, rig: &Rig, scenario: &Scenario, seed: u64) -> Result<(), wrenchd_sim::SimError> {
    let options = Options { seed, ..Options::default() };
    let notes = Notes { session: Some("monday".into()), repeat_of: None };
    write_run(dir, rig, &Truth::draw(rig, seed, 0.0), scenario, options, &notes, &mut |_| true)
}

fn frames(run: &Run) -> Vec<Stamped> {
    let mut reader = LogReader::open(&run.log, Interfaces::fixed(&run.config.bus.interfaces)).unwrap();
    let mut frames = Vec::new();
    while let Some(event) = reader.next_event().unwrap() {
        if let LogEvent::Frame(stamped) = event {
            frames.push(stamped);
        }
    }
    frames
}

fn entries(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn a_run_stands_by_itself_and_says_what_was_simulated() {
    for name in ["arm.toml", "arm_fd.toml"] {
        let (folder, rig) = (tempfile::tempdir().unwrap(), rig(name));
        let (dir, scenario) = (folder.path().join("run"), small(&rig));
        let mut shares = Vec::new();
        let notes = Notes { session: Some("a \"b\"".into()), repeat_of: Some("other".into()) };
        let truth = Truth::draw(&rig, 8, 0.0);
        write_run(&dir, &rig, &truth, &scenario, Options::default(), &notes, &mut |share| {
            shares.push(share);
            true
        })
        .unwrap();
        assert!(shares.is_sorted() && shares.last() == Some(&1.0));
        // Moved elsewhere it is still whole.
        let moved = folder.path().join("elsewhere");
        std::fs::rename(&dir, &moved).unwrap();
        let run = Run::load(&moved).unwrap();
        let again = Rig::load(run.config.clone()).unwrap();
        assert_eq!((run.session.as_deref(), run.repeat_of.as_deref()), (Some("a \"b\""), Some("other")));
        assert_eq!(again.fingerprint(), rig.fingerprint());
        assert_eq!(run.loads.intervals(), scenario.loads);
        assert!(run.excludes.is_empty());

        // The log's frames are the simulator's, to the microsecond.
        let logged = frames(&run);
        let mut simulator = Simulator::new(&rig, truth, &scenario, Options::default()).unwrap();
        let simulated: Vec<_> = simulator.by_ref().collect();
        assert_eq!(logged.len(), simulated.len());
        for (a, b) in logged.iter().zip(&simulated) {
            assert_eq!((a.frame, a.interface, a.stamp_ns), (b.frame, b.interface, b.stamp_ns / 1000 * 1000));
        }
        let first_ns = logged[0].stamp_ns;
        run.check_span((logged[logged.len() - 1].stamp_ns - first_ns) as f64 * 1e-9).unwrap();

        // Loads and reference of the run are the simulator's truth at every snapshot, noise of the reference apart.
        let reference = run.reference.as_ref().unwrap();
        let (mut mounted, mut loaded) = (0, 0);
        for snapshot in snapshots(&rig, logged.iter().copied()).0 {
            let t_s = (snapshot.instant_ns - first_ns) as f64 * 1e-9;
            let cycle_s = (t_s * 50.0).round() / 50.0;
            let mechanics = &mut simulator.mechanics();
            mechanics.update(cycle_s);
            let load = run.loads.at(t_s);
            assert_eq!(load, rig::run::Loads::new(scenario.loads.clone()).at(cycle_s));
            loaded += u32::from(load.mass_kg > 0.0);
            if let Some(wrench) = reference.at(t_s) {
                mounted += 1;
                let error = wrench.to_vector() - simulator.truth_at(cycle_s).to_vector();
                assert!(error.fixed_rows::<3>(0).amax() < 0.15 && error.fixed_rows::<3>(3).amax() < 0.02);
            }
        }
        assert!(mounted > 200 && loaded > 600, "{mounted} {loaded}");
    }
}

#[test]
fn labels_tell_the_truth_and_keep_what_they_said_of_other_runs() {
    let (folder, rig) = (tempfile::tempdir().unwrap(), rig("arm.toml"));
    let scenario = small(&rig);
    write(&folder.path().join("one"), &rig, &scenario, 1).unwrap();
    write(&folder.path().join("two"), &rig, &scenario, 2).unwrap();
    let text = std::fs::read_to_string(folder.path().join("labels.json")).unwrap();
    let labels: Value = serde_json::from_str(&text).unwrap();
    assert_eq!((&labels["seed"], &labels["effects"]), (&2.into(), &Value::Array(Vec::new())));
    assert_eq!(labels["gauges"], labels["cases"]["two"]["gauges"]);
    for (case, seed) in [("one", 1u64), ("two", 2)] {
        let gauges = labels["cases"][case]["gauges"].as_array().unwrap();
        for (label, gauge) in gauges.iter().zip(&Truth::draw(&rig, seed, 0.0).gauges) {
            let number = |key: &str| label[key].as_f64().unwrap();
            let frame = gauge.frame().unwrap();
            let told = ["r", "ax", "ay", "lx", "ly", "pitch", "bias"].map(number);
            let true_values = [
                frame.r_counts_per_nm,
                frame.a_x_rad,
                frame.a_y_rad,
                frame.l_x_m,
                frame.l_y_m,
                frame.pitch_m,
                gauge.bias_counts,
            ];
            for (told, true_value) in told.iter().zip(true_values) {
                assert!((told - true_value).abs() <= 1e-14 * true_value.abs() + 1e-15, "{told} {true_value}");
            }
        }
        assert_eq!(labels["cases"][case]["seed"], seed);
    }
}

#[test]
fn a_seed_gives_the_same_bytes() {
    let (folder, rig) = (tempfile::tempdir().unwrap(), rig("arm.toml"));
    let scenario = small(&rig);
    let path = |name: &str| folder.path().join(name);
    for (name, seed) in [("a", 7), ("b", 7), ("c", 8)] {
        write(&path(name), &rig, &scenario, seed).unwrap();
    }
    let bytes = |run: &str, file: &str| std::fs::read(path(run).join(file)).unwrap();
    for file in ["can.log.gz", "reference.csv", "run.toml", "arm.toml", "arm.urdf", "arm.dbc"] {
        assert_eq!(bytes("a", file), bytes("b", file), "{file}");
    }
    assert_eq!(entries(&path("a")).len(), 6);
    assert_ne!(bytes("a", "can.log.gz"), bytes("c", "can.log.gz"));
    assert_ne!(bytes("a", "reference.csv"), bytes("c", "reference.csv"));
}

#[test]
fn whole_or_nothing() {
    let (folder, rig) = (tempfile::tempdir().unwrap(), rig("arm.toml"));
    let scenario = small(&rig);
    let dir = folder.path().join("run");
    // Labels of somebody else are not overwritten, and nothing is begun.
    std::fs::write(folder.path().join("labels.json"), "[1]").unwrap();
    let message = write(&dir, &rig, &scenario, 1).unwrap_err().to_string();
    assert!(message.contains("labels.json") && message.contains("move it"), "{message}");
    assert_eq!(entries(folder.path()), ["labels.json"]);
    std::fs::remove_file(folder.path().join("labels.json")).unwrap();
    // A URDF that went away in the meantime: the half-written directory goes too.
    let mut gone = rig.clone();
    gone.config.robot.urdf = PathBuf::from("/nonexistent/arm.urdf");
    let message = write(&dir, &gone, &scenario, 1).unwrap_err().to_string();
    assert!(message.contains("/nonexistent/arm.urdf"), "{message}");
    assert!(entries(folder.path()).is_empty());
    // An existing run is never touched; an empty directory is as good as none.
    std::fs::create_dir(&dir).unwrap();
    write(&dir, &rig, &scenario, 1).unwrap();
    let message = write(&dir, &rig, &scenario, 1).unwrap_err().to_string();
    assert!(message.contains("exists already; remove it"), "{message}");
    assert_eq!(entries(folder.path()), ["labels.json", "run"]);
}

#[test]
fn a_configuration_from_elsewhere_finds_its_files_in_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let robot = folder.path().join("robot");
    std::fs::create_dir_all(robot.join("description")).unwrap();
    std::fs::copy(config_file("arm.urdf"), robot.join("description/arm.urdf")).unwrap();
    std::fs::copy(config_file("arm.dbc"), folder.path().join("bus.dbc")).unwrap();
    let text = common::edited(
        "arm.toml",
        &[("\"arm.urdf\"", "\"description/arm.urdf\""), ("\"arm.dbc\"", "\"../bus.dbc\"")],
    );
    std::fs::write(robot.join("run.toml"), text).unwrap();
    let rig = Rig::load_file(&robot.join("run.toml")).unwrap();
    let dir = folder.path().join("deep/er/out");
    write(&dir, &rig, &small(&rig), 1).unwrap();
    std::fs::remove_dir_all(&robot).unwrap();
    let run = Run::load(&dir).unwrap();
    assert_eq!(Rig::load(run.config).unwrap().urdf_sha256, rig.urdf_sha256);
}

#[test]
fn presets_keep_to_the_limits_of_the_arm_and_are_what_they_are_called() {
    let rig = rig("arm.toml");
    let limits = MotionLimits::of(&rig.chain).unwrap();
    for preset in Preset::ALL {
        assert_eq!(preset.name().parse::<Preset>().unwrap(), preset);
        let scenario = preset.scenario(&rig.chain, 3).unwrap();
        let mut state = JointState::at_rest(6);
        let mut fastest = 0.0f64;
        let mut still = 0;
        let steps = (scenario.duration_s() * 50.0) as usize;
        for step in 0..=steps {
            scenario.trajectory.at(step as f64 / 50.0, &mut state);
            for (joint, limit) in limits.joints.iter().enumerate() {
                assert!((limit.lower_rad..=limit.upper_rad).contains(&state.positions_rad[joint]));
                assert!(state.velocities_rad_s[joint].abs() <= limit.velocity_rad_s * 0.7501);
                assert!(state.accelerations_rad_s2[joint].abs() <= limit.acceleration_rad_s2 * 1.0001);
                fastest = fastest.max(state.velocities_rad_s[joint].abs());
            }
            still += u32::from(state.velocities_rad_s.iter().all(|v| v.abs() < 1e-3));
        }
        assert!(fastest > 1.5 && still > 500, "{} {fastest} {still}", preset.name());
        assert_eq!(scenario.reference.is_some(), matches!(preset, Preset::Calibration | Preset::Accuracy));
    }
    let calibration = Preset::Calibration.scenario(&rig.chain, 3).unwrap();
    assert_eq!(calibration.loads.len(), 3);
    assert!((900.0..2000.0).contains(&calibration.duration_s()), "{}", calibration.duration_s());
    let accuracy = Preset::Accuracy.scenario(&rig.chain, 3).unwrap();
    let mut largest = [0.0f64; 6];
    for step in 0..(accuracy.duration_s() * 100.0) as usize {
        let wrench = accuracy.push.at(step as f64 / 100.0).to_vector();
        largest = std::array::from_fn(|k| largest[k].max(wrench[k].abs()));
    }
    for axis in 0..3 {
        assert!(
            (4.9..=5.0).contains(&largest[axis]) && (0.48..=0.5).contains(&largest[3 + axis]),
            "{largest:?}"
        );
    }
    assert_ne!(
        Preset::Holds.scenario(&rig.chain, 3).unwrap(),
        Preset::Holds.scenario(&rig.chain, 4).unwrap()
    );
}
