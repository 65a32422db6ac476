//! The arm as a serial chain of links from base to tip, and the sections at which gauges sit.

use nalgebra::{Matrix3, Vector3};

use crate::error::{UrdfError, suggestion};
use crate::spatial::{Pose, RigidBody, rotation_about};

/// How a joint's child moves against its parent.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JointKind {
    /// Turns about its axis within limits.
    Revolute,
    /// Turns about its axis without limits of position.
    Continuous,
    /// Does not move.
    Fixed,
}

/// Limits of a joint's position (rad), speed (rad/s) and torque (Nm); infinite where the URDF gives none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Limits {
    /// Lowest position, rad.
    pub lower_rad: f64,
    /// Highest position, rad.
    pub upper_rad: f64,
    /// Highest speed, rad/s.
    pub velocity_rad_s: f64,
    /// Highest torque about the axis, Nm.
    pub effort_nm: f64,
}

/// One joint of the chain with its child link (frames: child link; SI).
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// The joint's name in the URDF.
    pub name: String,
    /// The child link's name in the URDF.
    pub child_link: String,
    /// How the child moves against the parent.
    pub kind: JointKind,
    /// Axis of rotation, unit vector in the child link's frame (z for a fixed joint).
    pub axis: Vector3<f64>,
    /// The child link's frame at position zero, seen from the parent link's frame (m).
    pub origin: Pose,
    /// The child link and all that branches off from it, child link's frame (kg, kg m, kg m^2).
    pub body: RigidBody,
    /// Limits of the movement, if the URDF states any.
    pub limits: Option<Limits>,
    /// Index of this joint's position (rad) among the chain's coordinates; none for a fixed joint.
    pub coordinate: Option<usize>,
}

/// Serial chain of links from base to tip, with gravity (m/s^2, base frame).
///
/// The fields are public so that a calibration can correct masses, placements and gravity.
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// Joints in order from base to tip, fixed ones included; the last one's child is the tip.
    pub joints: Vec<Joint>,
    /// Acceleration of free fall in the base frame, m/s^2.
    pub gravity_mps2: Vector3<f64>,
    /// Name of the base link (frame W).
    pub base: String,
    /// Name of the tip link (frame E).
    pub tip: String,
    /// What the reader should know about the URDF although it can be used, one line each.
    pub warnings: Vec<String>,
    /// Where the chain came from, for messages.
    pub file_name: String,
    /// Joints of the URDF that are not on the chain.
    pub other_joints: Vec<String>,
}

impl Chain {
    /// Number of positions (rad) that describe the arm.
    #[must_use]
    pub fn coordinates(&self) -> usize {
        self.joints.iter().filter(|joint| joint.coordinate.is_some()).count()
    }

    /// Names of the moving joints, in the order of the coordinates (rad).
    #[must_use]
    pub fn coordinate_names(&self) -> Vec<&str> {
        self.joints
            .iter()
            .filter(|joint| joint.coordinate.is_some())
            .map(|joint| joint.name.as_str())
            .collect()
    }

    /// Index among the joints of the one with this name.
    #[must_use]
    pub fn joint_index(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|joint| joint.name == name)
    }

    /// The chain with a tool rigidly at the tip: mass (kg), centre of mass (m) and inertia about it (kg m^2), tip frame.
    #[must_use]
    pub fn with_tool(mut self, mass_kg: f64, com_m: Vector3<f64>, inertia_kgm2: Matrix3<f64>) -> Self {
        if let Some(last) = self.joints.last_mut() {
            last.body += RigidBody::from_com(mass_kg, com_m, inertia_kgm2);
        }
        self
    }

    /// Placement (m) of every joint's child link in the base frame for the positions `positions_rad` (rad).
    ///
    /// For set-up and offline use; a missing position counts as zero.
    #[must_use]
    pub fn placements(&self, positions_rad: &[f64]) -> Vec<Pose> {
        let mut placed = Pose::identity();
        let mut placements = Vec::with_capacity(self.joints.len());
        for joint in &self.joints {
            placed = placed.compose(&joint.origin);
            if let Some(angle_rad) = joint.coordinate.and_then(|index| positions_rad.get(index)) {
                placed.rotation *= rotation_about(&joint.axis, *angle_rad);
            }
            placements.push(placed);
        }
        placements
    }
}

/// A cut through the arm at which a gauge sits, with its nominal sensing frame S (origin: the child link's).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Section {
    /// Index of the joint in [`Chain::joints`]; the section feels everything outboard of that joint.
    pub joint: usize,
    /// Takes components in S to components in the child link's frame.
    pub r_cs: Matrix3<f64>,
}

