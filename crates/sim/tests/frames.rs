//! Simulated frames decoded again by the code that decodes real ones.
#![allow(clippy::unwrap_used)]

mod common;

use common::{config_file, edited, rig, rig_of, snapshots};
use model::dynamics::Dynamics;
use model::spatial::Wrench;
use nalgebra::{Matrix3, Vector3, Vector6};
use rig::run::LoadInterval;
use wrenchd_sim::motion::{MotionLimits, Sine, Sines, Trajectory};
use wrenchd_sim::push::Push;
use wrenchd_sim::{Options, Preset, Scenario, SimError, Simulator, Truth};

/// A swing of all joints with a weight and a push; some seconds long.
fn lively(rig: &rig::Rig, seconds: f64) -> Scenario {
    let limits = MotionLimits::of(&rig.chain).unwrap();
    let mut trajectory = Trajectory::from_pose(limits.middle());
    trajectory.hold(0.5);
    let terms = (0..limits.joints.len())
        .map(|joint| {
            vec![Sine {
                amplitude_rad: 0.8,
                frequency_hz: 0.3 + 0.1 * joint as f64,
                phase_rad: 0.7 * joint as f64,
            }]
        })
        .collect();
    trajectory.swing(Sines::new(limits.middle(), terms, seconds, 0.5, &limits, 0.75));
    let mut push = Push::none();
    push.trapezoid(1.0, 2.0, 0.3, Wrench::new(Vector3::new(1.0, -2.0, 3.0), Vector3::new(0.1, 0.2, -0.3)));
    let loads = vec![LoadInterval { from_s: 0.7, to_s: 1e3, mass_kg: 0.5, com_m: [0.08, 0.0, 0.03] }];
    Scenario { loads, push, ..Scenario::of_motion(trajectory) }
}

/// Every snapshot holds what the formulas give for the same instant, rounded to the signal.
fn agrees(rig: &rig::Rig, rate_hz: f64) {
    let scenario = lively(rig, 2.0);
    let truth = Truth::draw(rig, 5, 0.003).without_noise();
    let options = Options { rate_hz: Some(rate_hz), ..Options::default() };
    let mut simulator = Simulator::new(rig, truth.clone(), &scenario, options).unwrap();
    let mut mechanics = simulator.mechanics();
    let cycles = simulator.cycles();
    let (snapshots, assembler) = snapshots(rig, simulator.by_ref());
    let counts = assembler.counts();
    assert_eq!((counts.late, counts.wrong_length, counts.missed), (0, 0, 0), "{counts:?}");
    assert_eq!(assembler.sequence_counts().missing, 0);
    assert!(snapshots.len() as u64 + 3 >= cycles, "{} of {cycles}", snapshots.len());
    let mut fastest = 0.0f64;
    for snapshot in &snapshots {
        assert!(snapshot.complete);
        let since_s = (snapshot.instant_ns - options.start_ns) as f64 * 1e-9;
        let t_s = (since_s * rate_hz).floor() / rate_hz;
        assert!(since_s - t_s < 0.0012);
        mechanics.update(t_s);
        for (index, gauge) in truth.gauges.iter().enumerate() {
            let expected = gauge.counts(&mechanics.load(index));
            let read = snapshot.gauges[index].unwrap().value;
            assert!((read - expected).abs() <= 0.5 + 1e-6, "t {t_s} gauge {index}: {read} for {expected}");
        }
        let state = mechanics.state();
        for (index, joint) in snapshot.joints.iter().enumerate() {
            let error = joint.position.unwrap().value - state.positions_rad[index];
            assert!(error.abs() <= 0.5e-6 + 1e-12);
            if let Ok(velocity) = joint.velocity {
                assert!((velocity.value - state.velocities_rad_s[index]).abs() <= 0.5e-6 + 1e-12);
            }
            fastest = fastest.max(state.velocities_rad_s[index].abs());
        }
    }
    assert!(fastest > 0.3, "{fastest}");
    let warm = snapshots.last().unwrap().temperatures.iter().map(|t| t.unwrap().value);
    assert!(warm.clone().count() == 8 && warm.into_iter().all(|t| (23.0..26.0).contains(&t)));
}

#[test]
fn classical_frames_decode_to_the_exact_loads() {
    agrees(&rig("arm.toml"), 125.0);
    agrees(&rig("arm.toml"), 1000.0);
}

#[test]
fn fd_frames_decode_to_the_exact_loads() {
    agrees(&rig("arm_fd.toml"), 125.0);
    agrees(&rig("arm_fd.toml"), 2000.0);
}

