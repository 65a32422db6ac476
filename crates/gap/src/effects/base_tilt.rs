//! A base that does not stand as in the simulation: gravity turned about two horizontal axes, 0.1..0.5 deg as a rule.

use super::*;

/// A base that does not stand as in the simulation: gravity turned about two horizontal axes, 0.1..0.5 deg as a rule.
pub(super) struct BaseTilt;

impl Effect for BaseTilt {
    fn id(&self) -> &'static str {
        "base_tilt"
    }

    fn words(&self) -> &'static str {
        "a base that does not stand level"
    }

    fn remedy(&self) -> &'static str {
        "level the base, or turn gravity in the simulation"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        arm::without_masses(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        arm::arm(session).map(|_| Place::Base).into_iter().collect()
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, _shape: &[f64]) -> Vec<Column> {
        let _ = place;
        arm::tilt_columns(session)
    }

    fn experiment(&self) -> &'static str {
        "the first joint turned through its range with the arm stretched out"
    }
}
