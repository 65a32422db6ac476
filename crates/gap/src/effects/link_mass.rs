//! Mass and first moments of a link that differ from the simulation's.
//!
//! Joint torques are linear in a link's inertial parameters (C. G. Atkeson, C. H. An, J. M. Hollerbach, Int. J. Robotics Research 5(3), 1986).
//! Where the URDF knows the link's mass, mass and inertia scale together (`relative_mass`); else the mass stands by itself.

use super::*;

/// The link is heavier or lighter in all its parts; else its centre of mass may be elsewhere, too.
const AS_A_WHOLE: f64 = 1.0;

/// Inertial parameters of a link.
pub(super) struct LinkMass;

impl Effect for LinkMass {
    fn id(&self) -> &'static str {
        "link_mass"
    }

    fn words(&self) -> &'static str {
        "mass or centre of mass of a link"
    }

    fn remedy(&self) -> &'static str {
        "weigh the link, or identify its mass in the simulation"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        arm::without_arm(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        arm::links(session)
    }

    fn shapes(&self, _session: &Session, _place: Place) -> Vec<Shape> {
        vec![Shape::new(), vec![AS_A_WHOLE]]
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Link(link) = place else { return Vec::new() };
        let mut columns = arm::body_columns(session, link, arm::Naming::Link);
        if shape.contains(&AS_A_WHOLE) {
            columns.retain(|column| column.parameter == arm::RELATIVE_MASS);
        }
        columns
    }

    fn experiment(&self) -> &'static str {
        "held poses far apart, with nothing at the tip and then with a known weight"
    }
}
