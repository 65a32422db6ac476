//! `[arm]` and `[[sensor.term]]` of a model: what comes back, and what is refused.

use std::path::Path;

use model::sensing::Compliance;
use nalgebra::Vector6;
use rig::model_file::{Arm, ArmDeviation, ArmJoint, EffectShape, Encoder, Provenance, Sensor, SensorTerm};
use rig::{ModelFile, Rig, RigError};

use super::{examples, message, with};

fn rig() -> Rig {
    Rig::load_file(&examples().join("arm.toml")).unwrap()
}

fn term(effect: EffectShape, index: usize) -> SensorTerm {
    let mut covariance = vec![0.0; 8 + index];
    covariance[7 + index] = 400.0;
    SensorTerm {
        effect,
        coefficient_counts: -1500.5,
        coefficient_sigma_counts: 20.0,
        start_sigma: 0.25,
        covariance,
    }
}

fn sensor(name: &str, section: &str, terms: Vec<SensorTerm>) -> Sensor {
    let compliance = Compliance::from_vector(&Vector6::new(100.0, -50.0, 20.0, 3e4, -2e4, 2e5));
    let mut covariance = [[0.0; 7]; 7];
    (0..7).for_each(|k| covariance[k][k] = 100.0);
    Sensor {
        bias_counts: 1234.5,
        bias_sigma_counts: 10.0,
        noise_slow_share: 0.15,
        noise_slow_time_s: 0.2,
        residual_rms_counts: 650.0,
        covariance,
        centre_counts: if terms.is_empty() { 0.0 } else { 5000.0 },
        scale_counts: if terms.is_empty() { 0.0 } else { 400_000.0 },
        terms,
        ..Sensor::known(name, section, &compliance, 600.0)
    }
}

/// All four effects on the first gauge, one on the third, and an arm with one deviation.
fn model(rig: &Rig) -> ModelFile {
    let all = [
        EffectShape::Temperature { lag_s: 55.0, reference_c: 20.0 },
        EffectShape::Power { order: 3 },
        EffectShape::Creep { tau_s: 30.0 },
        EffectShape::Hysteresis { width: 0.06 },
    ];
    let terms = |index: usize| match index {
        0 => all.iter().enumerate().map(|(k, effect)| term(*effect, k)).collect(),
        2 => vec![term(all[0], 0)],
        _ => Vec::new(),
    };
    let sensors: Vec<Sensor> =
        rig.config.sensors.iter().enumerate().map(|(k, s)| sensor(&s.name, &s.section, terms(k))).collect();
    let joints = rig.chain.joints.iter().enumerate().map(|(k, joint)| ArmJoint {
        name: joint.name.clone(),
        mass_kg: 0.01,
        zero_rad: 0.002 * k as f64,
        flexibility_rad_per_nm: if joint.coordinate.is_some() { 2e-4 } else { 0.0 },
        ..ArmJoint::default()
    });
    let deviation = ArmDeviation {
        gravity_turn_rad: [1e-5, 0.0, 0.0],
        joints: vec![[1e-6; 12]; rig.chain.joints.len()],
        gauges: sensors.iter().map(|s| vec![0.5; 7 + s.terms.len()]).collect(),
    };
    ModelFile {
        format: 1,
        provenance: Provenance {
            tool: "a test".into(),
            date: "2026-01-01".into(),
            axes: "full".into(),
            samples: 1,
            inputs: Vec::new(),
        },
        joints: rig
            .chain
            .coordinate_names()
            .into_iter()
            .map(|name| Encoder { name: name.into(), position_sigma_rad: 2e-5, velocity_sigma_rad_s: None })
            .collect(),
        arm: Some(Arm {
            admitted: vec!["link_masses".into()],
            gravity_turn_rad: [0.001, -0.002, 0.0],
            gravity_turn_sigma_rad: [1e-4, 1e-4, 0.0],
            joints: joints.collect(),
            deviations: vec![deviation],
        }),
        sensors,
        fingerprint: rig.fingerprint().clone(),
    }
}

fn parse(text: &str) -> Result<ModelFile, RigError> {
    ModelFile::parse(Path::new("model.toml"), text)
}

/// Loads a text as the daemon does.
fn load(text: &str, rig: &Rig) -> Result<ModelFile, RigError> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("model.toml");
    std::fs::write(&file, text).unwrap();
    ModelFile::load(&file, rig)
}

#[test]
fn arm_and_terms_come_back_as_they_were_written() {
    let rig = rig();
    let model = model(&rig);
    let text = model.to_toml();
    assert_eq!(load(&text, &rig).unwrap(), model);
    let gauges = model.gauges();
    assert_eq!(gauges[0].terms.terms.len(), 4);
    assert_eq!((gauges[0].covariance[(7, 7)], gauges[0].covariance[(11, 11)]), (400.0 - 0.25, 0.0));
    let (chain, arm) = model.arm(&rig.chain);
    assert_eq!((arm.flexibility_rad_per_nm, arm.deviations.len()), (vec![2e-4; 6], 1));
    assert!((chain.joints[1].body.mass_kg - rig.chain.joints[1].body.mass_kg - 0.01).abs() < 1e-12);
}

