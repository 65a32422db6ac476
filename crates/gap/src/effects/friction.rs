//! Friction in parallel with the sensor: against the motion (Coulomb), growing with speed (viscous).
//!
//! `coulomb tanh(q'/v) + viscous q'` (B. Armstrong-Hélouvry et al., Automatica 30, 1994); friction between motor and sensor is invisible
//! to a sensor on the link's side. The shape is v and whether the viscous part takes part.

use super::*;

/// Friction of a joint.
pub(super) struct Friction;

impl Effect for Friction {
    fn id(&self) -> &'static str {
        "friction"
    }

    fn words(&self) -> &'static str {
        "friction of the joint in parallel with the sensor"
    }

    fn remedy(&self) -> &'static str {
        "put the friction into the simulation; check seals and bearings"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_moving_joint(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        joints_with_moments(session)
    }

    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[("speed_rad_s", "rad/s")]
    }

    fn shapes(&self, session: &Session, _place: Place) -> Vec<Shape> {
        let _ = session;
        let speeds = [0.002, 0.01, 0.03, 0.1];
        let kinds = [COULOMB, BOTH];
        let mut shapes: Vec<Shape> = kinds.iter().flat_map(|kind| speeds.map(|v| vec![v, *kind])).collect();
        shapes.push(vec![0.0, VISCOUS]);
        shapes
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Joint(joint) = place else { return Vec::new() };
        let moving = &session.joints[joint];
        let Some(velocity) = &moving.velocity_rad_s else { return Vec::new() };
        let mut columns = Vec::new();
        for (channel, per_nm) in moment_channels(session, joint) {
            let per_nm = relief(session, channel) * per_nm;
            let size_nm = 3.0 * session.channels[channel].rms_gap() / per_nm.abs();
            if shape[1] != VISCOUS {
                let values = velocity.iter().map(|v| per_nm * (v / shape[0]).tanh()).collect();
                columns.push(
                    Column::value("coulomb_nm", "Nm", size_nm, channel, values).braking(session, channel),
                );
            }
            let fastest = largest(velocity);
            if shape[1] != COULOMB && fastest > 0.0 {
                let turned = velocity.iter().map(|v| per_nm * v).collect();
                columns.push(
                    Column::value("viscous", "Nm s/rad", size_nm / fastest, channel, turned)
                        .braking(session, channel),
                );
            }
        }
        columns
    }

    fn experiment(&self) -> &'static str {
        "each joint moved to and fro at three speeds"
    }
}

const COULOMB: f64 = 0.0;
const BOTH: f64 = 1.0;
const VISCOUS: f64 = 2.0;
