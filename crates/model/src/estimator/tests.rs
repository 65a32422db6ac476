//! The estimator against ideal gauges, arms that yield and arms that are not as they are thought to be.

use super::*;

const URDF: &str = include_str!("../../tests/data/arm_a.urdf");
const SECTIONS: [&str; 8] =
    ["joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6", "section_7", "section_8"];

fn arm() -> (Chain, Vec<Section>) {
    let gravity = nalgebra::Vector3::new(0.0, 0.0, -9.80665);
    let chain = Chain::from_urdf(URDF, "arm_a.urdf", "base_link", "tool0", gravity).unwrap();
    let sections = SECTIONS.iter().map(|s| Section::new(&chain, s, None).unwrap()).collect();
    (chain, sections)
}

/// Gauges with strong crosstalk, a different one each.
fn gauges() -> Vec<GaugeModel> {
    (0..8)
        .map(|k| {
            let s = f64::from(k);
            GaugeModel {
                compliance: Vector6::new(2e3 * s, -1e3, 500.0 * s, 4e4 - 9e3 * s, 2e4 * (s - 3.0), 2e5),
                bias_counts: 1e4 * s,
                covariance: GaugeCovariance::zeros(),
                assumed: None,
                noise_counts2: 500.0f64.powi(2),
                terms: GaugeTerms::default(),
            }
        })
        .collect()
}

fn pose() -> Vec<JointMotion> {
    [0.3, -0.9, 0.8, 0.4, -0.7, 0.2].map(JointMotion::at_rest).to_vec()
}

/// Readings of ideal gauges, from the loads by another way than the estimator's rows.
fn readings(
    gauges: &[GaugeModel],
    motion: &[JointMotion],
    wrench: &Wrench<Tip>,
) -> Vec<Option<GaugeReading>> {
    let (chain, sections) = arm();
    let mut d = Dynamics::new(&chain, &sections);
    let part = |f: fn(&JointMotion) -> f64| motion.iter().map(f).collect::<Vec<_>>();
    d.update(&part(|m| m.position_rad), &part(|m| m.velocity_rad_s), &part(|m| m.acceleration_rad_s2));
    gauges
        .iter()
        .enumerate()
        .map(|(i, g)| {
            let load = d.load(i) + d.tip_adjoint(i) * wrench.to_vector();
            Some(GaugeReading::from(g.compliance.dot(&load) + g.bias_counts))
        })
        .collect()
}

fn wrench() -> Wrench<Tip> {
    Wrench::from_vector(&Vector6::new(3.0, -2.0, 5.0, 0.2, -0.4, 0.1))
}

#[test]
fn finds_the_wrench_of_ideal_gauges_and_with_any_two_missing() {
    let (chain, sections) = arm();
    let mut estimator = WrenchEstimator::new(&chain, &sections, gauges());
    let mut motion = pose();
    motion[2].velocity_rad_s = 1.0;
    motion[4].acceleration_rad_s2 = 9.0;
    let all = readings(&gauges(), &motion, &wrench());
    for (a, b) in [(0, 0), (0, 1), (2, 5), (6, 7)] {
        let mut counts = all.clone();
        counts[a] = None;
        counts[b] = None;
        let found = estimator.estimate(&motion, &counts).unwrap();
        assert!((found.wrench.to_vector() - wrench().to_vector()).amax() < 1e-6, "{found:?}");
        assert!(found.parity_chi2 < 1e-9 && found.parity_dof == if a == b { 1 } else { 0 });
    }
    let mut counts = all;
    counts[..3].fill(None);
    assert_eq!(estimator.estimate(&motion, &counts), Err(NoWrench::TooFewGauges));
}

