//! Vectors of three whose components are one number or several at once: the same formulas for one joint and for two, for one gauge and for four.

use std::ops::{Add, Mul, Neg, Sub};

use nalgebra::{Matrix3, Vector3};
use wide::{f64x2, f64x4};

/// A number, or several side by side.
pub(crate) trait Number:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// The same number in all places.
    fn all(value: f64) -> Self;
    /// A number for each place.
    fn gather(of: impl Fn(usize) -> f64) -> Self;
}

impl Number for f64 {
    #[inline]
    fn all(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn gather(of: impl Fn(usize) -> f64) -> Self {
        of(0)
    }
}

impl Number for f64x2 {
    #[inline]
    fn all(value: f64) -> Self {
        Self::splat(value)
    }
    #[inline(always)]
    fn gather(of: impl Fn(usize) -> f64) -> Self {
        Self::new([of(0), of(1)])
    }
}

impl Number for f64x4 {
    #[inline]
    fn all(value: f64) -> Self {
        Self::splat(value)
    }
    #[inline(always)]
    fn gather(of: impl Fn(usize) -> f64) -> Self {
        Self::new([of(0), of(1), of(2), of(3)])
    }
}

/// A vector of three.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Triple<T> {
    pub(crate) x: T,
    pub(crate) y: T,
    pub(crate) z: T,
}

impl<T: Number> Triple<T> {
    /// The same vector in all places.
    #[inline]
    pub(crate) fn all(vector: &Vector3<f64>) -> Self {
        Self { x: T::all(vector.x), y: T::all(vector.y), z: T::all(vector.z) }
    }

    /// A vector for each place.
    #[inline(always)]
    pub(crate) fn gather<'a>(of: impl Fn(usize) -> &'a Vector3<f64>) -> Self {
        Self { x: T::gather(|k| of(k).x), y: T::gather(|k| of(k).y), z: T::gather(|k| of(k).z) }
    }

    #[inline]
    pub(crate) fn dot(&self, other: &Self) -> T {
        self.x * other.x + self.y * other.y + self.z * other.z
    }

    #[inline]
    pub(crate) fn cross(&self, other: &Self) -> Self {
        Self {
            x: self.y * other.z - self.z * other.y,
            y: self.z * other.x - self.x * other.z,
            z: self.x * other.y - self.y * other.x,
        }
    }
}

impl Triple<f64x2> {
    /// The vector in one place.
    #[inline]
    pub(crate) fn at(&self, place: usize) -> Vector3<f64> {
        let of = |number: &f64x2| number.as_array()[place];
        Vector3::new(of(&self.x), of(&self.y), of(&self.z))
    }
}

impl<T: Number> Add for Triple<T> {
    type Output = Self;
    #[inline]
    fn add(self, other: Self) -> Self {
        Self { x: self.x + other.x, y: self.y + other.y, z: self.z + other.z }
    }
}

impl<T: Number> Sub for Triple<T> {
    type Output = Self;
    #[inline]
    fn sub(self, other: Self) -> Self {
        Self { x: self.x - other.x, y: self.y - other.y, z: self.z - other.z }
    }
}

impl<T: Number> Neg for Triple<T> {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self { x: -self.x, y: -self.y, z: -self.z }
    }
}

impl<T: Number> Mul<T> for Triple<T> {
    type Output = Self;
    #[inline]
    fn mul(self, factor: T) -> Self {
        Self { x: self.x * factor, y: self.y * factor, z: self.z * factor }
    }
}

impl Triple<f64x4> {
    /// The vector in one place.
    #[inline]
    pub(crate) fn at(&self, place: usize) -> Vector3<f64> {
        let of = |number: &f64x4| number.as_array()[place];
        Vector3::new(of(&self.x), of(&self.y), of(&self.z))
    }
}

/// A matrix of three rows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rows<T>(pub(crate) [Triple<T>; 3]);

impl<T: Number> Rows<T> {
    /// A matrix for each place.
    #[inline(always)]
    pub(crate) fn gather<'a>(of: impl Fn(usize) -> &'a Matrix3<f64>) -> Self {
        let at = |i: usize, c: usize| T::gather(|k| of(k)[(i, c)]);
        Self([0, 1, 2].map(|i| Triple { x: at(i, 0), y: at(i, 1), z: at(i, 2) }))
    }

    /// Its columns.
    #[inline]
    pub(crate) fn columns(&self) -> [Triple<T>; 3] {
        let [a, b, c] = &self.0;
        [
            Triple { x: a.x, y: b.x, z: c.x },
            Triple { x: a.y, y: b.y, z: c.y },
            Triple { x: a.z, y: b.z, z: c.z },
        ]
    }

    /// Times a vector.
    #[inline]
    pub(crate) fn times(&self, vector: &Triple<T>) -> Triple<T> {
        let [x, y, z] = &self.0;
        Triple { x: x.dot(vector), y: y.dot(vector), z: z.dot(vector) }
    }

    /// The transpose times a vector.
    #[inline]
    pub(crate) fn transposed_times(&self, vector: &Triple<T>) -> Triple<T> {
        let [x, y, z] = &self.0;
        *x * vector.x + *y * vector.y + *z * vector.z
    }

    /// Sum of the diagonal.
    #[inline]
    pub(crate) fn trace(&self) -> T {
        let [x, y, z] = &self.0;
        x.x + y.y + z.z
    }
}
