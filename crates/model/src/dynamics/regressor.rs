//! Loads as linear functions of a link's ten inertial parameters.

use nalgebra::{SMatrix, Vector3};

use super::Dynamics;
use crate::spatial::{BODY_PARAMETERS, RigidBody};

impl Dynamics {
    /// Derivative of a section's load (N, Nm, about S, in S) by the ten parameters of a joint's child link.
    ///
    /// Parameters and their units as in [`RigidBody::parameters`], in the child link's frame; zero where the link is not
    /// outboard of the section. `joint` counts as in the chain's joints.
    #[must_use]
    pub fn regressor(&self, section: usize, joint: usize) -> SMatrix<f64, 6, BODY_PARAMETERS> {
        let mut columns = SMatrix::zeros();
        let at = self.sections[section];
        let Some((segment, link)) =
            self.links.get(joint).copied().flatten().filter(|(segment, _)| *segment >= at)
        else {
            return columns;
        };
        let motion = self.states[segment].motion.of(&link);
        let tip_in_link = link.inverse().compose(&self.states[segment].tip);
        let link_in_section = self.states[at].tip.compose(&tip_in_link.inverse());
        for parameter in 0..BODY_PARAMETERS {
            let mut parameters = [0.0; BODY_PARAMETERS];
            parameters[parameter] = 1.0;
            let (force, moment) = motion.load_of(&RigidBody::from_parameters(&parameters));
            let force: Vector3<f64> = link_in_section.rotation * force;
            let moment = link_in_section.rotation * moment + link_in_section.translation_m.cross(&force);
            columns.fixed_view_mut::<3, 1>(0, parameter).copy_from(&force);
            columns.fixed_view_mut::<3, 1>(3, parameter).copy_from(&moment);
        }
        columns
    }
}
