//! The causal filter of one joint, for the cycle: bounded work, no allocation.

use super::bank::Bank;
use super::kalman::{inner_density, inner_step, inner_variance, mixture, transition, unit_process};
use super::{JointMotion, Sampled};

/// After a longer silence than this the motion starts anew from the next position, ns.
const FORGET_NS: i64 = 500_000_000;

/// Readings before a motion is known: position, velocity, acceleration and jerk take one each, and one that tells
/// whether they predict anything.
const NEEDED: u8 = 5;

/// Readings before a motion is known again after a jump: what made it may come again.
const NEEDED_AFTER_JUMP: u8 = 12;

/// A reading that is farther from every prediction than noise explains, by more than this acceleration could have done since the last
/// one, may be a glitch, rad/s^2: one reading less does no harm.
const UNLIKELY_RAD_S2: f64 = 20.0;

/// If the next one is off by more than this acceleration could have done it was no glitch and is no motion, rad/s^2: robot joints reach tens.
const IMPOSSIBLE_RAD_S2: f64 = 100.0;

/// No joint turns faster, rad/s: two readings that are farther apart are not both the joint's.
const MOST_RAD_S: f64 = 25.0;

/// An acceleration beyond this is not believed, rad/s^2: then nothing is known of the motion.
const UNBELIEVED_RAD_S2: f64 = 50.0;

/// What noise explains, standard deviations of the filter that expects most.
const NOISE_SIGMA: f64 = 8.0;

/// An encoder that jumped back is where it was but for what the arm moved meanwhile: this share of the jump, and at most so many rad.
const MOVED: (f64, f64) = (0.2, 0.05);

fn moved_rad(jump_rad: f64) -> f64 {
    (MOVED.0 * jump_rad.abs()).min(MOVED.1)
}

/// A reading farther from what is expected than this, in standard deviations of the mixture, is believed when the next one bears it out.
const UNPROVEN_SIGMA: f64 = 6.0;

/// The same for the first reading after others stayed away: it may be one of those, held back by itself.
const UNPROVEN_AFTER_A_GAP_SIGMA: f64 = 2.5;

/// Where a motion explains a reading within this, in standard deviations of the mixture, a reading in between that it did not was a glitch.
const PLAIN_SIGMA: f64 = 4.0;

/// What became of a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fate {
    /// It is no newer than the last one.
    Ignored,
    /// No motion explains it: perhaps a glitch.
    PassedOver,
    /// The motion goes on with it.
    Taken,
    /// The motion starts anew with it.
    Anew,
}

/// Motion of one joint from its position readings so far: a bank of Kalman filters mixed by how well each predicts.
#[derive(Clone, Debug)]
pub struct MotionFilter {
    bank: Bank,
    /// What the motion is if the last reading was none of the joint's: it was unlikely, and the next one tells.
    without: Option<Bank>,
    encoder_variance_rad2: f64,
    last: Option<Sampled>,
    /// From the reading before the last one to the last, s.
    step_s: f64,
    /// Readings since the start, up to as many as are needed.
    readings: u8,
    needed: u8,
    /// The last reading was passed over as a glitch.
    passed_over: bool,
    /// The reading before the last one was not the joint's after all.
    revoked: bool,
    /// Sum of the jumps that stayed, rad: the joint may be where it was before them, or where it says.
    doubt_rad: f64,
    /// Where the joint was before the last jump, rad, and the doubt there was then.
    before_jump: (f64, f64),
}

impl MotionFilter {
    /// For an encoder whose single reading has this standard deviation (noise and rounding), rad.
    pub fn new(encoder_sigma_rad: f64) -> Self {
        let variance = encoder_sigma_rad * encoder_sigma_rad;
        Self {
            bank: Bank::at(0.0, variance),
            without: None,
            encoder_variance_rad2: variance,
            last: None,
            step_s: 0.0,
            readings: 0,
            needed: NEEDED,
            passed_over: false,
            revoked: false,
            doubt_rad: 0.0,
            before_jump: (0.0, 0.0),
        }
    }

