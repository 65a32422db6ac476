//! The causal filter of one joint, for the cycle: bounded work, no allocation.

use super::kalman::{State, UNIT_S, inner_density, mixture, transition, unit_process};
use super::{DWELL_S, JointMotion, SNAP_DENSITIES};

const MODELS: usize = SNAP_DENSITIES.len();

/// After a longer silence than this the motion starts anew from the next position, ns.
const FORGET_NS: i64 = 500_000_000;

/// Motion of one joint from its position readings so far: a bank of Kalman filters mixed by how well each predicts.
#[derive(Clone, Debug)]
pub struct MotionFilter {
    states: [State; MODELS],
    weights: [f64; MODELS],
    encoder_variance_rad2: f64,
    at_ns: Option<i64>,
}

impl MotionFilter {
    /// For an encoder whose single reading has this standard deviation (noise and rounding), rad.
    pub fn new(encoder_sigma_rad: f64) -> Self {
        let variance = encoder_sigma_rad * encoder_sigma_rad;
        Self {
            states: [State::from_position(0.0, variance); MODELS],
            weights: [1.0 / MODELS as f64; MODELS],
            encoder_variance_rad2: variance,
            at_ns: None,
        }
    }

    /// Takes in a position sampled at `at_ns`; one that is not newer than the last is ignored.
    pub fn measure(&mut self, at_ns: i64, position_rad: f64) {
        match self.at_ns {
            Some(last) if at_ns <= last && last - at_ns < FORGET_NS => return,
            Some(last) if at_ns > last && at_ns - last < FORGET_NS => self.advance(at_ns - last),
            // The first reading, a long silence, or a clock that was set back: start anew.
            _ => self.restart(position_rad),
        }
        self.at_ns = Some(at_ns);
        let mut fit = [0.0; MODELS];
        for (state, fit) in self.states.iter_mut().zip(&mut fit) {
            *fit = state.measure(0, position_rad, self.encoder_variance_rad2);
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

    /// Motion at `at_ns`, carried on from the last reading; `None` before the first one.
    pub fn motion(&self, at_ns: i64) -> Option<JointMotion> {
        let last = self.at_ns?;
        let state = mixture(&self.states, &self.weights);
        if at_ns <= last {
            return Some(state.motion());
        }
        let step = (at_ns - last) as f64 * 1e-9 / UNIT_S;
        let density: f64 = self.weights.iter().zip(&SNAP_DENSITIES).map(|(w, s)| w * s).sum();
        let process = unit_process(step) * inner_density(density);
        Some(state.predicted(&transition(step), &process).motion())
    }

    fn restart(&mut self, position_rad: f64) {
        self.states = [State::from_position(position_rad, self.encoder_variance_rad2); MODELS];
        self.weights = [1.0 / MODELS as f64; MODELS];
    }

    /// Mixes the filters by the chance that the strength of snap changed, then predicts each over `step_ns`.
    fn advance(&mut self, step_ns: i64) {
        let step_s = step_ns as f64 * 1e-9;
        let leave = 1.0 - (-step_s / DWELL_S).exp();
        // chance[i][k]: from strength i to its neighbour k, or staying.
        let chance = |i: usize, k: usize| -> f64 {
            let neighbours = if i == 0 || i == MODELS - 1 { 1.0 } else { 2.0 };
            match i.abs_diff(k) {
                0 => 1.0 - leave,
                1 => leave / neighbours,
                _ => 0.0,
            }
        };
        let transition = transition(step_s / UNIT_S);
        let process = unit_process(step_s / UNIT_S);
        let before = self.states;
        let mut expected = [0.0; MODELS];
        for k in 0..MODELS {
            let mut share = [0.0; MODELS];
            for i in 0..MODELS {
                share[i] = self.weights[i] * chance(i, k);
                expected[k] += share[i];
            }
            share.iter_mut().for_each(|w| *w /= expected[k]);
            self.states[k] = mixture(&before, &share)
                .predicted(&transition, &(process * inner_density(SNAP_DENSITIES[k])));
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

    #[test]
    fn follows_a_swing_with_honest_uncertainty() {
        let (sigma, mut noise) = (20e-6, Noise(5));
        let mut filter = MotionFilter::new(sigma);
        let (mut error2, mut normalised, mut n) = (0.0, 0.0, 0.0);
        for k in 0..4000i64 {
            let (t, w) = (k as f64 * 0.008, 9.0);
            filter.measure(k * 8_000_000, 0.2 * (w * t).sin() + sigma * noise.next());
            if k > 200 {
                let m = filter.motion(k * 8_000_000).unwrap();
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
            filter.measure(k * 8_000_000, 1.0 + sigma * noise.next());
        }
        let m = filter.motion(999 * 8_000_000).unwrap();
        assert!(m.acceleration_rad_s2.abs() < 0.15 && m.covariance[(2, 2)].sqrt() < 0.1, "{m:?}");
    }

    #[test]
    fn starts_anew_after_silence_and_when_the_clock_is_set_back() {
        let mut filter = MotionFilter::new(1e-5);
        assert!(filter.motion(0).is_none());
        filter.measure(0, 1.0);
        filter.measure(8_000_000, 1.01);
        filter.measure(4_000_000, 5.0);
        assert!((filter.motion(8_000_000).unwrap().position_rad - 1.01).abs() < 1e-4, "older reading ignored");
        filter.measure(2_000_000_000, -3.0);
        assert!((filter.motion(2_000_000_000).unwrap().position_rad + 3.0).abs() < 1e-9);
        filter.measure(-9_000_000_000, 2.0);
        assert!((filter.motion(-9_000_000_000).unwrap().position_rad - 2.0).abs() < 1e-9);
    }

    #[test]
    fn uncertainty_grows_while_nothing_comes() {
        let mut filter = MotionFilter::new(1e-5);
        for k in 0..100i64 {
            filter.measure(k * 1_000_000, 0.5);
        }
        let now = filter.motion(99_000_000).unwrap().covariance[(0, 0)];
        let later = filter.motion(119_000_000).unwrap().covariance[(0, 0)];
        assert!(later > now);
    }
}
