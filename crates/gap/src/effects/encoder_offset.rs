//! A joint's zero that is off: loads are those of another pose, 0.05..0.5 deg as a rule.

use super::*;

/// A joint's zero that is off: loads are those of another pose, 0.05..0.5 deg as a rule.
pub(super) struct EncoderOffset;

impl Effect for EncoderOffset {
    fn id(&self) -> &'static str {
        "encoder_offset"
    }

    fn words(&self) -> &'static str {
        "a joint's zero that is off"
    }

    fn remedy(&self) -> &'static str {
        "set the joint's zero again"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        arm::without_masses(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        arm::coordinates(session)
    }

    fn shapes(&self, session: &Session, _place: Place) -> Vec<Shape> {
        if arm::bends(session) { vec![TANGENT, vec![ARC]] } else { vec![TANGENT] }
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Joint(joint) = place else { return Vec::new() };
        if shape.is_empty() {
            return arm::turn_columns(session, joint, |_| 1.0, ("rad", "rad", arm::ZERO_RAD));
        }
        arm::bent_columns(session, joint)
    }

    fn compensate(&self, _session: &Session, term: &Fitted<'_>) -> Vec<Compensation> {
        let Place::Joint(coordinate) = term.place else { return Vec::new() };
        term.values.first().map(|rad| Compensation::Zero { coordinate, rad: *rad }).into_iter().collect()
    }

    fn experiment(&self) -> &'static str {
        "held poses far apart, with a known weight at the tip"
    }
}

/// A turn so small that loads change in proportion to it, or one that bends them.
const TANGENT: Shape = Shape::new();
const ARC: f64 = 1.0;
