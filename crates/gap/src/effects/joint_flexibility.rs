//! A joint that gives under its load: the pose is off by torque over stiffness, 1e3..3e4 Nm/rad, less at small joints.
//!
//! M. Spong, J. Dyn. Sys. Meas. Control 109, 1987. To first order in the compliance, which is what is fitted.

use super::*;

/// Compliance of an arm's large joints, rad/Nm.
const STIFF_RAD_PER_NM: f64 = 1e-3;
/// A small joint is softer: by so much any may give under the largest torque that it bears, rad ...
const USUAL_RAD: f64 = 0.05;
/// ... but none is softer than this, rad/Nm.
const SOFT_RAD_PER_NM: f64 = 0.1;

/// Compliance of a joint.
pub(super) struct JointFlexibility;

impl Effect for JointFlexibility {
    fn id(&self) -> &'static str {
        "joint_flexibility"
    }

    fn words(&self) -> &'static str {
        "a joint that gives under its load"
    }

    fn remedy(&self) -> &'static str {
        "put the stiffness into the simulation"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        arm::without_masses(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        arm::coordinates(session)
    }

    fn columns(&self, session: &Session, place: Place, _shape: &[f64]) -> Vec<Column> {
        let Place::Joint(joint) = place else { return Vec::new() };
        let Some(torque_nm) = arm::yielding_torque_nm(session, joint) else { return Vec::new() };
        let most_nm = largest(&torque_nm);
        let plausible = STIFF_RAD_PER_NM.max(USUAL_RAD / most_nm.max(f64::MIN_POSITIVE));
        let heading = ("nm_per_rad", "Nm/rad", plausible.min(SOFT_RAD_PER_NM));
        let columns = arm::turn_columns(session, joint, |row| torque_nm[row], heading);
        columns.into_iter().map(|column| column.positive().role(Role::Inverse)).collect()
    }

    fn experiment(&self) -> &'static str {
        "held poses far apart, with a known weight at the tip"
    }
}
