//! The passes inwards (places), outwards (motion) and inwards again (loads).

use nalgebra::{Matrix3, Vector3};

use super::{Dynamics, Motion, Segment, Turn};
use crate::spatial::Pose;

impl Dynamics {
    /// Loads and tip transport at the positions `positions_rad` (rad), at rest.
    ///
    /// The slice has one entry per coordinate; missing ones keep their last value.
    pub fn update_static(&mut self, positions_rad: &[f64]) {
        self.place(positions_rad);
        let still = self.still;
        let gravity = -still.proper_mps2;
        self.has_inertia = false;
        let (mut mass_kg, mut first_moment_kgm) = (0.0, Vector3::zeros());
        for (segment, state) in self.segments.iter().zip(&mut self.states).rev() {
            let body = &segment.body;
            state.body.mass_kg = body.mass_kg;
            state.body.first_moment_kgm =
                state.tip.rotation.tr_mul(&body.first_moment_kgm) + state.point_m * body.mass_kg;
            mass_kg += state.body.mass_kg;
            first_moment_kgm += state.body.first_moment_kgm;
            state.motion = still;
            state.force_n = gravity * mass_kg;
            state.moment_nm = first_moment_kgm.cross(&gravity);
        }
    }

    /// Loads and tip transport at the positions (rad), velocities (rad/s) and accelerations (rad/s^2) of the joints.
    ///
    /// The slices have one entry per coordinate; missing positions keep their last value, missing rates count as zero.
    pub fn update(&mut self, positions_rad: &[f64], velocities_rad_s: &[f64], accelerations_rad_s2: &[f64]) {
        self.place(positions_rad);
        let mut motion = self.still;
        for (segment, state) in self.segments.iter().zip(&mut self.states) {
            if let Turn::Coordinate(index) = segment.turn {
                let rate_rad_s = velocities_rad_s.get(index).copied().unwrap_or(0.0);
                let acceleration_rad_s2 = accelerations_rad_s2.get(index).copied().unwrap_or(0.0);
                motion = motion.turned(&state.axis, &state.point_m, rate_rad_s, acceleration_rad_s2);
            }
            state.motion = motion;
        }
        self.turn_bodies();
        let (mut force_n, mut moment_nm) = (Vector3::zeros(), Vector3::zeros());
        for state in self.states.iter_mut().rev() {
            let (own_force_n, own_moment_nm) = state.motion.load_of(&state.body);
            force_n += own_force_n;
            moment_nm += own_moment_nm;
            state.force_n = force_n;
            state.moment_nm = moment_nm;
        }
    }

    /// Brings the segments' bodies to E.
    pub(super) fn turn_bodies(&mut self) {
        for (segment, state) in self.segments.iter().zip(&mut self.states) {
            let place = Pose { rotation: state.tip.rotation.transpose(), translation_m: state.point_m };
            state.body = segment.body.transformed(&place);
        }
        self.has_inertia = true;
    }

    /// Places all segments at these positions (rad), from the tip inwards.
    fn place(&mut self, positions_rad: &[f64]) {
        for (sine, position_rad) in self.sines.iter_mut().zip(positions_rad) {
            *sine = position_rad.sin_cos();
        }
        let mut tip = self.tip;
        for (segment, state) in self.segments.iter().zip(&mut self.states).rev() {
            state.rotation = rotation(segment, &self.sines);
            state.tip = tip;
            state.axis = tip.rotation.row(2).transpose();
            state.point_m = -tip.rotation.tr_mul(&tip.translation_m);
            tip.translation_m = segment.origin.translation_m + state.rotation * tip.translation_m;
            tip.rotation = state.rotation * tip.rotation;
        }
        self.still = Motion::at_rest(&tip.rotation.tr_mul(&self.gravity_mps2));
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
