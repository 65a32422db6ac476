//! What of the arm, the weights and the reference can be other than declared, one number each with its prior width.

use model::arm::{ArmCorrection, JointCorrection};
use model::chain::{Chain, JointKind};
use model::spatial::RigidBody;
use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3, Vector6};

use super::rows::Row;

/// Corrections that are admitted or left out together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Group {
    /// Masses and first moments of the links.
    LinkMasses,
    /// Zeros of the encoders.
    EncoderZeros,
    /// What the joints yield under torque.
    JointFlexibility,
    /// Direction of gravity.
    BaseTilt,
    /// Masses of the weights and where they hang.
    Weights,
    /// Gain, alignment and zero of the reference.
    Reference,
    /// Places and directions of the joints.
    JointPlacement,
}

impl Group {
    /// All groups in the order in which they are tried.
    pub const ALL: [Self; 7] = [
        Self::LinkMasses,
        Self::EncoderZeros,
        Self::JointFlexibility,
        Self::BaseTilt,
        Self::Weights,
        Self::Reference,
        Self::JointPlacement,
    ];

    /// The group's name in model and report.
    pub fn name(self) -> &'static str {
        match self {
            Self::LinkMasses => "link_masses",
            Self::EncoderZeros => "encoder_zeros",
            Self::JointFlexibility => "joint_flexibility",
            Self::BaseTilt => "base_tilt",
            Self::Weights => "weights",
            Self::Reference => "reference",
            Self::JointPlacement => "joint_placement",
        }
    }
}

/// Prior widths: how far a real arm is from its papers, one standard deviation. A tenth of them or three times as much
/// changes little where the recordings say more; they only keep apart what the recordings cannot tell apart.
mod width {
    /// Links of a CAD model miss screws, cables and paint: 1..5 % of their mass.
    pub(super) const MASS_SHARE: f64 = 0.05;
    /// and 1..5 mm of their centre of mass.
    pub(super) const COM_M: f64 = 0.005;
    /// A mechanical zero is set by a mark or a pin: 0.05..0.5 degree.
    pub(super) const ZERO_RAD: f64 = 0.006;
    /// Gears and bearings yield with 1e3..3e4 Nm/rad.
    pub(super) const FLEXIBILITY_RAD_PER_NM: f64 = 3e-4;
    /// A table or pedestal leans by 0.1..0.5 degree.
    pub(super) const TILT_RAD: f64 = 0.006;
    /// Machined distances between axes: some tenths of a millimetre.
    pub(super) const SHIFT_M: f64 = 5e-4;
    /// Machined directions of axes: a tenth of a degree.
    pub(super) const TURN_RAD: f64 = 2e-3;
    /// A weight off a shelf.
    pub(super) const WEIGHT_SHARE: f64 = 5e-3;
    /// A weight's centre, measured with a caliper.
    pub(super) const WEIGHT_COM_M: f64 = 1e-3;
    /// Gain of a commercial force/torque sensor.
    pub(super) const REFERENCE_GAIN: f64 = 0.01;
    /// Its mounting against the tip frame.
    pub(super) const REFERENCE_TURN_RAD: f64 = 0.01;
    /// Its zero, N; Nm over the characteristic length.
    pub(super) const REFERENCE_ZERO_N: f64 = 0.02;
}

#[derive(Clone, Copy, Debug)]
enum Kind {
    /// A number of a joint's correction, in the order of its array.
    Joint {
        joint: usize,
        number: usize,
    },
    /// A turn of a joint's frame about an axis across the joint's.
    Turn {
        joint: usize,
        axis: Vector3<f64>,
    },
    /// A turn of gravity about a horizontal axis of the base.
    Gravity(Vector3<f64>),
    /// Relative mass of all weights that are said to be equally heavy.
    WeightMass(usize),
    /// Where a weight hangs.
    WeightCom(usize, usize),
    ReferenceGain(usize),
    ReferenceTurn(usize),
    ReferenceZero(usize),
}

/// One number that can be other than declared.
#[derive(Clone, Debug)]
pub struct Parameter {
    /// With which others it is admitted.
    pub group: Group,
    /// Standard deviation before any data, in its SI unit.
    pub width: f64,
    /// What it is, with its unit last.
    pub name: String,
    kind: Kind,
}

