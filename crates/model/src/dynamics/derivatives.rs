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

use super::outboard::{Composite, Field, Screw, Sum};
use super::{Dynamics, Motion, Turn};
use crate::spatial::{Pose, Tip, Wrench, join};

/// What the derivatives are read from: sums over the mass outboard of each segment, and what each joint's change does to it.
#[derive(Debug, Clone)]
pub(super) struct Derivatives {
    composites: Vec<Composite>,
    joints: Vec<Change>,
}

/// A joint's change: the fields of acceleration by its position, velocity and acceleration, and their sums over all that it carries.
#[derive(Debug, Clone)]
struct Change {
    screw: Screw,
    fields: [Field; 3],
    carried: [Sum; 3],
}

impl Derivatives {
    pub(super) fn new(segments: usize, coordinates: usize) -> Self {
        let screw = Screw {
            axis: Vector3::z(),
            point_m: Vector3::zeros(),
            inboard: Motion::at_rest(&Vector3::zeros()),
            inboard_mps: Vector3::zeros(),
        };
        let nothing = (Vector3::zeros(), Vector3::zeros());
        let change = Change { screw, fields: screw.fields(), carried: [nothing; 3] };
        Self { composites: vec![Composite::zero(); segments], joints: vec![change; coordinates] }
    }
}

impl Dynamics {
    /// Computes what the loads' derivatives are read from, at the state of the last update, whichever it was.
    ///
    /// Exact; does not allocate; about as long as the update itself.
    pub fn differentiate(&mut self) {
        self.collect();
        for coordinate in 0..self.coordinates {
            let turned = self.turned_load(coordinate);
            let Derivatives { composites, joints } = &mut self.derivatives;
            let (carried, joint) = (&composites[self.turning[coordinate]], &mut joints[coordinate]);
            joint.fields = joint.screw.fields();
            joint.carried = joint.fields.each_ref().map(|field| carried.sum(field));
            joint.carried[0] = add(joint.carried[0], turned);
        }
    }

    /// Derivative of a section's load (in S) by a coordinate: N/rad, Nm/rad; as of the last `differentiate`.
    #[must_use]
    pub fn by_position(&self, section: usize, coordinate: usize) -> Vector6<f64> {
        self.derivative(section, coordinate, 0)
    }

    /// Derivative of a section's load (in S) by a joint's velocity: N s/rad, Nm s/rad; as of the last `differentiate`.
    #[must_use]
    pub fn by_velocity(&self, section: usize, coordinate: usize) -> Vector6<f64> {
        self.derivative(section, coordinate, 1)
    }

    /// Derivative of a section's load (in S) by a joint's acceleration: N s^2/rad, Nm s^2/rad; as of the last `differentiate`.
    #[must_use]
    pub fn by_acceleration(&self, section: usize, coordinate: usize) -> Vector6<f64> {
        self.derivative(section, coordinate, 2)
    }

    /// All derivatives of what a gauge senses of the section's load, by each coordinate's position, velocity and acceleration in turn:
    /// counts s^k/rad; for the gauge's row to the tip (counts/N, counts/Nm, as [`Self::row_to_tip`] has it), as of the last `differentiate`.
    ///
    /// The same as the compliance's products with the derivatives, for a fraction of the work: the row's share of the mass is summed once.
    pub fn row_by_motion<'a>(
        &'a self,
        section: usize,
        row: &Vector6<f64>,
    ) -> impl Iterator<Item = [f64; 3]> + 'a {
        let (force, moment) = (row.fixed_rows::<3>(0).into_owned(), row.fixed_rows::<3>(3).into_owned());
        let felt = self.derivatives.composites[self.sections[section]].felt(&force, &moment);
        self.derivatives.joints.iter().enumerate().map(move |(coordinate, change)| {
            match self.carries(coordinate, section) {
                true => change.fields.each_ref().map(|field| -felt.of(field)),
                false => change.carried.map(|(f, m)| -(force.dot(&f) + moment.dot(&m))),
            }
        })
    }

    /// Whether a joint's turning moves the section as a whole, with all that is outboard of it.
    fn carries(&self, coordinate: usize, section: usize) -> bool {
        self.turning[coordinate] <= self.sections[section]
    }

    fn derivative(&self, section: usize, coordinate: usize, of: usize) -> Vector6<f64> {
        let change = &self.derivatives.joints[coordinate];
        let sum = match self.carries(coordinate, section) {
            true => self.derivatives.composites[self.sections[section]].sum(&change.fields[of]),
            false => change.carried[of],
        };
        self.reaction(section, sum)
    }

    /// Change by a coordinate of a tip wrench, constant in E, as a section inboard of the joint feels it: N/rad, Nm/rad about E's origin,
    /// in E as it was. Needs a `differentiate` at this state.
    #[must_use]
    pub fn turned_wrench(&self, coordinate: usize, wrench: &Wrench<Tip>) -> Vector6<f64> {
        let (force, moment) =
            self.derivatives.joints[coordinate].screw.turned(&wrench.force_n, &wrench.moment_nm);
        join(&force, &moment)
    }

    /// Whether a joint's turning turns a tip wrench against a section: it lies outboard of it.
    #[must_use]
    pub fn turns_tip(&self, coordinate: usize, section: usize) -> bool {
        !self.carries(coordinate, section)
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
        if self.carries(coordinate, section) {
            return Vector6::zeros();
        }
        let turned = self.derivatives.joints[coordinate].screw.turned(&wrench.force_n, &wrench.moment_nm);
        -self.reaction(section, turned)
    }

    /// Change by a coordinate of the sum of `(b, r x b)` outboard of its joint, as far as it turns along.
    fn turned_load(&self, coordinate: usize) -> Sum {
        let state = &self.states[self.turning[coordinate]];
        let at_tip = state.moment_nm - state.tip.translation_m.cross(&state.force_n);
        let (force, moment) = (state.tip.rotation.tr_mul(&state.force_n), state.tip.rotation.tr_mul(&at_tip));
        self.derivatives.joints[coordinate].screw.turned(&-force, &-moment)
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
                self.derivatives.joints[coordinate].screw = Screw {
                    axis: to_tip.rotation * Vector3::z(),
                    point_m: to_tip.translation_m,
                    inboard: self.inboard(index),
                    inboard_mps: velocity_mps,
                };
                velocity_mps += to_tip.translation_m.cross(&(rotation - inboard));
            }
            inboard = rotation;
            self.derivatives.composites[index] =
                Composite::of(&self.segments[index].body, &to_tip, &velocity_mps, &rotation);
        }
        self.accumulate();
    }

    /// Adds to every segment what is outboard of it.
    fn accumulate(&mut self) {
        let mut outboard = Composite::zero();
        for composite in self.derivatives.composites.iter_mut().rev() {
            outboard.mass_kg += composite.mass_kg;
            outboard.first_kgm += composite.first_kgm;
            outboard.inertia_kgm2 += composite.inertia_kgm2;
            outboard.momentum += composite.momentum;
            outboard.velocity_moment += composite.velocity_moment;
            *composite = outboard;
        }
    }
}

fn add((force, moment): Sum, (other_force, other_moment): Sum) -> Sum {
    (force + other_force, moment + other_moment)
}
