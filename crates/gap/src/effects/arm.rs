//! What each channel would show if the arm were another one: heavier links, turned joints, a leaning base, a body at the tip.
//!
//! All columns of an arm come from one pass over the rows (recursive Newton-Euler and its exact derivatives,
//! [`model::dynamics`]) and are kept in the session, since they cost most of all to compute.
//!
//! A simulated joint torque is what the joint must apply to the outboard side (`M q'' + C q' + g`, as every simulator gives
//! it), a gauge's counts are its compliance times what the outboard side applies: either is a row times the section's load.

mod pass;

use std::ops::Range;

use model::spatial::RigidBody;
use nalgebra::{Matrix3, Vector3};

use super::{Column, NO_JOINT, Place, Role, moment_channels};
use crate::parallel;
use crate::session::{Kinematics, Session};
use pass::Pass;

/// How the parameters of a body are called.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Naming {
    /// A link of the arm.
    Link,
    /// What hangs on the tip all the time although nothing was declared.
    Undeclared,
}

/// How far a first moment may be off: a body of the plausible mass displaced by this, m.
const DISPLACEMENT_M: f64 = 0.1;

/// Per sensing channel (in the order of [`Kinematics::sensing`]) a change, per row; empty where it does not feel it.
type BySensing = Vec<Vec<f64>>;

/// Changes of every sensing channel (channel's unit) per unit of what may be otherwise.
#[derive(Debug, Clone, Default)]
pub struct ArmColumns {
    /// By a coordinate's position, per rad.
    position: Vec<BySensing>,
    /// What the part of a load that goes with the cosine of a coordinate loses as that turns, per unit of `1 - cos`; none where gaps
    /// are so small that no turn behind them bends.
    bend: Vec<BySensing>,
    /// By a turn of gravity about the two level axes, per rad; by what gravity gains along itself, per unit of it.
    tilt: [BySensing; 3],
    /// By the body of each joint's child link: mass with all that goes with it, and first moments (per kg m).
    body: Vec<[BySensing; 4]>,
    /// By where a joint's child link sits on the link before, per m along that link's axes.
    shift: Vec<[BySensing; 3]>,
    /// By the declared body at the tip: mass where it is (per kg), and displacement (per m).
    declared: [BySensing; 4],
    /// Torque about each coordinate's axis that the outboard side applies, Nm.
    torque_nm: Vec<Vec<f64>>,
}

impl ArmColumns {
    fn new(session: &Session, arm: &Kinematics) -> Self {
        let parts = (0..PARTS).map(|k| session.rows() * k / PARTS..session.rows() * (k + 1) / PARTS);
        let parts: Vec<Range<usize>> = parts.collect();
        let made = parallel::map(&parts, |rows| {
            let mut pass = Pass::new(session, arm);
            rows.clone().for_each(|row| pass.row(row));
            pass.columns
        });
        let mut made = made.into_iter();
        let mut all = made.next().unwrap_or_default();
        made.for_each(|part| all.append(part));
        all
    }

    /// The rows of another after these.
    fn append(&mut self, other: Self) {
        for (own, more) in self.position.iter_mut().zip(other.position) {
            append(own, more);
        }
        for (own, more) in self.bend.iter_mut().zip(other.bend) {
            append(own, more);
        }
        for (own, more) in self.tilt.iter_mut().zip(other.tilt) {
            append(own, more);
        }
        for (own, more) in self.body.iter_mut().flatten().zip(other.body.into_iter().flatten()) {
            append(own, more);
        }
        for (own, more) in self.shift.iter_mut().flatten().zip(other.shift.into_iter().flatten()) {
            append(own, more);
        }
        for (own, more) in self.declared.iter_mut().zip(other.declared) {
            append(own, more);
        }
        append(&mut self.torque_nm, other.torque_nm);
    }
}

fn append(columns: &mut [Vec<f64>], more: Vec<Vec<f64>>) {
    columns.iter_mut().zip(more).for_each(|(own, more)| own.extend(more));
}

/// Stretches of rows that are computed at the same time.
const PARTS: usize = 4;