/// All such numbers of one calibration.
#[derive(Clone, Debug)]
pub struct Parameters {
    /// The numbers.
    pub list: Vec<Parameter>,
    masses_kg: Vec<f64>,
    bodies: Vec<RigidBody>,
    joints: usize,
}

/// Arm, weights and reference for one choice of the numbers.
#[derive(Clone, Debug)]
pub struct Setup {
    /// Corrections of the arm.
    pub arm: ArmCorrection,
    weights: Vec<RigidBody>,
    reference: Matrix6<f64>,
    reference_zero: Vector6<f64>,
}

impl Parameters {
    /// For an arm and the rows that were recorded with it.
    pub fn new(chain: &Chain, rows: &[Row]) -> Self {
        let mut bodies: Vec<RigidBody> = Vec::new();
        let mut masses_kg: Vec<f64> = Vec::new();
        for row in rows.iter().filter(|row| row.body.mass_kg != 0.0) {
            if !bodies.contains(&row.body) {
                bodies.push(row.body);
            }
            if !masses_kg.contains(&row.body.mass_kg) {
                masses_kg.push(row.body.mass_kg);
            }
        }
        let mut out = Self { list: Vec::new(), masses_kg, bodies, joints: chain.joints.len() };
        out.add_links(chain);
        out.add_joints(chain);
        out.add_surroundings(chain, rows.iter().any(|row| row.reference.is_some()));
        out
    }

    fn add(&mut self, group: Group, width: f64, name: String, kind: Kind) {
        self.list.push(Parameter { group, width, name, kind });
    }

    fn add_links(&mut self, chain: &Chain) {
        for (joint, entry) in chain.joints.iter().enumerate().filter(|(_, j)| j.body.mass_kg > 0.0) {
            let (link, mass_kg) = (&entry.child_link, entry.body.mass_kg);
            let kind = |number| Kind::Joint { joint, number };
            let width = width::MASS_SHARE * mass_kg;
            self.add(Group::LinkMasses, width, format!("{link}.mass_kg"), kind(0));
            for (axis, number) in ["x", "y", "z"].iter().zip(1..) {
                let name = format!("{link}.first_moment_{axis}_kgm");
                self.add(Group::LinkMasses, width::COM_M * mass_kg, name, kind(number));
            }
        }
    }

    fn add_joints(&mut self, chain: &Chain) {
        for (joint, entry) in chain.joints.iter().enumerate() {
            let name = &entry.name;
            let kind = |number| Kind::Joint { joint, number };
            if entry.coordinate.is_some() {
                self.add(Group::EncoderZeros, width::ZERO_RAD, format!("{name}.zero_rad"), kind(4));
                let yields = format!("{name}.flexibility_rad_per_nm");
                self.add(Group::JointFlexibility, width::FLEXIBILITY_RAD_PER_NM, yields, kind(11));
            }
            // Where the whole arm stands does not matter at rest.
            if joint == 0 {
                continue;
            }
            for (axis, number) in ["x", "y", "z"].iter().zip(8..) {
                let name = format!("{name}.shift_{axis}_m");
                self.add(Group::JointPlacement, width::SHIFT_M, name, kind(number));
            }
            // Turns about a moving joint's axis are its zero.
            let axes: Vec<Vector3<f64>> = match entry.kind {
                JointKind::Fixed => vec![Vector3::x(), Vector3::y(), Vector3::z()],
                _ => across(&entry.axis).into(),
            };
            for (axis, letter) in axes.into_iter().zip(["a", "b", "c"]) {
                let name = format!("{name}.turn_{letter}_rad");
                self.add(Group::JointPlacement, width::TURN_RAD, name, Kind::Turn { joint, axis });
            }
        }
    }

