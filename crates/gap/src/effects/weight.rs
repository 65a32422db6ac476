//! Joint torques of links that are heavier, lighter or elsewhere than simulated, for the effects that need an arm.
//!
//! A simulated joint torque is what the joint must apply to the outboard side (`M q'' + C q' + g`, as every simulator
//! gives it): minus the moment about the axis that the outboard side applies, which [`Dynamics`] computes.

use model::chain::Section;
use model::dynamics::Dynamics;
use model::spatial::BODY_PARAMETERS;
use nalgebra::Vector3;

use super::{Column, NO_JOINT, Place, moment_channels};
use crate::session::{Kinematics, Session};

/// How the parameters of a body are called.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Naming {
    /// A link of the arm.
    Link,
    /// What hangs on the tip.
    Payload,
}

/// How far a first moment may be off: a body of the plausible mass displaced by this, m.
const DISPLACEMENT_M: f64 = 0.1;
/// Step of a difference quotient, rad.
const STEP_RAD: f64 = 1e-5;

/// The arm, where its torque channels are known.
pub(super) fn arm(session: &Session) -> Option<&Kinematics> {
    session.kinematics.as_ref().filter(|arm| !sections(session, arm).is_empty())
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

/// Per channel that measures a joint's torque: the channel and the section at that joint.
fn sections(session: &Session, arm: &Kinematics) -> Vec<(usize, Section)> {
    let of_joint = |joint: usize| {
        Section::new(&arm.chain, &session.joints[joint].name, None)
            .ok()
            .map(|section| moment_channels(session, joint).map(move |channel| (channel, section)))
    };
    arm.joints.iter().filter_map(|joint| of_joint(*joint)).flatten().collect()
}

/// Where and how the arm moves at an instant.
#[derive(Clone)]
struct Instant {
    position_rad: Vec<f64>,
    velocity_rad_s: Vec<f64>,
    acceleration_rad_s2: Vec<f64>,
}

impl Instant {
    fn at(session: &Session, arm: &Kinematics, row: usize) -> Self {
        let derivative = |values: &Option<Vec<f64>>| values.as_ref().map_or(0.0, |values| values[row]);
        let joints = || arm.joints.iter().map(|joint| &session.joints[*joint]);
        Self {
            position_rad: joints().map(|joint| joint.position_rad[row]).collect(),
            velocity_rad_s: joints().map(|joint| derivative(&joint.velocity_rad_s)).collect(),
            acceleration_rad_s2: joints().map(|joint| derivative(&joint.acceleration_rad_s2)).collect(),
        }
    }

    fn update(&self, dynamics: &mut Dynamics) {
        dynamics.update(&self.position_rad, &self.velocity_rad_s, &self.acceleration_rad_s2);
    }
}

/// What mass (kg) and first moments (kg m) of the body at a link add to every joint's torque.
pub(super) fn body_columns(session: &Session, link: usize, naming: Naming) -> Vec<Column> {
    let Some(arm) = arm(session) else { return Vec::new() };
    let sections = sections(session, arm);
    let felt: Vec<usize> = (0..sections.len()).filter(|k| sections[*k].1.joint <= link).collect();
    let mut dynamics = Dynamics::new(&arm.chain, &sections.iter().map(|(_, s)| *s).collect::<Vec<_>>());
    let own = arm.chain.joints[link].body;
    let scales = naming == Naming::Link && own.mass_kg > 0.0;
    let parameters: [f64; BODY_PARAMETERS] =
        if scales { own.parameters() } else { std::array::from_fn(|k| f64::from(u8::from(k == 0))) };
    let mut values = vec![vec![Vec::with_capacity(session.rows()); felt.len()]; 4];
    for row in 0..session.rows() {
        Instant::at(session, arm, row).update(&mut dynamics);
        for (slot, &section) in felt.iter().enumerate() {
            let moments = dynamics.regressor(section, link).row(5).into_owned();
            let mass: f64 = moments.iter().zip(&parameters).map(|(m, p)| m * p).sum();
            values[0][slot].push(-mass);
            for axis in 0..3 {
                values[1 + axis][slot].push(-moments[1 + axis]);
            }
        }
    }
    let (mass, unit, plausible) = match (naming, scales) {
        (Naming::Link, true) => ("relative_mass", "1", 0.2),
        _ => ("d_mass", "kg", 1.0),
    };
    let moment = ["d_mc_x", "d_mc_y", "d_mc_z"];
    let plausible_kgm = DISPLACEMENT_M * if scales { own.mass_kg } else { 1.0 };
    let columns = values.into_iter().enumerate().map(|(k, parts)| {
        let parts = felt.iter().map(|slot| sections[*slot].0).zip(parts).collect();
        let (name, unit, plausible) =
            if k == 0 { (mass, unit, plausible) } else { (moment[k - 1], "kg m", plausible_kgm) };
        Column {
            parameter: name.to_owned(),
            unit: unit.to_owned(),
            role: super::Role::Value,
            plausible,
            is_positive: false,
            parts,
        }
    });
    columns.filter(|column| column.parts.iter().any(|(_, v)| v.iter().any(|x| x.abs() > 1e-9))).collect()
}

/// What gravity turned about the base's two level axes adds, per rad.
pub(super) fn tilt_columns(session: &Session) -> Vec<Column> {
    let Some(arm) = arm(session) else { return Vec::new() };
    let gravity = arm.chain.gravity_mps2;
    let down = gravity.try_normalize(1e-9).unwrap_or_else(|| -Vector3::z());
    let level = model::chain::rotation_from_z(&down);
    let turned = |axis: usize| {
        let mut chain = arm.chain.clone();
        chain.gravity_mps2 = gravity + level.column(axis).cross(&gravity) * STEP_RAD;
        difference(session, arm, &chain, |_, _| {})
    };
    // The tilt is the length of the two turns together.
    let roles = [super::Role::Sine, super::Role::Cosine];
    (0..2).map(|axis| turned_column(turned(axis), "rad", "rad", 0.02).role(roles[axis])).collect()
}

/// What a joint that stands further by `angle(row)` rad per unit of the parameter adds.
pub(super) fn turn_columns(
    session: &Session,
    joint: usize,
    angle: impl Fn(usize) -> f64,
    parameter: &str,
    unit: &str,
    plausible: f64,
) -> Vec<Column> {
    let Some(arm) = arm(session) else { return Vec::new() };
    let Some(coordinate) = arm.joints.iter().position(|known| *known == joint) else { return Vec::new() };
    let mut column = turned_column(
        difference(session, arm, &arm.chain, |instant, _| instant.position_rad[coordinate] += STEP_RAD),
        parameter,
        unit,
        plausible,
    );
    for (_, values) in &mut column.parts {
        for (row, value) in values.iter_mut().enumerate() {
            *value *= angle(row);
        }
    }
    vec![column]
}

fn turned_column(parts: Vec<(usize, Vec<f64>)>, parameter: &str, unit: &str, plausible: f64) -> Column {
    Column {
        parameter: parameter.to_owned(),
        unit: unit.to_owned(),
        role: super::Role::Value,
        plausible,
        is_positive: false,
        parts,
    }
}

/// Change of every joint's torque (Nm per rad) between the arm and a changed one.
fn difference(
    session: &Session,
    arm: &Kinematics,
    changed_chain: &model::chain::Chain,
    change: impl Fn(&mut Instant, usize),
) -> Vec<(usize, Vec<f64>)> {
    let sections = sections(session, arm);
    let only: Vec<Section> = sections.iter().map(|(_, section)| *section).collect();
    let mut before = Dynamics::new(&arm.chain, &only);
    let mut after = Dynamics::new(changed_chain, &only);
    let mut parts: Vec<(usize, Vec<f64>)> =
        sections.iter().map(|(channel, _)| (*channel, Vec::new())).collect();
    for row in 0..session.rows() {
        let mut instant = Instant::at(session, arm, row);
        instant.update(&mut before);
        change(&mut instant, row);
        instant.update(&mut after);
        for (section, (_, values)) in parts.iter_mut().enumerate() {
            values.push(-(after.load(section)[5] - before.load(section)[5]) / STEP_RAD);
        }
    }
    parts
}
