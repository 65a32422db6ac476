//! Sums over the mass outboard of a joint, and the fields of acceleration that a joint's change makes there.

use nalgebra::{Matrix3, Vector3};

use super::Motion;
use crate::spatial::{Pose, RigidBody, skew};

/// A force (N) and its moment (Nm) about E's origin, in E.
pub(super) type Sum = (Vector3<f64>, Vector3<f64>);

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
    /// A body given in a frame that is placed so in E, with the velocity (m/s) at E's origin and the rotation (rad/s).
    pub(super) fn of(
        body: &RigidBody,
        place: &Pose,
        velocity_mps: &Vector3<f64>,
        rotation_rad_s: &Vector3<f64>,
    ) -> Self {
        let RigidBody { mass_kg, first_moment_kgm: first_kgm, inertia_kgm2 } = body.transformed(place);
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

    pub(super) fn zero() -> Self {
        Self {
            mass_kg: 0.0,
            first_kgm: Vector3::zeros(),
            inertia_kgm2: Matrix3::zeros(),
            momentum: Vector3::zeros(),
            velocity_moment: Matrix3::zeros(),
        }
    }

    /// Sum of `(f, r x f)` for the field `f(r)`.
    pub(super) fn sum(&self, field: &Field) -> Sum {
        let Field { spin, constant, turning } = field;
        let force = spin.cross(&self.first_kgm) + constant * self.mass_kg + turning.cross(&self.momentum);
        let moment = self.inertia_kgm2 * spin
            + self.first_kgm.cross(constant)
            + turning * self.velocity_moment.trace()
            - self.velocity_moment.tr_mul(turning);
        (force, moment)
    }

    /// What a row of counts/N and counts/Nm (for forces and moments about E's origin, in E) makes of [`Self::sum`], as a function of the field.
    pub(super) fn felt(&self, force: &Vector3<f64>, moment: &Vector3<f64>) -> Felt {
        Felt {
            spin: self.first_kgm.cross(force) + self.inertia_kgm2 * moment,
            constant: force * self.mass_kg + moment.cross(&self.first_kgm),
            turning: self.momentum.cross(force) + moment * self.velocity_moment.trace()
                - self.velocity_moment * moment,
        }
    }
}

/// Linear function of a field.
#[derive(Debug, Clone, Copy)]
pub(super) struct Felt {
    spin: Vector3<f64>,
    constant: Vector3<f64>,
    turning: Vector3<f64>,
}

impl Felt {
    pub(super) fn of(&self, field: &Field) -> f64 {
        self.spin.dot(&field.spin) + self.constant.dot(&field.constant) + self.turning.dot(&field.turning)
    }
}

/// Acceleration as a function of place and velocity: `spin x r + constant + turning x v`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Field {
    spin: Vector3<f64>,
    constant: Vector3<f64>,
    turning: Vector3<f64>,
}

/// Axis of a joint and motion of its inboard side, at E's origin in E's axes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Screw {
    pub(super) axis: Vector3<f64>,
    pub(super) point_m: Vector3<f64>,
    pub(super) inboard: Motion,
    pub(super) inboard_mps: Vector3<f64>,
}

impl Screw {
    /// Change of a force and its moment about E's origin that turn about the axis (per rad).
    pub(super) fn turned(&self, force: &Vector3<f64>, moment: &Vector3<f64>) -> Sum {
        let z = &self.axis;
        (z.cross(force), z.cross(moment) - z.cross(&self.point_m).cross(force))
    }

    /// Change of the acceleration outboard by the joint's position, velocity and acceleration; by position without the terms `z x b`,
    /// which the caller adds where they do not cancel.
    ///
    /// By position what is linear in place is `Q [z] - [z] Q - 2 [W x z] [W]`, which is `[W' x z + (z x W) x W]`.
    pub(super) fn fields(&self) -> [Field; 3] {
        let (z, w, turning) = (&self.axis, &self.inboard.velocity_rad_s, &self.inboard.acceleration_rad_s2);
        let (lever, coriolis) = (z.cross(&self.point_m), w.cross(z) * 2.0);
        let by_position = Field {
            spin: turning.cross(z) + w.cross(&w.cross(z)),
            constant: -(turning.cross(&lever) + w.cross(&w.cross(&lever)))
                - z.cross(&self.inboard.proper_mps2)
                - coriolis.cross(&self.inboard_mps),
            turning: coriolis,
        };
        let by_velocity = Field {
            spin: coriolis,
            constant: (w.cross(&lever) + z.cross(&self.inboard_mps)) * -2.0,
            turning: z * 2.0,
        };
        let by_acceleration = Field { spin: *z, constant: -lever, turning: Vector3::zeros() };
        [by_position, by_velocity, by_acceleration]
    }
}
