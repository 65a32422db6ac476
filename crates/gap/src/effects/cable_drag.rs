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

    fn shapes(&self, session: &Session, _place: Place) -> Vec<Shape> {
        let is_of_gauges = session.channels.iter().any(|channel| channel.gauge.is_some());
        if is_of_gauges { vec![vec![STRAIGHT], vec![STIFFENING]] } else { vec![vec![STRAIGHT]] }
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Joint(joint) = place else { return Vec::new() };
        let moving = &session.joints[joint];
        let span = deviation(&moving.position_rad);
        if span <= 1e-6 {
            return Vec::new();
        }
        let mut columns = Vec::new();
        for (channel, per_nm) in moment_channels(session, joint) {
            let per_nm = relief(session, channel) * per_nm;
            let plausible = 3.0 * session.channels[channel].rms_gap() / per_nm.abs() / span;
            let turned = moving.position_rad.iter().map(|q| per_nm * q).collect();
            columns.push(
                Column::value("nm_per_rad", "Nm/rad", plausible, channel, turned).braking(session, channel),
            );
            if shape[0] == STIFFENING {
                let unit = &session.channels[channel].unit;
                let cubes = moving.position_rad.iter().map(|q| per_nm * q.powi(3)).collect();
                let rows = vec![per_nm; session.rows()];
                for (values, power) in [(rows, 0), (cubes, 3)] {
                    let size = plausible * span / span.powi(power);
                    columns.push(Column::value("", unit, size, channel, values).role(Role::Nuisance));
                }
            }
        }
        columns
    }

    fn experiment(&self) -> &'static str {
        "one joint turned through its whole range, slowly, both ways"
    }
}

/// A spring that is slack where the joint stands at zero.
const STRAIGHT: f64 = 0.0;
/// Slack elsewhere, and stiffer the more it is bent.
const STIFFENING: f64 = 1.0;