/// The load by hand: weight of every link and of the load, moments about each section, in its frame.
#[test]
fn static_readings_follow_the_published_formula() {
    let rig = rig("arm.toml");
    let mut truth = Truth::draw(&rig, 9, 0.0).without_noise();
    truth.gauges[2].compliance.force_counts_per_n.z += 800.0; // some pitch in one of them
    let pose = vec![0.3, -0.9, 0.8, -0.5, 1.1, 2.0];
    let mut trajectory = Trajectory::from_pose(pose.clone());
    trajectory.hold(0.5);
    let scenario = Scenario::of_motion(trajectory).with_load(0.5, [0.0, 0.08, 0.03]).unwrap();
    let simulator = Simulator::new(&rig, truth.clone(), &scenario, Options::default()).unwrap();
    let (snapshots, _) = snapshots(&rig, simulator);
    let placements = rig.chain.placements(&pose);
    let gravity = Vector3::new(0.0, 0.0, -9.80665);
    for (index, (section, gauge)) in rig.sections.iter().zip(&truth.gauges).enumerate() {
        let place = placements[section.joint];
        let (mut force, mut moment) = (Vector3::zeros(), Vector3::zeros());
        let mut add = |mass: f64, at: Vector3<f64>| {
            force += gravity * mass;
            moment += (at - place.translation_m).cross(&(gravity * mass));
        };
        for (joint, placed) in rig.chain.joints.iter().zip(&placements).skip(section.joint) {
            if let Some(com) = joint.body.com_m() {
                add(joint.body.mass_kg, placed.point(&com));
            }
        }
        add(0.5, placements.last().unwrap().point(&Vector3::new(0.0, 0.08, 0.03)));
        let into_s: Matrix3<f64> = (place.rotation * section.r_cs).transpose();
        let (f, t) = (into_s * force, into_s * moment);
        // z = r (R t + l x R f)_z + r h (R f)_z + b, with R = Ry(a_y) Rx(a_x)
        let frame = gauge.frame().unwrap();
        let ((sx, cx), (sy, cy)) = (frame.a_x_rad.sin_cos(), frame.a_y_rad.sin_cos());
        let rotation = Matrix3::new(cy, 0.0, sy, 0.0, 1.0, 0.0, -sy, 0.0, cy)
            * Matrix3::new(1.0, 0.0, 0.0, 0.0, cx, -sx, 0.0, sx, cx);
        let l = Vector3::new(frame.l_x_m, frame.l_y_m, 0.0);
        let (rf, rt) = (rotation * f, rotation * t);
        let z = frame.r_counts_per_nm * (rt + l.cross(&rf)).z
            + frame.r_counts_per_nm * frame.pitch_m * rf.z
            + gauge.bias_counts;
        let read = snapshots[5].gauges[index].unwrap().value;
        assert!((read - z).abs() <= 0.51, "gauge {index}: {read} for {z}");
    }
}

#[test]
fn the_true_wrench_is_push_and_weight_and_inertia() {
    let rig = rig("arm.toml");
    let scenario = lively(&rig, 2.0);
    let truth = Truth::draw(&rig, 5, 0.0);
    let mut simulator = Simulator::new(&rig, truth, &scenario, Options::default()).unwrap();
    assert_eq!(simulator.truth_at(0.1).to_vector(), Vector6::zeros());
    // Second difference of the load's place in the world against the true wrench.
    let mut dynamics = Dynamics::new(&rig.chain, &rig.sections);
    let mut state = wrenchd_sim::JointState::at_rest(6);
    let mut place = |t_s: f64| {
        scenario.trajectory.at(t_s, &mut state);
        dynamics.update(&state.positions_rad, &[], &[]);
        dynamics.tip_in_base()
    };
    for t_s in [0.9, 1.5, 1.9, 2.2] {
        let (h, com) = (1e-4, Vector3::new(0.08, 0.0, 0.03));
        let [before, now, after] = [t_s - h, t_s, t_s + h].map(&mut place);
        let acceleration = (before.point(&com) - now.point(&com) * 2.0 + after.point(&com)) / (h * h);
        let force = now.rotation.tr_mul(&((Vector3::new(0.0, 0.0, -9.80665) - acceleration) * 0.5));
        let expected = Wrench::new(force, com.cross(&force)) + scenario.push.at(t_s);
        let error = simulator.truth_at(t_s).to_vector() - expected.to_vector();
        assert!(error.amax() < 1e-4, "t {t_s}: {error}");
        assert!(acceleration.norm() > 0.05);
    }
}

