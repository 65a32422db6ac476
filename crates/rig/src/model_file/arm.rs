//! `[arm]` of a model: what the calibration corrects of the URDF, and how sure it is of that together with the gauges.

use model::arm::{ArmCorrection, JOINT_NUMBERS, JointCorrection};
use model::chain::Chain;
use model::estimator::{ArmModel, Deviation, GAUGE_NUMBERS};
use serde::{Deserialize, Serialize};

/// Most directions of uncertainty that the cycle carries: each costs a pass over the arm.
pub const MOST_DEVIATIONS: usize = 16;

/// The arm as it is against its URDF.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arm {
    /// Groups of corrections that were worth having on held-out poses.
    pub admitted: Vec<String>,
    /// Turn of gravity in the base frame as a rotation vector, rad: the base leans the other way.
    pub gravity_turn_rad: [f64; 3],
    /// Its standard deviations, rad.
    pub gravity_turn_sigma_rad: [f64; 3],
    /// Corrections of every joint of the chain from base to tip, fixed ones included.
    #[serde(rename = "joint", default)]
    pub joints: Vec<ArmJoint>,
    /// Directions in which arm and gauges are uncertain together, each one standard deviation long.
    #[serde(rename = "deviation", default, skip_serializing_if = "Vec::is_empty")]
    pub deviations: Vec<ArmDeviation>,
}

/// How a joint and its child link differ from the URDF (child link's frame, but `shift_m` in the parent link's).
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmJoint {
    /// The joint's name.
    pub name: String,
    /// Mass beyond the URDF's, kg.
    pub mass_kg: f64,
    /// First moment beyond the URDF's, kg m.
    pub first_moment_kgm: [f64; 3],
    /// True position less the encoder's, rad.
    pub zero_rad: f64,
    /// Turn of the joint's frame as a rotation vector, rad.
    pub turn_rad: [f64; 3],
    /// Shift of the joint's origin, m.
    pub shift_m: [f64; 3],
    /// What the joint yields under torque about its axis, rad/Nm.
    pub flexibility_rad_per_nm: f64,
    /// Standard deviations in the order above: mass, first moment, zero, turn, shift, flexibility.
    pub sigma: [f64; JOINT_NUMBERS],
}

/// An arm and its gauges one standard deviation away, less the calibrated ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ArmDeviation {
    /// Turn of gravity, rad.
    pub gravity_turn_rad: [f64; 3],
    /// One a joint: mass (kg), first moment (kg m), zero (rad), turn (rad), shift (m), flexibility (rad/Nm).
    pub joints: Vec<[f64; JOINT_NUMBERS]>,
    /// One a gauge: compliance (counts/N, counts/Nm), bias (counts), terms (counts).
    pub gauges: Vec<Vec<f64>>,
}

impl ArmJoint {
    /// From a correction and its standard deviations.
    pub fn new(name: &str, value: &JointCorrection, sigma: &JointCorrection) -> Self {
        Self {
            name: name.to_owned(),
            mass_kg: value.mass_kg,
            first_moment_kgm: value.first_moment_kgm,
            zero_rad: value.zero_rad,
            turn_rad: value.turn_rad,
            shift_m: value.shift_m,
            flexibility_rad_per_nm: value.flexibility_rad_per_nm,
            sigma: sigma.array(),
        }
    }

    /// As the model takes it.
    pub fn correction(&self) -> JointCorrection {
        JointCorrection {
            mass_kg: self.mass_kg,
            first_moment_kgm: self.first_moment_kgm,
            zero_rad: self.zero_rad,
            turn_rad: self.turn_rad,
            shift_m: self.shift_m,
            flexibility_rad_per_nm: self.flexibility_rad_per_nm,
        }
    }
}

impl ArmDeviation {
    fn correction(&self) -> ArmCorrection {
        ArmCorrection {
            gravity_turn_rad: self.gravity_turn_rad,
            joints: self.joints.iter().map(JointCorrection::from_array).collect(),
        }
    }

    /// A gauge's part, padded with zeros.
    pub(super) fn gauge(&self, gauge: usize) -> [f64; GAUGE_NUMBERS] {
        let numbers = self.gauges.get(gauge).map_or(&[][..], |numbers| numbers);
        std::array::from_fn(|k| numbers.get(k).copied().unwrap_or(0.0))
    }
}

