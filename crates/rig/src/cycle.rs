//! The cycle: CAN frames in, the environment's wrench out. Daemon, demo and offline commands all run this.
//!
//! ```text
//! frame + stamp -> Assembler -> snapshot -> MotionFilter per joint, Conditioner per gauge -> WrenchEstimator -> Estimate
//! ```
//!
//! A function of the frames, their stamps and the model alone: no clock, so live and offline agree. Allocates at
//! construction only.

use can::assembly::{Absence, Assembler, Snapshot};
use can::frame::Stamped;
use model::estimator::{GaugeModel, GaugeReading, NoWrench, Solution, WrenchEstimator};
use model::motion::{JointMotion, MotionFilter, RoundClock, Sampled};
use model::terms::{Conditioner, Effect};

use crate::model_file::ModelFile;
use crate::status::Status;
use crate::{Rig, RigError};

/// A wrench whose worst direction is less certain than this is flagged, N (moments over 0.1 m).
pub const UNCERTAIN_ABOVE_N: f64 = 1.0;

/// A wrench whose worst direction is less certain than this is no answer at all, N (moments over 0.1 m).
pub const INVALID_ABOVE_N: f64 = 10.0;

/// A gauge with noise of its own that says exactly the same so many times in a row has stopped measuring.
pub const STUCK_AFTER: u32 = 5;

/// Parity beyond this many standard deviations of a good arm's is flagged.
pub const PARITY_LIMIT_SIGMA: f64 = 8.0;

/// Wrench at one instant, or why there is none.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// The instant it refers to, ns since the Unix epoch.
    pub instant_ns: i64,
    /// Stamp of the last frame that went into it, ns since the Unix epoch.
    pub last_stamp_ns: i64,
    /// Number of its round since the start.
    pub round: u64,
    /// The environment's wrench about E's origin, in E, with its covariance; or why not.
    pub outcome: Result<Solution, Refusal>,
    /// What to know before using it.
    pub status: Status,
}

/// Why an instant has no wrench.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Refusal {
    /// No snapshot yet.
    NothingYet,
    /// This coordinate's position is not known.
    JointUnknown(usize),
    /// The estimator has no answer.
    Estimator(NoWrench),
    /// The worst direction is less certain than [`INVALID_ABOVE_N`].
    TooUncertain,
}

impl std::fmt::Display for Refusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::NothingYet => f.write_str("no complete snapshot yet"),
            Self::JointUnknown(k) => write!(f, "the position of coordinate {} is not known", k + 1),
            Self::Estimator(NoWrench::TooFewGauges) => f.write_str("fewer than six usable gauges"),
            Self::Estimator(NoWrench::Singular) => {
                f.write_str("the gauges do not see all six directions in this pose")
            }
            Self::Estimator(NoWrench::NotFinite) => f.write_str("a reading is not a finite number"),
            Self::TooUncertain => write!(
                f,
                "the usable gauges leave a direction uncertain by more than {INVALID_ABOVE_N} N in this pose"
            ),
        }
    }
}

/// Snapshot and joint motion to a wrench: the last part of the cycle, also used with a motion known from elsewhere.
#[derive(Clone, Debug)]
pub struct Stage {
    estimator: WrenchEstimator,
    readings: Vec<Option<GaugeReading>>,
    watches: Vec<StuckWatch>,
    conditioners: Vec<Conditioner>,
    /// Whether a gauge's readings are corrected for its temperature.
    thermal: Vec<bool>,
}

/// Tells a gauge that stands still from one that is quiet.
#[derive(Clone, Copy, Debug)]
struct StuckWatch {
    /// Whether the gauge's noise is large enough for equal readings to mean something.
    noisy: bool,
    last_counts: f64,
    repeats: u32,
}

impl StuckWatch {
    fn new(gauge: &GaugeModel) -> Self {
        /// Noise of so many counts makes equal readings in a row rarer than one in a million.
        const NOISY_COUNTS: f64 = 10.0;
        Self { noisy: gauge.noise_counts2 > NOISY_COUNTS.powi(2), last_counts: f64::NAN, repeats: 0 }
    }

    /// Takes in the next reading; whether the gauge is stuck.
    fn is_stuck(&mut self, counts: f64) -> bool {
        self.repeats = if counts == self.last_counts { self.repeats.saturating_add(1) } else { 0 };
        self.last_counts = counts;
        self.noisy && self.repeats >= STUCK_AFTER
    }
}

impl Stage {
    /// For a robot as its URDF has it, and its gauges.
    pub fn new(rig: &Rig, gauges: Vec<GaugeModel>) -> Self {
        let conditioners = gauges.iter().map(|gauge| Conditioner::new(&gauge.terms)).collect();
        Self::with(gauges.clone(), WrenchEstimator::new(&rig.chain, &rig.sections, gauges), conditioners)
    }

