//! From chain and sections to segments.

use nalgebra::{Matrix3, Vector3};

use super::derivatives::Derivatives;
use super::{Dynamics, Motion, Segment, State, Turn};
use crate::chain::{Chain, Joint, Section, rotation_from_z};
use crate::spatial::{Pose, RigidBody};

/// Segments so far, and where the link that is being looked at sits.
struct Flattening {
    segments: Vec<Segment>,
    sections: Vec<usize>,
    /// The current link's frame in the last segment's (in the base's before the first).
    here: Pose,
}

pub(super) fn flatten(chain: &Chain, sections: &[Section]) -> Dynamics {
    let mut flat = Flattening {
        segments: Vec::new(),
        sections: vec![usize::MAX; sections.len()],
        here: Pose::identity(),
    };
    let mut links = Vec::with_capacity(chain.joints.len());
    for (index, joint) in chain.joints.iter().enumerate() {
        flat.joint(joint, index, sections);
        links.push(flat.segments.len().checked_sub(1).map(|segment| (segment, flat.here)));
    }
    for (section, place) in sections.iter().zip(0..) {
        if flat.sections[place] == usize::MAX {
            flat.section(place, &section.r_cs);
        }
    }
    let coordinates = chain.coordinates();
    let mut turning = vec![0; coordinates];
    for (index, segment) in flat.segments.iter().enumerate() {
        if let Turn::Coordinate(coordinate) = segment.turn {
            turning[coordinate] = index;
        }
    }
    debug_assert!(turning.is_sorted(), "coordinates are counted from base to tip");
    let inboard = |section: &usize| turning.iter().filter(|segment| *segment <= section).count();
    let mut dynamics = Dynamics {
        inboard: flat.sections.iter().map(inboard).collect(),
        gravity_mps2: chain.gravity_mps2,
        coordinates,
        states: flat.segments.iter().map(|segment| at_zero(segment, &chain.gravity_mps2)).collect(),
        derivatives: Derivatives::new(flat.segments.len(), coordinates),
        unloaded: flat.segments.last().map_or_else(RigidBody::zero, |last| last.body),
        segments: flat.segments,
        sections: flat.sections,
        links,
        tip: flat.here,
        turning,
        sines: vec![(0.0, 1.0); coordinates],
    };
    dynamics.update_static(&vec![0.0; coordinates]);
    dynamics
}

impl Flattening {
    fn joint(&mut self, joint: &Joint, index: usize, sections: &[Section]) {
        self.here = self.here.compose(&joint.origin);
        let mine = |section: &Section| section.joint == index;
        if let Some(coordinate) = joint.coordinate {
            // Any frame with the axis as z will do; a section's spares that section a segment of its own.
            let turned = sections
                .iter()
                .filter(|section| mine(section))
                .map(|section| section.r_cs)
                .find(|r_cs| (r_cs * Vector3::z() - joint.axis).amax() < 1e-12)
                .unwrap_or_else(|| rotation_from_z(&joint.axis));
            self.segment(Turn::Coordinate(coordinate), &turned);
        }
        for (place, section) in sections.iter().enumerate().filter(|(_, section)| mine(section)) {
            self.section(place, &section.r_cs);
        }
        if let Some(last) = self.segments.last_mut() {
            last.body += joint.body.transformed(&self.here);
        }
    }

    /// Gives the section at the current link a segment, an existing one if it has the same frame.
    fn section(&mut self, place: usize, r_cs: &Matrix3<f64>) {
        let in_last = self.here.compose(&Pose { rotation: *r_cs, translation_m: Vector3::zeros() });
        let same =
            (in_last.rotation - Matrix3::identity()).amax() < 1e-15 && in_last.translation_m.amax() == 0.0;
        if !same || self.segments.is_empty() {
            self.segment(Turn::Fixed, r_cs);
        }
        self.sections[place] = self.segments.len() - 1;
    }

    /// Adds a segment whose frame is the current link's turned by `turned`, still without a body.
    fn segment(&mut self, turn: Turn, turned: &Matrix3<f64>) {
        let origin = self.here.compose(&Pose { rotation: *turned, translation_m: Vector3::zeros() });
        self.segments.push(Segment { turn, origin, body: RigidBody::zero() });
        self.here = Pose { rotation: turned.transpose(), translation_m: Vector3::zeros() };
    }
}

fn at_zero(segment: &Segment, gravity_mps2: &Vector3<f64>) -> State {
    State {
        rotation: segment.origin.rotation,
        motion: Motion::at_rest(gravity_mps2),
        force_n: Vector3::zeros(),
        moment_nm: Vector3::zeros(),
        tip: Pose::identity(),
    }
}
