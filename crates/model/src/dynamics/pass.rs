//! The passes outwards (motion) and inwards (loads, tip frame).

use nalgebra::{Matrix3, Vector3};

use super::{Dynamics, Motion, Segment, Turn};
use crate::spatial::Pose;

impl Dynamics {
    /// Loads and tip transport at the positions `positions_rad` (rad), at rest.
    ///
    /// The slice has one entry per coordinate; missing ones keep their last value.
    pub fn update_static(&mut self, positions_rad: &[f64]) {
        self.sines(positions_rad);
        let mut gravity = self.gravity_mps2;
        for (segment, state) in self.segments.iter().zip(&mut self.states) {
            state.rotation = rotation(segment, &self.sines);
            gravity = state.rotation.tr_mul(&gravity);
            state.motion = Motion::at_rest(&gravity);
        }
        let (mut mass_kg, mut first_moment_kgm) = (0.0, Vector3::zeros());
        for (segment, state) in self.segments.iter().zip(&mut self.states).rev() {
            mass_kg += segment.body.mass_kg;
            first_moment_kgm += segment.body.first_moment_kgm;
            let gravity = -state.motion.proper_mps2;
            state.force_n = gravity * mass_kg;
            state.moment_nm = first_moment_kgm.cross(&gravity);
            first_moment_kgm = state.rotation * first_moment_kgm + segment.origin.translation_m * mass_kg;
        }
        self.carry_tip();
    }

    /// Loads and tip transport at the positions (rad), velocities (rad/s) and accelerations (rad/s^2) of the joints.
    ///
    /// The slices have one entry per coordinate; missing positions keep their last value, missing rates count as zero.
    pub fn update(&mut self, positions_rad: &[f64], velocities_rad_s: &[f64], accelerations_rad_s2: &[f64]) {
        self.update_loads(positions_rad, velocities_rad_s, accelerations_rad_s2);
        self.carry_tip();
    }

    /// The loads alone, in five sixths of the time. What is asked about the tip seen from a segment (all ways of a tip wrench) needs
    /// [`Self::carry_tip`] before.
    pub fn update_loads(
        &mut self,
        positions_rad: &[f64],
        velocities_rad_s: &[f64],
        accelerations_rad_s2: &[f64],
    ) {
        self.sines(positions_rad);
        let mut inboard = Motion::at_rest(&self.gravity_mps2);
        for (segment, state) in self.segments.iter().zip(&mut self.states) {
            state.rotation = rotation(segment, &self.sines);
            let place = Pose { rotation: state.rotation, translation_m: segment.origin.translation_m };
            inboard = inboard.of(&place);
            if let Turn::Coordinate(index) = segment.turn {
                let rate_rad_s = velocities_rad_s.get(index).copied().unwrap_or(0.0);
                let acceleration_rad_s2 = accelerations_rad_s2.get(index).copied().unwrap_or(0.0);
                turn(&mut inboard, rate_rad_s, acceleration_rad_s2);
            }
            state.motion = inboard;
        }
        let (mut force_n, mut moment_nm) = (Vector3::zeros(), Vector3::zeros());
        for (segment, state) in self.segments.iter().zip(&mut self.states).rev() {
            let (own_force_n, own_moment_nm) = state.motion.load_of(&segment.body);
            state.force_n = force_n + own_force_n;
            state.moment_nm = moment_nm + own_moment_nm;
            force_n = state.rotation * state.force_n;
            moment_nm = state.rotation * state.moment_nm + segment.origin.translation_m.cross(&force_n);
        }
    }

    fn sines(&mut self, positions_rad: &[f64]) {
        for (sine, position_rad) in self.sines.iter_mut().zip(positions_rad) {
            *sine = position_rad.sin_cos();
        }
    }

    /// Tip transport at the positions of the last update: brings the tip frame inwards from segment to segment.
    pub fn carry_tip(&mut self) {
        let mut tip = self.tip;
        for (segment, state) in self.segments.iter().zip(&mut self.states).rev() {
            state.tip = tip;
            tip.translation_m = segment.origin.translation_m + state.rotation * tip.translation_m;
            tip.rotation = state.rotation * tip.rotation;
        }
    }
}

/// Takes components in the segment's frame to components in the inboard one's.
#[inline]
fn rotation(segment: &Segment, sines: &[(f64, f64)]) -> Matrix3<f64> {
    let fixed = &segment.origin.rotation;
    match segment.turn {
        Turn::Fixed => *fixed,
        Turn::Coordinate(index) => {
            let (sin, cos) = sines[index];
            let (x, y) = (fixed.column(0), fixed.column(1));
            Matrix3::from_columns(&[x * cos + y * sin, y * cos - x * sin, fixed.column(2).into_owned()])
        }
    }
}

/// Adds a turn about z to the motion of a frame.
#[inline]
fn turn(motion: &mut Motion, rate_rad_s: f64, acceleration_rad_s2: f64) {
    let carried = motion.velocity_rad_s;
    motion.velocity_rad_s.z += rate_rad_s;
    motion.acceleration_rad_s2 +=
        Vector3::new(carried.y * rate_rad_s, -carried.x * rate_rad_s, acceleration_rad_s2);
}