impl Arm {
    /// All corrections.
    pub fn correction(&self) -> ArmCorrection {
        ArmCorrection {
            gravity_turn_rad: self.gravity_turn_rad,
            joints: self.joints.iter().map(ArmJoint::correction).collect(),
        }
    }

    /// What the estimator takes beside the corrected chain; `chain` is the URDF's.
    pub fn model(&self, chain: &Chain) -> ArmModel {
        let calibrated = self.correction();
        let deviation = |deviation: &ArmDeviation| {
            let apart = deviation.correction();
            Deviation {
                chain: calibrated.plus(&apart).apply(chain),
                flexibility_rad_per_nm: apart.flexibility_rad_per_nm(chain),
                gauges: (0..deviation.gauges.len()).map(|gauge| deviation.gauge(gauge)).collect(),
            }
        };
        ArmModel {
            flexibility_rad_per_nm: calibrated.flexibility_rad_per_nm(chain),
            deviations: self.deviations.iter().map(deviation).collect(),
        }
    }

    /// Whether the numbers can be used, for gauges with so many terms each.
    pub(super) fn check(&self, terms: &[usize]) -> Result<(), String> {
        /// Larger corrections are another arm: rad, m, rad/Nm, a tenth of a turn each metre of everything.
        const LARGEST_TURN_RAD: f64 = 0.3;
        const LARGEST_SHIFT_M: f64 = 0.1;
        const LARGEST_FLEXIBILITY: f64 = 0.1;
        let within = |values: &[f64], most: f64| values.iter().all(|v| v.abs() <= most);
        if !within(&self.gravity_turn_rad, LARGEST_TURN_RAD) {
            return Err(format!("[arm] gravity_turn_rad = {:?} is beyond 0.3 rad", self.gravity_turn_rad));
        }
        for joint in &self.joints {
            let name = &joint.name;
            let turns = [joint.zero_rad, joint.turn_rad[0], joint.turn_rad[1], joint.turn_rad[2]];
            if !within(&turns, LARGEST_TURN_RAD) {
                return Err(format!("[arm] joint \"{name}\": zero_rad or turn_rad is beyond 0.3 rad"));
            }
            if !within(&joint.shift_m, LARGEST_SHIFT_M) {
                return Err(format!("[arm] joint \"{name}\": shift_m is beyond 0.1 m"));
            }
            if !within(&[joint.flexibility_rad_per_nm], LARGEST_FLEXIBILITY) {
                return Err(format!("[arm] joint \"{name}\": flexibility_rad_per_nm is beyond 0.1"));
            }
            if !joint.correction().array().iter().all(|v| v.is_finite()) {
                return Err(format!("[arm] joint \"{name}\" has a number that is not finite"));
            }
            if !joint.sigma.iter().all(|v| *v >= 0.0 && v.is_finite()) {
                return Err(format!("[arm] joint \"{name}\" has a standard deviation that is none"));
            }
        }
        if self.deviations.len() > MOST_DEVIATIONS {
            let n = self.deviations.len();
            return Err(format!("[arm] has {n} deviations, more than {MOST_DEVIATIONS}"));
        }
        for deviation in &self.deviations {
            let sizes = deviation.gauges.iter().map(Vec::len);
            if deviation.joints.len() != self.joints.len() || !sizes.eq(terms.iter().map(|n| 7 + n)) {
                return Err("[arm] has a deviation for other joints, gauges or terms than the model".into());
            }
            let gauges = deviation.gauges.iter().flatten();
            let all = deviation.joints.iter().flatten().chain(gauges).chain(&deviation.gravity_turn_rad);
            if !all.into_iter().all(|v| v.is_finite()) {
                return Err("[arm] has a deviation with a number that is not finite".into());
            }
        }
        Ok(())
    }

    /// Whether these corrections fit this chain.
    pub(super) fn check_chain(&self, chain: &Chain) -> Result<(), String> {
        let names = chain.joints.iter().map(|j| j.name.as_str());
        if !self.joints.iter().map(|j| j.name.as_str()).eq(names.clone()) {
            let names = names.collect::<Vec<_>>().join(", ");
            return Err(format!("its [[arm.joint]] tables are not those of the arm, {names}"));
        }
        for (joint, correction) in chain.joints.iter().zip(&self.joints) {
            let mass_kg = joint.body.mass_kg + correction.mass_kg;
            if mass_kg < 0.0 {
                return Err(format!("[arm] joint \"{}\": its link would weigh {mass_kg} kg", joint.name));
            }
        }
        Ok(())
    }
}
