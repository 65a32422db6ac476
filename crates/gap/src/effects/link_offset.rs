//! A link that sits elsewhere on the one before: all that is outboard of the joint has another lever about what is inboard.
//!
//! A load is linear in where it acts: `dM = d x F` with the force F that the joint passes on. What the shift does to accelerations is left out.

use super::*;

/// Place of a link on the one before.
pub(super) struct LinkOffset;

impl Effect for LinkOffset {
    fn id(&self) -> &'static str {
        "link_offset"
    }

    fn words(&self) -> &'static str {
        "a link that sits elsewhere on the one before"
    }

    fn remedy(&self) -> &'static str {
        "measure the link, or correct the joint's origin in the URDF"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        // While the arm carries the same it is a first moment of the link before.
        let same = || (!arm::carries_by_turns(session)).then(|| WEIGHTS.to_owned());
        arm::without_masses(session).or_else(same)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        arm::links(session)
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, _shape: &[f64]) -> Vec<Column> {
        let Place::Link(link) = place else { return Vec::new() };
        arm::shift_columns(session, link)
    }

    fn experiment(&self) -> &'static str {
        "held poses far apart, with nothing at the tip and then with a known weight"
    }
}

const WEIGHTS: &str = "recordings with different weights at the tip (declared [[load]]s)";