#[test]
fn an_arm_that_was_posed_ahead_for_this_motion_or_for_another_gives_the_same() {
    let (chain, sections) = arm();
    for flexibility_rad_per_nm in [vec![0.0; 6], vec![1e-4; 6]] {
        let arm = ArmModel { flexibility_rad_per_nm, deviations: Vec::new() };
        let fresh = || WrenchEstimator::with_arm(&chain, &sections, gauges(), arm.clone());
        let tool =
            RigidBody::from_com(0.7, nalgebra::Vector3::new(0.02, 0.0, 0.1), nalgebra::Matrix3::zeros());
        let mut moved = pose();
        moved[1].velocity_rad_s = 0.8;
        let counts = readings(&gauges(), &moved, &wrench());
        let mut estimator = fresh();
        for (ahead, payload) in [(&moved, false), (&pose(), false), (&moved, true), (&moved, true)] {
            estimator.prepare(ahead);
            let mut other = fresh();
            if payload {
                estimator.set_payload(&tool);
                other.set_payload(&tool);
            }
            let expected = other.estimate(&moved, &counts).unwrap();
            assert_eq!(estimator.estimate(&moved, &counts), Ok(expected));
            assert_eq!(estimator.estimate(&moved, &counts), Ok(expected), "asked for twice");
        }
    }
}

#[test]
fn a_gauge_with_an_unseen_direction_that_matters_is_hardly_used() {
    let (chain, sections) = arm();
    let truth = gauges();
    let mut seen = gauges();
    // Gauge 1 was calibrated without ever feeling torque about z: its estimate there is zero, far from the truth.
    seen[0].compliance[5] = 0.0;
    let mut assumed = Matrix6::zeros();
    assumed[(5, 5)] = 2e5f64.powi(2);
    seen[0].covariance.fixed_view_mut::<6, 6>(0, 0).copy_from(&assumed);
    seen[0].assumed = Some(assumed);
    let counts = readings(&truth, &pose(), &wrench());
    let mut with = WrenchEstimator::new(&chain, &sections, seen.clone());
    let found = with.estimate(&pose(), &counts).unwrap();
    let mut without_first = counts;
    without_first[0] = None;
    let reference = with.estimate(&pose(), &without_first).unwrap();
    let error = found.wrench.to_vector() - wrench().to_vector();
    for k in 0..6 {
        assert!(error[k].abs() < found.covariance[(k, k)].sqrt(), "{k} {error}");
        assert!(found.covariance[(k, k)] <= reference.covariance[(k, k)] * 1.0001);
    }
}

#[test]
fn uncertain_acceleration_widens_the_wrench() {
    let (chain, sections) = arm();
    let mut estimator = WrenchEstimator::new(&chain, &sections, gauges());
    let counts = readings(&gauges(), &pose(), &wrench());
    let sure = estimator.estimate(&pose(), &counts).unwrap();
    let mut motion = pose();
    motion[1].covariance[(2, 2)] = 4.0;
    let unsure = estimator.estimate(&motion, &counts).unwrap();
    assert!(unsure.covariance.trace() > 2.0 * sure.covariance.trace());
}

/// Readings of an arm whose joints yield, its true positions found by iterating to the end.
fn yielding(
    gauges: &[GaugeModel],
    motion: &[JointMotion],
    wrench: &Wrench<Tip>,
    flexibility: &[f64],
) -> Vec<Option<GaugeReading>> {
    let (chain, sections) = arm();
    let mut d = Dynamics::new(&chain, &sections);
    let mut bent = motion.to_vec();
    for _ in 0..20 {
        d.update_static(&bent.iter().map(|m| m.position_rad).collect::<Vec<_>>());
        for (k, joint) in bent.iter_mut().enumerate() {
            joint.position_rad = motion[k].position_rad + flexibility[k] * d.joint_torque_nm(k, wrench);
        }
    }
    readings(gauges, &bent, wrench)
}

