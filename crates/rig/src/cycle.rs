//! The cycle: CAN frames in, the environment's wrench out. Daemon, demo and offline commands all run this.
//!
//! ```text
//! frame + stamp -> Assembler -> snapshot -> MotionFilter per joint -> WrenchEstimator -> Estimate
//! ```
//!
//! A function of the frames, their stamps and the model alone: no clock, so live and offline agree. Allocates at
//! construction only.

use can::assembly::{Absence, Assembler, Snapshot};
use can::frame::Stamped;
use model::estimator::{GaugeModel, NoWrench, Solution, WrenchEstimator};
use model::motion::{JointMotion, MotionFilter, RoundClock, Sampled};
use model::spatial::RigidBody;

use crate::model_file::ModelFile;
use crate::status::Status;
use crate::tare::{Tare, TareRefusal, Tared};
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
    counts: Vec<Option<f64>>,
    watches: Vec<StuckWatch>,
    states: Vec<GaugeState>,
    tare: Tare,
    /// What hangs at the tip for now and is subtracted, tip frame.
    payload: RigidBody,
}

/// What became of a gauge's reading at the last instant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GaugeState {
    /// It is part of the wrench.
    Used,
    /// There was none.
    Absent(Absence),
    /// It says the same again and again.
    Stuck,
    /// The tare that is applied has no zero for it.
    NotTared,
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
    /// For a robot and its gauges.
    pub fn new(rig: &Rig, gauges: Vec<GaugeModel>) -> Self {
        let n = gauges.len();
        Self {
            watches: gauges.iter().map(StuckWatch::new).collect(),
            estimator: WrenchEstimator::new(&rig.chain, &rig.sections, gauges),
            counts: vec![None; n],
            states: vec![GaugeState::Absent(Absence::NeverSeen); n],
            tare: Tare::new(n, rig.chain.coordinates()),
            payload: RigidBody::zero(),
        }
    }

    /// The wrench of a snapshot, given every coordinate's motion at its instant.
    pub fn estimate(&mut self, snapshot: &Snapshot, motion: &[JointMotion], status: Status) -> Estimate {
        let mut status = status;
        self.counts.clear();
        for (k, (gauge, watch)) in snapshot.gauges.iter().zip(&mut self.watches).enumerate() {
            let state = match gauge {
                Err(absence) => GaugeState::Absent(*absence),
                Ok(reading) if watch.is_stuck(reading.value) => GaugeState::Stuck,
                Ok(_) if self.tare.is_left_out(k) => GaugeState::NotTared,
                Ok(_) => GaugeState::Used,
            };
            self.states[k] = state;
            status = status.with(left_out(state));
            let used = gauge.as_ref().ok().filter(|_| state == GaugeState::Used);
            self.counts.push(used.map(|reading| reading.value));
        }
        let outcome = self.estimator.estimate(motion, &self.counts).map_err(Refusal::Estimator);
        let outcome = outcome.and_then(|solution| match worst_sigma_n(&solution) <= INVALID_ABOVE_N {
            true => Ok(solution),
            false => Err(Refusal::TooUncertain),
        });
        status = status.with(match &outcome {
            Ok(solution) => judge(solution),
            Err(Refusal::TooUncertain) => Status::INVALID.with(Status::UNCERTAIN),
            Err(_) => Status::INVALID,
        });
        let tared = if self.tare.applied().is_some() { Status::TARED } else { Status::GOOD };
        status = status.with(tared);
        if outcome.is_ok() {
            self.observe_tare(snapshot, motion);
        }
        Estimate {
            instant_ns: snapshot.instant_ns,
            last_stamp_ns: snapshot.last_stamp_ns,
            round: snapshot.round,
            outcome,
            status,
        }
    }

    fn observe_tare(&mut self, snapshot: &Snapshot, motion: &[JointMotion]) {
        let fit = |state: &GaugeState| matches!(state, GaugeState::Used | GaugeState::NotTared);
        let counts = snapshot.gauges.iter().zip(&self.states);
        let counts = counts.map(|(gauge, state)| Some(gauge.as_ref().ok().filter(|_| fit(state))?.value));
        self.tare.observe(snapshot.instant_ns, counts, motion, &mut self.estimator);
    }

    /// The estimator with the state of the last estimate.
    pub fn estimator(&self) -> &WrenchEstimator {
        &self.estimator
    }

    /// What became of each gauge's reading at the last instant.
    pub fn gauge_states(&self) -> &[GaugeState] {
        &self.states
    }

    /// Each gauge's reading as far as it was used at the last instant, counts.
    pub fn counts(&self) -> &[Option<f64>] {
        &self.counts
    }

    /// Begins to average for a tare; [`Stage::take_tare_outcome`] tells how it ended.
    pub fn begin_tare(&mut self) {
        self.tare.begin();
    }

    /// Gives up a tare that runs.
    pub fn refuse_tare(&mut self, refusal: TareRefusal) {
        self.tare.refuse(refusal);
    }

    /// Takes the calibration's zeros again.
    pub fn untare(&mut self) {
        self.tare.undo(&mut self.estimator);
    }

    /// The tare that is applied.
    pub fn tared(&self) -> Option<Tared> {
        self.tare.applied()
    }

    /// How a tare ended, once.
    pub fn take_tare_outcome(&mut self) -> Option<Result<Tared, TareRefusal>> {
        self.tare.take_outcome()
    }

    /// Subtracts weight and inertia of a body that is rigidly at the tip (tip frame), from the next estimate on and in place of
    /// the one before; a body without mass takes it off.
    pub fn set_payload(&mut self, body: &RigidBody) {
        self.payload = *body;
        self.estimator.set_payload(body);
    }

    /// The body at the tip that is subtracted, tip frame.
    pub fn payload(&self) -> &RigidBody {
        &self.payload
    }

    /// Goes on with the payload of another stage, and with its tare where the gauges are calibrated as there.
    pub fn take_over(&mut self, other: &Self) {
        self.set_payload(&other.payload);
        if self.estimator.gauges() == other.estimator.gauges() {
            self.tare.take_over(&other.tare);
            for (gauge, zero) in other.estimator.zeros().iter().enumerate() {
                self.estimator.set_zero(gauge, *zero);
            }
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
            stage: Stage::new(rig, model.gauges()),
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

    /// The wrench of the next snapshot.
    pub fn advance(&mut self, snapshot: &Snapshot, stage: &mut Stage) -> Estimate {
        match self.track(snapshot) {
            Ok((motion, status)) => stage.estimate(snapshot, motion, status),
            Err(coordinate) => Estimate {
                instant_ns: snapshot.instant_ns,
                last_stamp_ns: snapshot.last_stamp_ns,
                round: snapshot.round,
                outcome: Err(Refusal::JointUnknown(coordinate)),
                status: Status::INVALID.with(Status::STALE),
            },
        }
    }
}

/// What a gauge's state means for the wrench.
fn left_out(state: GaugeState) -> Status {
    match state {
        GaugeState::Used => Status::GOOD,
        GaugeState::Absent(Absence::Saturated) => Status::DEGRADED.with(Status::SATURATED),
        GaugeState::Absent(Absence::Stale | Absence::NeverSeen) => Status::DEGRADED.with(Status::STALE),
        GaugeState::Absent(_) | GaugeState::Stuck | GaugeState::NotTared => Status::DEGRADED,
    }
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
