//! The causal filter of one joint, for the cycle: bounded work, no allocation.

use super::kalman::{
    State, UNIT_S, inner_density, inner_step, inner_variance, mixture, transition, unit_process,
};
use super::{DWELL_S, JointMotion, REST_S, SNAP_DENSITIES, Sampled};

/// At rest, and moving with each strength of snap.
const MODELS: usize = 1 + SNAP_DENSITIES.len();

/// After a longer silence than this the motion starts anew from the next position, ns.
const FORGET_NS: i64 = 500_000_000;

/// Readings before a motion is known: position, velocity, acceleration and jerk take one each, and one that tells
/// whether they predict anything.
const NEEDED: u8 = 5;

/// Motion of one joint from its position readings so far: a bank of Kalman filters mixed by how well each predicts.
#[derive(Clone, Debug)]
pub struct MotionFilter {
    states: [State; MODELS],
    weights: [f64; MODELS],
    encoder_variance_rad2: f64,
    last: Option<Sampled>,
    /// Readings since the start, up to [`NEEDED`].
    readings: u8,
}

impl MotionFilter {
    /// For an encoder whose single reading has this standard deviation (noise and rounding), rad.
    pub fn new(encoder_sigma_rad: f64) -> Self {
        let variance = encoder_sigma_rad * encoder_sigma_rad;
        Self {
            states: [State::from_position(0.0, variance); MODELS],
            weights: [1.0 / MODELS as f64; MODELS],
            encoder_variance_rad2: variance,
            last: None,
            readings: 0,
        }
    }

    /// Takes in a position sampled at a time that may itself be uncertain by `jitter_s` against the round's; one that is not newer than
    /// the last is ignored.
    pub fn measure(&mut self, at: Sampled, jitter_s: f64, position_rad: f64) {
        match self.last {
            Some(last) if at.at_ns <= last.at_ns && last.at_ns - at.at_ns < FORGET_NS => return,
            Some(last) if at.at_ns > last.at_ns && at.at_ns - last.at_ns < FORGET_NS => {
                self.advance(&last, &at)
            }
            // The first reading, a long silence, or a clock that was set back: start anew.
            _ => self.restart(position_rad),
        }
        self.last = Some(at);
        self.readings = (self.readings + 1).min(NEEDED);
        let mut fit = [0.0; MODELS];
        for (state, fit) in self.states.iter_mut().zip(&mut fit) {
            *fit = state.measure_position(position_rad, self.encoder_variance_rad2, jitter_s);
        }
        self.reweigh(&fit);
    }

    /// Takes in a velocity (rad/s, with its standard deviation) sampled together with the last position.
    pub fn measure_velocity(&mut self, velocity_rad_s: f64, sigma_rad_s: f64) {
        let (value, variance) = (velocity_rad_s * UNIT_S, (sigma_rad_s * UNIT_S).powi(2));
        let mut fit = [0.0; MODELS];
        for (state, fit) in self.states.iter_mut().zip(&mut fit) {
            *fit = state.measure(1, value, variance);
        }
        self.reweigh(&fit);
    }

    /// Motion at another time, carried on (or back) from the last reading; `None` while there are too few to know it.
    pub fn motion(&self, at: Sampled) -> Option<JointMotion> {
        let last = self.last.filter(|_| self.readings == NEEDED)?;
        let state = mixture(&self.states, &self.weights);
        if at.at_ns == last.at_ns {
            return Some(state.motion());
        }
        let step = inner_step(&last, &at);
        let density: f64 = self.weights[1..].iter().zip(&SNAP_DENSITIES).map(|(w, s)| w * s).sum();
        let process = unit_process(step.abs()) * inner_density(density);
        Some(state.predicted(&transition(step), &process).smeared(inner_variance(&last, &at)).motion())
    }

    fn restart(&mut self, position_rad: f64) {
        self.states = [State::from_position(position_rad, self.encoder_variance_rad2); MODELS];
        self.weights = [1.0 / MODELS as f64; MODELS];
        self.readings = 0;
    }

    /// Mixes the filters by the chance that what the joint does has changed, then predicts each over the step.
    fn advance(&mut self, last: &Sampled, at: &Sampled) {
        let step = inner_step(last, at);
        let variance = inner_variance(last, at);
        let chances = chances(step * UNIT_S);
        let (transition, process) = (transition(step), unit_process(step));
        let before = self.states;
        let mut expected = [0.0; MODELS];
        for k in 0..MODELS {
            let mut share = [0.0; MODELS];
            for i in 0..MODELS {
                share[i] = self.weights[i] * chances[i][k];
                expected[k] += share[i];
            }
            share.iter_mut().for_each(|w| *w /= expected[k]);
            let mixed = mixture(&before, &share);
            self.states[k] = match k.checked_sub(1) {
                None => mixed.resting(step),
                Some(k) => {
                    let process = process * inner_density(SNAP_DENSITIES[k]);
                    mixed.predicted(&transition, &process).smeared(variance)
                }
            };
        }
        self.weights = expected;
    }

    /// Weighs the filters by the log-likelihood of what they just measured. A floor keeps each of them reachable.
    fn reweigh(&mut self, fit: &[f64; MODELS]) {
        const FLOOR: f64 = 1e-12;
        let best = fit.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        if !best.is_finite() {
            return;
        }
        let mut total = 0.0;
        for (w, fit) in self.weights.iter_mut().zip(fit) {
            *w = (*w * (fit - best).exp()).max(FLOOR);
            total += *w;
        }
        self.weights.iter_mut().for_each(|w| *w /= total);
    }
}