    /// Takes in a position sampled at a time that may itself be uncertain by `jitter_s` against the round's; one that is not newer than
    /// the last is ignored.
    ///
    /// One that no motion can explain is passed over if it is alone. If the next one is no more possible the encoder has jumped: the
    /// motion starts anew from there, and as nobody knows which of the two places is true the position is uncertain by the distance
    /// from then on, until it jumps back.
    pub fn measure(&mut self, at: Sampled, jitter_s: f64, position_rad: f64) -> Fate {
        let mut fate = Fate::Taken;
        let unsure = self.last.map_or(0.0, |last| inner_variance(&last, &at));
        match self.last {
            Some(last) if at.at_ns <= last.at_ns && last.at_ns - at.at_ns < FORGET_NS => {
                return Fate::Ignored;
            }
            Some(last) if at.at_ns > last.at_ns && at.at_ns - last.at_ns < FORGET_NS => {
                self.bank.advance(&last, &at);
                self.without.iter_mut().for_each(|bank| bank.advance(&last, &at));
            }
            // The first reading, a long silence, or a clock that was set back: start anew.
            _ => {
                self.restart(position_rad);
                fate = Fate::Anew;
            }
        }
        let explained = self.choose(position_rad, jitter_s);
        let since_s = self.last.map_or(0.0, |last| (at.at_ns - last.at_ns) as f64 * 1e-9);
        let unproven_sigma =
            if since_s > 1.5 * self.step_s { UNPROVEN_AFTER_A_GAP_SIGMA } else { UNPROVEN_SIGMA };
        self.step_s = since_s;
        self.last = Some(at);
        if self.is_back(position_rad) {
            self.doubt_rad = self.before_jump.1;
            self.restart(position_rad);
            fate = Fate::Anew;
        } else if self.readings == 1 && self.is_beyond_reach(position_rad, since_s) {
            // The first reading or this one is wrong; the next ones tell.
            self.restart(position_rad);
            fate = Fate::Anew;
        } else if let Some(jump_rad) = self.jump(position_rad, jitter_s, since_s) {
            if !std::mem::replace(&mut self.passed_over, true) {
                return Fate::PassedOver;
            }
            self.begin_anew(position_rad, jump_rad);
            fate = Fate::Anew;
        } else if !explained {
            self.restart(position_rad);
            fate = Fate::Anew;
        }
        self.passed_over = false;
        self.readings = (self.readings + 1).min(self.needed);
        let variance = self.encoder_variance_rad2;
        if self.readings >= NEEDED {
            self.without = (!self.bank.expects(position_rad, variance, jitter_s, unsure, unproven_sigma))
                .then_some(self.bank);
        }
        self.bank.measure_position(position_rad, variance, jitter_s);
        fate
    }

    /// Whether the last reading was passed over: no motion explains it.
    pub fn has_passed_over(&self) -> bool {
        self.passed_over
    }

    /// Whether the last reading told that the one before it was not the joint's.
    pub fn has_revoked(&self) -> bool {
        self.revoked
    }

    /// How far the position is in doubt after jumps, rad.
    pub fn doubt_rad(&self) -> f64 {
        self.doubt_rad.abs()
    }

    /// Whether the last reading was the joint's, where that was in doubt: this one tells. `false` where neither motion explains it: then
    /// nothing is known of the joint's.
    fn choose(&mut self, position_rad: f64, jitter_s: f64) -> bool {
        self.revoked = false;
        let Some(without) = self.without.take() else { return true };
        let variance = self.encoder_variance_rad2;
        let likely = |bank: &Bank| bank.likelihood_ln(position_rad, variance, jitter_s);
        if likely(&without) > likely(&self.bank)
            && without.expects(position_rad, variance, jitter_s, 0.0, PLAIN_SIGMA)
        {
            self.bank = without;
            self.revoked = true;
            return true;
        }
        let explained = self.bank.expects(position_rad, variance, jitter_s, 0.0, UNPROVEN_SIGMA);
        self.revoked = !explained;
        explained
    }

