//! Links as rigid bodies, with what branches off them.

use nalgebra::{Matrix3, Vector3};
use urdf_rs::JointType;

use super::UrdfError;
use super::tree::Tree;
use crate::spatial::{Pose, RigidBody};

/// Relative rounding of inertias as URDFs print them.
const INERTIA_TOLERANCE: f64 = 1e-3;

impl Tree<'_> {
    /// A link with everything that branches off from it, in the link's frame.
    pub(super) fn lump(
        &self,
        link: usize,
        way: &[usize],
        warnings: &mut Vec<String>,
    ) -> Result<RigidBody, UrdfError> {
        let mut lumped = RigidBody::zero();
        let mut seen = vec![false; self.robot.links.len()];
        let mut open = vec![(link, Pose::identity())];
        while let Some((link, pose)) = open.pop() {
            if std::mem::replace(&mut seen[link], true) {
                continue;
            }
            lumped += self.body(link, warnings)?.transformed(&pose);
            for &index in self.children[link].iter().filter(|index| !way.contains(index)) {
                let joint = &self.robot.joints[index];
                if joint.joint_type != JointType::Fixed {
                    warnings.push(format!(
                        "joint \"{}\" branches off between base and tip and moves; link \"{}\" and what hangs on it \
                         count as fixed at position zero",
                        joint.name, joint.child.link
                    ));
                }
                open.push((
                    self.end(index, "child")?,
                    pose.compose(&self.pose("joint", &joint.name, &joint.origin)?),
                ));
            }
        }
        Ok(lumped)
    }

    /// A link's own inertia in its frame, checked.
    fn body(&self, link: usize, warnings: &mut Vec<String>) -> Result<RigidBody, UrdfError> {
        let link = &self.robot.links[link];
        let (mass_kg, given) = (link.inertial.mass.value, &link.inertial.inertia);
        let inertia = Matrix3::new(
            given.ixx, given.ixy, given.ixz, given.ixy, given.iyy, given.iyz, given.ixz, given.iyz, given.izz,
        );
        if !(mass_kg.is_finite() && mass_kg >= 0.0) {
            return Err(self.number(
                "link",
                &link.name,
                format!("a mass of {mass_kg} kg, which is not zero or more"),
            ));
        }
        if !inertia.iter().all(|entry| entry.is_finite()) {
            return Err(self.number("link", &link.name, "an inertia that is not finite".to_owned()));
        }
        let scale = inertia.amax().max(f64::MIN_POSITIVE);
        let mut principal = (inertia / scale).symmetric_eigenvalues() * scale;
        principal.as_mut_slice().sort_by(f64::total_cmp);
        let rounding = INERTIA_TOLERANCE * principal[2].abs();
        if principal[0] < -rounding {
            let what = format!("an inertia with the negative principal moment {:.3e} kg m^2", principal[0]);
            return Err(self.number("link", &link.name, what));
        }
        if principal[0] + principal[1] < principal[2] - rounding {
            warnings.push(format!(
                "link \"{}\": no body has the principal moments {:.3e}, {:.3e}, {:.3e} kg m^2 (the largest exceeds the \
                 sum of the others); used as it stands",
                link.name, principal[0], principal[1], principal[2]
            ));
        }
        let pose = self.pose("link", &link.name, &link.inertial.origin)?;
        Ok(RigidBody::from_com(mass_kg, Vector3::zeros(), inertia).transformed(&pose))
    }

    pub(super) fn pose(
        &self,
        element: &'static str,
        name: &str,
        given: &urdf_rs::Pose,
    ) -> Result<Pose, UrdfError> {
        if given.xyz.iter().chain(given.rpy.iter()).all(|number| number.is_finite()) {
            return Ok(Pose::from_xyz_rpy(given.xyz.0, given.rpy.0));
        }
        Err(self.number(element, name, "an origin that is not finite".to_owned()))
    }

    pub(super) fn number(&self, element: &'static str, name: &str, what: String) -> UrdfError {
        UrdfError::Number { file: self.file.to_owned(), element, name: name.to_owned(), what }
    }
}