    fn add_surroundings(&mut self, chain: &Chain, reference: bool) {
        if let Some(down) = chain.gravity_mps2.try_normalize(0.0) {
            for (axis, letter) in across(&down).into_iter().zip(["a", "b"]) {
                let name = format!("gravity.turn_{letter}_rad");
                self.add(Group::BaseTilt, width::TILT_RAD, name, Kind::Gravity(axis));
            }
        }
        for (index, mass_kg) in self.masses_kg.clone().into_iter().enumerate() {
            let name = format!("weight_{mass_kg}_kg.relative_mass");
            self.add(Group::Weights, width::WEIGHT_SHARE, name, Kind::WeightMass(index));
        }
        for index in 0..self.bodies.len() {
            for (letter, axis) in ["x", "y", "z"].iter().zip(0..) {
                let name = format!("weight_place_{}.{letter}_m", index + 1);
                self.add(Group::Weights, width::WEIGHT_COM_M, name, Kind::WeightCom(index, axis));
            }
        }
        if !reference {
            return;
        }
        const PARTS: [&str; 6] = ["fx", "fy", "fz", "tx", "ty", "tz"];
        for (k, part) in PARTS.iter().enumerate() {
            let name = format!("reference.gain_{part}");
            self.add(Group::Reference, width::REFERENCE_GAIN, name, Kind::ReferenceGain(k));
        }
        for (k, letter) in ["x", "y", "z"].iter().enumerate() {
            let name = format!("reference.turn_{letter}_rad");
            self.add(Group::Reference, width::REFERENCE_TURN_RAD, name, Kind::ReferenceTurn(k));
        }
        for (k, part) in PARTS.iter().enumerate() {
            let (unit, length) = if k < 3 { ("n", 1.0) } else { ("nm", super::LENGTH_M) };
            let name = format!("reference.zero_{part}_{unit}");
            self.add(Group::Reference, width::REFERENCE_ZERO_N * length, name, Kind::ReferenceZero(k));
        }
    }

    /// Arm, weights and reference at these values.
    pub fn setup(&self, values: &[f64]) -> Setup {
        let mut numbers = vec![[0.0; model::arm::JOINT_NUMBERS]; self.joints];
        let mut gravity = Vector3::zeros();
        let mut turn = Vector3::<f64>::zeros();
        let mut gain = Vector6::repeat(1.0);
        let mut reference_zero = Vector6::zeros();
        let mut heavier = vec![0.0; self.masses_kg.len()];
        let mut places = vec![Vector3::zeros(); self.bodies.len()];
        for (parameter, value) in self.list.iter().zip(values) {
            match parameter.kind {
                Kind::Joint { joint, number } => numbers[joint][number] += value,
                Kind::Turn { joint, axis } => (0..3).for_each(|k| numbers[joint][5 + k] += axis[k] * value),
                Kind::Gravity(axis) => gravity += axis * *value,
                Kind::WeightMass(index) => heavier[index] += value,
                Kind::WeightCom(index, axis) => places[index][axis] += value,
                Kind::ReferenceGain(k) => gain[k] += value,
                Kind::ReferenceTurn(k) => turn[k] += value,
                Kind::ReferenceZero(k) => reference_zero[k] += value,
            }
        }
        let weight = |(body, place): (&RigidBody, &Vector3<f64>)| {
            let heavier = self.masses_kg.iter().zip(&heavier).find(|(mass, _)| **mass == body.mass_kg);
            let mass_kg = body.mass_kg * (1.0 + heavier.map_or(0.0, |(_, share)| *share));
            let com_m = body.com_m().unwrap_or_default() + place;
            RigidBody::from_com(mass_kg, com_m, Matrix3::zeros())
        };
        let turned = Rotation3::new(turn).into_inner();
        let mut reference = Matrix6::<f64>::zeros();
        reference.fixed_view_mut::<3, 3>(0, 0).copy_from(&turned);
        reference.fixed_view_mut::<3, 3>(3, 3).copy_from(&turned);
        Setup {
            arm: ArmCorrection {
                gravity_turn_rad: gravity.into(),
                joints: numbers.iter().map(JointCorrection::from_array).collect(),
            },
            weights: self.bodies.iter().zip(&places).map(weight).collect(),
            reference: reference * Matrix6::from_diagonal(&gain),
            reference_zero,
        }
    }

    /// What hangs on the tip where this was declared.
    pub fn weight<'a>(&self, setup: &'a Setup, declared: &RigidBody) -> Option<&'a RigidBody> {
        self.bodies.iter().position(|body| body == declared).map(|index| &setup.weights[index])
    }
}

impl Setup {
    /// The wrench that acted where the reference said this (N, Nm, in E).
    pub fn reference(&self, said: &Vector6<f64>) -> Vector6<f64> {
        self.reference * (said - self.reference_zero)
    }
}

/// Two unit vectors across a direction and across each other.
fn across(direction: &Vector3<f64>) -> [Vector3<f64>; 2] {
    let turn = model::chain::rotation_from_z(direction);
    [turn.column(0).into_owned(), turn.column(1).into_owned()]
}
