//! The arm as it is against its URDF: what a calibration corrects of masses, placements, encoder zeros, joints and gravity.

use nalgebra::{Matrix3, Rotation3, Vector3};

use crate::chain::{Chain, Joint};
use crate::spatial::{Pose, RigidBody};

/// Numbers of one joint's correction.
pub const JOINT_NUMBERS: usize = 12;

/// How one joint and its child link differ from the URDF (child link's frame at position zero, SI).
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct JointCorrection {
    /// Mass of the child link and all that belongs to it beyond the URDF's, kg.
    pub mass_kg: f64,
    /// Its first moment beyond the URDF's, kg m, child link's frame.
    pub first_moment_kgm: [f64; 3],
    /// True position less the encoder's, rad.
    pub zero_rad: f64,
    /// Turn of the joint's frame (a rotation vector), rad, child link's frame.
    pub turn_rad: [f64; 3],
    /// Shift of the joint's origin, m, parent link's frame.
    pub shift_m: [f64; 3],
    /// What the joint yields under torque about its axis, rad/Nm: position of the link = encoder + this * load's torque.
    pub flexibility_rad_per_nm: f64,
}

impl JointCorrection {
    /// In the order mass (kg), first moment (kg m), zero (rad), turn (rad), shift (m), flexibility (rad/Nm).
    #[must_use]
    pub fn array(&self) -> [f64; JOINT_NUMBERS] {
        let ([hx, hy, hz], [a, b, c], [x, y, z]) = (self.first_moment_kgm, self.turn_rad, self.shift_m);
        [self.mass_kg, hx, hy, hz, self.zero_rad, a, b, c, x, y, z, self.flexibility_rad_per_nm]
    }

    /// From the order of [`Self::array`] (kg, kg m, rad, m, rad/Nm).
    #[must_use]
    pub fn from_array(n: &[f64; JOINT_NUMBERS]) -> Self {
        Self {
            mass_kg: n[0],
            first_moment_kgm: [n[1], n[2], n[3]],
            zero_rad: n[4],
            turn_rad: [n[5], n[6], n[7]],
            shift_m: [n[8], n[9], n[10]],
            flexibility_rad_per_nm: n[11],
        }
    }

    fn apply(&self, joint: &mut Joint) {
        joint.body += RigidBody {
            mass_kg: self.mass_kg,
            first_moment_kgm: Vector3::from(self.first_moment_kgm),
            inertia_kgm2: Matrix3::zeros(),
        };
        let turn = rotation(&Vector3::from(self.turn_rad)) * rotation(&(joint.axis * self.zero_rad));
        joint.origin = Pose {
            translation_m: joint.origin.translation_m + Vector3::from(self.shift_m),
            rotation: joint.origin.rotation * turn,
        };
    }
}

/// How an arm differs from its URDF.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ArmCorrection {
    /// Turn of gravity in the base frame (a rotation vector), rad: the base leans the other way.
    pub gravity_turn_rad: [f64; 3],
    /// One a joint of the chain, fixed ones included, from base to tip; empty where nothing is corrected.
    pub joints: Vec<JointCorrection>,
}

impl ArmCorrection {
    /// The chain with these corrections (SI); what the joints yield is not in it, since it depends on the load.
    #[must_use]
    pub fn apply(&self, chain: &Chain) -> Chain {
        let mut corrected = chain.clone();
        corrected.gravity_mps2 = rotation(&Vector3::from(self.gravity_turn_rad)) * chain.gravity_mps2;
        for (joint, correction) in corrected.joints.iter_mut().zip(&self.joints) {
            correction.apply(joint);
        }
        corrected
    }

    /// What each coordinate's joint yields, rad/Nm.
    #[must_use]
    pub fn flexibility_rad_per_nm(&self, chain: &Chain) -> Vec<f64> {
        let moving = chain.joints.iter().enumerate().filter(|(_, joint)| joint.coordinate.is_some());
        moving.map(|(k, _)| self.joints.get(k).map_or(0.0, |joint| joint.flexibility_rad_per_nm)).collect()
    }

