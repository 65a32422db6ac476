//! Sums over the mass outboard of a joint, and the fields of acceleration that a joint's change makes there.

use nalgebra::{Matrix3, Vector3};

use super::Motion;
use crate::lanes::{Number, Rows, Triple};
use crate::spatial::{RigidBody, skew};

/// A force (N) and its moment (Nm) about E's origin, in E.
pub(super) type Sum<T> = (Triple<T>, Triple<T>);

/// Sums over the mass of a segment and of everything outboard of it, about E's origin in E's axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Composite {
    pub(super) mass_kg: f64,
    /// Sum of `r`.
    pub(super) first_kgm: Vector3<f64>,
    /// Sum of `r^2 - r r^T`.
    pub(super) inertia_kgm2: Matrix3<f64>,
    /// Sum of `v`.
    pub(super) momentum: Vector3<f64>,
    /// Sum of `r v^T`.
    pub(super) velocity_moment: Matrix3<f64>,
}

impl Composite {
    /// A body in E, with the velocity (m/s) at E's origin and the rotation (rad/s).
    #[inline]
    pub(super) fn of(body: &RigidBody, velocity_mps: &Vector3<f64>, rotation_rad_s: &Vector3<f64>) -> Self {
        let RigidBody { mass_kg, first_moment_kgm: first_kgm, inertia_kgm2 } = *body;
        // Sum of `r r^T`.
        let second_kgm2 = Matrix3::from_diagonal_element(inertia_kgm2.trace() / 2.0) - inertia_kgm2;
        Self {
            mass_kg,
            first_kgm,
            inertia_kgm2,
            momentum: velocity_mps * mass_kg + rotation_rad_s.cross(&first_kgm),
            velocity_moment: first_kgm * velocity_mps.transpose() - second_kgm2 * skew(rotation_rad_s),
        }
    }

    /// Adds another one.
    #[inline]
    pub(super) fn add(&mut self, other: &Self) {
        self.mass_kg += other.mass_kg;
        self.first_kgm += other.first_kgm;
        self.inertia_kgm2 += other.inertia_kgm2;
        self.momentum += other.momentum;
        self.velocity_moment += other.velocity_moment;
    }

    pub(super) fn zero() -> Self {
        Self {
            mass_kg: 0.0,
            first_kgm: Vector3::zeros(),
            inertia_kgm2: Matrix3::zeros(),
            momentum: Vector3::zeros(),
            velocity_moment: Matrix3::zeros(),
        }
    }
}

/// The same sums for several joints at once.
#[derive(Debug, Clone, Copy)]
pub(super) struct Carried<T> {
    mass_kg: T,
    first_kgm: Triple<T>,
    inertia_kgm2: Rows<T>,
    momentum: Triple<T>,
    velocity_moment: Rows<T>,
}

impl<T: Number> Carried<T> {
    /// The same in all places.
    #[inline]
    pub(super) fn all(composite: &Composite) -> Self {
        Self {
            mass_kg: T::all(composite.mass_kg),
            first_kgm: Triple::all(&composite.first_kgm),
            inertia_kgm2: Rows::all(&composite.inertia_kgm2),
            momentum: Triple::all(&composite.momentum),
            velocity_moment: Rows::all(&composite.velocity_moment),
        }
    }

    /// Puts the sums of one joint into its place.
    #[inline]
    pub(super) fn put(&mut self, place: usize, composite: &Composite) {
        self.mass_kg.put(place, composite.mass_kg);
        self.first_kgm.put(place, &composite.first_kgm);
        self.inertia_kgm2.put(place, &composite.inertia_kgm2);
        self.momentum.put(place, &composite.momentum);
        self.velocity_moment.put(place, &composite.velocity_moment);
    }

    /// Sum of `(f, r x f)` for the field `f(r)`.
    #[inline]
    pub(super) fn sum(&self, field: &Field<T>) -> Sum<T> {
        let Field { spin, constant, turning } = field;
        let force = spin.cross(&self.first_kgm) + *constant * self.mass_kg + turning.cross(&self.momentum);
        let moment = self.inertia_kgm2.times(spin)
            + self.first_kgm.cross(constant)
            + *turning * self.velocity_moment.trace()
            - self.velocity_moment.transposed_times(turning);
        (force, moment)
    }

    /// The same for the field of an acceleration, which does not turn with velocity.
    #[inline]
    pub(super) fn sum_still(&self, field: &Field<T>) -> Sum<T> {
        let Field { spin, constant, .. } = field;
        let force = spin.cross(&self.first_kgm) + *constant * self.mass_kg;
        (force, self.inertia_kgm2.times(spin) + self.first_kgm.cross(constant))
    }