fn columns(session: &Session) -> Option<(&Kinematics, &ArmColumns)> {
    let arm = arm(session)?;
    Some((arm, session.arm_columns.get_or_init(|| ArmColumns::new(session, arm))))
}

/// The arm, where there are channels that feel it.
pub(super) fn arm(session: &Session) -> Option<&Kinematics> {
    session.kinematics.as_ref().filter(|arm| !arm.sensing.is_empty())
}

pub(super) fn without_arm(session: &Session) -> Option<String> {
    if session.kinematics.is_none() {
        return Some("the robot's kinematics ([robot] urdf, [[joint]] with position)".to_owned());
    }
    arm(session).is_none().then(|| NO_JOINT.to_owned())
}

pub(super) fn without_masses(session: &Session) -> Option<String> {
    without_arm(session).or_else(|| {
        let has = arm(session).is_some_and(|arm| arm.has_masses);
        (!has).then(|| "the links' masses in the URDF (<inertial>)".to_owned())
    })
}

/// Links that any channel feels.
pub(super) fn links(session: &Session) -> Vec<Place> {
    arm(session).map_or_else(Vec::new, |arm| (0..arm.chain.joints.len()).map(Place::Link).collect())
}

/// Joints of the session that move the arm.
pub(super) fn coordinates(session: &Session) -> Vec<Place> {
    arm(session).map_or_else(Vec::new, |arm| arm.joints.iter().map(|joint| Place::Joint(*joint)).collect())
}

/// Whether anything was declared to hang on the tip.
pub(super) fn is_loaded(session: &Session) -> bool {
    arm(session).is_some_and(|arm| arm.carried.iter().any(|(_, body)| body.mass_kg > 0.0))
}

/// Whether what hangs on the tip or acts on it is not the same all the time.
pub(super) fn carries_by_turns(session: &Session) -> bool {
    arm(session).is_some_and(|arm| {
        let is_first = |(_, body): &(Range<usize>, RigidBody)| *body == arm.carried[0].1;
        !arm.carried.iter().all(is_first) || arm.wrench.iter().any(|wrench| *wrench != arm.wrench[0])
    })
}

/// Name of the mass of a link over the simulation's, less one.
pub(super) const RELATIVE_MASS: &str = "relative_mass";

/// What mass and first moments (kg m) of the body at a link add.
pub(super) fn body_columns(session: &Session, link: usize, naming: Naming) -> Vec<Column> {
    let Some((arm, all)) = columns(session) else { return Vec::new() };
    let own = arm.chain.joints[link].body;
    let scales = own.mass_kg > 0.0;
    let (mass, unit, plausible) = match (naming, scales) {
        (Naming::Link, true) => (RELATIVE_MASS, "1", 0.2),
        _ => ("d_mass", "kg", 1.0),
    };
    let plausible_kgm = DISPLACEMENT_M * if scales { own.mass_kg } else { 1.0 };
    let names = [mass, "d_mc_x", "d_mc_y", "d_mc_z"];
    let columns = all.body[link].iter().zip(names).enumerate().map(|(k, (values, name))| {
        let (unit, plausible) = if k == 0 { (unit, plausible) } else { ("kg m", plausible_kgm) };
        column(arm, values, name, unit, plausible)
    });
    columns.filter(shows).collect()
}

/// What the declared body at the tip adds if it is heavier (kg) or elsewhere (m).
pub(super) fn declared_columns(session: &Session) -> Vec<Column> {
    let Some((arm, all)) = columns(session) else { return Vec::new() };
    let names = ["d_mass", "d_com_x", "d_com_y", "d_com_z"];
    let columns = all.declared.iter().zip(names).enumerate().map(|(k, (values, name))| {
        let (unit, plausible) = if k == 0 { ("kg", 1.0) } else { ("m", DISPLACEMENT_M) };
        column(arm, values, name, unit, plausible)
    });
    columns.filter(shows).collect()
}

/// So much of gravity a turn by several degrees takes from its old direction (`1 - cos`).
const LOST_BY_TILT: f64 = 1e-3;

