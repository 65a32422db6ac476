//! Wrenches with their frame as a type, rigid placements and rigid bodies.
//!
//! Inside a frame plain `nalgebra` vectors are used; what crosses a module's border carries its frame in its type.
//! Six-vectors are force first, then moment.

use std::marker::PhantomData;
use std::ops::{Add, AddAssign, Mul, Neg, Sub};

use nalgebra::{Matrix3, Rotation3, Vector3, Vector6};

/// Frame marker E: origin and axes of the tip link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Tip;

/// Frame marker S: origin and axes of a section's nominal sensing frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct Section;

/// Frame marker W: origin and axes of the base link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub struct World;

/// Force (N) and moment (Nm) about the origin of frame `F`, in the axes of `F`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wrench<F> {
    /// Force in the axes of `F`, N.
    pub force_n: Vector3<f64>,
    /// Moment about the origin of `F`, in its axes, Nm.
    pub moment_nm: Vector3<f64>,
    frame: PhantomData<F>,
}

impl<F> Wrench<F> {
    /// Wrench of the given force (N) and moment (Nm) about the origin of `F`, in its axes.
    #[must_use]
    pub const fn new(force_n: Vector3<f64>, moment_nm: Vector3<f64>) -> Self {
        Self { force_n, moment_nm, frame: PhantomData }
    }

    /// The wrench without force and moment (N, Nm).
    #[must_use]
    pub fn zero() -> Self {
        Self::new(Vector3::zeros(), Vector3::zeros())
    }

    /// Wrench from a six-vector in `F`: force (N) first, then moment (Nm).
    #[must_use]
    pub fn from_vector(vector: &Vector6<f64>) -> Self {
        Self::new(
            Vector3::new(vector[0], vector[1], vector[2]),
            Vector3::new(vector[3], vector[4], vector[5]),
        )
    }

    /// The six-vector in `F`: force (N) first, then moment (Nm).
    #[must_use]
    pub fn to_vector(self) -> Vector6<f64> {
        join(&self.force_n, &self.moment_nm)
    }
}

impl<F> From<Vector6<f64>> for Wrench<F> {
    fn from(vector: Vector6<f64>) -> Self {
        Self::from_vector(&vector)
    }
}

impl<F> From<Wrench<F>> for Vector6<f64> {
    fn from(wrench: Wrench<F>) -> Self {
        wrench.to_vector()
    }
}

impl<F> Add for Wrench<F> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self::new(self.force_n + other.force_n, self.moment_nm + other.moment_nm)
    }
}

impl<F> Sub for Wrench<F> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self::new(self.force_n - other.force_n, self.moment_nm - other.moment_nm)
    }
}

impl<F> Neg for Wrench<F> {
    type Output = Self;
    fn neg(self) -> Self {
        Self::new(-self.force_n, -self.moment_nm)
    }
}

impl<F> Mul<f64> for Wrench<F> {
    type Output = Self;
    fn mul(self, factor: f64) -> Self {
        Self::new(self.force_n * factor, self.moment_nm * factor)
    }
}

/// Six-vector of two three-vectors, the first one on top (force first, then moment).
#[inline]
pub(crate) fn join(top: &Vector3<f64>, bottom: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(top.x, top.y, top.z, bottom.x, bottom.y, bottom.z)
}

/// Matrix of the cross product: `skew(a) b = a x b` (unit of `a`).
#[must_use]
pub fn skew(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// Rotation by `angle_rad` (rad) about the unit vector `axis`, as a matrix (Rodrigues).
#[must_use]
pub fn rotation_about(axis: &Vector3<f64>, angle_rad: f64) -> Matrix3<f64> {
    let (sin, cos) = angle_rad.sin_cos();
    let outer = axis * axis.transpose();
    outer + (Matrix3::identity() - outer) * cos + skew(axis) * sin
}

/// Placement of a child frame in a parent frame: axes (a rotation matrix) and origin (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// Takes components in the child frame to components in the parent frame.
    pub rotation: Matrix3<f64>,
    /// The child's origin seen from the parent's, in parent axes, m.
    pub translation_m: Vector3<f64>,
}

impl Pose {
    /// Child and parent frame coincide (m, rotation matrix).
    #[must_use]
    pub fn identity() -> Self {
        Self { rotation: Matrix3::identity(), translation_m: Vector3::zeros() }
    }

