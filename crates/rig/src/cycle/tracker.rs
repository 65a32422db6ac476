//! The joints of successive snapshots to their motion, and with it each snapshot to its wrench.

use can::assembly::{Absence, JointBinding, Snapshot};
use model::motion::{JointMotion, MotionFilter, RoundClock, Sampled};

use super::lag::{Lag, Round};
use super::low_pass::LowPass;
use super::stuck::StuckWatch;
use super::{Estimate, Refusal, Stage};
use crate::Rig;
use crate::model_file::{Encoder, ModelFile};
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
    filters: Vec<MotionFilter>,
    velocity_sigmas: Vec<f64>,
    watches: Vec<StuckWatch>,
    motion: Vec<JointMotion>,
    lag: Option<Lag>,
    low_pass: Option<LowPass>,
}

/// An encoder whose noise is far above its resolution does not say the same again and again.
fn encoder_watch(encoder: &Encoder, joint: &JointBinding) -> StuckWatch {
    let resolution_rad = (joint.position.spec.scale * joint.position.to_si).abs();
    StuckWatch::new(encoder.position_sigma_rad, resolution_rad)
}

impl MotionTracker {
    /// For the coordinates of a robot with the encoders of its model, and its `[filter]`.
    pub fn new(rig: &Rig, model: &ModelFile) -> Self {
        let encoders: Vec<_> = (0..rig.chain.coordinates()).map(|k| model.encoder(k)).collect();
        let sigmas_rad = encoders.iter().map(|e| e.position_sigma_rad);
        Self {
            clock: RoundClock::default(),
            filters: sigmas_rad.clone().map(MotionFilter::new).collect(),
            velocity_sigmas: encoders.iter().map(|e| e.velocity_sigma_rad_s.unwrap_or(f64::NAN)).collect(),
            watches: encoders
                .iter()
                .zip(&rig.layout.joints)
                .map(|(e, joint)| encoder_watch(e, joint))
                .collect(),
            motion: vec![JointMotion::at_rest(0.0); encoders.len()],
            lag: Lag::new(rig, sigmas_rad),
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
        // Every filter is fed, whatever the others lack: a joint that comes back must find its neighbours warm.
        for k in 0..self.filters.len() {
            let known = self.follow_joint(k, snapshot, &mut round);
            match self.filters[k].motion(at).filter(|_| known) {
                Some(motion) => self.motion[k] = motion,
                None => round.unknown = round.unknown.or(Some(k)),
            }
        }
        round
    }

    /// Takes in one joint; whether its motion can be known.
    fn follow_joint(&mut self, k: usize, snapshot: &Snapshot, round: &mut Round) -> bool {
        let (filter, joint) = (&mut self.filters[k], &snapshot.joints[k]);
        let mut lag = self.lag.as_mut().map(|lag| lag.joint(k));
        match joint.position {
            Ok(position) if self.watches[k].is_stuck(position.value) => {
                filter.forget();
                lag.iter_mut().for_each(|lag| lag.push(round.at, 0.0, None));
                false
            }
            // Perhaps the last frame again: carried on from those before until that is known.
            Ok(_) if self.watches[k].repeats() => {
                lag.iter_mut().for_each(|lag| lag.push(round.at, 0.0, None));
                true
            }
            Ok(position) => {
                // A delay of its own counts from its own stamp, with that stamp's scatter.
                let scatter_s = if position.age_ns == 0 { 0.0 } else { round.at.scatter_s };
                let jitter_s = scatter_s.hypot(position.unsure_ns as f64 * 1e-9);
                let at = Sampled { at_ns: round.at.at_ns - position.age_ns, ..round.at };
                let fate = filter.measure(at, jitter_s, position.value);
                if let Some(lag) = &mut lag {
                    if filter.has_revoked() {
                        lag.revoke();
                    }
                    lag.push(at, jitter_s, Some((position.value, fate)));
                }
                if let Ok(velocity) = joint.velocity
                    && velocity.at_ns == position.at_ns
                    && self.velocity_sigmas[k].is_finite()
                {
                    filter.measure_velocity(velocity.value, self.velocity_sigmas[k]);
                    lag.iter_mut()
                        .for_each(|lag| lag.measure_velocity(velocity.value, self.velocity_sigmas[k]));
                }
                true
            }
            absent => {
                lag.iter_mut().for_each(|lag| lag.push(round.at, 0.0, None));
                // One lost frame: carried on from those before, with the uncertainty that brings.
                let one = matches!(absent, Err(Absence::Missed | Absence::Repeated | Absence::WrongLength));
                if one {
                    round.status = round.status.with(Status::STALE);
                }
                one
            }
        }
    }

    /// Motion of every coordinate as last tracked.
    pub fn motion(&self) -> &[JointMotion] {
        &self.motion
    }

    /// Takes in the next snapshot and hands each instant that is ready to `out`, oldest first: this one, or with a `[filter]` that waits
    /// mostly an earlier one.
    pub fn advance(&mut self, snapshot: &Snapshot, stage: &mut Stage, mut out: impl FnMut(&Instant<'_>)) {
        let round = self.follow(snapshot);
        let astray = self.filters.iter().map(MotionFilter::has_passed_over);
        let Some(lag) = &mut self.lag else {
            let estimate = estimate(snapshot, round, &self.motion, astray, stage);
            return out(&Instant {
                estimate: finished(estimate, &mut self.low_pass),
                snapshot,
                motion: &self.motion,
            });
        };
        let doubts_rad = self.filters.iter().map(MotionFilter::doubt_rad);
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
