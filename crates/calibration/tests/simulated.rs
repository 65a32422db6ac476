//! Calibrations of simulated arms against the gauges that were put in.
#![allow(clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use wrenchd_calibration::{Axes, Calibration, Keep, Recording, calibrate};

use rig::run::Exclude;
use rig::{Config, Rig, Run};
use sim::motion::MotionLimits;
use sim::output::{Notes, write_run};
use sim::scenario::{CalibrationPlan, Scenario};
use sim::{Options, Simulator, Truth};

fn arm() -> Rig {
    let file: PathBuf = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/arm.toml");
    Rig::load(Config::load(&file).unwrap()).unwrap()
}

/// Fewer and shorter poses than a real calibration has.
fn short_plan() -> CalibrationPlan {
    CalibrationPlan {
        bare_poses: 24,
        poses_per_weight: 24,
        pushed_poses: 16,
        hold_s: 1.5,
        ..Default::default()
    }
}

fn scenario(rig: &Rig, seed: u64) -> Scenario {
    short_plan().scenario(&MotionLimits::of(&rig.chain).unwrap(), seed)
}

fn recording(rig: &Rig, truth: &Truth, scenario: &Scenario, seed: u64) -> Recording {
    let options = Options { seed, ..Options::default() };
    let simulator = Simulator::new(rig, truth.clone(), scenario, options).unwrap();
    let csv = sim::output::reference_csv(&simulator, scenario, seed).unwrap();
    let mut recording = Recording::from_frames(rig, "simulated", simulator).unwrap();
    recording.loads = ::rig::run::Loads::new(scenario.loads.clone());
    recording.reference = Some(::rig::run::Reference::parse(Path::new("reference.csv"), &csv).unwrap());
    recording
}

fn calibrated(rig: &Rig, recording: &Recording) -> Calibration {
    calibrate(rig, std::slice::from_ref(recording), Axes::Full, Vec::new(), "2026-01-01").unwrap()
}

/// (estimate - truth) / sigma of everything that is determined: r a_x a_y l_x l_y pitch and bias of every gauge.
fn normalised_errors(found: &Calibration, truth: &Truth) -> Vec<Vec<f64>> {
    let mut out = Vec::new();
    for (sensor, gauge) in found.model.sensors.iter().zip(&truth.gauges) {
        let frame = gauge.frame().unwrap();
        let expected =
            [frame.r_counts_per_nm, frame.a_x_rad, frame.a_y_rad, frame.l_x_m, frame.l_y_m, frame.pitch_m];
        let mut row: Vec<f64> = (0..6)
            .filter_map(|k| {
                let (value, sigma) = (sensor.frame.array()[k]?, sensor.frame_sigma.array()[k]?);
                let turn = std::f64::consts::TAU;
                let mut error = value - expected[k];
                if k == 1 || k == 2 {
                    error -= (error / turn).round() * turn;
                }
                Some(error / sigma)
            })
            .collect();
        row.push((sensor.bias_counts - gauge.bias_counts) / sensor.bias_sigma_counts);
        out.push(row);
    }
    out
}

