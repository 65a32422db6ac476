//! What hangs on the tip differs from what the simulation carries: a body rigidly fixed there.
//!
//! As [`super::link_mass`], at the tip; the same as the last link's mass wherever nothing is declared to hang there at times only.

use super::*;

/// A body at the tip.
pub(super) struct Payload;

impl Effect for Payload {
    fn id(&self) -> &'static str {
        "payload"
    }

    fn words(&self) -> &'static str {
        "what hangs on the tip"
    }

    fn remedy(&self) -> &'static str {
        "weigh the payload and its centre of mass"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        weight::without_arm(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        weight::arm(session).map(|_| Place::Tip).into_iter().collect()
    }

    fn columns(&self, session: &Session, place: Place, _shape: &[f64]) -> Vec<Column> {
        let _ = place;
        let Some(last) = weight::arm(session).and_then(|arm| arm.chain.joints.len().checked_sub(1)) else {
            return Vec::new();
        };
        weight::body_columns(session, last, weight::Naming::Payload)
    }

    fn experiment(&self) -> &'static str {
        "held poses far apart, with nothing at the tip and then with a known weight"
    }
}
