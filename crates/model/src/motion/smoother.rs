//! Motion from the whole recording: Rauch-Tung-Striebel smoothing, blended over strengths of snap.

use super::kalman::{State, inner_density, inner_step, inner_variance, transition, unit_process};
use super::{JointMotion, Sampled};
use nalgebra::{Cholesky, Matrix4};

/// Spectral densities of the driving snap that are blended, rad^2/s^7: from a held pose to a violent move.
pub(super) const DENSITIES: [f64; 6] = [1.0, 3e1, 1e3, 3e4, 1e6, 1e8];

/// Gaps longer than this cut the recording into pieces smoothed on their own, ns.
const CUT_NS: i64 = 500_000_000;

/// Likelihood is weighed over this time to each side when choosing the strength of snap, s.
pub(super) const WEIGHING_S: f64 = 0.15;

/// Motion of one joint at every reading, without lag.
///
/// `at` (strictly rising) and `positions_rad` are its readings; `encoder_sigma_rad` the standard deviation of one.
/// Each strength of snap of the bank is smoothed by Rauch-Tung-Striebel; at every instant they are blended by
/// their predictive likelihood nearby. Offline: allocates, time linear in the number of readings.
pub fn smooth(at: &[Sampled], positions_rad: &[f64], encoder_sigma_rad: f64) -> Vec<JointMotion> {
    assert_eq!(at.len(), positions_rad.len(), "one position an instant");
    let mut out = Vec::with_capacity(at.len());
    let mut start = 0;
    for end in 1..=at.len() {
        if end == at.len() || at[end].at_ns - at[end - 1].at_ns > CUT_NS {
            smooth_piece(&at[start..end], &positions_rad[start..end], encoder_sigma_rad, &mut out);
            start = end;
        }
    }
    out
}

fn smooth_piece(at: &[Sampled], positions_rad: &[f64], sigma_rad: f64, out: &mut Vec<JointMotion>) {
    let variance = sigma_rad * sigma_rad;
    let passes: Vec<Pass> =
        DENSITIES.iter().map(|s| Pass::run(at, positions_rad, variance, inner_density(*s))).collect();
    let scores: Vec<Vec<f64>> = passes.iter().map(|p| local_mean(at, &p.fit)).collect();
    for k in 0..at.len() {
        let best = scores.iter().map(|s| s[k]).fold(f64::NEG_INFINITY, f64::max);
        let weights: Vec<f64> = scores.iter().map(|s| (s[k] - best).exp()).collect();
        let total: f64 = weights.iter().sum();
        let states = passes.iter().map(|p| &p.states[k]);
        out.push(blend(states.zip(weights.iter().map(|w| w / total))).motion());
    }
}

/// Forward filter and backward smoother for one strength of snap.
struct Pass {
    states: Vec<State>,
    /// Log-likelihood of each reading given those before it.
    fit: Vec<f64>,
}

impl Pass {
    fn run(at: &[Sampled], positions_rad: &[f64], variance: f64, density: f64) -> Self {
        let n = at.len();
        let mut states = Vec::with_capacity(n);
        let mut fit = Vec::with_capacity(n);
        let mut state = State::from_position(positions_rad[0], variance);
        for k in 0..n {
            if k > 0 {
                state = Step::new(&at[k - 1], &at[k], density).forward(&state);
            }
            fit.push(state.measure_position(positions_rad[k], variance, 0.0));
            states.push(state);
        }
        for k in (0..n - 1).rev() {
            states[k] = backward(&states[k], &states[k + 1], &Step::new(&at[k], &at[k + 1], density));
        }
        Self { states, fit }
    }
}

/// What happens to a motion between two readings for one strength of snap.
pub(super) struct Step {
    transition: Matrix4<f64>,
    process: Matrix4<f64>,
    variance: f64,
}

impl Step {
    /// From one sampling to another, driven by snap of this density (inner units).
    pub(super) fn new(from: &Sampled, to: &Sampled, density: f64) -> Self {
        let step = inner_step(from, to);
        Self {
            transition: transition(step),
            process: unit_process(step) * density,
            variance: inner_variance(from, to),
        }
    }