#[test]
fn fifty_calibrations_are_as_uncertain_as_they_say() {
    let rig = arm();
    let results: Vec<(u64, Vec<Vec<f64>>)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..2u64)
            .map(|worker| {
                let rig = &rig;
                scope.spawn(move || {
                    (100..150u64)
                        .filter(|seed| seed % 2 == worker)
                        .map(|seed| {
                            let truth = Truth::draw(rig, seed, 0.003);
                            let limits = MotionLimits::of(&rig.chain).unwrap();
                            let scenario = CalibrationPlan::default().scenario(&limits, seed);
                            let recording = recording(rig, &truth, &scenario, seed);
                            (seed, normalised_errors(&calibrated(rig, &recording), &truth))
                        })
                        .collect::<Vec<_>>()
                })
            })
            .collect();
        workers.into_iter().flat_map(|w| w.join().unwrap()).collect()
    });
    assert_eq!(results.len(), 50);
    let rms = |values: &[f64]| (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt();
    let mut all = Vec::new();
    for (seed, gauges) in &results {
        for (gauge, row) in gauges.iter().enumerate() {
            assert_eq!(row.len(), 7, "seed {seed}: everything of gauge {gauge} is determined");
            all.extend(row.iter().map(|error| (*error, *seed, gauge)));
        }
    }
    let overall = rms(&all.iter().map(|(error, ..)| *error).collect::<Vec<_>>());
    let worst = all.iter().max_by(|a, b| a.0.abs().total_cmp(&b.0.abs())).unwrap();
    println!(
        "50 calibrations: RMS of (estimate - truth) / sigma = {overall:.3}, worst (sigmas, seed, gauge) {worst:?}"
    );
    assert!(worst.0.abs() <= 4.0, "{worst:?}");
    assert!((0.7..=1.4).contains(&overall), "{overall}");
    for k in 0..7 {
        let of_one: Vec<f64> =
            results.iter().flat_map(|(_, gauges)| gauges.iter().map(|row| row[k])).collect();
        let one = rms(&of_one);
        println!("parameter {k}: {one:.3}");
        assert!((0.7..=1.4).contains(&one), "parameter {k}: {one}");
    }
}

/// A recording that is too long for memory: fewer of its instants say the same, only less surely.
#[test]
fn a_thinned_recording_calibrates_as_surely_as_it_says() {
    let rig = arm();
    let truth = Truth::draw(&rig, 9, 0.003);
    let folder = tempfile::tempdir().unwrap();
    let (dir, options) = (folder.path().join("run"), Options { seed: 9, ..Options::default() });
    write_run(&dir, &rig, &truth, &scenario(&rig, 9), options, &Notes::default(), &mut |_| true).unwrap();
    let run = Run::load(&dir).unwrap();
    let whole = Recording::read(&run, &rig, |_| {}).unwrap();
    let most = whole.len() / 3;
    // Its loads reach to the end of the log, which may not be among what is kept.
    let thinned = Recording::read_some(&run, &rig, Keep::Spread(most), |_| {}).unwrap();
    assert!((most / 2..=most).contains(&thinned.len()), "{} of {}", thinned.len(), whole.len());
    assert_eq!(thinned.end_ns, whole.end_ns);
    let minutes = Recording::read_some(&run, &rig, Keep::Stretches(most), |_| {}).unwrap();
    assert!(minutes.len() <= most && minutes.end_ns == whole.end_ns);
    let found = calibrated(&rig, &thinned);
    let errors = normalised_errors(&found, &truth).concat();
    assert!(errors.iter().all(|error| error.abs() < 4.5), "{errors:?}");
    assert!(found.warnings[0].contains("too long to be held in memory"), "{:?}", found.warnings);
    // One reading is as noisy as it was.
    for (few, all) in found.model.sensors.iter().zip(&calibrated(&rig, &whole).model.sensors) {
        let ratio = few.noise_floor_counts / all.noise_floor_counts;
        assert!((0.9..1.1).contains(&ratio), "{}: {ratio}", few.name);
    }
}

/// An arm that holds poses with weights and moves between them; nothing pushes it.
fn without_pushes(rig: &Rig, truth: &Truth, seed: u64) -> Recording {
    let mut recording = recording(rig, truth, &scenario(rig, seed), seed);
    let pushes = recording.reference.as_ref().unwrap().rows();
    let (from_s, to_s) = (pushes[0].t_s - 1.0, pushes[pushes.len() - 1].t_s + 1.0);
    recording.excludes = vec![Exclude { from_s, to_s, why: "pushes".into() }];
    recording
}

