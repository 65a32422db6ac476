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
use wide::{f64x2, f64x4};

use super::inertial::{FOUR, Inertial};
use super::outboard::{Carried, Field, Screw, Sum};
use super::{Dynamics, Motion};
use crate::lanes::Triple;
use crate::spatial::{Pose, Tip, Wrench, join};

/// Joints that are worked on at once.
const LANES: usize = 2;

/// What the derivatives are read from: sums over the mass outboard of each segment, and what each joint's change does to it.
#[derive(Debug, Clone)]
pub(super) struct Derivatives {
    /// The segments, four at a time.
    groups: Vec<Inertial>,
    composites: Vec<Carried<f64>>,
    joints: Vec<Change>,
}

/// Two neighbouring joints' change: the fields of acceleration by position, velocity and acceleration, and their sums over all that is carried.
#[derive(Debug, Clone)]
struct Change {
    screw: Screw<f64x2>,
    outboard: Carried<f64x2>,
    /// The load of all that is carried: force and moment about E's origin, in E.
    load: Sum<f64x2>,
    fields: [Field<f64x2>; 3],
    carried: [Sum<f64x2>; 3],
}

impl Derivatives {
    pub(super) fn new(segments: usize, coordinates: usize) -> Self {
        let zero = Triple::all(&Vector3::zeros());
        let screw = Screw::unmoved();
        let change = Change {
            fields: screw.fields(),
            screw,
            outboard: Carried::zero(),
            load: (zero, zero),
            carried: [(zero, zero); 3],
        };
        Self {
            groups: vec![Inertial::nothing(); segments.div_ceil(FOUR)],
            composites: vec![Carried::zero(); segments],
            joints: vec![change; coordinates.div_ceil(LANES)],
        }
    }
}

impl Change {
    /// Takes in how the joints of these segments lie, what loads them, and how their inboard sides move; `still` is the base's motion.
    fn look(&mut self, groups: &[Inertial], segment: impl Fn(usize) -> usize, still: &Motion) {
        let at = |lane: usize, of: fn(&Inertial) -> &Triple<f64x4>| {
            of(&groups[segment(lane) / FOUR]).at(segment(lane) % FOUR)
        };
        let inboard = |lane: usize, of: fn(&Inertial) -> &Triple<f64x4>, base: &Vector3<f64>| {
            segment(lane)
                .checked_sub(1)
                .map_or(*base, |inboard| of(&groups[inboard / FOUR]).at(inboard % FOUR))
        };
        let own = |of: fn(&Inertial) -> &Triple<f64x4>| {
            let both = [at(0, of), at(1, of)];
            Triple::gather(|lane| &both[lane])
        };
        let before = |of: fn(&Inertial) -> &Triple<f64x4>, base: &Vector3<f64>| {
            let both = [inboard(0, of, base), inboard(1, of, base)];
            Triple::gather(|lane| &both[lane])
        };
        self.screw = Screw {
            axis: own(|group| &group.axis),
            point_m: own(|group| &group.point_m),
            rotation_rad_s: before(|group| &group.rotation_rad_s, &still.velocity_rad_s),
            turning_rad_s2: before(|group| &group.turning_rad_s2, &still.acceleration_rad_s2),
            proper_mps2: before(|group| &group.proper_mps2, &still.proper_mps2),
            velocity_mps: before(|group| &group.velocity_mps, &Vector3::zeros()),
        };
        self.load = (own(|group| &group.force_n), own(|group| &group.moment_nm));
    }

    fn find(&mut self) {
        self.fields = self.screw.fields();
        let [position, velocity, acceleration] = &self.fields;
        let (force, moment) = self.outboard.sum(position);
        // What is carried turns along.
        let (turned_force, turned_moment) = self.screw.turned(&self.load.0, &self.load.1);
        let by_position = (force - turned_force, moment - turned_moment);
        self.carried = [by_position, self.outboard.sum(velocity), self.outboard.sum_still(acceleration)];
    }

    /// What a row makes of the change where the joints carry its section, and what it senses is that function of fields.
    #[inline]
    fn inboard(&self, felt: &Field<f64x2>) -> [f64x2; 3] {
        let [position, velocity, acceleration] = &self.fields;
        [-felt.dot(position), -felt.dot(velocity), -felt.dot_still(acceleration)]
    }

    /// The same where the joints lie outboard of it.
    #[inline]
    fn outboard(&self, (force, moment): &Sum<f64x2>) -> [f64x2; 3] {
        self.carried.map(|(f, m)| -(force.dot(&f) + moment.dot(&m)))
    }
}

impl Dynamics {
    /// Computes what the loads' derivatives are read from, at the state of the last update, whichever it was.
    ///
    /// Exact; does not allocate; about as long as the update itself.
    pub fn differentiate(&mut self) {
        self.collect();
        self.derivatives.joints.iter_mut().for_each(Change::find);
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
        let pairs = self.row_by_motion_of_two(section, row);
        let joints = pairs.flat_map(|pair| [0, 1].map(|lane| pair.map(|part| part.as_array()[lane])));
        joints.take(self.coordinates)
    }

