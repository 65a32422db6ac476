//! The cycle: CAN frames in, the environment's wrench out. Daemon, demo and offline commands all run this.
//!
//! ```text
//! frame + stamp -> Assembler -> snapshot -> MotionFilter per joint, Conditioner per gauge -> WrenchEstimator -> Estimate
//! ```
//!
//! A function of the frames, their stamps and the model alone: no clock, so live and offline agree. Allocates at
//! construction only.

mod stage;

pub use stage::{GaugeState, Stage};

use can::assembly::{Absence, Assembler, Snapshot};
use can::frame::Stamped;
use model::estimator::{NoWrench, Solution};
use model::motion::{JointMotion, MotionFilter, RoundClock, Sampled};

use crate::model_file::ModelFile;
use crate::status::Status;
use crate::tare::TareRefusal;
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
            let estimate = self.tracker.advance(snapshot, &mut self.stage);
            if let Err(refusal) = estimate.outcome {
                self.stage.refuse_tare(TareRefusal::NoWrench(refusal));
            }
            out(&estimate);
        }
    }

    /// The last part, where tare and payload are applied.
    pub fn stage(&self) -> &Stage {
        &self.stage
    }

    /// The last part, to tare or to declare a payload.
    pub fn stage_mut(&mut self) -> &mut Stage {
        &mut self.stage
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
