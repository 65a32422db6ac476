//! Links, joints and base as they were built.

use model::chain::Chain;
use model::spatial::{Pose, RigidBody};
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use rand::RngExt;
use rand::rngs::StdRng;

use super::{log_uniform, uniform};
use crate::gauge::normal;

/// Standard deviation of a link's mass against the URDF's.
const MASS_SHARE: f64 = 0.03;
/// Standard deviation of its centre of mass, m, each axis.
const COM_M: f64 = 0.002;
/// Standard deviation of an encoder's zero, rad: two tenths of a degree.
const ZERO_RAD: f64 = 0.0035;
/// Standard deviation of a joint's place, m, each axis.
const SHIFT_M: f64 = 0.0002;
/// Standard deviation of a joint's direction, rad, each axis.
const TURN_RAD: f64 = 0.0005;
/// How far the base leans, rad.
const LEAN_RAD: (f64, f64) = (0.002, 0.006);
/// Stiffness of joints under load, Nm/rad.
const STIFFNESS_NM_PER_RAD: (f64, f64) = (3e3, 2e4);
/// By what share a joint is softer around no torque.
const SOFTER: (f64, f64) = (0.2, 0.6);
/// Torque at which half of that is gone, Nm.
const STIFFENS_AT_NM: (f64, f64) = (3.0, 10.0);

/// The arm that was built where another was drawn.
#[derive(Clone, Debug, PartialEq)]
pub struct Body {
    /// Masses, places and gravity as they are.
    pub chain: Chain,
    /// True position less the encoder's of each coordinate, rad.
    pub zeros_rad: Vec<f64>,
    /// What each coordinate's joint yields.
    pub springs: Vec<Spring>,
}

/// A geared joint: soft around no torque, stiffer under load (K1 < K2 < K3 in data sheets of strain-wave gears).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spring {
    /// Stiffness under much torque, Nm/rad.
    pub stiffness_nm_per_rad: f64,
    /// By what share it yields more around none.
    pub softer: f64,
    /// Torque at which half of that is gone, Nm.
    pub stiffens_at_nm: f64,
    /// From one side of the gear's play to the other, rad.
    pub play_rad: f64,
}

/// Torque that takes up most of a gear's play, Nm.
const PLAY_TAKEN_UP_NM: f64 = 0.05;

impl Spring {
    /// How far it yields under a torque (Nm), rad.
    #[must_use]
    pub fn yield_rad(&self, torque_nm: f64) -> f64 {
        let soft = self.softer / (1.0 + (torque_nm / self.stiffens_at_nm).powi(2));
        let side = torque_nm / torque_nm.hypot(PLAY_TAKEN_UP_NM);
        torque_nm / self.stiffness_nm_per_rad * (1.0 + soft) + 0.5 * self.play_rad * side
    }
}

impl Body {
    /// The arm as it was drawn: stiff, its encoders right.
    #[must_use]
    pub fn nominal(chain: &Chain) -> Self {
        let stiff =
            Spring { stiffness_nm_per_rad: f64::INFINITY, softer: 0.0, stiffens_at_nm: 1.0, play_rad: 0.0 };
        let coordinates = chain.coordinates();
        Self { chain: chain.clone(), zeros_rad: vec![0.0; coordinates], springs: vec![stiff; coordinates] }
    }

    pub(super) fn draw(nominal: &Chain, rng: &mut StdRng) -> Self {
        let mut chain = nominal.clone();
        for (index, joint) in chain.joints.iter_mut().enumerate() {
            joint.body = built(&joint.body, rng);
            if index > 0 {
                let turn = Rotation3::new(vector(TURN_RAD, rng)).into_inner();
                joint.origin = Pose {
                    translation_m: joint.origin.translation_m + vector(SHIFT_M, rng),
                    rotation: joint.origin.rotation * turn,
                };
            }
        }
        let azimuth = uniform(rng, 0.0, std::f64::consts::TAU);
        let lean_rad = uniform(rng, LEAN_RAD.0, LEAN_RAD.1);
        let axis = Unit::new_normalize(Vector3::new(azimuth.cos(), azimuth.sin(), 0.0));
        chain.gravity_mps2 = Rotation3::from_axis_angle(&axis, lean_rad) * nominal.gravity_mps2;
        let coordinates = nominal.coordinates();
        let spring = |rng: &mut StdRng| Spring {
            stiffness_nm_per_rad: log_uniform(rng, STIFFNESS_NM_PER_RAD.0, STIFFNESS_NM_PER_RAD.1),
            softer: rng.random_range(SOFTER.0..SOFTER.1),
            stiffens_at_nm: uniform(rng, STIFFENS_AT_NM.0, STIFFENS_AT_NM.1),
            play_rad: 0.0,
        };
        Self {
            chain,
            zeros_rad: (0..coordinates).map(|_| ZERO_RAD * normal(rng)).collect(),
            springs: (0..coordinates).map(|_| spring(rng)).collect(),
        }
    }
}

/// A link with its screws, cables and paint.
fn built(drawn: &RigidBody, rng: &mut StdRng) -> RigidBody {
    let share = 1.0 + MASS_SHARE * normal(rng);
    let Some(com_m) = drawn.com_m() else { return *drawn };
    let mass_kg = drawn.mass_kg * share;
    let com_m = com_m + vector(COM_M, rng);
    let heavier = RigidBody::from_com(mass_kg, com_m, Matrix3::zeros());
    RigidBody { inertia_kgm2: drawn.inertia_kgm2 * share, ..heavier }
}

fn vector(sigma: f64, rng: &mut StdRng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| sigma * normal(rng))
}
