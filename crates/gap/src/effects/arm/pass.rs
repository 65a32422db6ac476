//! One pass over the rows: what every channel would show if the arm were another one.

use model::chain::{Chain, Section};
use model::dynamics::Dynamics;
use model::spatial::{BODY_PARAMETERS, RigidBody, Tip, Wrench};
use nalgebra::{Matrix3, Vector3};

use super::{ArmColumns, bends};
use crate::session::{Kinematics, Session};

/// One pass over the rows.
pub(super) struct Pass<'a> {
    session: &'a Session,
    arm: &'a Kinematics,
    dynamics: Dynamics,
    /// The same with a section at every joint: what each passes on.
    passing_on: Dynamics,
    /// The arm at rest, half a turn of a joint away.
    half_turned: Dynamics,
    /// The arm at rest under nothing but what a turn of gravity adds to it.
    turned: [Dynamics; 3],
    carried: RigidBody,
    /// Per joint what its child link is made of where that scales as a whole, else a unit of mass.
    unit_body: Vec<[f64; BODY_PARAMETERS]>,
    positions: [Vec<f64>; 3],
    pub(super) columns: ArmColumns,
}

impl<'a> Pass<'a> {
    pub(super) fn new(session: &'a Session, arm: &'a Kinematics) -> Self {
        let sections: Vec<Section> = arm.sensing.iter().map(|sensing| sensing.section).collect();
        let gravity = arm.chain.gravity_mps2;
        let level = level_axes(&gravity);
        let changes = [level.column(0).cross(&gravity), level.column(1).cross(&gravity), gravity];
        let turned = changes.map(|change| {
            let mut chain: Chain = arm.chain.clone();
            chain.gravity_mps2 = change;
            Dynamics::new(&chain, &sections)
        });
        let empty = || vec![Vec::with_capacity(session.rows()); sections.len()];
        // Rows that are not felt take no memory; the others as much as they need.
        let room = |is_felt: bool| Vec::with_capacity(if is_felt { session.rows() } else { 0 });
        let felt = |before: usize| sections.iter().map(|section| room(section.joint < before)).collect();
        let links = arm.chain.joints.len();
        let columns = ArmColumns {
            position: (0..arm.joints.len()).map(|_| empty()).collect(),
            bend: if bends(session) { arm.joints.iter().map(|_| empty()).collect() } else { Vec::new() },
            tilt: std::array::from_fn(|_| empty()),
            body: (0..links).map(|link| std::array::from_fn(|_| felt(link + 1))).collect(),
            shift: (0..links).map(|link| std::array::from_fn(|_| felt(link))).collect(),
            declared: std::array::from_fn(|_| vec![Vec::new(); sections.len()]),
            torque_nm: vec![Vec::with_capacity(session.rows()); arm.joints.len()],
        };
        Self {
            session,
            arm,
            dynamics: Dynamics::new(&arm.chain, &sections),
            passing_on: Dynamics::new(&arm.chain, &joint_sections(&arm.chain)),
            half_turned: Dynamics::new(&arm.chain, &sections),
            turned,
            carried: RigidBody::zero(),
            unit_body: arm.chain.joints.iter().map(|joint| unit_body(&joint.body)).collect(),
            positions: std::array::from_fn(|_| vec![0.0; arm.joints.len()]),
            columns,
        }
    }

    pub(super) fn row(&mut self, row: usize) {
        self.carry(row);
        self.positions = self.arm.motion_at(self.session, row);
        let [position, velocity, acceleration] = &self.positions;
        self.dynamics.update(position, velocity, acceleration);
        self.dynamics.differentiate();
        self.turned.iter_mut().for_each(|turned| turned.update_static(position));
        let wrench = self.arm.wrench.get(row).copied().unwrap_or_else(Wrench::zero);
        for (k, torques) in self.columns.torque_nm.iter_mut().enumerate() {
            torques.push(self.dynamics.joint_torque_nm(k, &wrench));
        }
        for section in 0..self.arm.sensing.len() {
            self.section(section, &wrench);
            self.bodies(section);
            self.declared(section);
        }
        self.shift(&wrench);
        self.bend(&wrench);
    }

    /// All that is outboard of a joint has another lever where its link sits elsewhere: `dM = d x F` for every section before, with the force F
    /// that the joint passes on.
    fn shift(&mut self, wrench: &Wrench<Tip>) {
        let [position, velocity, acceleration] = &self.positions;
        self.passing_on.update_loads(position, velocity, acceleration);
        self.passing_on.carry_tip();
        let placements = self.arm.chain.placements(position);
        for link in 1..self.columns.shift.len() {
            let load = self.passing_on.load(link).fixed_rows::<3>(0)
                + self.passing_on.load_of_tip_wrench(link, wrench).force_n;
            let force_n = placements[link].rotation * load;
            let axes = placements[link - 1].rotation;
            let levers: [Vector3<f64>; 3] = std::array::from_fn(|axis| axes.column(axis).cross(&force_n));
            for (slot, sensing) in self.arm.sensing.iter().enumerate() {
                if sensing.section.joint >= link {
                    continue;
                }
                let placed = placements[sensing.section.joint].rotation * sensing.section.r_cs;
                let moment = placed * sensing.row.fixed_rows::<3>(3);
                for (values, lever) in self.columns.shift[link].iter_mut().zip(&levers) {
                    values[slot].push(moment.dot(lever));
                }
            }
        }
    }