/// `chances[i][k]`: that a joint in mode i is in mode k after `step_s`. From rest to any strength of snap alike; from one
/// strength to those beside it or to rest.
fn chances(step_s: f64) -> [[f64; MODELS]; MODELS] {
    let wake = 1.0 - (-step_s / REST_S).exp();
    let change = 1.0 - (-step_s / DWELL_S).exp();
    let mut chances = [[0.0; MODELS]; MODELS];
    chances[0] = [wake / (MODELS - 1) as f64; MODELS];
    chances[0][0] = 1.0 - wake;
    for i in 1..MODELS {
        let beside = [i - 1, i + 1].into_iter().filter(|k| (1..MODELS).contains(k));
        let share = change / (1 + beside.clone().count()) as f64;
        beside.for_each(|k| chances[i][k] = share);
        chances[i][0] = share;
        chances[i][i] = 1.0 - change;
    }
    chances
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Deterministic noise: the sum of twelve uniform numbers from a small generator is near enough to Gaussian.
    struct Noise(u64);
    impl Noise {
        fn next(&mut self) -> f64 {
            (0..12)
                .map(|_| {
                    self.0 = self.0.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                    (self.0 >> 11) as f64 / (1u64 << 53) as f64
                })
                .sum::<f64>()
                - 6.0
        }
    }

    fn exactly(at_ns: i64) -> Sampled {
        Sampled { at_ns, ..Sampled::default() }
    }

    #[test]
    fn follows_a_swing_with_honest_uncertainty() {
        let (sigma, mut noise) = (20e-6, Noise(5));
        let mut filter = MotionFilter::new(sigma);
        let (mut error2, mut normalised, mut n) = (0.0, 0.0, 0.0);
        for k in 0..4000i64 {
            let (t, w) = (k as f64 * 0.008, 9.0);
            filter.measure(exactly(k * 8_000_000), 0.0, 0.2 * (w * t).sin() + sigma * noise.next());
            if k > 200 {
                let m = filter.motion(exactly(k * 8_000_000)).unwrap();
                let e = m.acceleration_rad_s2 + 0.2 * w * w * (w * t).sin();
                error2 += e * e;
                normalised += e * e / m.covariance[(2, 2)];
                n += 1.0;
            }
        }
        let (rms, nees) = ((error2 / n).sqrt(), normalised / n);
        assert!(rms < 0.5, "acceleration error {rms} rad/s^2 of a 16 rad/s^2 swing");
        assert!((0.3..1.5).contains(&nees), "normalised error {nees}");
    }

    #[test]
    fn a_held_joint_has_next_to_no_acceleration() {
        let (sigma, mut noise) = (20e-6, Noise(9));
        let mut filter = MotionFilter::new(sigma);
        for k in 0..1000i64 {
            filter.measure(exactly(k * 8_000_000), 0.0, 1.0 + sigma * noise.next());
        }
        let m = filter.motion(exactly(999 * 8_000_000)).unwrap();
        assert!(m.acceleration_rad_s2.abs() < 0.02 && m.covariance[(2, 2)].sqrt() < 0.02, "{m:?}");
    }

    #[test]
    fn starts_anew_after_silence_and_when_the_clock_is_set_back() {
        let mut filter = MotionFilter::new(1e-5);
        assert!(filter.motion(exactly(0)).is_none());
        let settle = |filter: &mut MotionFilter, from_ns: i64, at_rad: f64| {
            for k in 0..i64::from(NEEDED) {
                let now = from_ns + k * 8_000_000;
                assert!(filter.motion(exactly(now)).is_none(), "too few readings");
                filter.measure(exactly(now), 0.0, at_rad);
                filter.measure(exactly(now - 4_000_000), 0.0, 5.0); // older than the last: ignored
            }
            let now = from_ns + i64::from(NEEDED - 1) * 8_000_000;
            assert!((filter.motion(exactly(now)).unwrap().position_rad - at_rad).abs() < 1e-4);
        };
        settle(&mut filter, 0, 1.0);
        // The first reading after silence starts anew; that it came is not known before it is measured.
        filter.measure(exactly(2_000_000_000), 0.0, -3.0);
        filter.measure(exactly(-9_000_000_000), 0.0, 2.0);
        assert!(filter.motion(exactly(-9_000_000_000)).is_none());
        for k in 1..i64::from(NEEDED) {
            filter.measure(exactly(-9_000_000_000 + k * 8_000_000), 0.0, 2.0);
        }
        assert!((filter.motion(exactly(-8_968_000_000)).unwrap().position_rad - 2.0).abs() < 1e-4);
    }

    #[test]
    fn uncertainty_grows_while_nothing_comes() {
        let mut filter = MotionFilter::new(1e-5);
        for k in 0..100i64 {
            filter.measure(exactly(k * 1_000_000), 0.0, 0.5);
        }
        let now = filter.motion(exactly(99_000_000)).unwrap().covariance[(0, 0)];
        let later = filter.motion(exactly(119_000_000)).unwrap().covariance[(0, 0)];
        assert!(later > now);
    }
}
