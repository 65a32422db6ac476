//! What the calibrated arm adds to the estimator: joints that yield, and directions in which arm and gauges are uncertain together.

use nalgebra::{SVector, Vector6};

use crate::chain::{Chain, Section};
use crate::dynamics::Dynamics;
use crate::spatial::{RigidBody, Tip, Wrench};

use super::{Excitation, GAUGE_NUMBERS};

/// An arm and its gauges one standard deviation away from the calibrated ones, along a direction of their uncertainty.
#[derive(Clone, Debug)]
pub struct Deviation {
    /// The arm there (SI).
    pub chain: Chain,
    /// What each coordinate's joint yields there beyond the calibrated value, rad/Nm.
    pub flexibility_rad_per_nm: Vec<f64>,
    /// Each gauge's numbers there less the calibrated ones: compliance (counts/N, counts/Nm), bias (counts), terms (counts).
    pub gauges: Vec<[f64; GAUGE_NUMBERS]>,
}

/// What is known of an arm beyond its chain.
#[derive(Clone, Debug, Default)]
pub struct ArmModel {
    /// What each coordinate's joint yields, rad/Nm; empty or zeros for a stiff arm.
    pub flexibility_rad_per_nm: Vec<f64>,
    /// Directions of joint uncertainty, independent of each other.
    pub deviations: Vec<Deviation>,
}

/// The same, compiled for the cycle. Allocates at construction only.
#[derive(Clone, Debug)]
pub(super) struct Arm {
    pub(super) flexibility_rad_per_nm: Vec<f64>,
    /// The calibrated arm at rest in the present pose, against which deviations are taken.
    still: Dynamics,
    deviations: Vec<(Dynamics, Deviation)>,
    positions: Vec<f64>,
}

impl Arm {
    pub(super) fn new(chain: &Chain, sections: &[Section], model: ArmModel) -> Self {
        let still = Dynamics::new(chain, sections);
        let mut flexibility_rad_per_nm = model.flexibility_rad_per_nm;
        flexibility_rad_per_nm.resize(still.coordinates(), 0.0);
        Self {
            flexibility_rad_per_nm,
            positions: vec![0.0; still.coordinates()],
            still,
            deviations: model
                .deviations
                .into_iter()
                .map(|deviation| (Dynamics::new(&deviation.chain, sections), deviation))
                .collect(),
        }
    }

    pub(super) fn yields(&self) -> bool {
        self.flexibility_rad_per_nm.iter().any(|f| *f != 0.0)
    }

    /// Places arm and deviations at the links' positions (rad) under a wrench: each joint yields a little more in a deviation.
    pub(super) fn place(&mut self, positions_rad: &[f64], wrench: &Wrench<Tip>) {
        if self.deviations.is_empty() {
            return;
        }
        self.still.update_static(positions_rad);
        for (dynamics, deviation) in &mut self.deviations {
            for (k, position) in self.positions.iter_mut().enumerate() {
                let more = deviation.flexibility_rad_per_nm.get(k).copied().unwrap_or(0.0);
                *position = positions_rad[k];
                if more != 0.0 {
                    *position += more * self.still.joint_torque_nm(k, wrench);
                }
            }
            dynamics.update_static(&self.positions);
        }
    }

    /// A body at the tip is the same in every deviation.
    pub(super) fn set_payload(&mut self, body: &RigidBody) {
        self.still.set_payload(body);
        for (dynamics, _) in &mut self.deviations {
            dynamics.set_payload(body);
        }
    }

    pub(super) fn deviations(&self) -> usize {
        self.deviations.len()
    }

    /// How a deviation changes the prediction of a gauge with this compliance under this excitation, counts.
    pub(super) fn change_counts(
        &self,
        deviation: usize,
        gauge: usize,
        compliance: &Vector6<f64>,
        excitation: &Excitation,
        wrench: &Wrench<Tip>,
    ) -> f64 {
        let (dynamics, numbers) = &self.deviations[deviation];
        let load = |d: &Dynamics| d.load(gauge) + d.load_of_tip_wrench(gauge, wrench).to_vector();
        let by_arm = compliance.dot(&(load(dynamics) - load(&self.still)));
        let own = numbers.gauges.get(gauge).map_or(0.0, |n| SVector::from(*n).dot(excitation));
        by_arm + own
    }
}
