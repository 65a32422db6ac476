//! The cycle: CAN frames in, the environment's wrench out. Daemon, demo and offline commands all run this.
//!
//! ```text
//! frame + stamp -> Assembler -> snapshot -> MotionFilter per joint, Conditioner per gauge -> WrenchEstimator -> Estimate
//! [filter] delay_s ...................... `lag`: an instant waits, and its motion is known from both sides
//! [filter] cutoff_hz ................................................................................... `low_pass` on wrenches
//! ```
//!
//! A function of the frames, their stamps and the model alone: no clock, so live and offline agree. Allocates at
//! construction only.

mod isolation;
mod joint;
mod lag;
mod low_pass;
mod one_frame;
mod several;
mod stage;
mod stuck;
mod tracker;
mod window;

pub use stage::{GaugeState, Stage};
pub use tracker::{Instant, MotionTracker};

use can::assembly::Assembler;
use can::frame::Stamped;
use model::estimator::{NoWrench, Solution};
use model::motion::JointMotion;

use crate::model_file::ModelFile;
use crate::status::Status;
use crate::{Rig, RigError};

/// A wrench whose worst direction is less certain than this is flagged, N (moments over 0.1 m).
pub const UNCERTAIN_ABOVE_N: f64 = 1.0;

/// A wrench whose worst direction is less certain than this is no answer at all, N (moments over 0.1 m).
pub const INVALID_ABOVE_N: f64 = 10.0;

/// A gauge or encoder with much noise of its own that says exactly the same so many times in a row has stopped measuring (a calmer one later).
pub const STUCK_AFTER: u32 = 5;

/// Parity beyond this many standard deviations of a good arm's is flagged (squared, and as much more as there are spare gauges).
pub const PARITY_LIMIT_SIGMA: f64 = 8.0;

/// Wrench at one instant, or why there is none.
#[derive(Clone, Debug, PartialEq)]
pub struct Estimate {
    /// The instant it refers to, ns since the Unix epoch.
    pub instant_ns: i64,
    /// By how much the newest instant that went into it is later, ns: zero without a `[filter]`.
    pub delay_ns: i64,
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
    /// A gauge is at fault, it is not clear which, and the error may be more than [`INVALID_ABOVE_N`].
    Fault,
    /// The gauges contradict each other in a way that no fault of a single one can explain, and by so much that a direction may be wrong by
    /// more than [`INVALID_ABOVE_N`].
    Contradiction,
    /// Several sensors said what cannot be, one soon after the other.
    SeveralAstray,
    /// The gauges contradict each other and have done so since the start.
    Unproven,
}

impl Refusal {
    /// Whether zeros that drifted may be all that is wrong: then a tare is the remedy, not to be refused for it.
    pub(crate) fn is_of_zeros(self) -> bool {
        matches!(self, Self::Fault | Self::Contradiction | Self::Unproven)
    }
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
            Self::Fault => write!(
                f,
                "a gauge is at fault and it is not clear yet which; the error may be more than {INVALID_ABOVE_N} N"
            ),
            Self::Contradiction => f.write_str(
                "the gauges contradict each other in a way that no single fault explains: zeros that drifted (tare), another model, or something that touches the arm beside its tip",
            ),
            Self::SeveralAstray => f.write_str(
                "several sensors said what cannot be, one soon after the other: frames are corrupted on their way, or several gauges or encoders fail",
            ),
            Self::Unproven => f.write_str(
                "pose and counts have contradicted the model since the start: zeros that drifted (tare), joints that are not where they say, something that touches the arm, or another arm's model",
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
            self.tracker.advance(snapshot, &mut self.stage, |instant| out(&instant.estimate));
        }
    }

    /// Does ahead what does not wait for the rest of the round's frames. A round that ends as it seemed is then sooner done; one that ends otherwise
    /// is done as ever: estimates are the same to the bit.
    pub fn prepare(&mut self) {
        let motion = self.assembler.preview().and_then(|open| self.tracker.prepare(open));
        if let Some(motion) = motion {
            self.stage.prepare(motion);
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

    /// Motion of every coordinate as last tracked.
    pub fn motion(&self) -> &[JointMotion] {
        self.tracker.motion()
    }

    /// What the assembler met so far.
    pub fn assembler(&self) -> &Assembler {
        &self.assembler
    }
}
