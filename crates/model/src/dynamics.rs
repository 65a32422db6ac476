//! Loads of the arm's own weight and motion at every section, and the way of a tip wrench to every section.
//!
//! The recursive Newton-Euler algorithm (R. Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 5), in axes that move
//! with the arm. [`Dynamics::new`] flattens the chain into segments whose z axis is their joint's axis, wherever possible
//! the sensing frames themselves, so that loads come out in S without a further rotation; fixed joints without a section
//! vanish. A `Dynamics` is its own workspace: nothing after `new` allocates, every loop is bounded by the segments.
//!
//! Sign: a load is what the outboard side applies to the inboard side. An arm at rest under its section weighs `m g`.

mod derivatives;
mod flatten;
mod inertial;
mod outboard;
mod pass;
mod regressor;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;

use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};

use crate::chain::{Chain, Section};
use crate::spatial::{Pose, RigidBody, Tip, Wrench, join, skew};
use derivatives::Derivatives;

/// What moves a segment against its inboard neighbour.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Turn {
    /// About the segment's z axis, by the coordinate of this index.
    Coordinate(usize),
    Fixed,
}

/// Constant part of a segment: its frame at coordinate zero seen from the inboard segment's, and what it carries.
#[derive(Debug, Clone)]
struct Segment {
    turn: Turn,
    origin: Pose,
    body: RigidBody,
}

/// State of a segment in its own frame.
#[derive(Debug, Clone)]
struct State {
    /// Components in this segment's frame to components in the inboard one's.
    rotation: Matrix3<f64>,
    motion: Motion,
    /// What this segment and everything outboard applies to the inboard side, about this frame's origin.
    force_n: Vector3<f64>,
    moment_nm: Vector3<f64>,
    /// The tip frame seen from this one.
    tip: Pose,
}

/// Motion of a frame against the base, in its own axes: rotation, and acceleration of the origin less gravity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Angular velocity against the base, rad/s.
    pub velocity_rad_s: Vector3<f64>,
    /// Angular acceleration against the base, rad/s^2.
    pub acceleration_rad_s2: Vector3<f64>,
    /// Acceleration of the frame's origin minus gravity (what an accelerometer there shows), m/s^2.
    pub proper_mps2: Vector3<f64>,
}

impl Motion {
    /// At rest under this gravity (m/s^2, own axes).
    fn at_rest(gravity_mps2: &Vector3<f64>) -> Self {
        Self {
            velocity_rad_s: Vector3::zeros(),
            acceleration_rad_s2: Vector3::zeros(),
            proper_mps2: -gravity_mps2,
        }
    }

    /// Proper acceleration (m/s^2) of a point fixed in this frame at `point_m` (m).
    #[inline]
    fn at(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        let w = &self.velocity_rad_s;
        self.proper_mps2 + self.acceleration_rad_s2.cross(point_m) + w.cross(&w.cross(point_m))
    }

    /// Motion of a frame fixed in this one.
    fn of(&self, pose: &Pose) -> Self {
        Self {
            velocity_rad_s: pose.rotation.tr_mul(&self.velocity_rad_s),
            acceleration_rad_s2: pose.rotation.tr_mul(&self.acceleration_rad_s2),
            proper_mps2: pose.rotation.tr_mul(&self.at(&pose.translation_m)),
        }
    }

    /// Force (N) and moment about the frame's origin (Nm) that a body which moves so applies to what carries it.
    #[inline]
    fn load_of(&self, body: &RigidBody) -> (Vector3<f64>, Vector3<f64>) {
        let (w, h, b) = (&self.velocity_rad_s, &body.first_moment_kgm, &self.proper_mps2);
        let inertia = &body.inertia_kgm2;
        let force = b * body.mass_kg + self.acceleration_rad_s2.cross(h) + w.cross(&w.cross(h));
        let moment = inertia * self.acceleration_rad_s2 + w.cross(&(inertia * w)) + h.cross(b);
        (-force, -moment)
    }
}

/// The arm with its sections, compiled for the cycle, with the state of the last update.
#[derive(Debug, Clone)]
pub struct Dynamics {
    gravity_mps2: Vector3<f64>,
    coordinates: usize,
    segments: Vec<Segment>,
    states: Vec<State>,
    /// The segment whose frame is the section's, per section.
    sections: Vec<usize>,
    /// Where a joint's child link sits: the segment and the link's frame in it; none inboard of all segments.
    links: Vec<Option<(usize, Pose)>>,
    /// The tip frame in the last segment's, or in the base if there are no segments.
    tip: Pose,
    /// What the last segment carries without a payload.
    unloaded: RigidBody,
    /// How many of the coordinates, in the order of the chain, lie inboard of a section, per section.
    inboard: Vec<usize>,
    /// Per coordinate its segment.
    turning: Vec<usize>,
    sines: Vec<(f64, f64)>,
    derivatives: Derivatives,
}

impl Dynamics {
    /// Compiles chain and sections (SI); allocates all that the updates need.
    ///
    /// A chain that a calibration changed afterwards needs a new `Dynamics`. A section whose joint the chain does not
    /// have counts as one at the tip.
    #[must_use]
    pub fn new(chain: &Chain, sections: &[Section]) -> Self {
        flatten::flatten(chain, sections)
    }

    /// Number of coordinates (rad) that an update takes.
    #[must_use]
    pub fn coordinates(&self) -> usize {
        self.coordinates
    }

