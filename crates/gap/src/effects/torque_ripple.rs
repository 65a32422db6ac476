//! Gears and bearings: sine and cosine of multiples of the joint's angle, even 2kN for a harmonic drive of ratio N.
//!
//! T. Tuttle, W. Seering, IEEE Trans. Robotics and Automation 12, 1996: kinematic error of harmonic drives at two cycles per turn of the
//! wave generator. H. Taghirad, P. Bélanger, J. Dyn. Sys. Meas. Control 120, 1998: the ripple of a torque sensor in the gear grows with the torque.

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
        let mut peaks = Vec::new();
        for (channel, _) in moment_channels(session, joint) {
            let own = &session.channels[channel];
            let power =
                crate::spectrum::power_by_order(&session.joints[joint].position_rad, &own.gap, HIGHEST);
            peaks.extend(crate::spectrum::peaks(&power, LOWEST, PEAKS).into_iter().map(f64::round));
        }
        let mut shapes: Vec<Shape> = Vec::new();
        for (kind, mut orders) in [(STEADY, [&USUAL[..], &peaks].concat()), (BY_LOAD, peaks.clone())] {
            orders.sort_by(f64::total_cmp);
            orders.dedup();
            shapes.extend(orders.into_iter().map(|order| vec![order, kind]));
        }
        shapes
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Joint(joint) = place else { return Vec::new() };
        let moving = &session.joints[joint];
        let turn = |q: &f64| shape[0] * q;
        let Some(strength) = strength(session, joint, shape[1]) else { return Vec::new() };
        let mut columns = Vec::new();
        for (channel, per_nm) in moment_channels(session, joint) {
            let size_nm = 3.0 * session.channels[channel].rms_gap() / per_nm.abs();
            let wave = |of: fn(f64) -> f64| -> Vec<f64> {
                let rows = moving.position_rad.iter().zip(&strength);
                rows.map(|(q, strength)| per_nm * strength * of(turn(q))).collect()
            };
            let sine = Column::value("amplitude", "Nm", size_nm, channel, wave(f64::sin));
            let cosine = Column { parts: vec![(channel, wave(f64::cos))], ..sine.clone() };
            columns.push(sine.role(Role::Sine));
            columns.push(cosine.role(Role::Cosine));
        }
        columns
    }

    fn experiment(&self) -> &'static str {
        "each joint turned slowly and evenly through its range"
    }
}

/// The wave is the same under any load, or grows with the joint's torque.
const STEADY: f64 = 0.0;
const BY_LOAD: f64 = 1.0;

/// How strong the wave is at each row, against its amplitude: that under the largest torque where it grows with it.
fn strength(session: &Session, joint: usize, kind: f64) -> Option<Vec<f64>> {
    if kind == STEADY {
        return Some(vec![1.0; session.rows()]);
    }
    let torque_nm = arm::yielding_torque_nm(session, joint)?;
    let most_nm = largest(&torque_nm).max(f64::MIN_POSITIVE);
    Some(torque_nm.iter().map(|torque| torque.abs() / most_nm).collect())
}

/// Orders that gears in use have; any other must stand out of the gap by itself.
const USUAL: [f64; 10] = [60.0, 100.0, 120.0, 160.0, 200.0, 202.0, 240.0, 242.0, 320.0, 322.0];
/// Lower orders are what weight makes of the angle.
const LOWEST: usize = 4;
/// Orders from 0 that are looked at.
const HIGHEST: usize = 400;
/// Orders that stand out and are tried.
const PEAKS: usize = 4;
