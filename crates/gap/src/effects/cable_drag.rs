//! A cable that is bent as the joint turns: a spring in parallel with the sensor, slack where the joint stands at zero
//! (a cable that is slack elsewhere shows as a zero that is off as well).

use super::*;

/// A cable that is bent as the joint turns: a spring in parallel with the sensor.
pub(super) struct CableDrag;

impl Effect for CableDrag {
    fn id(&self) -> &'static str {
        "cable_drag"
    }

    fn words(&self) -> &'static str {
        "a cable or hose that pulls as the joint turns"
    }

    fn remedy(&self) -> &'static str {
        "lay the cable with more slack"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_moving_joint(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        joints_with_moments(session)
    }

    fn columns(&self, session: &Session, place: Place, _shape: &[f64]) -> Vec<Column> {
        let Place::Joint(joint) = place else { return Vec::new() };
        let moving = &session.joints[joint];
        let span = deviation(&moving.position_rad);
        if span <= 1e-6 {
            return Vec::new();
        }
        let mut columns = Vec::new();
        for (channel, per_nm) in moment_channels(session, joint) {
            let plausible = 3.0 * session.channels[channel].rms_gap() / per_nm.abs() / span;
            let turned = moving.position_rad.iter().map(|q| per_nm * q).collect();
            columns.push(Column::value("nm_per_rad", "Nm/rad", plausible, channel, turned).positive());
        }
        columns
    }

    fn experiment(&self) -> &'static str {
        "one joint turned through its whole range, slowly, both ways"
    }
}
