//! The simulation of a recorded motion: Newton-Euler over the calibrated arm, then the calibrated gauges.

use std::ops::Range;

use calibration::Recording;
use model::chain::Chain;
use model::dynamics::Dynamics;
use model::estimator::{ArmModel, GaugeModel};
use model::motion::JointMotion;
use model::spatial::{RigidBody, Tip, Wrench};
use model::terms::{Conditioner, Regressors};
use nalgebra::Vector6;
use rig::{ModelFile, Rig};

/// Rows between two at which the gauges' answer to accelerations is computed: it changes as slowly as the pose.
const LOOK_EVERY: usize = 16;

/// Predicted signals, row after row.
pub(super) struct Prediction {
    /// The arm as calibrated.
    pub(super) chain: Chain,
    pub(super) arm: ArmModel,
    pub(super) gauges: Vec<GaugeModel>,
    dynamics: Dynamics,
    conditioners: Vec<Conditioner>,
    /// Per gauge the signal without its bias, counts.
    pub(super) signals: Vec<Vec<f64>>,
    /// Per gauge the load of its section (N, Nm about S, in S).
    pub(super) loads: Vec<Vec<Vector6<f64>>>,
    /// Per gauge the values of its terms.
    pub(super) regressors: Vec<Vec<Regressors>>,
    /// What hung on the tip, by rows.
    pub(super) carried: Vec<(Range<usize>, RigidBody)>,
    /// What else acted on the tip; empty where no run has a reference.
    pub(super) wrenches: Vec<Wrench<Tip>>,
    rows: usize,
    /// Per gauge and coordinate what it makes of an acceleration (counts s^2/rad), as of the last look.
    by_acceleration: Vec<Vec<f64>>,
    /// Per gauge and row what the uncertainty of the accelerations adds to its variance, counts^2.
    pub(super) motion_counts2: Vec<Vec<f32>>,
}

impl Prediction {
    pub(super) fn new(rig: &Rig, model: &ModelFile) -> Self {
        let (chain, arm) = model.arm(&rig.chain);
        let gauges = model.gauges();
        let n = gauges.len();
        Self {
            dynamics: Dynamics::new(&chain, &rig.sections),
            conditioners: Vec::new(),
            signals: vec![Vec::new(); n],
            loads: vec![Vec::new(); n],
            regressors: vec![Vec::new(); n],
            carried: Vec::new(),
            wrenches: Vec::new(),
            rows: 0,
            by_acceleration: vec![Vec::new(); n],
            motion_counts2: vec![Vec::new(); n],
            chain,
            arm,
            gauges,
        }
    }

    /// At the start of a run the gauges' past is unknown.
    pub(super) fn begin(&mut self) {
        self.conditioners = self.gauges.iter().map(|gauge| Conditioner::new(&gauge.terms)).collect();
    }

    /// Lets the gauges' terms follow an instant.
    pub(super) fn condition(&mut self, recording: &Recording, instant: usize) {
        for (gauge, conditioner) in self.conditioners.iter_mut().enumerate() {
            let (counts, temperature) =
                (recording.counts[gauge][instant], recording.temperatures_c[gauge][instant]);
            conditioner.push(recording.at_ns[instant], counts, temperature);
        }
    }

    /// Predicts a row: the instant last conditioned, at `t_s` of the recording, in this motion.
    pub(super) fn row(&mut self, recording: &Recording, t_s: f64, motion: &[JointMotion]) {
        let body = recording.loads.at(t_s);
        self.carry(body);
        let reference = recording.reference.as_ref().and_then(|reference| reference.at(t_s));
        let wrench = reference.unwrap_or_else(Wrench::zero);
        if reference.is_some() || !self.wrenches.is_empty() {
            self.wrenches.resize(self.rows, Wrench::zero());
            self.wrenches.push(wrench);
        }
        self.place(motion, &wrench);
        for (index, gauge) in self.gauges.iter().enumerate() {
            let load =
                self.dynamics.load(index) + self.dynamics.load_of_tip_wrench(index, &wrench).to_vector();
            let regressors = self.conditioners[index].regressors();
            self.signals[index].push(gauge.compliance.dot(&load) + gauge.terms.counts(regressors));
            self.loads[index].push(load);
            if !gauge.terms.terms.is_empty() {
                self.regressors[index].push(*regressors);
            }
        }
        if self.rows.is_multiple_of(LOOK_EVERY) {
            self.look();
        }
        for (variances, by) in self.motion_counts2.iter_mut().zip(&self.by_acceleration) {
            let parts = by.iter().zip(motion).map(|(by, joint)| by * by * joint.covariance[(2, 2)]);
            variances.push(parts.sum::<f64>() as f32);
        }
        self.rows += 1;
    }

    /// What hangs on the tip is part of the arm.
    fn carry(&mut self, body: RigidBody) {
        match self.carried.last_mut() {
            Some((rows, last)) if *last == body => rows.end = self.rows + 1,
            _ => {
                self.dynamics.set_payload(&body);
                self.carried.push((self.rows..self.rows + 1, body));
            }
        }
    }

    /// Moves the arm, and lets the joints yield under their load.
    fn place(&mut self, motion: &[JointMotion], wrench: &Wrench<Tip>) {
        let part = |f: fn(&JointMotion) -> f64| motion.iter().map(f).collect::<Vec<f64>>();
        let (mut q, qd) = (part(|m| m.position_rad), part(|m| m.velocity_rad_s));
        let qdd = part(|m| m.acceleration_rad_s2);
        self.dynamics.update(&q, &qd, &qdd);
        if self.arm.flexibility_rad_per_nm.iter().any(|f| *f != 0.0) {
            for (k, flexibility) in self.arm.flexibility_rad_per_nm.iter().enumerate() {
                q[k] += flexibility * self.dynamics.joint_torque_nm(k, wrench);
            }
            self.dynamics.update(&q, &qd, &qdd);
        }
    }

    /// How much every gauge answers to accelerations in the present pose.
    fn look(&mut self) {
        self.dynamics.differentiate();
        for (index, gauge) in self.gauges.iter().enumerate() {
            let row = self.dynamics.row_to_tip(index, &gauge.compliance);
            let felt = self.dynamics.row_by_motion(index, &row);
            self.by_acceleration[index] = felt.map(|[_, _, by_acceleration]| by_acceleration).collect();
        }
    }
}
