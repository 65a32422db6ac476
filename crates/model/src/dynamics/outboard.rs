//! Sums over the mass outboard of a joint, and the fields of acceleration that a joint's change makes there.

use nalgebra::Vector3;
use wide::f64x4;

use crate::lanes::{Number, Rows, Triple};

/// A force (N) and its moment (Nm) about E's origin, in E.
pub(super) type Sum<T> = (Triple<T>, Triple<T>);

/// Numbers of [`Carried`].
const NUMBERS: usize = 25;

/// Sums over the mass of a segment, or of it and everything outboard of it, about E's origin in E's axes: the mass, `r`, `r^2 - r r^T`, `v`
/// and `r v^T`, in this order.
#[derive(Debug, Clone, Copy)]
pub(super) struct Carried<T>([T; NUMBERS]);

impl<T: Number> Carried<T> {
    /// Of a body with this mass (kg), first moment (kg m) and inertia (kg m^2), whose point at E's origin moves at `velocity_mps`.
    #[inline]
    pub(super) fn of(
        mass_kg: T,
        first_kgm: &Triple<T>,
        inertia_kgm2: &Rows<T>,
        velocity_mps: &Triple<T>,
        rotation_rad_s: &Triple<T>,
    ) -> Self {
        let (h, v, [xx, yy, zz]) = (first_kgm, velocity_mps, &inertia_kgm2.0);
        let momentum = *v * mass_kg + rotation_rad_s.cross(h);
        // The sum of `r r^T` is half the inertia's trace less the inertia.
        let half = inertia_kgm2.trace() * T::all(0.5);
        let (mut x, mut y, mut z) = (-*xx, -*yy, -*zz);
        (x.x, y.y, z.z) = (half + x.x, half + y.y, half + z.z);
        let [x, y, z] =
            [(h.x, x), (h.y, y), (h.z, z)].map(|(first, second)| *v * first - second.cross(rotation_rad_s));
        let moments = [xx, yy, zz, &momentum, &x, &y, &z];
        let mut numbers = [mass_kg; NUMBERS];
        for (at, triple) in [h].into_iter().chain(moments).enumerate() {
            numbers[3 * at + 1..3 * at + 4].copy_from_slice(&[triple.x, triple.y, triple.z]);
        }
        Self(numbers)
    }

    /// Nothing.
    pub(super) fn zero() -> Self {
        Self([T::all(0.0); NUMBERS])
    }

    /// The sums of one segment for each place.
    #[inline(always)]
    pub(super) fn gather<'a>(of: impl Fn(usize) -> &'a Carried<f64>) -> Self {
        Self(std::array::from_fn(|number| T::gather(|k| of(k).0[number])))
    }

    #[inline]
    fn triple(&self, from: usize) -> Triple<T> {
        Triple { x: self.0[from], y: self.0[from + 1], z: self.0[from + 2] }
    }

    #[inline]
    fn rows(&self, from: usize) -> Rows<T> {
        Rows([self.triple(from), self.triple(from + 3), self.triple(from + 6)])
    }

    #[inline]
    fn mass_kg(&self) -> T {
        self.0[0]
    }

    #[inline]
    fn first_kgm(&self) -> Triple<T> {
        self.triple(1)
    }

    #[inline]
    fn inertia_kgm2(&self) -> Rows<T> {
        self.rows(4)
    }

    #[inline]
    fn momentum(&self) -> Triple<T> {
        self.triple(13)
    }

    #[inline]
    fn velocity_moment(&self) -> Rows<T> {
        self.rows(16)
    }

    /// Sum of `(f, r x f)` for the field `f(r)`.
    #[inline]
    pub(super) fn sum(&self, field: &Field<T>) -> Sum<T> {
        let Field { spin, constant, turning } = field;
        let force =
            spin.cross(&self.first_kgm()) + *constant * self.mass_kg() + turning.cross(&self.momentum());
        let moment = self.inertia_kgm2().times(spin)
            + self.first_kgm().cross(constant)
            + *turning * self.velocity_moment().trace()
            - self.velocity_moment().transposed_times(turning);
        (force, moment)
    }

    /// The same for the field of an acceleration, which does not turn with velocity.
    #[inline]
    pub(super) fn sum_still(&self, field: &Field<T>) -> Sum<T> {
        let Field { spin, constant, .. } = field;
        let force = spin.cross(&self.first_kgm()) + *constant * self.mass_kg();
        (force, self.inertia_kgm2().times(spin) + self.first_kgm().cross(constant))
    }

    /// What a row of counts/N and counts/Nm (for forces and moments about E's origin, in E) makes of [`Self::sum`], as a function of the field.
    #[inline]
    pub(super) fn felt(&self, force: &Triple<T>, moment: &Triple<T>) -> Field<T> {
        Field {
            spin: self.first_kgm().cross(force) + self.inertia_kgm2().times(moment),
            constant: *force * self.mass_kg() + moment.cross(&self.first_kgm()),
            turning: self.momentum().cross(force) + *moment * self.velocity_moment().trace()
                - self.velocity_moment().times(moment),
        }
    }
}

impl Carried<f64> {
    /// Adds those of a place of others.
    #[inline]
    pub(super) fn add(&mut self, others: &Carried<f64x4>, place: usize) {
        self.0.iter_mut().zip(&others.0).for_each(|(sum, other)| *sum += other.as_array()[place]);
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
    pub(super) axis: Triple<T>,
    pub(super) point_m: Triple<T>,
    pub(super) rotation_rad_s: Triple<T>,
    pub(super) turning_rad_s2: Triple<T>,
    pub(super) proper_mps2: Triple<T>,
    pub(super) velocity_mps: Triple<T>,
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