/// Leaves out what is not still.
fn without_moves(recording: &mut Recording) {
    let still = wrenchd_calibration::still::still_instants(&recording.at_ns, &recording.positions_rad);
    let mut from = None;
    for (k, still) in still.iter().enumerate() {
        match (still, from) {
            (false, None) => from = Some(k),
            (true, Some(begin)) => {
                let (from_s, to_s) = (recording.time_s(begin), recording.time_s(k - 1));
                recording.excludes.push(Exclude { from_s, to_s, why: "moves".into() });
                from = None;
            }
            _ => {}
        }
    }
}

#[test]
fn moves_determine_the_vertical_first_joint() {
    let rig = arm();
    let mut off_sigmas = Vec::new();
    for seed in 7..11 {
        let truth = Truth::draw(&rig, seed, 0.003);
        let found = calibrated(&rig, &without_pushes(&rig, &truth, seed));
        let first = &found.model.sensors[0];
        assert!(first.unobservable.is_empty(), "{:?}", first.unobservable);
        let real = truth.gauges[0].frame().unwrap().r_counts_per_nm;
        let (scale, sigma) = (first.frame.array()[0].unwrap(), first.frame_sigma.array()[0].unwrap());
        println!("seed {seed}: {scale:.0} of {real:.0} counts/Nm, sigma {sigma:.0}");
        assert!(sigma < 0.1 * real, "{sigma} of {real}");
        off_sigmas.extend(normalised_errors(&found, &truth).swap_remove(0));
    }
    // Links are as the URDF has them here: what is kept open for others is more than what is wrong.
    let worst = off_sigmas.iter().fold(0.0, |worst: f64, off| worst.max(off.abs()));
    assert!(off_sigmas.len() == 28 && worst < 3.0, "{off_sigmas:?}");
}

#[test]
fn gauges_that_are_late_are_told() {
    let rig = arm();
    let truth = Truth::draw(&rig, 7, 0.0);
    let mut recording = without_pushes(&rig, &truth, 7);
    let late = |recording: &Recording| calibrated(&rig, recording).report.gauges_late_s.unwrap();
    let (in_time, late_by_one) = (late(&recording), {
        // Each reading comes one round later than it was.
        recording.counts.iter_mut().for_each(|counts| counts.rotate_right(1));
        late(&recording)
    });
    println!("{in_time:?}, one round late {late_by_one:?}");
    assert!(in_time.value.abs() < 4.0 * in_time.sigma && in_time.sigma < 1e-3, "{in_time:?}");
    let round_s = (recording.at_ns[1000] - recording.at_ns[0]) as f64 * 1e-12;
    assert!((late_by_one.value - round_s).abs() < 4.0 * late_by_one.sigma, "{late_by_one:?}, {round_s}");
    let said = calibrated(&rig, &recording).warnings;
    assert!(said.iter().any(|line| line.contains("delay_s")), "{said:?}");
}

#[test]
fn weights_in_held_poses_leave_the_vertical_first_joint_undetermined() {
    let rig = arm();
    let truth = Truth::draw(&rig, 7, 0.0);
    let mut recording = without_pushes(&rig, &truth, 7);
    without_moves(&mut recording);
    let found = calibrated(&rig, &recording);
    let first = &found.report.sensors[0];
    assert_eq!((first.r, first.ax, first.lx, first.pitch, first.sigma.r), (None, None, None, None, None));
    // Force along x and y and torque about z are what weights never load a vertical joint with.
    let mut unseen: Vec<usize> = Vec::new();
    for u in &first.unobservable {
        unseen.extend((0..6).filter(|k| u.direction[*k].abs() > 0.99));
        for remedy in ["pull sideways", "tilt the base", "move"] {
            assert!(u.remedy.contains(remedy), "{}", u.remedy);
        }
    }
    unseen.sort_unstable();
    assert_eq!(unseen, [0, 1, 5]);
    for k in 0..6 {
        assert_eq!(first.compliance[k].is_none(), unseen.contains(&k), "component {k}");
    }
    let model = found.model.to_toml();
    let back = ::rig::ModelFile::parse(Path::new("model.toml"), &model).unwrap();
    assert_eq!(back, found.model, "what is absent stays absent");
    // Joints 4 to 6 turn every way: nothing of them is left open.
    assert!(found.report.sensors[3..6].iter().all(|s| s.unobservable.is_empty() && s.r.is_some()));
}

