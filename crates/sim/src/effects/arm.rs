//! Effects of the arm: masses, zeros, springs, the base, what hangs at the tip, what touches a link.

use nalgebra::{Rotation3, Unit, Vector3, Vector6};
use rand::RngExt;
use rig::Rig;

use super::{Effect, Kind, Place};
use crate::imperfect::{Body, Spring};
use crate::random::{Purpose, stream};
use crate::scenario::Scenario;

/// Where a weight hangs elsewhere, m per kg of which it is heavier.
const DISPLACED_M_PER_KG: f64 = 0.05;
/// Time in which a touch grows and vanishes, s.
const RAMP_S: f64 = 0.15;

/// Changes the arm itself.
pub(super) fn change(effect: &Effect, body: &mut Body) {
    match (effect.kind, effect.place) {
        (Kind::LinkMass, Place::Link(link)) => {
            let own = &mut body.chain.joints[link].body;
            let factor = 1.0 + effect.strength;
            own.mass_kg *= factor;
            own.first_moment_kgm *= factor;
            own.inertia_kgm2 *= factor;
        }
        (Kind::EncoderOffset, Place::Joint(joint)) => body.zeros_rad[joint] += effect.strength,
        (Kind::JointFlexibility, Place::Joint(joint)) => {
            let spring = &mut body.springs[joint];
            let tight = Spring { play_rad: 0.0, ..*spring };
            let stiffness_nm_per_rad = (tight.yield_rad(1.0) + effect.strength).recip();
            *spring = Spring { stiffness_nm_per_rad, softer: 0.0, ..*spring };
        }
        (Kind::Backlash, Place::Joint(joint)) => body.springs[joint].play_rad += effect.strength,
        (Kind::LinkOffset, Place::Link(link)) => {
            let mut rng = stream(effect.seed, Purpose::Effects);
            let to = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
            let to = to.try_normalize(1e-6).unwrap_or_else(Vector3::x);
            body.chain.joints[link].origin.translation_m += to * effect.strength;
        }
        (Kind::BaseTilt, _) => {
            let azimuth = stream(effect.seed, Purpose::Effects).random_range(0.0..std::f64::consts::TAU);
            let axis = Unit::new_normalize(Vector3::new(azimuth.cos(), azimuth.sin(), 0.0));
            body.chain.gravity_mps2 =
                Rotation3::from_axis_angle(&axis, effect.strength) * body.chain.gravity_mps2;
        }
        _ => {}
    }
}

/// Changes what hangs at the tip where something was declared.
pub(super) fn change_loads(effect: &Effect, scenario: &mut Scenario) {
    if effect.kind != Kind::Payload {
        return;
    }
    let mut rng = stream(effect.seed, Purpose::Effects);
    let to: [f64; 3] = std::array::from_fn(|_| rng.random_range(-1.0..1.0));
    for load in scenario.loads.iter_mut().filter(|load| load.mass_kg > 0.0) {
        load.mass_kg = (load.mass_kg + effect.strength).max(0.0);
        for (place, to) in load.com_m.iter_mut().zip(to) {
            *place += DISPLACED_M_PER_KG * effect.strength * to;
        }
    }
}

/// A force on a link for a while.
#[derive(Clone, Debug)]
pub(crate) struct Contact {
    link: usize,
    from_s: f64,
    to_s: f64,
    /// N, in the base frame.
    force_n: Vector3<f64>,
    /// Where it acts, m, in the link's frame.
    point_m: Vector3<f64>,
}

impl Contact {
    pub(super) fn new(effect: &Effect, rig: &Rig, scenario: &Scenario) -> Option<Self> {
        let (Kind::ExternalContact, Place::Link(link)) = (effect.kind, effect.place) else { return None };
        let mut rng = stream(effect.seed, Purpose::Effects);
        let duration_s = scenario.duration_s();
        let begin_s = duration_s * rng.random_range(0.1..0.6);
        let drawn = [begin_s, begin_s + duration_s * rng.random_range(0.15..0.3)];
        let given = [effect.number("from_s"), effect.number("to_s")];
        let [from_s, to_s] = if given[0] >= 0.0 && given[1] > given[0] { given } else { drawn };
        let direction = Vector3::from_fn(|_, _| rng.random_range(-1.0..1.0));
        let beside_m = Vector3::from_fn(|_, _| rng.random_range(-0.03..0.03));
        Some(Self {
            link,
            from_s,
            to_s,
            force_n: direction.try_normalize(1e-6).unwrap_or_else(Vector3::x) * effect.strength,
            point_m: rig.chain.joints[link].body.com_m().unwrap_or_default() + beside_m,
        })
    }

    /// What it adds to every section's load (N, Nm about S, in S) at an instant in a pose (rad).
    pub(crate) fn add(&self, rig: &Rig, t_s: f64, positions_rad: &[f64], loads: &mut [Vector6<f64>]) {
        let grown = ((t_s - self.from_s) / RAMP_S).min((self.to_s - t_s) / RAMP_S).clamp(0.0, 1.0);
        if grown == 0.0 {
            return;
        }
        let placements = rig.chain.placements(positions_rad);
        let point_m = placements[self.link].point(&self.point_m);
        let force_n = self.force_n * grown;
        for (section, load) in
            rig.sections.iter().zip(loads).filter(|(section, _)| section.joint <= self.link)
        {
            let place = &placements[section.joint];
            let to_section = (place.rotation * section.r_cs).transpose();
            let moment_nm = (point_m - place.translation_m).cross(&force_n);
            let (force, moment) = (to_section * force_n, to_section * moment_nm);
            *load += Vector6::new(force.x, force.y, force.z, moment.x, moment.y, moment.z);
        }
    }
}