    /// The same to a time that may lie before: then the state is as unsure as that long after.
    pub(super) fn carrying(from: &Sampled, to: &Sampled, density: f64) -> Self {
        let step = inner_step(from, to);
        Self { process: unit_process(step.abs()) * density, ..Self::new(from, to, density) }
    }

    /// The state after the step.
    pub(super) fn forward(&self, state: &State) -> State {
        state.predicted(&self.transition, &self.process).smeared(self.variance)
    }

    /// How much of what is learnt of the state after the step is true of the one before.
    pub(super) fn gain(&self, filtered: &State, predicted: &State) -> Option<Matrix4<f64>> {
        let inverse = Cholesky::new(predicted.covariance)?.inverse();
        Some(filtered.covariance * self.transition.transpose() * inverse)
    }
}

/// Rauch, Tung, Striebel: the filtered state corrected by what came after.
fn backward(filtered: &State, next: &State, step: &Step) -> State {
    let predicted = step.forward(filtered);
    match step.gain(filtered, &predicted) {
        Some(gain) => filtered.in_the_light_of(next, &predicted, &gain),
        None => *filtered,
    }
}

pub(super) fn blend<'a>(parts: impl Iterator<Item = (&'a State, f64)> + Clone) -> State {
    let mut mean = nalgebra::Vector4::zeros();
    for (state, w) in parts.clone() {
        mean += state.mean * w;
    }
    let mut covariance = Matrix4::zeros();
    for (state, w) in parts {
        let apart = state.mean - mean;
        covariance += (state.covariance + apart * apart.transpose()) * w;
    }
    State { mean, covariance }
}

/// Sum of the values within [`WEIGHING_S`] to each side.
fn local_mean(at: &[Sampled], values: &[f64]) -> Vec<f64> {
    let mut cumulated = Vec::with_capacity(values.len() + 1);
    cumulated.push(0.0);
    for v in values {
        cumulated.push(cumulated[cumulated.len() - 1] + v);
    }
    let reach = (WEIGHING_S * 1e9) as i64;
    let (mut from, mut to) = (0, 0);
    at.iter()
        .map(|sampled| {
            let t = sampled.at_ns;
            while at[from].at_ns < t - reach {
                from += 1;
            }
            while to < at.len() && at[to].at_ns <= t + reach {
                to += 1;
            }
            cumulated[to] - cumulated[from]
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn exactly(at_ns: impl IntoIterator<Item = i64>) -> Vec<Sampled> {
        at_ns.into_iter().map(|at_ns| Sampled { at_ns, ..Sampled::default() }).collect()
    }

    #[test]
    fn recovers_the_acceleration_of_a_swing_without_lag() {
        let (w, dt) = (10.0f64, 0.008);
        let at = exactly((0..2000).map(|k| k * 8_000_000));
        let truth = |k: usize| 0.2 * (w * k as f64 * dt).sin();
        // Rounding to 20 urad stands for the encoder's noise.
        let q: Vec<f64> = (0..2000).map(|k| (truth(k) / 2e-5).round() * 2e-5).collect();
        let motion = smooth(&at, &q, 2e-5 / 12f64.sqrt());
        for k in 100..1900 {
            let error = motion[k].acceleration_rad_s2 + w * w * truth(k);
            assert!(error.abs() < 0.25, "{k}: {error}");
        }
    }

    #[test]
    fn pieces_on_both_sides_of_a_gap_do_not_touch() {
        let at = exactly([0, 8_000_000, 16_000_000, 5_000_000_000, 5_008_000_000]);
        let q = [1.0, 1.0, 1.0, -2.0, -2.0];
        let motion = smooth(&at, &q, 1e-5);
        assert_eq!(motion.len(), 5);
        assert!((motion[2].position_rad - 1.0).abs() < 1e-4 && (motion[3].position_rad + 2.0).abs() < 1e-4);
        assert!(smooth(&[], &[], 1e-5).is_empty());
    }
}
