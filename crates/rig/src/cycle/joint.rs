//! One joint's readings to its motion, round by round; and ahead of a round's end where its reading is there.

use can::assembly::{Absence, JointBinding, JointReading};
use model::motion::{JointMotion, LagSmoother, MotionFilter, Sampled};

use super::stuck::StuckWatch;
use crate::model_file::Encoder;

/// Follows one joint. Allocates nothing.
#[derive(Clone, Debug)]
pub(super) struct Joint {
    now: Follower,
    /// The same one reading on.
    next: Follower,
    /// That reading with its round, and what it comes to, as long as the round has not ended.
    ahead: Option<(Sampled, JointReading, Followed)>,
}

/// What a joint's reading comes to.
#[derive(Clone, Copy, Debug)]
pub(super) struct Followed {
    /// Its motion, as far as it is known.
    pub(super) motion: Option<JointMotion>,
    /// One lost frame: carried on from those before, with the uncertainty that brings.
    pub(super) is_carried_on: bool,
}

/// The state of a joint.
#[derive(Clone, Debug)]
struct Follower {
    filter: MotionFilter,
    watch: StuckWatch,
    velocity_sigma_rad_s: f64,
}

impl Joint {
    /// For a joint with this encoder.
    pub(super) fn new(encoder: &Encoder, binding: &JointBinding) -> Self {
        // An encoder whose noise is far above its resolution does not say the same again and again.
        let resolution_rad = (binding.position.spec.scale * binding.position.to_si).abs();
        let now = Follower {
            filter: MotionFilter::new(encoder.position_sigma_rad),
            watch: StuckWatch::of_encoder(encoder.position_sigma_rad, resolution_rad),
            velocity_sigma_rad_s: encoder.velocity_sigma_rad_s.unwrap_or(f64::NAN),
        };
        Self { next: now.clone(), now, ahead: None }
    }

    /// Its filter after the last reading.
    pub(super) fn filter(&self) -> &MotionFilter {
        &self.now.filter
    }

    /// Takes in what a round that ended has of it.
    pub(super) fn follow(
        &mut self,
        at: Sampled,
        reading: &JointReading,
        lag: Option<&mut LagSmoother>,
    ) -> Followed {
        match self.ahead.take() {
            Some((ahead, of, followed)) if ahead == at && of == *reading && lag.is_none() => {
                std::mem::swap(&mut self.now, &mut self.next);
                followed
            }
            _ => self.now.follow(at, reading, lag),
        }
    }

    /// What it would be if the round ended with this reading: kept for when it does.
    pub(super) fn prepare(&mut self, at: Sampled, reading: &JointReading) -> Followed {
        if let Some((ahead, of, followed)) = &self.ahead
            && *ahead == at
            && of == reading
        {
            return *followed;
        }
        self.next.clone_from(&self.now);
        let followed = self.next.follow(at, reading, None);
        self.ahead = Some((at, *reading, followed));
        followed
    }
}

impl Follower {
    fn follow(&mut self, at: Sampled, reading: &JointReading, lag: Option<&mut LagSmoother>) -> Followed {
        let (is_known, is_carried_on) = self.take_in(at, reading, lag);
        Followed { motion: self.filter.motion(at).filter(|_| is_known), is_carried_on }
    }

    /// Whether the motion can be known, and whether it is carried on without a reading.
    fn take_in(
        &mut self,
        round: Sampled,
        reading: &JointReading,
        mut lag: Option<&mut LagSmoother>,
    ) -> (bool, bool) {
        let filter = &mut self.filter;
        match reading.position {
            Ok(position) if self.watch.is_stuck(position.value) => {
                filter.forget();
                lag.iter_mut().for_each(|lag| lag.push(round, 0.0, None));
                (false, false)
            }
            // Perhaps the last frame again: carried on from those before until that is known.
            Ok(_) if self.watch.repeats() => {
                lag.iter_mut().for_each(|lag| lag.push(round, 0.0, None));
                (true, false)
            }
            Ok(position) => {
                // A delay of its own counts from its own stamp, with that stamp's scatter.
                let scatter_s = if position.age_ns == 0 { 0.0 } else { round.scatter_s };
                let jitter_s = scatter_s.hypot(position.unsure_ns as f64 * 1e-9);
                let at = Sampled { at_ns: round.at_ns - position.age_ns, ..round };
                let fate = filter.measure(at, jitter_s, position.value);
                if let Some(lag) = &mut lag {
                    if filter.has_revoked() {
                        lag.revoke();
                    }
                    lag.push(at, jitter_s, Some((position.value, fate)));
                }
                if let Ok(velocity) = reading.velocity
                    && velocity.at_ns == position.at_ns
                    && self.velocity_sigma_rad_s.is_finite()
                {
                    filter.measure_velocity(velocity.value, self.velocity_sigma_rad_s);
                    lag.iter_mut()
                        .for_each(|lag| lag.measure_velocity(velocity.value, self.velocity_sigma_rad_s));
                }
                (true, false)
            }
            Err(absence) => {
                lag.iter_mut().for_each(|lag| lag.push(round, 0.0, None));
                let is_one = matches!(absence, Absence::Missed | Absence::Repeated | Absence::WrongLength);
                (is_one, is_one)
            }
        }
    }
}
