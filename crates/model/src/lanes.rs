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
    /// Puts a number into one place.
    fn put(&mut self, place: usize, value: f64);
}

impl Number for f64 {
    #[inline]
    fn all(value: f64) -> Self {
        value
    }
    #[inline]
    fn put(&mut self, _: usize, value: f64) {
        *self = value;
    }
}

impl Number for f64x2 {
    #[inline]
    fn all(value: f64) -> Self {
        Self::splat(value)
    }
    #[inline]
    fn put(&mut self, place: usize, value: f64) {
        self.as_mut_array()[place] = value;
    }
}

impl Number for f64x4 {
    #[inline]
    fn all(value: f64) -> Self {
        Self::splat(value)
    }
    #[inline]
    fn put(&mut self, place: usize, value: f64) {
        self.as_mut_array()[place] = value;
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

    /// Puts a vector into one place.
    #[inline]
    pub(crate) fn put(&mut self, place: usize, vector: &Vector3<f64>) {
        self.x.put(place, vector.x);
        self.y.put(place, vector.y);
        self.z.put(place, vector.z);
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
    pub(crate) fn of(&self, place: usize) -> [f64; 3] {
        [&self.x, &self.y, &self.z].map(|number| number.as_array()[place])
    }
}

/// A matrix of three rows.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Rows<T>(pub(crate) [Triple<T>; 3]);

impl<T: Number> Rows<T> {
    /// The same matrix in all places.
    #[inline]
    pub(crate) fn all(matrix: &Matrix3<f64>) -> Self {
        Self([0, 1, 2].map(|i| Triple::all(&Vector3::new(matrix[(i, 0)], matrix[(i, 1)], matrix[(i, 2)]))))
    }

    /// Puts a matrix into one place.
    #[inline]
    pub(crate) fn put(&mut self, place: usize, matrix: &Matrix3<f64>) {
        for (i, row) in self.0.iter_mut().enumerate() {
            row.put(place, &Vector3::new(matrix[(i, 0)], matrix[(i, 1)], matrix[(i, 2)]));
        }
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
