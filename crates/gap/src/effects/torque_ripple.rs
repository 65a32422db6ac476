//! Gears and bearings: sine and cosine of multiples of the joint's angle, even 2kN for a harmonic drive of ratio N.
//!
//! T. Tuttle, W. Seering, IEEE Trans. Robotics and Automation 12, 1996: kinematic error of harmonic drives at two cycles per turn of the
//! wave generator.

use super::*;

/// Ripple of a gear.
pub(super) struct TorqueRipple;

impl Effect for TorqueRipple {
    fn id(&self) -> &'static str {
        "torque_ripple"
    }

    fn words(&self) -> &'static str {
        "a ripple that repeats with the joint's angle"
    }

    fn remedy(&self) -> &'static str {
        "compensate by the joint's angle"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_moving_joint(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        joints_with_moments(session)
    }

    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[("cycles_per_rev", "1")]
    }

    fn shapes(&self, session: &Session, place: Place) -> Vec<Shape> {
        let Place::Joint(joint) = place else { return Vec::new() };
        let mut orders: Vec<f64> = USUAL.to_vec();
        for (channel, _) in moment_channels(session, joint) {
            let own = &session.channels[channel];
            let power =
                crate::spectrum::power_by_order(&session.joints[joint].position_rad, &own.gap, HIGHEST);
            orders.extend(crate::spectrum::peaks(&power, LOWEST, PEAKS).into_iter().map(f64::round));
        }
        orders.sort_by(f64::total_cmp);
        orders.dedup();
        orders.into_iter().map(|order| vec![order]).collect()
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Joint(joint) = place else { return Vec::new() };
        let moving = &session.joints[joint];
        let turn = |q: &f64| shape[0] * q;
        let mut columns = Vec::new();
        for (channel, per_nm) in moment_channels(session, joint) {
            let size_nm = 3.0 * session.channels[channel].rms_gap() / per_nm.abs();
            let sine = Column::value(
                "amplitude",
                "Nm",
                size_nm,
                channel,
                moving.position_rad.iter().map(|q| per_nm * turn(q).sin()).collect(),
            );
            let cosine = Column {
                parts: vec![(channel, moving.position_rad.iter().map(|q| per_nm * turn(q).cos()).collect())],
                ..sine.clone()
            };
            columns.push(sine.role(Role::Sine));
            columns.push(cosine.role(Role::Cosine));
        }
        columns
    }

    fn experiment(&self) -> &'static str {
        "each joint turned slowly and evenly through its range"
    }
}

/// Orders that gears in use have; any other must stand out of the gap by itself.
const USUAL: [f64; 10] = [60.0, 100.0, 120.0, 160.0, 200.0, 202.0, 240.0, 242.0, 320.0, 322.0];
/// Lower orders are what weight makes of the angle.
const LOWEST: usize = 4;
/// Orders from 0 that are looked at.
const HIGHEST: usize = 400;
/// Orders that stand out and are tried.
const PEAKS: usize = 4;