/// What gravity turned about the base's two level axes adds, per rad; and what it loses along its old direction, which makes the turn
/// exact however large it is (a load at rest is linear in gravity).
pub(super) fn tilt_columns(session: &Session) -> Vec<Column> {
    let Some((arm, all)) = columns(session) else { return Vec::new() };
    // The tilt is the length of the two turns together.
    let roles = [Role::Sine, Role::Cosine];
    let level = (0..2).map(|axis| column(arm, &all.tilt[axis], "rad", "rad", 0.02).role(roles[axis]));
    let down = column(arm, &all.tilt[2], "", "1", LOST_BY_TILT).role(Role::Nuisance);
    level.chain([down]).collect()
}

/// What a joint that stands further by `angle(row)` rad per unit of the parameter adds.
pub(super) fn turn_columns(
    session: &Session,
    joint: usize,
    angle: impl Fn(usize) -> f64,
    heading: (&str, &str, f64),
) -> Vec<Column> {
    let Some((arm, all)) = columns(session) else { return Vec::new() };
    let Some(coordinate) = arm.joints.iter().position(|known| *known == joint) else { return Vec::new() };
    let mut column = column(arm, &all.position[coordinate], heading.0, heading.1, heading.2);
    for (_, values) in &mut column.parts {
        for (row, value) in values.iter_mut().enumerate() {
            *value *= angle(row);
        }
    }
    vec![column]
}

/// An encoder's zero that is off by as much as a coupling's clamp may slip.
pub(super) const ZERO_RAD: f64 = 0.05;

/// What a joint that stands further adds, per rad; and what that loses by bending, which makes the turn exact at rest however large it is.
pub(super) fn bent_columns(session: &Session, joint: usize) -> Vec<Column> {
    let mut out = turn_columns(session, joint, |_| 1.0, ("rad", "rad", ZERO_RAD));
    let Some((arm, all)) = columns(session) else { return out };
    let coordinate = arm.joints.iter().position(|known| *known == joint);
    if let Some(values) = coordinate.and_then(|coordinate| all.bend.get(coordinate)) {
        out.push(column(arm, values, "", "1", LOST_BY_TILT).role(Role::Nuisance));
    }
    out
}

/// Gap over its scale above which the arc of a turn may differ from its tangent by more than noise.
const BENDS_ABOVE: f64 = 5.0;

/// Whether any channel's gap is large enough for that.
pub(super) fn bends(session: &Session) -> bool {
    let is_large = |channel: &crate::session::Channel| {
        channel.gauge.is_some() && channel.rms_gap() > BENDS_ABOVE * channel.scale
    };
    session.channels.iter().any(is_large)
}

/// Torque about a joint's axis (Nm) under which it gives, per row: what the outboard side applies.
pub(super) fn yielding_torque_nm(session: &Session, joint: usize) -> Option<Vec<f64>> {
    let (arm, all) = columns(session)?;
    let of_simulator = moment_channels(session, joint)
        .map(|(channel, _)| &session.channels[channel])
        .find(|channel| channel.gauge.is_none());
    if let Some(channel) = of_simulator {
        return Some(channel.simulated.iter().map(|torque| -torque).collect());
    }
    let coordinate = arm.joints.iter().position(|known| *known == joint)?;
    Some(all.torque_nm[coordinate].clone())
}

/// Channels that feel a force on a link.
pub(super) fn felt_by(session: &Session, link: usize) -> Vec<usize> {
    let sensing = arm(session).map_or(&[][..], |arm| &arm.sensing);
    sensing.iter().filter(|at| at.section.joint <= link).map(|at| at.channel).collect()
}

/// A force keeps its direction in the base, or in the link that it acts on.
pub(super) const IN_BASE: f64 = 0.0;
pub(super) const IN_LINK: f64 = 1.0;