    /// Placement from a URDF origin: position (m, parent axes) and fixed-axis roll, pitch, yaw (rad).
    #[must_use]
    pub fn from_xyz_rpy(xyz_m: [f64; 3], rpy_rad: [f64; 3]) -> Self {
        let [roll, pitch, yaw] = rpy_rad;
        Self {
            rotation: Rotation3::from_euler_angles(roll, pitch, yaw).into_inner(),
            translation_m: Vector3::from(xyz_m),
        }
    }

    /// Placement (m) in the parent of a frame whose placement in this child frame is `inner`.
    #[must_use]
    pub fn compose(&self, inner: &Self) -> Self {
        Self {
            rotation: self.rotation * inner.rotation,
            translation_m: self.translation_m + self.rotation * inner.translation_m,
        }
    }

    /// Placement of the parent frame in the child frame (m).
    #[must_use]
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation_m: -(rotation * self.translation_m) }
    }

    /// A point given in the child frame (m), seen from the parent frame (m).
    #[must_use]
    pub fn point(&self, point_m: &Vector3<f64>) -> Vector3<f64> {
        self.translation_m + self.rotation * point_m
    }
}

impl Default for Pose {
    fn default() -> Self {
        Self::identity()
    }
}

/// Mass (kg), first moment (kg m) and inertia (kg m^2) of a rigid body about its frame's origin, in its frame's axes.
///
/// Loads are linear in these ten numbers, sums and changes of frame are exact.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RigidBody {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Mass times centre of mass, body frame, kg m.
    pub first_moment_kgm: Vector3<f64>,
    /// Inertia about the body frame's origin (not about the centre of mass), body axes, kg m^2.
    pub inertia_kgm2: Matrix3<f64>,
}

/// Number of inertial parameters of a rigid body, in the order of [`RigidBody::parameters`].
pub const BODY_PARAMETERS: usize = 10;

impl RigidBody {
    /// A body without mass (kg, kg m, kg m^2).
    #[must_use]
    pub fn zero() -> Self {
        Self { mass_kg: 0.0, first_moment_kgm: Vector3::zeros(), inertia_kgm2: Matrix3::zeros() }
    }

    /// Body from mass (kg), centre of mass (m, body frame) and inertia about it (kg m^2, body axes).
    #[must_use]
    pub fn from_com(mass_kg: f64, com_m: Vector3<f64>, inertia_about_com_kgm2: Matrix3<f64>) -> Self {
        Self {
            mass_kg,
            first_moment_kgm: com_m * mass_kg,
            inertia_kgm2: inertia_about_com_kgm2 + point_inertia(&com_m) * mass_kg,
        }
    }

    /// Centre of mass in the body frame, m; none for a body without mass.
    #[must_use]
    pub fn com_m(&self) -> Option<Vector3<f64>> {
        (self.mass_kg != 0.0).then(|| self.first_moment_kgm / self.mass_kg)
    }

    /// The same body (kg, kg m, kg m^2) described in the parent frame of `pose`, about the parent's origin.
    #[must_use]
    pub fn transformed(&self, pose: &Pose) -> Self {
        let (rotation, shift) = (&pose.rotation, &pose.translation_m);
        let turned = rotation * self.first_moment_kgm;
        let left = rotation * self.inertia_kgm2;
        // With `s = h + p m / 2` the shift adds `2 p.s - p s' - s p'`.
        let half = turned + shift * (self.mass_kg / 2.0);
        let along = shift.component_mul(&half) * 2.0;
        let entry = |i: usize, k: usize| {
            (left[(i, 0)] * rotation[(k, 0)] + left[(i, 1)] * rotation[(k, 1)])
                + left[(i, 2)] * rotation[(k, 2)]
        };
        let beside = |i: usize, k: usize| entry(i, k) - (shift[i] * half[k] + half[i] * shift[k]);
        let (xy, xz, yz) = (beside(0, 1), beside(0, 2), beside(1, 2));
        let (xx, yy, zz) = (
            entry(0, 0) + along.y + along.z,
            entry(1, 1) + along.x + along.z,
            entry(2, 2) + along.x + along.y,
        );
        Self {
            mass_kg: self.mass_kg,
            first_moment_kgm: turned + shift * self.mass_kg,
            inertia_kgm2: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
        }
    }

    /// The ten parameters: mass (kg), first moments x y z (kg m), inertia xx xy xz yy yz zz about the origin (kg m^2).
    #[must_use]
    pub fn parameters(&self) -> [f64; BODY_PARAMETERS] {
        let (h, i) = (&self.first_moment_kgm, &self.inertia_kgm2);
        [self.mass_kg, h.x, h.y, h.z, i[(0, 0)], i[(0, 1)], i[(0, 2)], i[(1, 1)], i[(1, 2)], i[(2, 2)]]
    }