#[test]
fn follows_joints_that_yield_and_terms_that_add() {
    let (chain, sections) = arm();
    let flexibility = vec![1e-4, 2e-4, 3e-4, 5e-4, 2e-4, 1e-4];
    let mut counts = yielding(&gauges(), &pose(), &wrench(), &flexibility);
    let model = ArmModel { flexibility_rad_per_nm: flexibility, deviations: Vec::new() };
    let mut known = gauges();
    known[3].terms.terms.push(crate::terms::Term {
        effect: crate::terms::Effect::Power { order: 2 },
        coefficient_counts: 4000.0,
        start_sigma: 0.0,
    });
    if let Some(reading) = &mut counts[3] {
        reading.regressors[0] = 0.5;
        reading.counts += 2000.0;
    }
    let mut stiff = WrenchEstimator::new(&chain, &sections, gauges());
    let mut soft = WrenchEstimator::with_arm(&chain, &sections, known, model);
    let error = |e: &mut WrenchEstimator| {
        (e.estimate(&pose(), &counts).unwrap().wrench.to_vector() - wrench().to_vector()).amax()
    };
    // What is left of the second step of the fixed point is a ten-thousandth of what the first took away.
    assert!(
        error(&mut stiff) > 0.02 && error(&mut soft) < 5e-5,
        "{} {}",
        error(&mut stiff),
        error(&mut soft)
    );
}

#[test]
fn a_deviation_is_worth_the_error_that_it_would_make() {
    let (chain, sections) = arm();
    let mut correction = crate::arm::ArmCorrection {
        joints: vec![crate::arm::JointCorrection::default(); chain.joints.len()],
        ..Default::default()
    };
    correction.joints[4].mass_kg = 0.05;
    correction.joints[2].zero_rad = 0.002;
    let mut numbers = vec![[0.0; GAUGE_NUMBERS]; 8];
    numbers[5][5] = 300.0;
    let deviation = Deviation {
        chain: correction.apply(&chain),
        flexibility_rad_per_nm: vec![0.0; 6],
        gauges: numbers.clone(),
    };
    let model = ArmModel { flexibility_rad_per_nm: Vec::new(), deviations: vec![deviation] };
    // With six gauges no weight matters: the same readings on the deviated arm move the wrench by one standard deviation.
    let mut counts = readings(&gauges(), &pose(), &wrench());
    counts[..2].fill(None);
    let mut deviated = gauges();
    deviated[5].compliance[5] += 300.0;
    let mut plain = WrenchEstimator::new(&chain, &sections, gauges());
    let mut other = WrenchEstimator::new(&correction.apply(&chain), &sections, deviated);
    let mut unsure = WrenchEstimator::with_arm(&chain, &sections, gauges(), model);
    let [sure, moved, unsure] =
        [&mut plain, &mut other, &mut unsure].map(|e| e.estimate(&pose(), &counts).unwrap());
    let shift = moved.wrench.to_vector() - sure.wrench.to_vector();
    let added = unsure.covariance - sure.covariance;
    assert!(shift.norm() > 0.02, "{shift}");
    for k in 0..6 {
        assert!((added[(k, k)].sqrt() / shift[k].abs() - 1.0).abs() < 0.01, "{k} {added} {shift}");
    }
}

#[test]
fn the_roots_of_covariances_multiply_back() {
    let covariance = nalgebra::Matrix3::new(2.0, 0.3, 0.1, 0.3, 1.0, -0.2, 0.1, -0.2, 0.5);
    let joints = [JointMotion { covariance, ..JointMotion::at_rest(0.0) }, JointMotion::at_rest(0.0)];
    let roots = MotionRoots::of(&joints);
    let felt = |by: [f64; 3]| {
        let (first, [second, third]) = roots.felt(by.map(f64x2::splat));
        [first, second, third].map(|error| *error.as_array())
    };
    for by in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.3, -2.0, 0.7]] {
        let by_vector = nalgebra::Vector3::from(by);
        let variance: f64 = felt(by).iter().map(|[error, _]| error * error).sum();
        assert!((variance - (by_vector.transpose() * covariance * by_vector)[(0, 0)]).abs() < 1e-14);
        assert!(felt(by).iter().all(|[_, still]| *still == 0.0));
    }
}
