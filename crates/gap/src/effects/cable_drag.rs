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
        let mut shapes = vec![vec![0.0, STRAIGHT]];
        if session.channels.iter().any(|channel| channel.gauge.is_some()) {
            shapes.extend(SLACK_RAD.map(|slack_rad| vec![slack_rad, BENT]));
            shapes.push(vec![0.0, STIFFENING]);
        }
        shapes
    }

    fn is_continuous(&self) -> bool {
        true
    }

    fn searched(&self, shape: &[f64]) -> usize {
        if shape[1] == BENT { 2 } else { 1 }
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
            let kappa = if shape[1] == BENT { STIFFER_PER_RAD2 } else { 0.0 };
            let bent = moving.position_rad.iter().map(|q| q - shape[0]);
            let turned = bent.map(|bent| per_nm * bent * (1.0 + kappa * bent * bent)).collect();
            columns.push(
                Column::value("nm_per_rad", "Nm/rad", plausible, channel, turned).braking(session, channel),
            );
            if shape[1] == STIFFENING {
                let unit = &session.channels[channel].unit;
                for power in [0, 2, 3] {
                    let values = moving.position_rad.iter().map(|q| per_nm * q.powi(power)).collect();
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
/// Slack elsewhere, and stiffer the more it is bent, by any third-order law.
const STIFFENING: f64 = 1.0;
/// Slack elsewhere, and stiffer by as much as cables are: `k d (1 + 0.3 d^2)`.
const BENT: f64 = 2.0;
const STIFFER_PER_RAD2: f64 = 0.3;
/// Where a cable may be slack, rad; the angle itself is searched between these.
const SLACK_RAD: [f64; 5] = [-1.2, -0.6, 0.0, 0.6, 1.2];