    /// Body (kg, kg m, kg m^2) from its ten parameters in the order of [`Self::parameters`].
    #[must_use]
    pub fn from_parameters(parameters: &[f64; BODY_PARAMETERS]) -> Self {
        let [mass_kg, hx, hy, hz, xx, xy, xz, yy, yz, zz] = *parameters;
        Self {
            mass_kg,
            first_moment_kgm: Vector3::new(hx, hy, hz),
            inertia_kgm2: Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz),
        }
    }
}

impl Add for RigidBody {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            mass_kg: self.mass_kg + other.mass_kg,
            first_moment_kgm: self.first_moment_kgm + other.first_moment_kgm,
            inertia_kgm2: self.inertia_kgm2 + other.inertia_kgm2,
        }
    }
}

impl AddAssign for RigidBody {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

/// Inertia about the origin of a unit point mass at `at_m` (m), kg m^2 per kg.
fn point_inertia(at_m: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::identity() * at_m.norm_squared() - at_m * at_m.transpose()
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn pose() -> Pose {
        Pose::from_xyz_rpy([0.3, -0.2, 0.5], [0.4, -1.1, 2.0])
    }

    #[test]
    fn roll_pitch_yaw_turn_about_fixed_axes_in_this_order() {
        let (x, y, z) = (Vector3::x(), Vector3::y(), Vector3::z());
        let expected = rotation_about(&z, 2.0) * rotation_about(&y, -1.1) * rotation_about(&x, 0.4);
        assert!((pose().rotation - expected).amax() < 1e-15);
        assert!(
            (rotation_about(&z, 0.5) * x - Vector3::new(0.5_f64.cos(), 0.5_f64.sin(), 0.0)).amax() < 1e-15
        );
    }

    #[test]
    fn a_pose_and_its_inverse_cancel() {
        let both = pose().compose(&pose().inverse());
        assert!((both.rotation - Matrix3::identity()).amax() < 1e-15 && both.translation_m.amax() < 1e-15);
        let (inner, point) =
            (Pose::from_xyz_rpy([1.0, 2.0, 3.0], [0.1, 0.2, 0.3]), Vector3::new(0.7, 0.1, -0.4));
        let apart = pose().compose(&inner).point(&point) - pose().point(&inner.point(&point));
        assert!(apart.amax() < 1e-15);
    }

    #[test]
    fn bodies_are_sums_of_points_in_any_frame() {
        let points = [(0.5, [0.1, 0.2, 0.3]), (1.5, [-0.4, 0.0, 0.2]), (0.7, [0.3, -0.5, 0.1])];
        let points = points.map(|(mass, at)| (mass, Vector3::from(at)));
        let sum = |place: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| {
            points.iter().fold(RigidBody::zero(), |sum, (mass, at)| {
                sum + RigidBody::from_com(*mass, place(at), Matrix3::zeros())
            })
        };
        let (here, there) = (sum(&|at| *at), sum(&|at| pose().point(at)));
        let moved = here.transformed(&pose());
        assert!((moved.inertia_kgm2 - there.inertia_kgm2).amax() < 1e-14);
        assert!((moved.first_moment_kgm - there.first_moment_kgm).amax() < 1e-14);
        assert_eq!(RigidBody::from_parameters(&here.parameters()), here);
        assert!(RigidBody::zero().com_m().is_none());
        // Two kilograms 3 m from the x axis.
        let one = RigidBody::from_com(2.0, Vector3::new(7.0, 3.0, 0.0), Matrix3::zeros());
        assert_eq!(one.inertia_kgm2[(0, 0)], 18.0);
        assert_eq!(one.inertia_kgm2[(0, 1)], -42.0);
    }

    #[test]
    fn wrenches_are_force_first() {
        let vector = Vector6::new(1.0, 2.0, 3.0, 4.0, 5.0, 6.0);
        let wrench = Wrench::<Tip>::from(vector);
        assert_eq!((wrench.force_n.y, wrench.moment_nm.x), (2.0, 4.0));
        assert_eq!(Vector6::from(wrench * 2.0 - wrench), vector);
        assert_eq!((wrench + -wrench), Wrench::zero());
        assert_eq!(skew(&wrench.force_n) * wrench.moment_nm, wrench.force_n.cross(&wrench.moment_nm));
    }
}