/// What a force (per N) at a link's centre of mass and a moment (per Nm) about it add at these rows: where a link is touched is not
/// known, and from its middle the lever is short whichever way the link turns.
pub(super) fn force_columns(session: &Session, link: usize, rows: &[usize], frame: f64) -> Vec<Column> {
    let Some(arm) = arm(session) else { return Vec::new() };
    let felt: Vec<usize> = (0..arm.sensing.len()).filter(|k| arm.sensing[*k].section.joint <= link).collect();
    let mut parts: Vec<BySensing> = vec![vec![vec![0.0; session.rows()]; felt.len()]; 6];
    let mut positions = vec![0.0; arm.joints.len()];
    let middle_m = arm.chain.joints[link].body.com_m().unwrap_or_default();
    for &row in rows {
        for (k, joint) in arm.joints.iter().enumerate() {
            positions[k] = session.joints[*joint].position_rad[row];
        }
        let placements = arm.chain.placements(&positions);
        let held = if frame == IN_LINK { placements[link].rotation } else { Matrix3::identity() };
        for (slot, &sensing) in felt.iter().enumerate() {
            let at = &arm.sensing[sensing];
            let section = &placements[at.section.joint];
            let to_section = (section.rotation * at.section.r_cs).transpose();
            let lever_m = placements[link].point(&middle_m) - section.translation_m;
            let (force, moment) =
                (at.row.fixed_rows::<3>(0).into_owned(), at.row.fixed_rows::<3>(3).into_owned());
            for axis in 0..3 {
                let along: Vector3<f64> = held.column(axis).into_owned();
                let turned = moment.dot(&(to_section * along));
                parts[axis][slot][row] =
                    force.dot(&(to_section * along)) + moment.dot(&(to_section * lever_m.cross(&along)));
                parts[3 + axis][slot][row] = turned;
            }
        }
    }
    let columns = parts.into_iter().enumerate().map(|(k, values)| {
        let parts = felt.iter().map(|k| arm.sensing[*k].channel).zip(values).collect();
        let (unit, plausible) = if k < 3 { ("N", 50.0) } else { ("Nm", 10.0) };
        Column::of_parts("", unit, plausible, parts)
    });
    columns.collect()
}

/// Links are made to a millimetre; a URDF may be wrong by more.
const SHIFT_M: f64 = 0.005;

/// What a link that sits elsewhere on the one before adds, per m along the axes of the one before.
pub(super) fn shift_columns(session: &Session, link: usize) -> Vec<Column> {
    let Some((arm, all)) = columns(session) else { return Vec::new() };
    // To a single one it is nothing but an axis of its own that sits elsewhere.
    if arm.sensing.iter().filter(|sensing| sensing.section.joint < link).count() < 2 {
        return Vec::new();
    }
    let columns = all.shift[link].iter().zip(["d_x", "d_y", "d_z"]);
    columns.map(|(values, name)| column(arm, values, name, "m", SHIFT_M)).filter(shows).collect()
}

impl Kinematics {
    /// What hangs on the tip at a row, as declared.
    fn carried_at(&self, row: usize) -> RigidBody {
        let carried = self.carried.iter().find(|(rows, _)| rows.contains(&row));
        carried.map_or_else(RigidBody::zero, |(_, body)| *body)
    }

    /// Position (rad), velocity and acceleration of every coordinate at a row; zeros where they are not known.
    fn motion_at(&self, session: &Session, row: usize) -> [Vec<f64>; 3] {
        let joints = || self.joints.iter().map(|joint| &session.joints[*joint]);
        let of = |values: &Option<Vec<f64>>| values.as_ref().map_or(0.0, |values| values[row]);
        [
            joints().map(|joint| joint.position_rad[row]).collect(),
            joints().map(|joint| of(&joint.velocity_rad_s)).collect(),
            joints().map(|joint| of(&joint.acceleration_rad_s2)).collect(),
        ]
    }
}

fn column(arm: &Kinematics, values: &BySensing, parameter: &str, unit: &str, plausible: f64) -> Column {
    let felt = values.iter().enumerate().filter(|(_, values)| !values.is_empty());
    let parts = felt.map(|(k, values)| (arm.sensing[k].channel, values.clone())).collect();
    Column::of_parts(parameter, unit, plausible, parts)
}

fn shows(column: &Column) -> bool {
    column.parts.iter().any(|(_, values)| values.iter().any(|value| value.abs() > 1e-9))
}
