//! `[filter] delay_s`: every instant waits so long for later ones, and its motion is known from both sides.

use can::assembly::Snapshot;
use model::motion::{JointMotion, LagSmoother, Sampled};

use crate::Rig;
use crate::status::Status;

/// Rounds a second for which there is room; at more the wait is shorter.
const MOST_HZ: f64 = 1100.0;

/// An instant is due a tenth of a round before it has waited long enough: stamps scatter.
const EARLY: f64 = 0.1;

/// What a round says of the joints.
#[derive(Clone, Copy, Debug)]
pub(super) struct Round {
    pub(super) at: Sampled,
    pub(super) status: Status,
    /// The first coordinate that is not known.
    pub(super) unknown: Option<usize>,
}

/// A round that waits.
#[derive(Clone, Debug)]
pub(super) struct Held {
    pub(super) snapshot: Snapshot,
    pub(super) round: Round,
    pub(super) motion: Vec<JointMotion>,
    /// Joints whose encoder says what cannot be, and how far each position is in doubt, rad.
    pub(super) astray: Vec<bool>,
    doubts_rad: Vec<f64>,
    pub(super) waited_ns: i64,
}

/// The rounds that wait, and the smoothers of their joints. Allocates at construction only.
#[derive(Clone, Debug)]
pub(super) struct Lag {
    delay_ns: i64,
    /// What waited so much longer is not told any more, ns.
    stale_after_ns: i64,
    joints: Vec<LagSmoother>,
    ring: Vec<Held>,
    /// Rounds so far, and of those how many wait no more.
    rounds: usize,
    told: usize,
    step_ns: i64,
}

impl Lag {
    /// For a rig's `[filter]`, if it waits, and the standard deviations of its encoders, rad.
    pub(super) fn new(rig: &Rig, sigmas_rad: impl Iterator<Item = f64>) -> Option<Self> {
        let delay_s = rig.config.filter.delay_s.filter(|delay_s| *delay_s > 0.0)?;
        let rounds = (delay_s * MOST_HZ).ceil() as usize + 2;
        let joints: Vec<_> = sigmas_rad.map(|sigma_rad| LagSmoother::new(sigma_rad, rounds)).collect();
        let n = joints.len();
        let empty = Held {
            snapshot: Snapshot::empty(rig.layout.gauges.len(), rig.layout.joints.len()),
            round: Round { at: Sampled::default(), status: Status::GOOD, unknown: None },
            motion: vec![JointMotion::at_rest(0.0); n],
            astray: vec![false; n],
            doubts_rad: vec![0.0; n],
            waited_ns: 0,
        };
        Some(Self {
            delay_ns: (delay_s * 1e9).round() as i64,
            stale_after_ns: rig.layout.stale_after_ns,
            joints,
            ring: vec![empty; rounds],
            rounds: 0,
            told: 0,
            step_ns: 0,
        })
    }

    /// A joint's smoother; it takes one reading or none a round.
    pub(super) fn joint(&mut self, k: usize) -> &mut LagSmoother {
        &mut self.joints[k]
    }

    /// Takes in a round whose joints were given to their smoothers: its motion as far as it is known by now, and for each joint whether
    /// it goes astray and how far it is in doubt, rad.
    pub(super) fn push(
        &mut self,
        snapshot: &Snapshot,
        round: Round,
        motion: &[JointMotion],
        joints: impl Iterator<Item = (bool, f64)>,
    ) {
        let slots = self.ring.len();
        if let Some(last) = self.rounds.checked_sub(1) {
            self.step_ns = round.at.at_ns - self.ring[last % slots].round.at.at_ns;
        }
        let held = &mut self.ring[self.rounds % slots];
        held.snapshot.clone_from(snapshot);
        held.round = round;
        held.motion.copy_from_slice(motion);
        for (k, (astray, doubt_rad)) in joints.enumerate() {
            (held.astray[k], held.doubts_rad[k]) = (astray, doubt_rad);
        }
        self.rounds += 1;
    }

    /// The oldest round that has waited long enough, with its motion in the light of those after it.
    pub(super) fn next_due(&mut self) -> Option<&Held> {
        let slots = self.ring.len();
        let newest_ns = self.ring[self.rounds.checked_sub(1)? % slots].round.at.at_ns;
        loop {
            let back = self.rounds.checked_sub(self.told + 1)?;
            let held = &mut self.ring[self.told % slots];
            held.waited_ns = newest_ns - held.round.at.at_ns;
            let early_ns = (EARLY * self.step_ns as f64) as i64;
            if held.waited_ns < self.delay_ns - early_ns && back + 1 < slots {
                return None;
            }
            self.told += 1;
            if held.waited_ns - self.delay_ns <= self.stale_after_ns {
                let held = &mut self.ring[(self.told - 1) % slots];
                look_back(&self.joints, held, back);
                return Some(held);
            }
        }
    }
}

/// What later rounds say of a round's motion.
fn look_back(joints: &[LagSmoother], held: &mut Held, back: usize) {
    for (k, joint) in joints.iter().enumerate() {
        if let Some(motion) = joint.motion(back, held.round.at) {
            held.motion[k] = motion;
            held.motion[k].covariance[(0, 0)] += held.doubts_rad[k] * held.doubts_rad[k];
        }
    }
}
