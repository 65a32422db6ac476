//! The joints of successive snapshots to their motion, and with it each snapshot to its wrench.

use can::assembly::Snapshot;
use model::motion::{JointMotion, MotionFilter, RoundClock};

use super::joint::Joint;
use super::lag::{Lag, Round};
use super::low_pass::LowPass;
use super::{Estimate, Refusal, Stage};
use crate::Rig;
use crate::model_file::ModelFile;
use crate::status::Status;
use crate::tare::TareRefusal;

/// An instant that the tracker is done with.
#[derive(Debug)]
pub struct Instant<'a> {
    /// Its wrench.
    pub estimate: Estimate,
    /// Its readings.
    pub snapshot: &'a Snapshot,
    /// Every coordinate's motion, as far as it is known.
    pub motion: &'a [JointMotion],
}

/// Motion of all coordinates from the joints of successive snapshots.
#[derive(Clone, Debug)]
pub struct MotionTracker {
    clock: RoundClock,
    joints: Vec<Joint>,
    motion: Vec<JointMotion>,
    /// What the motion will be if the open round ends with the readings that it has.
    ahead: Vec<JointMotion>,
    lag: Option<Lag>,
    low_pass: Option<LowPass>,
}

impl MotionTracker {
    /// For the coordinates of a robot with the encoders of its model, and its `[filter]`.
    pub fn new(rig: &Rig, model: &ModelFile) -> Self {
        let encoders: Vec<_> = (0..rig.chain.coordinates()).map(|k| model.encoder(k)).collect();
        let at_rest = vec![JointMotion::at_rest(0.0); encoders.len()];
        Self {
            clock: RoundClock::default(),
            joints: encoders.iter().zip(&rig.layout.joints).map(|(e, joint)| Joint::new(e, joint)).collect(),
            motion: at_rest.clone(),
            ahead: at_rest,
            lag: Lag::new(rig, encoders.iter().map(|e| e.position_sigma_rad)),
            low_pass: rig.config.filter.cutoff_hz.map(LowPass::new),
        }
    }

    /// Takes in a snapshot's joints; every coordinate's motion at its instant, with what to flag, or the first coordinate
    /// that is not known. Causal, whatever the `[filter]`.
    pub fn track(&mut self, snapshot: &Snapshot) -> Result<(&[JointMotion], Status), usize> {
        let round = self.follow(snapshot);
        match round.unknown {
            None => Ok((&self.motion, round.status)),
            Some(k) => Err(k),
        }
    }

    fn follow(&mut self, snapshot: &Snapshot) -> Round {
        let at = self.clock.observe(snapshot.instant_ns, snapshot.cycles);
        let mut round = Round { at, status: Status::GOOD, unknown: None };
        // Every joint is followed, whatever the others lack: one that comes back must find its neighbours warm.
        for (k, joint) in self.joints.iter_mut().enumerate() {
            let lag = self.lag.as_mut().map(|lag| lag.joint(k));
            let followed = joint.follow(at, &snapshot.joints[k], lag);
            if followed.is_carried_on {
                round.status = round.status.with(Status::STALE);
            }
            match followed.motion {
                Some(motion) => self.motion[k] = motion,
                None => round.unknown = round.unknown.or(Some(k)),
            }
        }
        round
    }

    /// Follows those joints ahead that have come in a round that has not ended: when it does, that is done. What the motion will be if it ends
    /// so; none where not all of it is known. Changes nothing that [`MotionTracker::advance`] or [`MotionTracker::track`] say.
    pub fn prepare(&mut self, open: &Snapshot) -> Option<&[JointMotion]> {
        if self.lag.is_some() {
            return None;
        }
        let at = self.clock.clone().observe(open.instant_ns, open.cycles);
        let mut all = true;
        for ((joint, reading), ahead) in self.joints.iter_mut().zip(&open.joints).zip(&mut self.ahead) {
            let followed = reading.position.is_ok().then(|| joint.prepare(at, reading));
            match followed.and_then(|followed| followed.motion) {
                Some(motion) => *ahead = motion,
                None => all = false,
            }
        }
        all.then_some(&self.ahead)
    }

    /// Motion of every coordinate as last tracked.
    pub fn motion(&self) -> &[JointMotion] {
        &self.motion
    }

    /// Takes in the next snapshot and hands each instant that is ready to `out`, oldest first: this one, or with a `[filter]` that waits
    /// mostly an earlier one.
    pub fn advance(&mut self, snapshot: &Snapshot, stage: &mut Stage, mut out: impl FnMut(&Instant<'_>)) {
        let round = self.follow(snapshot);
        let filters = self.joints.iter().map(Joint::filter);
        let astray = filters.clone().map(MotionFilter::has_passed_over);
        let Some(lag) = &mut self.lag else {
            let estimate = estimate(snapshot, round, &self.motion, astray, stage);
            return out(&Instant {
                estimate: finished(estimate, &mut self.low_pass),
                snapshot,
                motion: &self.motion,
            });
        };
        let doubts_rad = filters.map(MotionFilter::doubt_rad);
        lag.push(snapshot, round, &self.motion, astray.zip(doubts_rad));
        while let Some(held) = lag.next_due() {
            let mut estimate =
                estimate(&held.snapshot, held.round, &held.motion, held.astray.iter().copied(), stage);
            estimate.delay_ns = held.waited_ns;
            estimate.last_stamp_ns = snapshot.last_stamp_ns;
            let estimate = finished(estimate, &mut self.low_pass);
            out(&Instant { estimate, snapshot: &held.snapshot, motion: &held.motion });
        }
    }
}

fn finished(mut estimate: Estimate, low_pass: &mut Option<LowPass>) -> Estimate {
    low_pass.iter_mut().for_each(|filter| filter.apply(&mut estimate));
    estimate
}

/// The wrench of a snapshot with its motion; `astray`: joints whose encoder says what cannot be.
fn estimate(
    snapshot: &Snapshot,
    round: Round,
    motion: &[JointMotion],
    astray: impl Iterator<Item = bool>,
    stage: &mut Stage,
) -> Estimate {
    let estimate = match round.unknown {
        None => {
            stage.begin(snapshot.instant_ns);
            astray.enumerate().filter(|(_, astray)| *astray).for_each(|(k, _)| stage.doubt_joint(k));
            stage.estimate(snapshot, motion, round.status)
        }
        Some(coordinate) => Estimate {
            instant_ns: snapshot.instant_ns,
            delay_ns: 0,
            last_stamp_ns: snapshot.last_stamp_ns,
            round: snapshot.round,
            outcome: Err(Refusal::JointUnknown(coordinate)),
            status: Status::INVALID.with(Status::STALE).with(stage.listen(snapshot)),
        },
    };
    if let Err(refusal) = estimate.outcome
        && !refusal.is_of_zeros()
    {
        stage.refuse_tare(TareRefusal::NoWrench(refusal));
    }
    estimate
}