    /// The same for two joints at a time; behind the last joint comes what means nothing, where their number is odd.
    #[inline]
    pub(crate) fn row_by_motion_of_two<'a>(
        &'a self,
        section: usize,
        row: &Vector6<f64>,
    ) -> impl Iterator<Item = [f64x2; 3]> + 'a {
        let row = [row.fixed_rows::<3>(0).into_owned(), row.fixed_rows::<3>(3).into_owned()];
        let felt = self.derivatives.composites[self.sections[section]]
            .felt(&Triple::all(&row[0]), &Triple::all(&row[1]));
        let twice = |t: &Triple<f64>| Triple::all(&Vector3::new(t.x, t.y, t.z));
        let felt =
            Field { spin: twice(&felt.spin), constant: twice(&felt.constant), turning: twice(&felt.turning) };
        let row = (Triple::all(&row[0]), Triple::all(&row[1]));
        let inboard = self.inboard_coordinates(section);
        self.derivatives.joints.iter().enumerate().map(move |(pair, change)| {
            match inboard.saturating_sub(LANES * pair) {
                0 => change.outboard(&row),
                1 => {
                    let (first, second) = (change.inboard(&felt), change.outboard(&row));
                    std::array::from_fn(|k| f64x2::new([first[k].as_array()[0], second[k].as_array()[1]]))
                }
                _ => change.inboard(&felt),
            }
        })
    }

    /// Whether a joint's turning moves the section as a whole, with all that is outboard of it.
    fn carries(&self, coordinate: usize, section: usize) -> bool {
        self.turning[coordinate] <= self.sections[section]
    }

    fn derivative(&self, section: usize, coordinate: usize, of: usize) -> Vector6<f64> {
        let change = &self.derivatives.joints[coordinate / LANES];
        let (force, moment) = match self.carries(coordinate, section) {
            true => {
                let outboard = &self.derivatives.composites[self.sections[section]];
                Carried::gather(|_| outboard).sum(&change.fields[of])
            }
            false => change.carried[of],
        };
        self.reaction(section, (force.at(coordinate % LANES), moment.at(coordinate % LANES)))
    }

    /// Change by a coordinate of a tip wrench, constant in E, as a section inboard of the joint feels it: N/rad, Nm/rad about E's origin,
    /// in E as it was. Needs a `differentiate` at this state.
    #[must_use]
    pub fn turned_wrench(&self, coordinate: usize, wrench: &Wrench<Tip>) -> Vector6<f64> {
        let (force, moment) = self.turned_by_two(coordinate / LANES, wrench);
        join(&force.at(coordinate % LANES), &moment.at(coordinate % LANES))
    }

    /// The same for every two joints.
    pub(crate) fn turned_wrenches<'a>(
        &'a self,
        wrench: &'a Wrench<Tip>,
    ) -> impl Iterator<Item = [f64x2; 6]> + 'a {
        (0..self.derivatives.joints.len()).map(|pair| {
            let (force, moment) = self.turned_by_two(pair, wrench);
            [force.x, force.y, force.z, moment.x, moment.y, moment.z]
        })
    }

    #[inline]
    fn turned_by_two(&self, pair: usize, wrench: &Wrench<Tip>) -> Sum<f64x2> {
        let screw = &self.derivatives.joints[pair].screw;
        screw.turned(&Triple::all(&wrench.force_n), &Triple::all(&wrench.moment_nm))
    }

    /// Whether a joint's turning turns a tip wrench against a section: it lies outboard of it.
    #[must_use]
    pub fn turns_tip(&self, coordinate: usize, section: usize) -> bool {
        !self.carries(coordinate, section)
    }

    /// How many coordinates lie inboard of a section and turn it as a whole: the first ones.
    #[must_use]
    pub fn inboard_coordinates(&self, section: usize) -> usize {
        self.inboard[section]
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
        let turned = self.turned_wrench(coordinate, wrench);
        -self.reaction(
            section,
            (turned.fixed_rows::<3>(0).into_owned(), turned.fixed_rows::<3>(3).into_owned()),
        )
    }

    /// Load in S that answers a sum of `(b, r x b)` given in E: shifted, turned and reversed.
    fn reaction(&self, section: usize, (force, moment): (Vector3<f64>, Vector3<f64>)) -> Vector6<f64> {
        let tip = self.tip_in_section(section);
        let force = tip.rotation * -force;
        join(&force, &(tip.rotation * -moment + tip.translation_m.cross(&force)))
    }

    /// Motion of the base, at E's origin in E's axes.
    fn base_motion(&self) -> Motion {
        let base = Motion::at_rest(&self.gravity_mps2);
        let Some((segment, state)) = self.segments.first().zip(self.states.first()) else { return base };
        let place = Pose { rotation: state.rotation, translation_m: segment.origin.translation_m };
        base.of(&place).of(&state.tip)
    }

    /// Sums over what is outboard of each segment, and with them what each joint carries, and how its inboard side moves.
    fn collect(&mut self) {
        let still = self.base_motion();
        let Derivatives { groups, composites, joints } = &mut self.derivatives;
        let (mut velocity_mps, mut before) = (Vector3::zeros(), Vector3::zeros());
        let parts = self.segments.chunks(FOUR).zip(self.states.chunks(FOUR));
        for (group, (segments, states)) in groups.iter_mut().zip(parts) {
            group.look(segments, states);
            let velocities: [Vector3<f64>; FOUR] = std::array::from_fn(|lane| {
                // The joint's own point moves alike on both sides.
                let rotation = group.rotation_rad_s.at(lane);
                velocity_mps += group.point_m.at(lane).cross(&(rotation - before));
                before = rotation;
                velocity_mps
            });
            group.velocity_mps = Triple::gather(|lane| &velocities[lane]);
        }
        let mut outboard = Carried::zero();
        for (group, composites) in groups.iter().zip(composites.chunks_mut(FOUR)).rev() {
            let own = group.carried();
            for (lane, composite) in composites.iter_mut().enumerate().rev() {
                outboard.add(&own, lane);
                *composite = outboard;
            }
        }
        for (pair, joint) in joints.iter_mut().enumerate() {
            let segment = |lane: usize| self.turning[(LANES * pair + lane).min(self.coordinates - 1)];
            joint.outboard = Carried::gather(|lane| &composites[segment(lane)]);
            joint.look(groups, segment, &still);
        }
    }
}