#[test]
fn a_seed_gives_the_same_frames_and_another_seed_others() {
    let rig = rig("arm.toml");
    let frames = |seed| {
        let truth = Truth::draw(&rig, 3, 0.0);
        let options = Options { seed, ..Options::default() };
        Simulator::new(&rig, truth, &lively(&rig, 1.0), options).unwrap().collect::<Vec<_>>()
    };
    let first = frames(1);
    assert_eq!(first, frames(1));
    assert_ne!(first, frames(2));
    assert_eq!(Truth::draw(&rig, 3, 0.002), Truth::draw(&rig, 3, 0.002));
    assert_ne!(Truth::draw(&rig, 3, 0.002), Truth::draw(&rig, 4, 0.002));
    assert!(first.is_sorted_by_key(|stamped| stamped.stamp_ns));
}

#[test]
fn noise_is_that_of_the_truth() {
    let rig = rig("arm_fd.toml");
    let truth = Truth::draw(&rig, 3, 0.0);
    let mut trajectory = Trajectory::from_pose(vec![0.0, -1.0, 0.5, 0.0, 0.5, 0.0]);
    trajectory.hold(60.0);
    let simulator =
        Simulator::new(&rig, truth.clone(), &Scenario::of_motion(trajectory), Options::default()).unwrap();
    let (snapshots, _) = snapshots(&rig, simulator);
    let deviation = |values: Vec<f64>| {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
    };
    for (index, gauge) in truth.gauges.iter().enumerate() {
        let counts = deviation(snapshots.iter().map(|s| s.gauges[index].unwrap().value).collect());
        assert!((counts / gauge.noise.sigma_counts - 1.0).abs() < 0.06, "{counts}");
    }
    for joint in 0..6 {
        let rad = deviation(snapshots.iter().map(|s| s.joints[joint].position.unwrap().value).collect());
        assert!((rad / 20e-6 - 1.0).abs() < 0.06, "{rad}");
    }
}

#[test]
fn drawn_gauges_are_like_cheap_ones() {
    let rig = rig("arm.toml");
    let mut percents = Vec::new();
    for seed in 0..50 {
        for gauge in Truth::draw(&rig, seed, 0.0).gauges {
            let frame = gauge.frame().unwrap();
            assert!((1.5e5..6e5).contains(&frame.r_counts_per_nm) && gauge.bias_counts.abs() <= 2e5);
            assert!(frame.l_x_m.hypot(frame.l_y_m) <= 0.02 + 1e-12 && frame.pitch_m.abs() < 1e-12);
            percents.push(gauge.compliance.crosstalk_percent(0.1));
        }
    }
    assert!(percents.iter().all(|percent| (2.999..270.001).contains(percent)));
    let share = |low, high| percents.iter().filter(|p| (low..high).contains(*p)).count() as f64 / 400.0;
    assert!(share(0.0, 10.0) > 0.15 && share(100.0, 271.0) > 0.12);
    let pitches: Vec<f64> = (0..20)
        .flat_map(|seed| Truth::draw(&rig, seed, 0.004).gauges)
        .map(|g| g.frame().unwrap().pitch_m)
        .collect();
    assert!(
        pitches.iter().all(|pitch| pitch.abs() <= 0.004 + 1e-12) && pitches.iter().any(|p| p.abs() > 0.003)
    );
}

#[test]
fn beyond_the_range_is_at_its_end_and_flagged() {
    let rig = rig("arm.toml");
    let mut truth = Truth::draw(&rig, 3, 0.0).without_noise();
    truth.gauges[3].bias_counts = 9e6;
    let mut trajectory = Trajectory::from_pose(vec![0.0; 6]);
    trajectory.hold(0.2);
    let frames: Vec<_> =
        Simulator::new(&rig, truth, &Scenario::of_motion(trajectory), Options::default()).unwrap().collect();
    let frame = frames.iter().find(|stamped| stamped.frame.id().number() == 258).unwrap().frame;
    assert_eq!(frame.data()[3..6], [0xFF, 0xFF, 0x7F]);
    assert_eq!(frame.data()[7], 0b10);
    let (snapshots, _) = snapshots(&rig, frames.into_iter());
    assert_eq!(snapshots[0].gauges[3], Err(can::assembly::Absence::Saturated));
    assert!(snapshots[0].gauges[2].is_ok());
}