    /// For a robot as it was calibrated.
    pub fn of_model(rig: &Rig, model: &ModelFile) -> Self {
        let gauges = model.gauges();
        let (chain, arm) = model.arm(&rig.chain);
        let conditioners = gauges.iter().map(|gauge| Conditioner::new(&gauge.terms)).collect();
        let estimator = WrenchEstimator::with_arm(&chain, &rig.sections, gauges.clone(), arm);
        Self::with(gauges, estimator, conditioners)
    }

    fn with(gauges: Vec<GaugeModel>, estimator: WrenchEstimator, conditioners: Vec<Conditioner>) -> Self {
        let is_thermal = |gauge: &GaugeModel| {
            gauge.terms.terms.iter().any(|term| matches!(term.effect, Effect::Temperature { .. }))
        };
        Self {
            watches: gauges.iter().map(StuckWatch::new).collect(),
            thermal: gauges.iter().map(is_thermal).collect(),
            readings: Vec::with_capacity(gauges.len()),
            estimator,
            conditioners,
        }
    }

    /// Takes in a snapshot's gauges and temperatures; what to flag of them.
    fn listen(&mut self, snapshot: &Snapshot) -> Status {
        let mut status = Status::GOOD;
        self.readings.clear();
        for (k, gauge) in snapshot.gauges.iter().enumerate() {
            let counts = match gauge {
                Ok(reading) if self.watches[k].is_stuck(reading.value) => Err(Status::DEGRADED),
                Ok(reading) => Ok(reading.value),
                Err(absence) => Err(left_out(*absence)),
            };
            status = status.with(counts.err().unwrap_or_default());
            let temperature = snapshot.temperatures[k].ok().map(|reading| reading.value);
            if self.thermal[k] && temperature.is_none() {
                status = status.with(Status::STALE);
            }
            let conditioner = &mut self.conditioners[k];
            conditioner.push(snapshot.instant_ns, counts.ok(), temperature);
            self.readings.push(counts.ok().map(|counts| GaugeReading {
                counts,
                regressors: *conditioner.regressors(),
                unsettled_counts2: conditioner.unsettled_counts2(),
            }));
        }
        status
    }

    /// The wrench of a snapshot, given every coordinate's motion at its instant. The same snapshot may come twice.
    pub fn estimate(&mut self, snapshot: &Snapshot, motion: &[JointMotion], status: Status) -> Estimate {
        let mut status = status.with(self.listen(snapshot));
        let outcome = self.estimator.estimate(motion, &self.readings).map_err(Refusal::Estimator);
        let outcome = outcome.and_then(|solution| match worst_sigma_n(&solution) <= INVALID_ABOVE_N {
            true => Ok(solution),
            false => Err(Refusal::TooUncertain),
        });
        status = status.with(match &outcome {
            Ok(solution) => judge(solution),
            Err(Refusal::TooUncertain) => Status::INVALID.with(Status::UNCERTAIN),
            Err(_) => Status::INVALID,
        });
        Estimate {
            instant_ns: snapshot.instant_ns,
            last_stamp_ns: snapshot.last_stamp_ns,
            round: snapshot.round,
            outcome,
            status,
        }
    }

    /// The estimator with the state of the last estimate.
    pub fn estimator(&self) -> &WrenchEstimator {
        &self.estimator
    }
}

/// The whole way from frames to wrenches.
#[derive(Debug)]
pub struct Cycle {
    assembler: Assembler,
    tracker: MotionTracker,
    stage: Stage,
}

impl Cycle {
    /// For a robot with its stored model.
    pub fn new(rig: &Rig, model: &ModelFile) -> Result<Self, RigError> {
        Ok(Self {
            assembler: Assembler::new(&rig.layout)?,
            tracker: MotionTracker::new(rig, model),
            stage: Stage::of_model(rig, model),
        })
    }

    /// Takes the next frame and hands each wrench that it completes to `out`, oldest first (mostly none or one).
    pub fn push(&mut self, frame: &Stamped, mut out: impl FnMut(&Estimate)) {
        for snapshot in self.assembler.push(frame) {
            out(&self.tracker.advance(snapshot, &mut self.stage));
        }
    }

    /// What the assembler met so far.
    pub fn assembler(&self) -> &Assembler {
        &self.assembler
    }
}

/// Motion of all coordinates from the joints of successive snapshots.
#[derive(Clone, Debug)]
pub struct MotionTracker {
    clock: RoundClock,
    filters: Vec<MotionFilter>,
    velocity_sigmas: Vec<f64>,
    motion: Vec<JointMotion>,
}

impl MotionTracker {
    /// For the coordinates of a robot with the encoders of its model.
    pub fn new(rig: &Rig, model: &ModelFile) -> Self {
        let encoders: Vec<_> = (0..rig.chain.coordinates()).map(|k| model.encoder(k)).collect();
        Self {
            clock: RoundClock::default(),
            filters: encoders.iter().map(|e| MotionFilter::new(e.position_sigma_rad)).collect(),
            velocity_sigmas: encoders.iter().map(|e| e.velocity_sigma_rad_s.unwrap_or(f64::NAN)).collect(),
            motion: vec![JointMotion::at_rest(0.0); encoders.len()],
        }
    }

