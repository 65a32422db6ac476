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
        arm::without_arm(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        arm::arm(session).map(|_| Place::Tip).into_iter().collect()
    }

    fn shapes(&self, session: &Session, _place: Place) -> Vec<Shape> {
        if arm::is_loaded(session) {
            vec![vec![DECLARED], vec![DECLARED, ITS_MASS], vec![ALWAYS]]
        } else {
            vec![vec![ALWAYS]]
        }
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, _place: Place, shape: &[f64]) -> Vec<Column> {
        if shape[0] == DECLARED {
            let mut columns = arm::declared_columns(session);
            columns.truncate(if shape.contains(&ITS_MASS) { 1 } else { columns.len() });
            return columns;
        }
        let Some(last) = arm::arm(session).and_then(|arm| arm.chain.joints.len().checked_sub(1)) else {
            return Vec::new();
        };
        arm::body_columns(session, last, arm::Naming::Undeclared)
    }

    fn experiment(&self) -> &'static str {
        "held poses far apart, with nothing at the tip and then with a known weight"
    }
}

/// The body that was declared is another one; only where one was declared.
const DECLARED: f64 = 0.0;
/// It hangs where it was declared, and only its mass is another one.
const ITS_MASS: f64 = 2.0;
/// A body hangs there all the time.
const ALWAYS: f64 = 1.0;