    /// What a row of counts/N and counts/Nm (for forces and moments about E's origin, in E) makes of [`Self::sum`], as a function of the field.
    #[inline]
    pub(super) fn felt(&self, force: &Triple<T>, moment: &Triple<T>) -> Field<T> {
        Field {
            spin: self.first_kgm.cross(force) + self.inertia_kgm2.times(moment),
            constant: *force * self.mass_kg + moment.cross(&self.first_kgm),
            turning: self.momentum.cross(force) + *moment * self.velocity_moment.trace()
                - self.velocity_moment.times(moment),
        }
    }
}

/// Acceleration as a function of place and velocity, `spin x r + constant + turning x v`; or a linear function of such.
#[derive(Debug, Clone, Copy)]
pub(super) struct Field<T> {
    pub(super) spin: Triple<T>,
    pub(super) constant: Triple<T>,
    pub(super) turning: Triple<T>,
}

impl<T: Number> Field<T> {
    #[inline]
    pub(super) fn dot(&self, other: &Self) -> T {
        self.dot_still(other) + self.turning.dot(&other.turning)
    }

    /// The same where one of them does not turn with velocity.
    #[inline]
    pub(super) fn dot_still(&self, other: &Self) -> T {
        self.spin.dot(&other.spin) + self.constant.dot(&other.constant)
    }
}

/// Axis of a joint and motion of its inboard side, at E's origin in E's axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Screw<T> {
    axis: Triple<T>,
    point_m: Triple<T>,
    rotation_rad_s: Triple<T>,
    turning_rad_s2: Triple<T>,
    proper_mps2: Triple<T>,
    velocity_mps: Triple<T>,
}

impl<T: Number> Screw<T> {
    /// Along z through the origin, inboard of which nothing moves.
    pub(super) fn unmoved() -> Self {
        let zero = Triple::all(&Vector3::zeros());
        Self {
            axis: Triple::all(&Vector3::z()),
            point_m: zero,
            rotation_rad_s: zero,
            turning_rad_s2: zero,
            proper_mps2: zero,
            velocity_mps: zero,
        }
    }

    /// Puts one joint into its place.
    #[inline]
    pub(super) fn put(
        &mut self,
        place: usize,
        axis: &Vector3<f64>,
        point_m: &Vector3<f64>,
        inboard: &Motion,
        inboard_mps: &Vector3<f64>,
    ) {
        self.axis.put(place, axis);
        self.point_m.put(place, point_m);
        self.rotation_rad_s.put(place, &inboard.velocity_rad_s);
        self.turning_rad_s2.put(place, &inboard.acceleration_rad_s2);
        self.proper_mps2.put(place, &inboard.proper_mps2);
        self.velocity_mps.put(place, inboard_mps);
    }

    /// Change of a force and its moment about E's origin that turn about the axis (per rad).
    #[inline]
    pub(super) fn turned(&self, force: &Triple<T>, moment: &Triple<T>) -> Sum<T> {
        let z = &self.axis;
        (z.cross(force), z.cross(moment) - z.cross(&self.point_m).cross(force))
    }

    /// Change of the acceleration outboard by the joint's position, velocity and acceleration; by position without the terms `z x b`,
    /// which the caller adds where they do not cancel.
    ///
    /// By position what is linear in place is `Q [z] - [z] Q - 2 [W x z] [W]`, which is `[W' x z + (z x W) x W]`.
    #[inline]
    pub(super) fn fields(&self) -> [Field<T>; 3] {
        let (z, w, turning, two) = (&self.axis, &self.rotation_rad_s, &self.turning_rad_s2, T::all(2.0));
        let (lever, across) = (z.cross(&self.point_m), w.cross(z));
        let (coriolis, swept) = (across * two, w.cross(&lever));
        let by_position = Field {
            spin: turning.cross(z) + w.cross(&across),
            constant: -(turning.cross(&lever)
                + w.cross(&swept)
                + z.cross(&self.proper_mps2)
                + coriolis.cross(&self.velocity_mps)),
            turning: coriolis,
        };
        let by_velocity = Field {
            spin: coriolis,
            constant: (swept + z.cross(&self.velocity_mps)) * -two,
            turning: *z * two,
        };
        let by_acceleration = Field { spin: *z, constant: -lever, turning: Triple::all(&Vector3::zeros()) };
        [by_position, by_velocity, by_acceleration]
    }
}