    /// Number of sections.
    #[must_use]
    pub fn sections(&self) -> usize {
        self.sections.len()
    }

    /// Load of a section: force (N) and moment (Nm) that the arm outboard applies to its inboard side, about S, in S.
    #[inline]
    #[must_use]
    pub fn load(&self, section: usize) -> Vector6<f64> {
        let state = &self.states[self.sections[section]];
        join(&state.force_n, &state.moment_nm)
    }

    /// The tip frame E seen from a section's frame S (m), and the section's load as force (N) and moment (Nm) about S, in S.
    #[inline]
    pub(crate) fn section(&self, section: usize) -> (&Pose, &Vector3<f64>, &Vector3<f64>) {
        let state = &self.states[self.sections[section]];
        (&state.tip, &state.force_n, &state.moment_nm)
    }

    /// The tip frame E seen from a section's frame S (m): its rotation takes components in E to components in S.
    #[inline]
    #[must_use]
    pub fn tip_in_section(&self, section: usize) -> &Pose {
        &self.states[self.sections[section]].tip
    }

    /// Row for a tip wrench in E (counts/N, counts/Nm) of a gauge with the compliance `compliance` in S.
    ///
    /// `row . W = compliance . (X_SE W)` with `X_SE` of [`Self::tip_adjoint`].
    #[inline]
    #[must_use]
    pub fn row_to_tip(&self, section: usize, compliance: &Vector6<f64>) -> Vector6<f64> {
        let tip = self.tip_in_section(section);
        let force = Vector3::new(compliance[0], compliance[1], compliance[2]);
        let moment = Vector3::new(compliance[3], compliance[4], compliance[5]);
        let at_tip = force + moment.cross(&tip.translation_m);
        join(&tip.rotation.tr_mul(&at_tip), &tip.rotation.tr_mul(&moment))
    }

    /// Matrix `X_SE` that takes a tip wrench in E (N, Nm about E) to the load of the section in S (N, Nm about S).
    #[must_use]
    pub fn tip_adjoint(&self, section: usize) -> Matrix6<f64> {
        let tip = self.tip_in_section(section);
        let mut adjoint = Matrix6::zeros();
        adjoint.fixed_view_mut::<3, 3>(0, 0).copy_from(&tip.rotation);
        adjoint.fixed_view_mut::<3, 3>(3, 3).copy_from(&tip.rotation);
        let lever = skew(&tip.translation_m) * tip.rotation;
        adjoint.fixed_view_mut::<3, 3>(3, 0).copy_from(&lever);
        adjoint
    }

    /// Load (N, Nm, about S, in S) that a tip wrench in E adds to a section.
    #[must_use]
    pub fn load_of_tip_wrench(
        &self,
        section: usize,
        wrench: &Wrench<Tip>,
    ) -> Wrench<crate::spatial::Section> {
        let tip = self.tip_in_section(section);
        let force = tip.rotation * wrench.force_n;
        Wrench::new(force, tip.rotation * wrench.moment_nm + tip.translation_m.cross(&force))
    }

    /// Torque about a coordinate's axis (Nm) that the arm outboard of its joint and a tip wrench in E apply to the inboard side.
    #[must_use]
    pub fn joint_torque_nm(&self, coordinate: usize, wrench: &Wrench<Tip>) -> f64 {
        let state = &self.states[self.turning[coordinate]];
        let force = state.tip.rotation * wrench.force_n;
        let moment = state.tip.rotation * wrench.moment_nm + state.tip.translation_m.cross(&force);
        state.moment_nm.z + moment.z
    }

    /// The tip frame E in the base frame W (m).
    #[must_use]
    pub fn tip_in_base(&self) -> Pose {
        match self.segments.len() {
            0 => self.tip,
            count => self.segment_in_base(count - 1).compose(&self.tip),
        }
    }

    /// A section's frame S in the base frame W (m).
    #[must_use]
    pub fn section_in_base(&self, section: usize) -> Pose {
        self.segment_in_base(self.sections[section])
    }

    /// Motion of the tip frame (rad/s, rad/s^2, m/s^2, in E).
    #[must_use]
    pub fn tip_motion(&self) -> Motion {
        let base = Motion::at_rest(&self.gravity_mps2);
        self.states.last().map_or(base, |state| state.motion).of(&self.tip)
    }

    /// Wrench (N, Nm, about E, in E) that a body rigidly at the tip (tip frame) applies to the arm: weight and inertia.
    #[must_use]
    pub fn payload_wrench(&self, body: &RigidBody) -> Wrench<Tip> {
        let (force, moment) = self.tip_motion().load_of(body);
        Wrench::new(force, moment)
    }

    /// Makes a body (tip frame) that is rigidly fixed to the tip a part of the arm, in place of the one before; a body without
    /// mass takes it off. Counts from the next update on; exact, as if the chain had been made with it.
    pub fn set_payload(&mut self, body: &RigidBody) {
        if let Some(last) = self.segments.last_mut() {
            last.body = self.unloaded + body.transformed(&self.tip);
        }
    }

    fn segment_in_base(&self, segment: usize) -> Pose {
        let place = |index: usize| Pose {
            rotation: self.states[index].rotation,
            translation_m: self.segments[index].origin.translation_m,
        };
        (0..=segment).fold(Pose::identity(), |placed, index| placed.compose(&place(index)))
    }
}
