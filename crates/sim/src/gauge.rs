//! Noise of a gauge and of an encoder, sample by sample.

use rand::rngs::StdRng;
use rand_distr::{Distribution, StandardNormal};

use crate::truth::GaugeNoise;

/// One gauge's noise: white, and a part that is correlated in time (first-order autoregressive).
#[derive(Clone, Debug)]
pub(crate) struct NoiseState {
    white_counts: f64,
    slow_counts: f64,
    decay: f64,
    slow: f64,
}

impl NoiseState {
    /// Noise sampled every `step_s`, its slow part somewhere in its stationary distribution.
    pub(crate) fn new(noise: &GaugeNoise, step_s: f64, rng: &mut StdRng) -> Self {
        let share = noise.slow_share.clamp(0.0, 1.0);
        let decay = if noise.slow_time_s > 0.0 { (-step_s / noise.slow_time_s).exp() } else { 0.0 };
        Self {
            white_counts: noise.sigma_counts * (1.0 - share).sqrt(),
            slow_counts: noise.sigma_counts * share.sqrt(),
            decay,
            slow: normal(rng),
        }
    }

    /// The next sample's noise, counts.
    pub(crate) fn next(&mut self, rng: &mut StdRng) -> f64 {
        let now = self.slow * self.slow_counts + normal(rng) * self.white_counts;
        self.slow = self.decay * self.slow + (1.0 - self.decay * self.decay).sqrt() * normal(rng);
        now
    }
}

/// A standard normal number.
pub(crate) fn normal(rng: &mut StdRng) -> f64 {
    StandardNormal.sample(rng)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::{Purpose, stream};

    #[test]
    fn variance_and_correlation_are_as_asked() {
        let noise = GaugeNoise { sigma_counts: 600.0, slow_share: 0.15, slow_time_s: 0.2 };
        let mut rng = stream(1, Purpose::GaugeNoise);
        let mut state = NoiseState::new(&noise, 0.008, &mut rng);
        let samples: Vec<f64> = (0..400_000).map(|_| state.next(&mut rng)).collect();
        let covariance = |lag: usize| {
            samples.iter().zip(&samples[lag..]).map(|(a, b)| a * b).sum::<f64>()
                / (samples.len() - lag) as f64
        };
        let variance = covariance(0);
        assert!((variance.sqrt() / 600.0 - 1.0).abs() < 0.01, "{variance}");
        for (lag, expected) in [(1, 0.15 * (-0.04f64).exp()), (25, 0.15 * (-1.0f64).exp())] {
            let share = covariance(lag) / variance;
            assert!((share - expected).abs() < 0.015, "lag {lag}: {share} for {expected}");
        }
    }
}
