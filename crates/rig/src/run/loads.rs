//! What hung on the tip, and when.

use model::spatial::RigidBody;
use nalgebra::{Matrix3, Vector3};
use serde::Deserialize;

/// A point mass rigidly fixed to the tip during from <= t < to.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LoadInterval {
    /// Its beginning (s from the log's first frame).
    #[serde(rename = "from")]
    pub from_s: f64,
    /// Its end (s from the log's first frame).
    #[serde(rename = "to")]
    pub to_s: f64,
    /// Mass (kg).
    #[serde(rename = "mass")]
    pub mass_kg: f64,
    /// Where the mass is, in E (m).
    #[serde(rename = "com", deserialize_with = "crate::config::three")]
    pub com_m: [f64; 3],
}

impl LoadInterval {
    /// The point mass as a rigid body about E's origin, in E's axes (kg, kg m, kg m^2).
    #[must_use]
    pub fn body(&self) -> RigidBody {
        RigidBody::from_com(self.mass_kg, Vector3::from(self.com_m), Matrix3::zeros())
    }
}

/// All loads of a run; those that overlap in time add.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Loads {
    intervals: Vec<LoadInterval>,
}

impl Loads {
    /// The loads of these intervals, which keep their order.
    #[must_use]
    pub fn new(intervals: Vec<LoadInterval>) -> Self {
        Self { intervals }
    }

    /// The intervals (s, kg, m in E), in the file's order.
    #[must_use]
    pub fn intervals(&self) -> &[LoadInterval] {
        &self.intervals
    }

    /// What hangs on the tip at an instant (s from the log's first frame), as one rigid body about E's origin, in E's
    /// axes (kg, kg m, kg m^2); outside every interval a body without mass.
    #[must_use]
    pub fn at(&self, t_s: f64) -> RigidBody {
        self.intervals
            .iter()
            .filter(|load| load.from_s <= t_s && t_s < load.to_s)
            .fold(RigidBody::zero(), |sum, load| sum + load.body())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlapping_loads_add_and_the_end_is_open() {
        let loads = Loads::new(vec![
            LoadInterval { from_s: 1.0, to_s: 3.0, mass_kg: 0.5, com_m: [0.0, 0.0, 0.1] },
            LoadInterval { from_s: 2.0, to_s: 4.0, mass_kg: 1.5, com_m: [0.2, 0.0, 0.0] },
        ]);
        assert_eq!(loads.at(0.999), RigidBody::zero());
        assert_eq!(loads.at(1.0).mass_kg, 0.5);
        assert_eq!(loads.at(4.0), RigidBody::zero());
        let both = loads.at(2.5);
        assert_eq!(both.mass_kg, 2.0);
        assert!((both.first_moment_kgm - Vector3::new(0.3, 0.0, 0.05)).norm() < 1e-15);
        // sum of m (|c|^2 1 - c c^T): 0.5 * 0.01 = 0.005 about x and y, 1.5 * 0.04 = 0.06 about y and z
        let expected = Matrix3::from_diagonal(&Vector3::new(0.005, 0.065, 0.06));
        assert!((both.inertia_kgm2 - expected).norm() < 1e-15);
        assert_eq!(loads.at(3.0).mass_kg, 1.5);
    }
}