    /// Takes in a snapshot's joints; every coordinate's motion at its instant, with what to flag, or the first coordinate
    /// that is not known.
    pub fn track(&mut self, snapshot: &Snapshot) -> Result<(&[JointMotion], Status), usize> {
        let round = self.clock.observe(snapshot.instant_ns, snapshot.cycles);
        let mut status = Status::GOOD;
        let mut unknown = None;
        // Every filter is fed, whatever the others lack: a joint that comes back must find its neighbours warm.
        for (k, filter) in self.filters.iter_mut().enumerate() {
            let joint = &snapshot.joints[k];
            let known = match joint.position {
                Ok(position) => {
                    // A delay of its own counts from its own stamp, with that stamp's scatter.
                    let jitter_s = if position.age_ns == 0 { 0.0 } else { round.scatter_s };
                    let at_ns = round.at_ns - position.age_ns;
                    filter.measure(Sampled { at_ns, ..round }, jitter_s, position.value);
                    if let Ok(velocity) = joint.velocity
                        && velocity.at_ns == position.at_ns
                        && self.velocity_sigmas[k].is_finite()
                    {
                        filter.measure_velocity(velocity.value, self.velocity_sigmas[k]);
                    }
                    true
                }
                // One lost frame: carried on from those before, with the uncertainty that brings.
                Err(Absence::Missed | Absence::Repeated | Absence::WrongLength) => {
                    status = status.with(Status::STALE);
                    true
                }
                Err(_) => false,
            };
            match filter.motion(round).filter(|_| known) {
                Some(motion) => self.motion[k] = motion,
                None => unknown = unknown.or(Some(k)),
            }
        }
        match unknown {
            None => Ok((&self.motion, status)),
            Some(k) => Err(k),
        }
    }

    /// Motion of every coordinate as last tracked.
    pub fn motion(&self) -> &[JointMotion] {
        &self.motion
    }

    /// The wrench of the next snapshot.
    pub fn advance(&mut self, snapshot: &Snapshot, stage: &mut Stage) -> Estimate {
        match self.track(snapshot) {
            Ok((motion, status)) => stage.estimate(snapshot, motion, status),
            Err(coordinate) => {
                let heard = stage.listen(snapshot);
                Estimate {
                    instant_ns: snapshot.instant_ns,
                    last_stamp_ns: snapshot.last_stamp_ns,
                    round: snapshot.round,
                    outcome: Err(Refusal::JointUnknown(coordinate)),
                    status: Status::INVALID.with(Status::STALE).with(heard),
                }
            }
        }
    }
}

/// What a gauge's absence means for the wrench.
fn left_out(absence: Absence) -> Status {
    Status::DEGRADED.with(match absence {
        Absence::Saturated => Status::SATURATED,
        Absence::Stale | Absence::NeverSeen => Status::STALE,
        _ => Status::GOOD,
    })
}

/// Standard deviation of the worst direction, N (moments over the characteristic length).
fn worst_sigma_n(solution: &Solution) -> f64 {
    1.0 / solution.singular_values_per_n[5]
}

/// What a solution says about itself.
fn judge(solution: &Solution) -> Status {
    let uncertain = worst_sigma_n(solution) > UNCERTAIN_ABOVE_N;
    let limit = PARITY_LIMIT_SIGMA.powi(2) + solution.parity_dof as f64;
    let parity = solution.parity_dof > 0 && solution.parity_chi2 > limit;
    let flag = |raised: bool, status| if raised { status } else { Status::GOOD };
    flag(uncertain, Status::UNCERTAIN).with(flag(parity, Status::PARITY))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gauge(noise_counts: f64) -> GaugeModel {
        GaugeModel {
            compliance: nalgebra::Vector6::zeros(),
            bias_counts: 0.0,
            covariance: nalgebra::SMatrix::zeros(),
            assumed: None,
            noise_counts2: noise_counts * noise_counts,
            terms: model::terms::GaugeTerms::default(),
        }
    }

    #[test]
    fn a_noisy_gauge_that_repeats_itself_is_stuck_until_it_moves() {
        let mut watch = StuckWatch::new(&gauge(700.0));
        let stuck: Vec<bool> = [3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 4.0].map(|c| watch.is_stuck(c)).into();
        assert_eq!(stuck, [false, false, false, false, false, true, true, false]);
    }

    #[test]
    fn a_quiet_gauge_may_repeat_itself() {
        let mut watch = StuckWatch::new(&gauge(0.5));
        assert!((0..100).all(|_| !watch.is_stuck(3.0)));
    }
}