#[test]
fn a_model_without_arm_and_terms_says_nothing_of_them() {
    let rig = rig();
    let mut plain = model(&rig);
    plain.arm = None;
    plain
        .sensors
        .iter_mut()
        .for_each(|s| (s.centre_counts, s.scale_counts, s.terms) = (0.0, 0.0, Vec::new()));
    let text = plain.to_toml();
    assert!(!text.contains("arm]") && !text.contains("term") && !text.contains("scale_counts"), "{text}");
    assert_eq!(load(&text, &rig).unwrap(), plain);
    assert_eq!(plain.arm(&rig.chain).0, rig.chain);
}

#[test]
fn unknown_effects_and_keys_are_refused() {
    let text = model(&rig()).to_toml();
    let cases = [
        with(&text, ".creep]", ".wear]"),
        with(&text, "tau_s = ", "tau_ms = "),
        with(&text, "[arm]\n", "[arm]\nlean = 1.0\n"),
        with(&text, "zero_rad = ", "zero_deg = "),
    ];
    for (case, named) in cases.iter().zip(["wear", "tau_ms", "lean", "zero_deg"]) {
        let said = message(parse(case));
        assert!(said.contains(named) && said.contains("model.toml"), "{said}");
    }
}

#[test]
fn numbers_that_cannot_be_are_refused() {
    let rig = rig();
    let refused = |change: &dyn Fn(&mut ModelFile), says: &str| {
        let mut changed = model(&rig);
        change(&mut changed);
        let said = message(parse(&changed.to_toml()));
        assert!(said.contains(says) && said.contains("calibrate again"), "{said}");
    };
    refused(
        &|m| m.sensors[0].terms[0].effect = EffectShape::Temperature { lag_s: 0.0, reference_c: 20.0 },
        "term 1",
    );
    refused(&|m| m.sensors[0].terms[1].effect = EffectShape::Power { order: 7 }, "term 2");
    refused(&|m| m.sensors[0].terms[2].covariance.push(0.0), "term 3: its covariance must be 10");
    refused(&|m| m.sensors[0].terms[3].start_sigma = -1.0, "term 4");
    refused(&|m| m.sensors[0].terms[0].covariance[6] = 1e6, "negative variance");
    refused(&|m| m.sensors[2].scale_counts = 0.0, "scale_counts");
    refused(
        &|m| {
            let (effect, n) = (m.sensors[0].terms[2].effect, 10);
            m.sensors[4].scale_counts = 1e5;
            m.sensors[4].terms = (0..n).map(|k| term(effect, k)).collect();
        },
        "10 terms, more than 9",
    );
    let arm = |change: fn(&mut Arm)| move |m: &mut ModelFile| change(m.arm.as_mut().unwrap());
    refused(&arm(|arm| arm.gravity_turn_rad[1] = 0.5), "gravity_turn_rad");
    refused(&arm(|arm| arm.joints[2].zero_rad = 1.0), "zero_rad");
    refused(&arm(|arm| arm.joints[2].shift_m[0] = -0.2), "shift_m");
    refused(&arm(|arm| arm.joints[2].flexibility_rad_per_nm = 1.0), "flexibility_rad_per_nm");
    refused(&arm(|arm| arm.joints[2].sigma[0] = -1.0), "standard deviation");
    refused(&arm(|arm| arm.deviations = vec![arm.deviations[0].clone(); 17]), "17 deviations");
    refused(&arm(|arm| arm.deviations[0].gauges[1].push(0.0)), "other joints, gauges or terms");
    refused(&arm(|arm| arm.deviations[0].gauges[1][6] = 11.0), "says more than the gauge's covariance");
}

#[test]
fn numbers_that_are_not_finite_are_refused() {
    let text = model(&rig()).to_toml();
    for (from, to) in [
        ("mass_kg = 0.01", "mass_kg = inf"),
        ("coefficient_counts = -1500.5", "coefficient_counts = nan"),
        ("gravity_turn_rad = [0.001", "gravity_turn_rad = [nan"),
        ("start_sigma = 0.25", "start_sigma = nan"),
    ] {
        let said = message(parse(&with(&text, from, to)));
        assert!(said.contains("finite") || said.contains("beyond"), "{said}");
    }
}

#[test]
fn corrections_of_another_arm_are_refused() {
    let rig = rig();
    let mut other = model(&rig);
    if let Some(arm) = &mut other.arm {
        arm.joints[3].name = "elbow".into();
    }
    assert!(message(load(&other.to_toml(), &rig)).contains("[[arm.joint]] tables are not those of the arm"));
    let mut light = model(&rig);
    if let Some(arm) = &mut light.arm {
        arm.joints[1].mass_kg = -1e3;
    }
    assert!(message(load(&light.to_toml(), &rig)).contains("would weigh"));
}
