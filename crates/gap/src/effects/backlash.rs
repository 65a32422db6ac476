//! Play of a gear: the link stands on one side of it or the other, as its load pushes it.
//!
//! M. Nordin, P.-O. Gutman, Automatica 38, 2002. Under next to no torque it is between them.

use super::*;

/// Play of a joint's gear.
pub(super) struct Backlash;

/// Torque at which the link leans on one side, over the largest that the joint bears: play is taken up by little.
const TAKEN_UP: f64 = 0.02;
/// Play of a worn gear, rad.
const PLAY_RAD: f64 = 0.01;
/// The joint has to be loaded both ways for its play to show: the lesser share of the instants, at least.
const BOTH_WAYS: f64 = 0.02;

impl Effect for Backlash {
    fn id(&self) -> &'static str {
        "backlash"
    }

    fn words(&self) -> &'static str {
        "play of a joint's gear"
    }

    fn remedy(&self) -> &'static str {
        "adjust or replace the gear; measure the angle on the link's side"
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
        let is_pushed = |torque: &&f64| torque.abs() > TAKEN_UP * most_nm;
        let forth = torque_nm.iter().filter(is_pushed).filter(|torque| **torque > 0.0).count();
        let back = torque_nm.iter().filter(is_pushed).count() - forth;
        if (forth.min(back) as f64) < BOTH_WAYS * torque_nm.len() as f64 {
            return Vec::new();
        }
        let side = |row: usize| 0.5 * (torque_nm[row] / (TAKEN_UP * most_nm)).tanh();
        let columns = arm::turn_columns(session, joint, side, ("rad", "rad", PLAY_RAD));
        columns.into_iter().map(Column::positive).collect()
    }

    fn experiment(&self) -> &'static str {
        "poses in which weight turns each joint first one way, then the other"
    }
}