    /// A load at rest is `a + b cos + c sin` of each coordinate: half a turn away it is less by `2 b`, if begun at 0.
    fn bend(&mut self, wrench: &Wrench<Tip>) {
        if self.columns.bend.is_empty() {
            return;
        }
        let sensing = &self.arm.sensing;
        let mut at_rest = |positions: &[f64]| -> Vec<f64> {
            self.half_turned.update_static(positions);
            let arm = &self.half_turned;
            let load = |k: usize| arm.load(k) + arm.load_of_tip_wrench(k, wrench).to_vector();
            sensing.iter().enumerate().map(|(k, at)| at.row.dot(&load(k))).collect()
        };
        let mut positions = self.positions[0].clone();
        let here = at_rest(&positions);
        for (k, changes) in self.columns.bend.iter_mut().enumerate() {
            positions[k] += std::f64::consts::PI;
            let there = at_rest(&positions);
            positions[k] -= std::f64::consts::PI;
            for ((change, here), there) in changes.iter_mut().zip(&here).zip(there) {
                change.push((there - here) / 2.0);
            }
        }
    }

    /// What hangs on the tip here belongs to the arm.
    fn carry(&mut self, row: usize) {
        let body = self.arm.carried_at(row);
        if body != self.carried {
            self.carried = body;
            self.dynamics.set_payload(&body);
            self.passing_on.set_payload(&body);
            self.half_turned.set_payload(&body);
            self.turned.iter_mut().for_each(|turned| turned.set_payload(&body));
        }
    }

    fn section(&mut self, section: usize, wrench: &Wrench<Tip>) {
        let sensing = self.arm.sensing[section].row;
        for (k, changes) in self.columns.position.iter_mut().enumerate() {
            let load = self.dynamics.by_position(section, k)
                + self.dynamics.tip_wrench_by_position(section, k, wrench);
            changes[section].push(sensing.dot(&load));
        }
        for (turned, changes) in self.turned.iter().zip(&mut self.columns.tilt) {
            changes[section].push(sensing.dot(&turned.load(section)));
        }
    }

    fn bodies(&mut self, section: usize) {
        let sensing = &self.arm.sensing[section];
        for (link, changes) in self.columns.body.iter_mut().enumerate().skip(sensing.section.joint) {
            let per_parameter = self.dynamics.regressor(section, link).tr_mul(&sensing.row);
            let own: f64 = per_parameter.iter().zip(&self.unit_body[link]).map(|(c, p)| c * p).sum();
            changes[0][section].push(own);
            (0..3).for_each(|axis| changes[1 + axis][section].push(per_parameter[1 + axis]));
        }
    }

    fn declared(&mut self, section: usize) {
        let Some(last) = self.arm.chain.joints.len().checked_sub(1) else { return };
        if self.arm.carried.is_empty() {
            return;
        }
        let row = &self.arm.sensing[section].row;
        let com_m = self.carried.com_m();
        let per_parameter = self.dynamics.regressor(section, last).tr_mul(row);
        let body = com_m.map(|com_m| RigidBody::from_com(1.0, com_m, Matrix3::zeros()).parameters());
        let mass = body.map_or(0.0, |body| per_parameter.iter().zip(&body).map(|(c, p)| c * p).sum());
        self.columns.declared[0][section].push(mass);
        for axis in 0..3 {
            self.columns.declared[1 + axis][section].push(per_parameter[1 + axis] * self.carried.mass_kg);
        }
    }
}

/// Two axes at right angles to gravity, and gravity's own, as columns.
fn level_axes(gravity_mps2: &Vector3<f64>) -> Matrix3<f64> {
    let down = gravity_mps2.try_normalize(1e-9).unwrap_or_else(|| -Vector3::z());
    model::chain::rotation_from_z(&down)
}

/// The body itself where the URDF knows its mass, else 1 kg.
fn unit_body(own: &RigidBody) -> [f64; BODY_PARAMETERS] {
    if own.mass_kg > 0.0 { own.parameters() } else { std::array::from_fn(|k| f64::from(u8::from(k == 0))) }
}

/// A section at each joint, as its child link's frame has it.
fn joint_sections(chain: &Chain) -> Vec<Section> {
    (0..chain.joints.len()).map(|joint| Section { joint, r_cs: Matrix3::identity() }).collect()
}
