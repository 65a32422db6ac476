//! Exact derivatives of the sections' loads by the joints' positions, velocities and accelerations.
//!
//! Everything is written in the inertial frame that coincides with the tip frame E at this instant. A load is
//! `L = -integral over the outboard mass of (b, r x b)` with the proper acceleration `b = a - g`. With `z`, `p` the axis
//! of joint j, `W`, `V0`, `B0` rotation, velocity and proper acceleration of the inboard side of the joint at E's origin,
//! `Q = [W'] + [W]^2`, and `u = v - V0 - W x r` the velocity against that side, the acceleration of outboard mass changes by
//!
//! ```text
//! d/dq'':  z x (r - p)
//! d/dq' :  2 W x (z x (r - p)) + 2 z x u
//! d/dq  :  Q (z x (r - p)) + 2 W x (z x u) + z x (b - B0 - Q r - 2 W x u)
//! ```
//!
//! each of which is affine in r, v and b, so that sums over the outboard mass (mass, first and second moment, momentum,
//! the moment of velocity) are all that is needed. If j lies inboard of the section, the section turns along, and the
//! terms `z x b` are exactly those that turning the frame takes away again.

use nalgebra::{Vector3, Vector6};

use super::outboard::{Composite, Screw, Sum};
use super::{Dynamics, Motion, Turn};
use crate::spatial::{Pose, Tip, Wrench, join};

/// Tables of derivatives, one row per section, and what they are computed from.
#[derive(Debug, Clone)]
pub(super) struct Derivatives {
    composites: Vec<Composite>,
    screws: Vec<Screw>,
    by_position: Vec<Vector6<f64>>,
    by_velocity: Vec<Vector6<f64>>,
    by_acceleration: Vec<Vector6<f64>>,
}

impl Derivatives {
    pub(super) fn new(segments: usize, sections: usize, coordinates: usize) -> Self {
        let screw = Screw {
            axis: Vector3::z(),
            point_m: Vector3::zeros(),
            inboard: Motion::at_rest(&Vector3::zeros()),
            inboard_mps: Vector3::zeros(),
        };
        let table = vec![Vector6::zeros(); sections * coordinates];
        Self {
            composites: vec![Composite::zero(); segments],
            screws: vec![screw; coordinates],
            by_position: table.clone(),
            by_velocity: table.clone(),
            by_acceleration: table,
        }
    }
}

impl Dynamics {
    /// Computes the loads' derivatives at the state of the last update, whichever it was.
    ///
    /// Exact; does not allocate; some 15 times as long as the update itself on the reference arm with eight sections.
    pub fn differentiate(&mut self) {
        self.collect();
        for section in 0..self.sections.len() {
            for coordinate in 0..self.coordinates {
                let place = section * self.coordinates + coordinate;
                let outboard = self.turning[coordinate] > self.sections[section];
                let felt = self.turning[coordinate].max(self.sections[section]);
                let composite = &self.derivatives.composites[felt];
                let screw = &self.derivatives.screws[coordinate];
                let position = match outboard {
                    true => add(composite.sum(&screw.by_position()), self.turned_load(coordinate)),
                    false => composite.sum(&screw.by_position()),
                };
                let velocity = composite.sum(&screw.by_velocity());
                let acceleration = composite.sum(&screw.by_acceleration());
                self.derivatives.by_position[place] = self.reaction(section, position);
                self.derivatives.by_velocity[place] = self.reaction(section, velocity);
                self.derivatives.by_acceleration[place] = self.reaction(section, acceleration);
            }
        }
    }

    /// The same after an update at rest, faster: the rates are taken as zero, and with them the derivative by velocity.
    pub fn differentiate_static(&mut self) {
        self.collect_static();
        for section in 0..self.sections.len() {
            for coordinate in 0..self.coordinates {
                let place = section * self.coordinates + coordinate;
                let outboard = self.turning[coordinate] > self.sections[section];
                let felt = self.turning[coordinate].max(self.sections[section]);
                let composite = &self.derivatives.composites[felt];
                let screw = &self.derivatives.screws[coordinate];
                let constant = -screw.axis.cross(&screw.inboard.proper_mps2);
                let force = constant * composite.mass_kg;
                let weight = (force, composite.first_kgm.cross(&constant));
                let position = if outboard { add(weight, self.turned_load(coordinate)) } else { weight };
                let acceleration = composite.sum(&screw.by_acceleration());
                self.derivatives.by_position[place] = self.reaction(section, position);
                self.derivatives.by_velocity[place] = Vector6::zeros();
                self.derivatives.by_acceleration[place] = self.reaction(section, acceleration);
            }
        }
    }

    /// Derivative of a section's load (in S) by a coordinate: N/rad, Nm/rad; as of the last `differentiate`.
    #[must_use]
    pub fn by_position(&self, section: usize, coordinate: usize) -> &Vector6<f64> {
        &self.derivatives.by_position[section * self.coordinates + coordinate]
    }

