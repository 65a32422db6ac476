//! The same readings taken at face value: every gauge senses its nominal axis only, as without a crosstalk calibration.

use can::assembly::{Assembler, Snapshot};
use can::frame::Stamped;
use model::estimator::{GaugeCovariance, GaugeModel};
use model::motion::JointMotion;
use model::spatial::{Tip, Wrench};
use model::terms::GaugeTerms;
use nalgebra::Vector6;
use rig::cycle::{MotionTracker, Stage};
use rig::model_file::Sensor;
use rig::{ModelFile, Rig, Status};

use crate::Error;

/// Standard deviation that every gauge gets, Nm: the same, so that the solution is unweighted in Nm.
const EQUAL_NM: f64 = 1e-3;

/// Follows the frames; estimates only when it is asked, since a person looks a few times a second.
pub(super) struct Nominal {
    assembler: Assembler,
    tracker: MotionTracker,
    stage: Stage,
    latest: Option<Snapshot>,
    /// Motion at the latest snapshot, unless a joint is not known there
    motion: Option<(Vec<JointMotion>, Status)>,
}

impl Nominal {
    /// For a calibrated robot: the baseline beside the calibration.
    pub(super) fn new(rig: &Rig, model: &ModelFile) -> Result<Self, Error> {
        Ok(Self {
            assembler: Assembler::new(&rig.layout)?,
            tracker: MotionTracker::new(rig, model),
            stage: Stage::new(rig, model.sensors.iter().map(gauge).collect()),
            latest: None,
            motion: None,
        })
    }

    /// Takes in the next frame.
    pub(super) fn push(&mut self, frame: &Stamped) {
        for snapshot in self.assembler.push(frame) {
            self.motion = self.tracker.track(snapshot).ok().map(|(motion, status)| (motion.to_vec(), status));
            match &mut self.latest {
                Some(latest) => latest.clone_from(snapshot),
                None => self.latest = Some(snapshot.clone()),
            }
        }
    }

    /// The newest readings.
    pub(super) fn snapshot(&self) -> Option<&Snapshot> {
        self.latest.as_ref()
    }

    /// The wrench (N, Nm about E's origin, in E) of the newest readings with their instant, ns since the Unix epoch.
    pub(super) fn wrench(&mut self) -> Option<(i64, Wrench<Tip>)> {
        let snapshot = self.latest.as_ref()?;
        let (motion, status) = self.motion.as_ref()?;
        let estimate = self.stage.estimate(snapshot, motion, *status);
        Some((estimate.instant_ns, estimate.outcome.ok()?.wrench))
    }
}

fn gauge(sensor: &Sensor) -> GaugeModel {
    let k = sensor.nominal_axes.k_counts_per_nm;
    GaugeModel {
        compliance: Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, k),
        bias_counts: sensor.nominal_axes.bias_counts,
        covariance: GaugeCovariance::zeros(),
        assumed: None,
        noise_counts2: (k * EQUAL_NM).powi(2).max(f64::MIN_POSITIVE),
        terms: GaugeTerms::default(),
    }
}