#[test]
fn pages_share_what_is_outside_them_and_counters_count_frames() {
    let config = edited("arm.toml", &[]);
    let dbc = edited(
        "arm.dbc",
        &[
            (
                "SG_ Counts1 : 0|24@1-",
                "SG_ Page M : 58|2@1+ (1,0) [0|3] \"\" HOST\n SG_ Counts1 m1 : 0|24@1-",
            ),
            ("SG_ Counts2 : 24|24@1-", "SG_ Counts2 m2 : 24|24@1-"),
            ("[-6.4|6.4] \"rad\"", "[-400|400] \"deg\""),
        ],
    );
    let dbc = dbc.replace("(1E-006,0)", "(1E-005,0)");
    let rig = rig_of(&config, &dbc);
    let truth = Truth::draw(&rig, 5, 0.0).without_noise();
    let simulator = Simulator::new(&rig, truth.clone(), &lively(&rig, 1.0), Options::default()).unwrap();
    let mut mechanics = simulator.mechanics();
    let frames: Vec<_> = simulator.collect();
    let pages: Vec<u8> = frames
        .iter()
        .filter(|stamped| stamped.frame.id().number() == 257)
        .map(|stamped| stamped.frame.data()[7] >> 2 & 3)
        .collect();
    assert_eq!(pages[..4], [1, 2, 1, 2]);
    let first: Vec<u8> =
        frames.iter().filter(|s| s.frame.id().number() == 257).map(|s| s.frame.data()[6]).take(4).collect();
    assert_eq!(first, [0, 1, 2, 3], "the counter outside the pages counts the message's frames");
    let (snapshots, _) = snapshots(&rig, frames.into_iter());
    let snapshot = &snapshots[60];
    let t_s = ((snapshot.instant_ns - wrenchd_sim::START_NS) as f64 * 1e-9 * 125.0).floor() / 125.0;
    mechanics.update(t_s);
    for index in 0..8 {
        let expected = truth.gauges[index].counts(&mechanics.load(index));
        assert!((snapshot.gauges[index].unwrap().value - expected).abs() < 0.51);
    }
    for joint in 0..6 {
        let error = snapshot.joints[joint].position.unwrap().value - mechanics.state().positions_rad[joint];
        assert!(error.abs() < 1e-7);
    }
}

#[test]
fn delayed_signals_and_other_interfaces_come_out_right() {
    let config = edited(
        "arm.toml",
        &[
            ("interfaces = [\"can0\"]", "interfaces = [\"can0\", \"can7\"]"),
            ("name = \"joint_1\"\n", "name = \"joint_1\"\ninterface = \"can7\"\ndelay_s = 0.011\n"),
            ("name = \"joint_2\"\n", "name = \"joint_2\"\ninterface = \"can7\"\ndelay_s = 0.004\n"),
        ],
    );
    let rig = rig_of(&config, &edited("arm.dbc", &[]));
    let truth = Truth::draw(&rig, 5, 0.0).without_noise();
    let simulator = Simulator::new(&rig, truth, &lively(&rig, 2.0), Options::default()).unwrap();
    let mut mechanics = simulator.mechanics();
    let frames: Vec<_> = simulator.collect();
    assert!(frames.is_sorted_by_key(|stamped| stamped.stamp_ns));
    assert!(frames.iter().any(|stamped| stamped.interface == 1 && stamped.frame.id().number() == 513));
    let (snapshots, _) = snapshots(&rig, frames.into_iter());
    for snapshot in &snapshots[20..] {
        for joint in [0, 1] {
            let reading = snapshot.joints[joint].position.unwrap();
            mechanics.update((reading.at_ns - wrenchd_sim::START_NS) as f64 * 1e-9);
            let error = reading.value - mechanics.state().positions_rad[joint];
            assert!(error.abs() < 5e-6, "{error}");
        }
    }
}

#[test]
fn what_cannot_be_is_refused_with_a_reason() {
    let rig = rig("arm.toml");
    let truth = Truth::draw(&rig, 1, 0.0);
    let scenario = lively(&rig, 1.0);
    let words = |truth: Truth, scenario: &Scenario, rate_hz: f64| {
        let options = Options { rate_hz: Some(rate_hz), ..Options::default() };
        Simulator::new(&rig, truth, scenario, options).err().unwrap().to_string()
    };
    let message = words(truth.clone(), &scenario, 2000.0);
    assert!(message.contains("can0") && message.contains("lower the rate"), "{message}");
    for rate_hz in [0.0, -1.0, f64::NAN, 1e9] {
        assert!(words(truth.clone(), &scenario, rate_hz).contains("cannot be simulated"));
    }
    let mut few = truth.clone();
    few.gauges.pop();
    assert!(words(few, &scenario, 125.0).contains("7 gauges"));
    let mut far = Trajectory::from_pose(vec![7.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    far.hold(1.0);
    let message = words(truth, &Scenario::of_motion(far), 125.0);
    assert!(message.contains("joint_1") && message.contains("Joints12.Position1"), "{message}");
    assert!(scenario.clone().with_load(-1.0, [0.0; 3]).is_err());
    assert!(scenario.with_load(1.0, [f64::NAN, 0.0, 0.0]).is_err());
    let message = "sweeep".parse::<Preset>().err().unwrap().to_string();
    assert!(message.contains("calibration, accuracy, sweep, holds"), "{message}");
    let missing = Trajectory::from_csv(&config_file("none.csv"), &MotionLimits::of(&rig.chain).unwrap());
    assert!(matches!(missing, Err(SimError::Read { .. })));
}
