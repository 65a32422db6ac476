//! Found effects as changes of the calibrated model, where the daemon can compensate them.

use rig::model_file::{Arm, ArmJoint, Components, EffectShape, SensorTerm};
use rig::{ModelFile, Rig};

use crate::diagnosis::Diagnosis;
use crate::effects::Compensation;
use model::terms::MOST_TERMS;

/// The model with the found effects in it, and the effects that it cannot hold.
///
/// Covariances stay as they were: what was found is far better known than what it replaces was wrong by.
#[must_use]
pub fn apply(model: &ModelFile, rig: &Rig, diagnosis: &Diagnosis) -> (ModelFile, Vec<String>) {
    let mut model = model.clone();
    let mut left = Vec::new();
    for finding in &diagnosis.findings {
        let taken = finding.compensations.iter().all(|change| tell(&mut model, rig, change));
        if finding.compensations.is_empty() || !taken {
            left.push(finding.effect.clone());
        }
    }
    (model, left)
}

/// Whether the model could take the change in.
fn tell(model: &mut ModelFile, rig: &Rig, change: &Compensation) -> bool {
    match change {
        Compensation::Bias { gauge, counts } => model.sensors[*gauge].bias_counts += counts,
        Compensation::Compliance { gauge, change } => turn(&mut model.sensors[*gauge], change),
        Compensation::Zero { coordinate, rad } => zero(model, rig, *coordinate, *rad),
        Compensation::Term { gauge, effect, counts, scaling } => {
            let sensor = &mut model.sensors[*gauge];
            if sensor.terms.len() >= MOST_TERMS {
                return false;
            }
            if sensor.terms.is_empty() {
                [sensor.centre_counts, sensor.scale_counts] = *scaling;
            }
            let covariance = vec![0.0; 8 + sensor.terms.len()];
            sensor.terms.push(SensorTerm {
                effect: EffectShape::from(*effect),
                coefficient_counts: *counts,
                coefficient_sigma_counts: 0.0,
                start_sigma: 0.0,
                covariance,
            });
        }
    }
    true
}

fn turn(sensor: &mut rig::model_file::Sensor, change: &nalgebra::Vector6<f64>) {
    let compliance = sensor.working() + change;
    sensor.compliance = Components::from_array(std::array::from_fn(|k| Some(compliance[k])));
    if let Some(working) = &mut sensor.working_compliance {
        *working = std::array::from_fn(|k| compliance[k]);
    }
    let derived = model::sensing::Compliance::from_vector(&compliance);
    sensor.crosstalk_percent = Some(derived.crosstalk_percent(sensor.crosstalk_length_m));
    if let Some(frame) = derived.actual_frame() {
        let numbers =
            [frame.r_counts_per_nm, frame.a_x_rad, frame.a_y_rad, frame.l_x_m, frame.l_y_m, frame.pitch_m];
        sensor.frame = rig::model_file::Frame::from_array(numbers.map(Some));
    }
}

fn zero(model: &mut ModelFile, rig: &Rig, coordinate: usize, rad: f64) {
    let joints = &rig.chain.joints;
    let arm = model.arm.get_or_insert_with(|| Arm {
        joints: joints
            .iter()
            .map(|joint| ArmJoint { name: joint.name.clone(), ..ArmJoint::default() })
            .collect(),
        ..Arm::default()
    });
    for (own, joint) in arm.joints.iter_mut().zip(joints) {
        if joint.coordinate == Some(coordinate) {
            own.zero_rad += rad;
        }
    }
}