    /// Both corrections together, number by number (the turns are small enough to add).
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        let sum3 = |a: &[f64; 3], b: &[f64; 3]| std::array::from_fn(|k| a[k] + b[k]);
        let (mine, theirs) = (&self.joints, &other.joints);
        let joint = |of: &[JointCorrection], k: usize| of.get(k).copied().unwrap_or_default().array();
        Self {
            gravity_turn_rad: sum3(&self.gravity_turn_rad, &other.gravity_turn_rad),
            joints: (0..mine.len().max(theirs.len()))
                .map(|k| {
                    let (a, b) = (joint(mine, k), joint(theirs, k));
                    JointCorrection::from_array(&std::array::from_fn(|n| a[n] + b[n]))
                })
                .collect(),
        }
    }
}

fn rotation(vector_rad: &Vector3<f64>) -> Matrix3<f64> {
    Rotation3::new(*vector_rad).into_inner()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use crate::chain::Section;
    use crate::dynamics::Dynamics;

    const ARM: &str = include_str!("../tests/data/arm_a.urdf");

    fn arm() -> Chain {
        Chain::from_urdf(ARM, "arm_a.urdf", "base_link", "tool0", Vector3::new(0.0, 0.0, -9.80665)).unwrap()
    }

    fn load(chain: &Chain, q: &[f64]) -> nalgebra::Vector6<f64> {
        let mut dynamics = Dynamics::new(chain, &[Section::new(chain, "joint_2", None).unwrap()]);
        dynamics.update_static(q);
        dynamics.load(0)
    }

    #[test]
    fn a_zero_is_the_same_as_another_position() {
        let chain = arm();
        let mut correction = ArmCorrection {
            joints: vec![JointCorrection::default(); chain.joints.len()],
            ..Default::default()
        };
        correction.joints[chain.joint_index("joint_3").unwrap()].zero_rad = 0.02;
        let q = [0.3, -0.9, 0.8, 0.4, -0.7, 0.2];
        let mut moved = q;
        moved[2] += 0.02;
        assert!((load(&correction.apply(&chain), &q) - load(&chain, &moved)).amax() < 1e-12);
    }

    #[test]
    fn mass_and_first_moment_add_to_the_link_and_gravity_keeps_its_length() {
        let chain = arm();
        let mut correction = ArmCorrection {
            joints: vec![JointCorrection::default(); chain.joints.len()],
            ..Default::default()
        };
        let last = chain.joints.len() - 1;
        correction.joints[last].mass_kg = 0.5;
        correction.joints[last].first_moment_kgm = [0.0, 0.01, 0.02];
        let body = RigidBody::from_com(0.5, Vector3::new(0.0, 0.02, 0.04), Matrix3::zeros());
        let tool = chain.clone().with_tool(0.5, Vector3::new(0.0, 0.02, 0.04), Matrix3::zeros());
        let q = [0.3, -0.9, 0.8, 0.4, -0.7, 0.2];
        assert!((body.first_moment_kgm - Vector3::new(0.0, 0.01, 0.02)).amax() < 1e-15);
        assert!((load(&correction.apply(&chain), &q) - load(&tool, &q)).amax() < 1e-12);
        correction.gravity_turn_rad = [0.01, -0.02, 0.0];
        let gravity = correction.apply(&chain).gravity_mps2;
        assert!((gravity.norm() - 9.80665).abs() < 1e-12 && (gravity.x - 0.02 * 9.80665).abs() < 1e-3);
    }

    #[test]
    fn corrections_add_number_by_number() {
        let one = JointCorrection::from_array(&std::array::from_fn(|k| k as f64));
        assert_eq!(one.array()[11], one.flexibility_rad_per_nm);
        let arm = ArmCorrection { gravity_turn_rad: [1.0, 2.0, 3.0], joints: vec![one] };
        let twice = arm.plus(&arm);
        assert_eq!(twice.gravity_turn_rad, [2.0, 4.0, 6.0]);
        assert_eq!(twice.joints[0].array(), std::array::from_fn(|k| 2.0 * k as f64));
        assert_eq!(ArmCorrection::default().plus(&arm), arm);
    }
}