    /// Derivative of a section's load (in S) by a joint's velocity: N s/rad, Nm s/rad; as of the last `differentiate`.
    #[must_use]
    pub fn by_velocity(&self, section: usize, coordinate: usize) -> &Vector6<f64> {
        &self.derivatives.by_velocity[section * self.coordinates + coordinate]
    }

    /// Derivative of a section's load (in S) by a joint's acceleration: N s^2/rad, Nm s^2/rad; as of the last `differentiate`.
    #[must_use]
    pub fn by_acceleration(&self, section: usize, coordinate: usize) -> &Vector6<f64> {
        &self.derivatives.by_acceleration[section * self.coordinates + coordinate]
    }

    /// Derivative by a coordinate of what a tip wrench, constant in E, adds to a section's load (in S): N/rad, Nm/rad.
    ///
    /// Needs a `differentiate` at this state; zero for joints inboard of the section, which turn section and tip alike.
    #[must_use]
    pub fn tip_wrench_by_position(
        &self,
        section: usize,
        coordinate: usize,
        wrench: &Wrench<Tip>,
    ) -> Vector6<f64> {
        if self.turning[coordinate] <= self.sections[section] {
            return Vector6::zeros();
        }
        let turned = self.derivatives.screws[coordinate].turned(&wrench.force_n, &wrench.moment_nm);
        -self.reaction(section, turned)
    }

    /// Change by a coordinate of the sum of `(b, r x b)` outboard of its joint, as far as it turns along.
    fn turned_load(&self, coordinate: usize) -> Sum {
        let state = &self.states[self.turning[coordinate]];
        let at_tip = state.moment_nm - state.tip.translation_m.cross(&state.force_n);
        let (force, moment) = (state.tip.rotation.tr_mul(&state.force_n), state.tip.rotation.tr_mul(&at_tip));
        self.derivatives.screws[coordinate].turned(&-force, &-moment)
    }

    /// Load in S that answers a sum of `(b, r x b)` given in E: shifted, turned and reversed.
    fn reaction(&self, section: usize, (force, moment): Sum) -> Vector6<f64> {
        let tip = self.tip_in_section(section);
        let force = tip.rotation * -force;
        join(&force, &(tip.rotation * -moment + tip.translation_m.cross(&force)))
    }

    /// Motion of what carries a segment, at E's origin in E's axes.
    fn inboard(&self, segment: usize) -> Motion {
        let carried = &self.states[segment];
        let place =
            Pose { rotation: carried.rotation, translation_m: self.segments[segment].origin.translation_m };
        match segment.checked_sub(1) {
            None => Motion::at_rest(&self.gravity_mps2).of(&place).of(&carried.tip),
            Some(inboard) => self.states[inboard].motion.of(&self.states[inboard].tip),
        }
    }

    fn collect(&mut self) {
        let (mut velocity_mps, mut inboard) = (Vector3::zeros(), Vector3::zeros());
        for index in 0..self.segments.len() {
            let tip = self.states[index].tip;
            let to_tip = tip.inverse();
            let rotation = tip.rotation.tr_mul(&self.states[index].motion.velocity_rad_s);
            if let Turn::Coordinate(coordinate) = self.segments[index].turn {
                self.derivatives.screws[coordinate] = Screw {
                    axis: to_tip.rotation * Vector3::z(),
                    point_m: to_tip.translation_m,
                    inboard: self.inboard(index),
                    inboard_mps: velocity_mps,
                };
                velocity_mps += to_tip.translation_m.cross(&(rotation - inboard));
            }
            inboard = rotation;
            self.derivatives.composites[index] =
                Composite::of(&self.segments[index].body, &to_tip).moving(&velocity_mps, &rotation);
        }
        self.accumulate();
    }

    fn collect_static(&mut self) {
        for index in 0..self.segments.len() {
            let state = &self.states[index];
            let to_tip = state.tip.inverse();
            if let Turn::Coordinate(coordinate) = self.segments[index].turn {
                let screw = &mut self.derivatives.screws[coordinate];
                screw.axis = to_tip.rotation * Vector3::z();
                screw.point_m = to_tip.translation_m;
                screw.inboard = Motion::at_rest(&-(to_tip.rotation * state.motion.proper_mps2));
                screw.inboard_mps = Vector3::zeros();
            }
            self.derivatives.composites[index] = Composite::of(&self.segments[index].body, &to_tip);
        }
        self.accumulate();
    }

    /// Adds to every segment what is outboard of it.
    fn accumulate(&mut self) {
        let mut outboard = Composite::zero();
        for composite in self.derivatives.composites.iter_mut().rev() {
            outboard.mass_kg += composite.mass_kg;
            outboard.first_kgm += composite.first_kgm;
            outboard.second_kgm2 += composite.second_kgm2;
            outboard.momentum += composite.momentum;
            outboard.velocity_moment += composite.velocity_moment;
            *composite = outboard;
        }
    }
}

fn add((force, moment): Sum, (other_force, other_moment): Sum) -> Sum {
    (force + other_force, moment + other_moment)
}
