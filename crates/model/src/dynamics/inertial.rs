//! Segments in the inertial frame that coincides with the tip frame E, four at a time: their bodies and how they move there.

use nalgebra::Vector3;
use wide::f64x4;

use super::outboard::Carried;
use super::{Segment, State};
use crate::lanes::{Number, Rows, Triple};

/// Segments of a group.
pub(super) const FOUR: usize = 4;

/// Up to four segments in E's axes and about its origin; behind the last one comes what means nothing.
#[derive(Debug, Clone)]
pub(super) struct Inertial {
    mass_kg: f64x4,
    first_kgm: Triple<f64x4>,
    inertia_kgm2: Rows<f64x4>,
    /// Their frames' z axes and origins (m).
    pub(super) axis: Triple<f64x4>,
    pub(super) point_m: Triple<f64x4>,
    /// Rotation (rad/s) and its change (rad/s^2), and velocity (m/s) and proper acceleration (m/s^2) as if E's origin were a point of them.
    pub(super) rotation_rad_s: Triple<f64x4>,
    pub(super) turning_rad_s2: Triple<f64x4>,
    pub(super) proper_mps2: Triple<f64x4>,
    pub(super) velocity_mps: Triple<f64x4>,
    /// Load: force (N) and moment (Nm).
    pub(super) force_n: Triple<f64x4>,
    pub(super) moment_nm: Triple<f64x4>,
}

impl Inertial {
    pub(super) fn nothing() -> Self {
        let zero = Triple::all(&Vector3::zeros());
        Self {
            mass_kg: f64x4::ZERO,
            first_kgm: zero,
            inertia_kgm2: Rows([zero; 3]),
            axis: zero,
            point_m: zero,
            rotation_rad_s: zero,
            turning_rad_s2: zero,
            proper_mps2: zero,
            velocity_mps: zero,
            force_n: zero,
            moment_nm: zero,
        }
    }

    /// Of these segments; what they carry, and all but their velocity.
    pub(super) fn look(&mut self, segments: &[Segment], states: &[State]) {
        let last = states.len() - 1;
        let state = |lane: usize| &states[lane.min(last)];
        let rotation = Rows::gather(|lane| &state(lane).tip.rotation);
        let tip_m = Triple::gather(|lane| &state(lane).tip.translation_m);
        let to_tip = |vector: &Triple<f64x4>| rotation.transposed_times(vector);
        self.axis = rotation.0[2];
        self.point_m = -to_tip(&tip_m);
        self.move_along(states, &tip_m, to_tip);
        let force = Triple::gather(|lane| &state(lane).force_n);
        let moment = Triple::gather(|lane| &state(lane).moment_nm);
        self.force_n = to_tip(&force);
        self.moment_nm = to_tip(&(moment - tip_m.cross(&force)));
        self.carry(segments, &rotation);
    }

    fn move_along(
        &mut self,
        states: &[State],
        tip_m: &Triple<f64x4>,
        to_tip: impl Fn(&Triple<f64x4>) -> Triple<f64x4>,
    ) {
        let motion = |lane: usize| &states[lane.min(states.len() - 1)].motion;
        let w = Triple::gather(|lane| &motion(lane).velocity_rad_s);
        let turning = Triple::gather(|lane| &motion(lane).acceleration_rad_s2);
        let proper = Triple::gather(|lane| &motion(lane).proper_mps2);
        self.rotation_rad_s = to_tip(&w);
        self.turning_rad_s2 = to_tip(&turning);
        self.proper_mps2 = to_tip(&(proper + turning.cross(tip_m) + w.cross(&w.cross(tip_m))));
    }

    /// Brings the bodies to E: with `s = h + p m / 2` the shift adds `2 p.s - p s' - s p'` to the turned inertia.
    fn carry(&mut self, segments: &[Segment], rotation: &Rows<f64x4>) {
        let body = |lane: usize| &segments[lane.min(segments.len() - 1)].body;
        let (p, columns) = (self.point_m, rotation.columns());
        let mass_kg = f64x4::gather(|lane| body(lane).mass_kg);
        let turned = rotation.transposed_times(&Triple::gather(|lane| &body(lane).first_moment_kgm));
        let inertia = Rows::gather(|lane| &body(lane).inertia_kgm2);
        let [x, y, z] = columns.each_ref().map(|column| inertia.times(column));
        let half = turned + p * (mass_kg * f64x4::HALF);
        let along = Triple { x: p.x * half.x, y: p.y * half.y, z: p.z * half.z } * f64x4::splat(2.0);
        let xy = columns[0].dot(&y) - (p.x * half.y + half.x * p.y);
        let xz = columns[0].dot(&z) - (p.x * half.z + half.x * p.z);
        let yz = columns[1].dot(&z) - (p.y * half.z + half.y * p.z);
        let xx = columns[0].dot(&x) + (along.y + along.z);
        let yy = columns[1].dot(&y) + (along.x + along.z);
        let zz = columns[2].dot(&z) + (along.x + along.y);
        self.mass_kg = mass_kg;
        self.first_kgm = turned + p * mass_kg;
        let row = |x, y, z| Triple { x, y, z };
        self.inertia_kgm2 = Rows([row(xx, xy, xz), row(xy, yy, yz), row(xz, yz, zz)]);
    }

    /// Sums over each segment's own mass.
    pub(super) fn carried(&self) -> Carried<f64x4> {
        let (v, w) = (&self.velocity_mps, &self.rotation_rad_s);
        Carried::of(self.mass_kg, &self.first_kgm, &self.inertia_kgm2, v, w)
    }
}
