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
    /// Sum of `r r^T`.
    pub(super) second_kgm2: Matrix3<f64>,
    /// Sum of `v`.
    pub(super) momentum: Vector3<f64>,
    /// Sum of `r v^T`.
    pub(super) velocity_moment: Matrix3<f64>,
}

impl Composite {
    /// A body given in a frame that is placed so in E, at rest.
    pub(super) fn of(body: &RigidBody, place: &Pose) -> Self {
        let placed = body.transformed(place);
        let inertia = &placed.inertia_kgm2;
        Self {
            mass_kg: placed.mass_kg,
            first_kgm: placed.first_moment_kgm,
            second_kgm2: Matrix3::identity() * (inertia.trace() / 2.0) - inertia,
            ..Self::zero()
        }
    }

    /// The same body with the velocity (m/s) at E's origin and the rotation (rad/s).
    pub(super) fn moving(mut self, velocity_mps: &Vector3<f64>, rotation_rad_s: &Vector3<f64>) -> Self {
        self.momentum = velocity_mps * self.mass_kg + rotation_rad_s.cross(&self.first_kgm);
        self.velocity_moment =
            self.first_kgm * velocity_mps.transpose() - self.second_kgm2 * skew(rotation_rad_s);
        self
    }

    pub(super) fn zero() -> Self {
        Self {
            mass_kg: 0.0,
            first_kgm: Vector3::zeros(),
            second_kgm2: Matrix3::zeros(),
            momentum: Vector3::zeros(),
            velocity_moment: Matrix3::zeros(),
        }
    }

    /// Sum of `(f, r x f)` for the field `f(r) = linear r + constant + turning x v`.
    pub(super) fn sum(&self, field: &Field) -> Sum {
        let force = field.linear * self.first_kgm
            + field.constant * self.mass_kg
            + field.turning.cross(&self.momentum);
        let n = field.linear * self.second_kgm2;
        let moment = Vector3::new(n[(2, 1)] - n[(1, 2)], n[(0, 2)] - n[(2, 0)], n[(1, 0)] - n[(0, 1)])
            + self.first_kgm.cross(&field.constant)
            + field.turning * self.velocity_moment.trace()
            - self.velocity_moment.tr_mul(&field.turning);
        (force, moment)
    }
}

/// Acceleration as a function of place and velocity: `linear r + constant + turning x v`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Field {
    linear: Matrix3<f64>,
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

    pub(super) fn by_acceleration(&self) -> Field {
        Field {
            linear: skew(&self.axis),
            constant: -self.axis.cross(&self.point_m),
            turning: Vector3::zeros(),
        }
    }

    pub(super) fn by_velocity(&self) -> Field {
        let (z, w) = (&self.axis, &self.inboard.velocity_rad_s);
        Field {
            linear: skew(&w.cross(z)) * 2.0,
            constant: (w.cross(&z.cross(&self.point_m)) + z.cross(&self.inboard_mps)) * -2.0,
            turning: z * 2.0,
        }
    }

    /// Without the terms `z x b`, which the caller adds where they do not cancel.
    pub(super) fn by_position(&self) -> Field {
        let (z, w) = (&self.axis, &self.inboard.velocity_rad_s);
        let (z_cross, w_cross) = (skew(z), skew(w));
        let q = skew(&self.inboard.acceleration_rad_s2) + w_cross * w_cross;
        let coriolis = w.cross(z) * 2.0;
        Field {
            linear: q * z_cross - z_cross * q - skew(&coriolis) * w_cross,
            constant: -(q * z.cross(&self.point_m))
                - z.cross(&self.inboard.proper_mps2)
                - coriolis.cross(&self.inboard_mps),
            turning: coriolis,
        }
    }
}