#[test]
fn outliers_and_absent_readings_do_not_spoil_a_gauge() {
    let rig = arm();
    let truth = Truth::draw(&rig, 3, 0.0);
    let mut recording = recording(&rig, &truth, &scenario(&rig, 3), 3);
    for (k, counts) in recording.counts[2].iter_mut().enumerate() {
        match k % 50 {
            7 => *counts = counts.map(|c| c + 40_000.0),
            13..=15 => *counts = None,
            _ => {}
        }
    }
    let found = calibrated(&rig, &recording);
    for row in normalised_errors(&found, &truth) {
        assert!(row.iter().all(|e| e.abs() < 5.0), "{row:?}");
    }
    assert!(
        found.warnings.iter().any(|w| w.contains("s3") && w.contains("too far off")),
        "{:?}",
        found.warnings
    );
}

#[test]
fn a_dead_gauge_and_an_arm_that_never_rests_are_refused_in_words() {
    let rig = arm();
    let truth = Truth::draw(&rig, 1, 0.0);
    let mut recording = recording(&rig, &truth, &scenario(&rig, 1), 1);
    let fails = |recording: &Recording| {
        calibrate(&rig, std::slice::from_ref(recording), Axes::Full, Vec::new(), "2026-01-01")
            .unwrap_err()
            .to_string()
    };
    let mut dead = recording.clone();
    dead.counts[4].iter_mut().for_each(|c| *c = Some(1234.0));
    assert!(fails(&dead).contains("\"s5\": does not change at all"), "{}", fails(&dead));
    let mut silent = recording.clone();
    silent.counts[0].iter_mut().for_each(|c| *c = None);
    assert!(fails(&silent).contains("\"s1\": has 0 readings"), "{}", fails(&silent));
    for (k, q) in recording.positions_rad[0].iter_mut().enumerate() {
        *q += 0.001 * k as f64;
    }
    assert!(fails(&recording).contains("never holds still"), "{}", fails(&recording));
}

#[test]
fn sessions_have_zeros_of_their_own() {
    let rig = arm();
    let truth = Truth::draw(&rig, 5, 0.0);
    let mut shifted = truth.clone();
    shifted.gauges.iter_mut().for_each(|g| g.bias_counts += 30_000.0);
    let mut first = recording(&rig, &truth, &scenario(&rig, 5), 5);
    let mut second = recording(&rig, &shifted, &scenario(&rig, 6), 6);
    (first.session, second.session) = ("monday".into(), "tuesday".into());
    let found = calibrate(&rig, &[first, second], Axes::Full, Vec::new(), "2026-01-01").unwrap();
    for row in normalised_errors(&found, &shifted) {
        assert!(row.iter().all(|e| e.abs() < 4.5), "{row:?}");
    }
    assert!(found.warnings.iter().any(|w| w.contains("tuesday")), "{:?}", found.warnings);
}

#[test]
fn the_baselines_as_models_know_only_what_they_know() {
    let rig = arm();
    let truth = Truth::draw(&rig, 9, 0.0);
    let recording = recording(&rig, &truth, &scenario(&rig, 9), 9);
    let with =
        |axes| calibrate(&rig, std::slice::from_ref(&recording), axes, Vec::new(), "2026-01-01").unwrap();
    let (nominal, five, full) = (with(Axes::Nominal), with(Axes::Five), with(Axes::Full));
    for k in 0..8 {
        let c = nominal.report.sensors[k].compliance;
        assert!(c[..5].iter().all(|c| *c == Some(0.0)) && c[5] != Some(0.0));
        assert_eq!(five.report.sensors[k].pitch.map(|p| p.abs() < 1e-12), Some(true));
        assert_eq!(five.model.sensors[k].five_parameter, full.model.sensors[k].five_parameter);
    }
}
