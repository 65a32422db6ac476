//! The simulator beside recorded means of held poses, whose mechanics were computed by MuJoCo.
//!
//! `data/held_poses.csv`: samples averaged, mass (kg) and its place in E (m), wrench beside it (N, Nm, about E's origin, in
//! E; a reference sensor's mean), positions (rad), readings (counts). The gauges were these.
#![allow(clippy::unwrap_used)]

mod common;

use common::{rig, snapshots};
use model::sensing::ActualFrame;
use model::spatial::Wrench;
use nalgebra::Vector3;
use rig::run::LoadInterval;
use wrenchd_sim::motion::Trajectory;
use wrenchd_sim::push::Push;
use wrenchd_sim::truth::{GaugeNoise, TrueEncoder};
use wrenchd_sim::{Options, Scenario, Simulator, TrueGauge, Truth};

/// r (counts/Nm), a_x, a_y (rad), l_x, l_y (m), bias (counts); pitch 0.
const GAUGES: [[f64; 6]; 8] = [
    [
        164871.92116592117,
        -0.1078975641218679,
        0.0004895695783171679,
        -0.002245351137865737,
        -0.0013110658488683672,
        -171831.76953832127,
    ],
    [
        165850.41245422637,
        0.7787637324493052,
        -0.26210953478778937,
        0.02036513407109377,
        -0.0012536180820230671,
        -89876.47369554828,
    ],
    [
        252265.96205537886,
        0.0073595991878880425,
        -0.030203452649307592,
        -0.0006886015603577352,
        -0.0005194730071386701,
        192365.4557189222,
    ],
    [
        497543.70453850814,
        -0.08912477757706215,
        -0.03128604201606294,
        -0.008065430478495719,
        -0.0034190253885705096,
        120881.07351139339,
    ],
    [
        495060.9810107406,
        0.019115769769770315,
        0.0200409292512701,
        -0.0007693358572695076,
        -0.002453866897379188,
        -28020.523180865857,
    ],
    [
        546398.8850018468,
        -0.44034028709375744,
        -0.8426675307989453,
        -0.002690433670708212,
        -0.01057570204576044,
        -119692.41833551228,
    ],
    [
        224368.0603337336,
        -0.19685707835683985,
        0.03895397659182718,
        -0.00460991828393621,
        -0.009537081654280683,
        -136070.5223580076,
    ],
    [
        317193.5924686883,
        -0.06422808794131661,
        0.01661320060136371,
        0.0023212929716914807,
        0.0014863162383315887,
        35152.776266744215,
    ],
];

fn truth() -> Truth {
    let gauge = |[r, ax, ay, lx, ly, bias_counts]: [f64; 6]| TrueGauge {
        compliance: ActualFrame {
            r_counts_per_nm: r,
            a_x_rad: ax,
            a_y_rad: ay,
            l_x_m: lx,
            l_y_m: ly,
            pitch_m: 0.0,
        }
        .compliance(),
        bias_counts,
        noise: GaugeNoise { sigma_counts: 600.0, slow_share: 0.15, slow_time_s: 0.2 },
    };
    let encoder = TrueEncoder { position_sigma_rad: 20e-6, velocity_sigma_rad_s: 1e-3 };
    Truth {
        gauges: GAUGES.map(gauge).to_vec(),
        encoders: vec![encoder; 6],
        imperfections: None,
        effects: wrenchd_sim::effects::Effects::default(),
    }
}

#[test]
fn held_poses_read_as_recorded() {
    let (rig, truth) = (rig("arm.toml"), truth());
    let (mut squares, mut count, mut worst) = (0.0f64, 0.0f64, 0.0f64);
    for line in include_str!("data/held_poses.csv").lines().skip(1) {
        let row: Vec<f64> = line.split(',').map(|cell| cell.parse().unwrap()).collect();
        let (samples, load, push, pose, recorded) =
            (row[0], &row[1..5], &row[5..11], &row[11..17], &row[17..]);
        let wrench =
            Wrench::new(Vector3::from_column_slice(&push[..3]), Vector3::from_column_slice(&push[3..]));
        let mut trajectory = Trajectory::from_pose(pose.to_vec());
        trajectory.hold(0.1);
        let mut steady = Push::none();
        steady.knot(-1.0, wrench);
        steady.knot(1.0, wrench);
        let com_m = [load[1], load[2], load[3]];
        let loads = vec![LoadInterval { from_s: 0.0, to_s: 1.0, mass_kg: load[0], com_m }];
        let scenario = Scenario { push: steady, loads, ..Scenario::of_motion(trajectory) };
        let exact = truth.clone().without_noise();
        let simulator = Simulator::new(&rig, exact, &scenario, Options::default()).unwrap();
        let mechanics = simulator.mechanics();
        let (snapshots, _) = snapshots(&rig, simulator);
        for (index, (gauge, recorded)) in truth.gauges.iter().zip(recorded).enumerate() {
            let read = snapshots[2].gauges[index].unwrap().value;
            // Mean of the noise, whose slow part averages over some 0.4 s as over one sample; 50 samples a second.
            let noise = &gauge.noise;
            let slow = (2.0 * noise.slow_time_s * 50.0 / samples).min(1.0);
            let variance =
                noise.sigma_counts.powi(2) * ((1.0 - noise.slow_share) / samples + noise.slow_share * slow);
            // The reference sensor's own noise, where it was mounted: 0.02 .. 0.03 N and 1 mNm a sample.
            let to_tip = reference_share(&mechanics, gauge, index) / samples;
            let sigma = if wrench == Wrench::zero() { variance.sqrt() } else { (variance + to_tip).sqrt() };
            let off = (read - recorded) / sigma;
            squares += off * off;
            count += 1.0;
            worst = worst.max(off.abs());
        }
    }
    let rms = (squares / count).sqrt();
    assert!(count > 250.0 && (0.7..1.3).contains(&rms) && worst < 4.5, "rms {rms}, worst {worst} of {count}");
}

/// Variance (counts^2) that one sample of the reference sensor brings to a gauge.
fn reference_share(mechanics: &wrenchd_sim::Mechanics, gauge: &TrueGauge, section: usize) -> f64 {
    let sigmas = [0.02, 0.02, 0.03, 0.001, 0.001, 0.001];
    let row = mechanics.row_to_tip(section, &gauge.compliance);
    row.iter().zip(sigmas).map(|(part, sigma)| (part * sigma).powi(2)).sum()
}