    /// Starts anew with the next reading: the last ones were not the joint's. What they did to the doubt of its position is forgotten, too.
    pub fn forget(&mut self) {
        if self.last.take().is_some() && self.doubt_rad != self.before_jump.1 {
            self.doubt_rad = self.before_jump.1;
        }
        self.readings = 0;
    }

    /// Takes in a velocity (rad/s, with its standard deviation) sampled together with the last position.
    pub fn measure_velocity(&mut self, velocity_rad_s: f64, sigma_rad_s: f64) {
        self.bank.measure_velocity(velocity_rad_s, sigma_rad_s);
    }

    /// Motion at another time, carried on (or back) from the last reading; `None` while there are too few to know it, or they make no sense.
    pub fn motion(&self, at: Sampled) -> Option<JointMotion> {
        let last = self.last.filter(|_| self.readings == self.needed)?;
        let state = match &self.without {
            None => self.bank.mixture(),
            Some(without) => mixture(&[self.bank.mixture(), without.mixture()], &[0.5; 2]),
        };
        let doubted = |mut motion: JointMotion| {
            motion.covariance[(0, 0)] += self.doubt_rad * self.doubt_rad;
            // Late or wrong readings on the way, not the joint.
            (motion.acceleration_rad_s2.abs() <= UNBELIEVED_RAD_S2).then_some(motion)
        };
        if at.at_ns == last.at_ns {
            return doubted(state.motion());
        }
        let step = inner_step(&last, &at);
        let process = unit_process(step.abs()) * inner_density(self.bank.density());
        doubted(state.predicted(&transition(step), &process).smeared(inner_variance(&last, &at)).motion())
    }

    /// After a jump: what was known before says how far the position is in doubt, if anything was known.
    fn begin_anew(&mut self, position_rad: f64, jump_rad: f64) {
        if self.readings == self.needed {
            let left_rad = self.doubt_rad + jump_rad;
            self.before_jump = (position_rad - jump_rad, self.doubt_rad);
            self.doubt_rad = if left_rad.abs() < moved_rad(jump_rad) { 0.0 } else { left_rad };
        }
        self.restart(position_rad);
        self.needed = NEEDED_AFTER_JUMP;
    }

    /// Whether a joint that has just jumped is where it was before: two glitches in a row were no jump.
    fn is_back(&self, position_rad: f64) -> bool {
        let (place_rad, doubt_rad) = self.before_jump;
        let jump_rad = self.doubt_rad - doubt_rad;
        self.readings < self.needed
            && jump_rad != 0.0
            && (position_rad - place_rad).abs() < moved_rad(jump_rad)
    }

    /// Whether no joint gets from the only reading so far to this one in `since_s`.
    fn is_beyond_reach(&self, position_rad: f64, since_s: f64) -> bool {
        let room_rad = NOISE_SIGMA * self.encoder_variance_rad2.sqrt() + MOST_RAD_S * since_s;
        self.bank.nearest_rad(position_rad).is_some_and(|off_rad| off_rad.abs() > room_rad)
    }

    /// How far a reading is from where the joint can be `since_s` after the last one, rad; `None` where it can be there.
    fn jump(&self, position_rad: f64, jitter_s: f64, since_s: f64) -> Option<f64> {
        if self.readings < 2 {
            return None;
        }
        let most_rad_s2 = if self.passed_over { IMPOSSIBLE_RAD_S2 } else { UNLIKELY_RAD_S2 };
        let variance = self.bank.boldest_variance(self.encoder_variance_rad2, jitter_s);
        let room_rad = NOISE_SIGMA * variance.sqrt() + 0.5 * most_rad_s2 * since_s * since_s;
        // No joint stops dead: one that came to rest is where the filters for moving joints expect it, too.
        let nearest_rad = self.bank.nearest_rad(position_rad)?;
        (nearest_rad.abs() > room_rad).then_some(nearest_rad)
    }

    fn restart(&mut self, position_rad: f64) {
        self.bank = Bank::at(position_rad, self.encoder_variance_rad2);
        self.without = None;
        self.readings = 0;
        self.needed = NEEDED;
        self.passed_over = false;
    }
}

#[cfg(test)]
mod tests;