impl Section {
    /// Section at the named joint, sensing about `axis` (child link's frame, any length).
    ///
    /// S is the child link's frame turned by the smallest rotation that takes z to the axis; for the axis -z that is
    /// half a turn about x. Without an axis the joint's own is taken, z for a fixed joint.
    ///
    /// # Errors
    /// The chain has no such joint, or the axis has no direction.
    pub fn new(chain: &Chain, joint_name: &str, axis: Option<[f64; 3]>) -> Result<Self, UrdfError> {
        let joint = chain.joint_index(joint_name).ok_or_else(|| {
            let name = joint_name.to_owned();
            if chain.other_joints.contains(&name) {
                return UrdfError::OffChain { name, base: chain.base.clone(), tip: chain.tip.clone() };
            }
            let names = chain.joints.iter().map(|joint| joint.name.as_str());
            UrdfError::UnknownSection {
                suggestion: suggestion(joint_name, names),
                name,
                file: chain.file_name.clone(),
            }
        })?;
        let sensing = match axis {
            Some(axis) => unit(&Vector3::from(axis))
                .ok_or_else(|| UrdfError::SectionAxis { name: joint_name.to_owned(), axis })?,
            None if chain.joints[joint].kind == JointKind::Fixed => Vector3::z(),
            None => chain.joints[joint].axis,
        };
        Ok(Self { joint, r_cs: rotation_from_z(&sensing) })
    }
}

/// Smallest rotation that takes z to the unit vector `axis`; half a turn about x for -z.
#[must_use]
pub fn rotation_from_z(axis: &Vector3<f64>) -> Matrix3<f64> {
    let (x, y, z) = (axis.x, axis.y, axis.z);
    let sin_squared = x * x + y * y;
    if sin_squared == 0.0 {
        return if z >= 0.0 {
            Matrix3::identity()
        } else {
            Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0))
        };
    }
    // (1 - cos) / sin^2 = 1 / (1 + cos), the second form being accurate in the upper half, the first in the lower.
    let k = if z >= 0.0 { 1.0 / (1.0 + z) } else { (1.0 - z) / sin_squared };
    Matrix3::new(1.0 - k * x * x, -k * x * y, x, -k * x * y, 1.0 - k * y * y, y, -x, -y, z)
}

/// The direction of a vector; none if it has none (zero, infinite or not a number).
pub(crate) fn unit(vector: &Vector3<f64>) -> Option<Vector3<f64>> {
    let largest = vector.amax();
    if !(largest > 0.0 && largest.is_finite() && vector.iter().all(|component| component.is_finite())) {
        return None;
    }
    let scaled = vector / largest;
    Some(scaled / scaled.norm())
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    const ARM_B: &str = include_str!("../tests/data/arm_b.urdf");

    fn arm_b() -> Chain {
        Chain::from_urdf(ARM_B, "arm_b.urdf", "pedestal", "point", Vector3::new(0.0, 0.0, -9.8)).unwrap()
    }

    #[test]
    fn the_smallest_rotation_takes_z_to_the_axis() {
        let axes = [
            [0.36, 0.48, 0.8],
            [0.36, 0.48, -0.8],
            [1.0, 0.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, 1.0],
            [1e-9, 2e-9, 1.0],
            [1e-9, -2e-9, -1.0],
            [1e-3, 1e-4, -1.0],
        ];
        for axis in axes.map(|axis| unit(&Vector3::from(axis)).unwrap()) {
            let turned = rotation_from_z(&axis);
            assert!((turned * Vector3::z() - axis).amax() < 1e-15, "{axis}");
            assert!((turned * turned.transpose() - Matrix3::identity()).amax() < 1e-14, "{axis}");
            assert!((turned.determinant() - 1.0).abs() < 1e-14, "{axis}");
            let library = Rotation3::rotation_between(&Vector3::z(), &axis).unwrap();
            assert!((turned - library.into_inner()).amax() < 1e-6, "{axis}");
        }
        let half_turn = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        assert_eq!(rotation_from_z(&-Vector3::z()), half_turn);
    }

    #[test]
    fn sections_sense_about_their_joint_s_axis_unless_told() {
        let chain = arm_b();
        let sensing = |name: &str, axis| Section::new(&chain, name, axis).unwrap().r_cs * Vector3::z();
        assert!((sensing("a2", None) - Vector3::new(0.36, 0.48, 0.8)).amax() < 1e-15);
        assert_eq!(sensing("a1", None), -Vector3::z());
        assert_eq!(sensing("cut_1", None), Vector3::z());
        assert!((sensing("cut_1", Some([0.0, 3.0, 4.0])) - Vector3::new(0.0, 0.6, 0.8)).amax() < 1e-15);
    }

    #[test]
    fn sections_that_cannot_be_are_refused() {
        let chain = arm_b();
        let words = |name: &str, axis| Section::new(&chain, name, axis).unwrap_err().to_string();
        assert!(
            words("cut_3", None).contains("no joint of the URDF (nearest: \"cut_"),
            "{}",
            words("cut_3", None)
        );
        assert!(words("grip", None).contains("not between base \"pedestal\" and tip \"point\""));
        assert!(words("a1", Some([0.0; 3])).contains("no direction"));
        assert!(words("a1", Some([0.0, f64::NAN, 1.0])).contains("no direction"));
    }

    #[test]
    fn a_tool_belongs_to_the_last_body() {
        let (bare, com) = (arm_b(), Vector3::new(0.1, 0.0, 0.05));
        let tooled = bare.clone().with_tool(2.0, com, Matrix3::identity() * 0.01);
        let before = bare.joints.last().unwrap().body;
        let after = tooled.joints.last().unwrap().body;
        assert_eq!(after, before + RigidBody::from_com(2.0, com, Matrix3::identity() * 0.01));
        assert_eq!(bare.joints[..bare.joints.len() - 1], tooled.joints[..bare.joints.len() - 1]);
    }
}
