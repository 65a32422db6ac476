//! A cable that is bent as the joint turns: a spring in parallel with the sensor.

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
        let middle = mean(&moving.position_rad);
        let span = deviation(&moving.position_rad);
        if span <= 1e-6 {
            return Vec::new();
        }
        let turned: Vec<f64> = moving.position_rad.iter().map(|q| q - middle).collect();
        // Where the cable is slack is not known: a constant comes along.
        let mut columns = Vec::new();
        for channel in moment_channels(session, joint) {
            let size_nm = 3.0 * session.channels[channel].rms_gap();
            let constant = Column::value("", "Nm", size_nm, channel, vec![1.0; session.rows()]);
            columns.push(Column::value("nm_per_rad", "Nm/rad", size_nm / span, channel, turned.clone()).positive());
            columns.push(constant.role(Role::Nuisance));
        }
        columns
    }

    fn experiment(&self) -> &'static str {
        "one joint turned through its whole range, slowly, both ways"
    }
}
