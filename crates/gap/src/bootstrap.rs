//! Intervals from drawing blocks again and again.
//!
//! The paired block bootstrap: a difference between two models is taken block by block, so that what both miss alike
//! cancels (B. Efron, R. Tibshirani, An Introduction to the Bootstrap, 1993, ch. 8). Blocks are not drawn with replacement but
//! weighed at random (D. Rubin, The Bayesian Bootstrap, Annals of Statistics 9, 1981): what only few blocks show, an event or a limit
//! that is reached, is then in every draw.

/// How often blocks are weighed.
const DRAWS: usize = 600;

/// Weights of the blocks, on average one, the same draws for all questions.
pub(crate) struct Bootstrap {
    draws: Vec<Vec<f64>>,
}

impl Bootstrap {
    /// Draws for so many blocks.
    pub(crate) fn new(blocks: usize) -> Self {
        let mut state: u64 = 0x5EED_0F0B_10C5;
        let draw = |_| {
            // Spacings of uniform variates: exponential ones over their sum.
            let weights: Vec<f64> = (0..blocks).map(|_| exponential(&mut state)).collect();
            let mean = weights.iter().sum::<f64>() / blocks.max(1) as f64;
            weights.into_iter().map(|weight| weight / mean).collect()
        };
        Self { draws: (0..DRAWS).map(draw).collect() }
    }

    /// What every block weighs, draw by draw.
    pub(crate) fn draws(&self) -> &[Vec<f64>] {
        &self.draws
    }

    /// A statistic of weighted sums, for every draw, in ascending order; draws without a value are left out.
    pub(crate) fn distribution(&self, mut statistic: impl FnMut(&[f64]) -> Option<f64>) -> Vec<f64> {
        let mut values: Vec<f64> = self.draws.iter().filter_map(|weights| statistic(weights)).collect();
        values.sort_by(f64::total_cmp);
        values
    }

    /// The value below which this share of the drawn sums lies.
    pub(crate) fn quantile_of_sum(&self, values: &[f64], share: f64) -> f64 {
        let sums = self.distribution(|weights| Some(weighted(weights, values)));
        quantile(&sums, share)
    }
}

/// Sum of values, each as often as it weighs.
pub(crate) fn weighted(weights: &[f64], values: &[f64]) -> f64 {
    weights.iter().zip(values).map(|(weight, value)| weight * value).sum()
}

/// Interpolated quantile of ascending values; 0 of none.
pub(crate) fn quantile(sorted: &[f64], share: f64) -> f64 {
    let at = share * sorted.len().saturating_sub(1) as f64;
    let (low, part) = (at.floor() as usize, at.fract());
    match (sorted.get(low), sorted.get(low + 1)) {
        (Some(a), Some(b)) => a + part * (b - a),
        (Some(a), None) => *a,
        _ => 0.0,
    }
}

/// A standard exponential variate.
fn exponential(state: &mut u64) -> f64 {
    // 53 bits, never 0.
    let uniform = ((next(state) >> 11) as f64 + 0.5) / (1_u64 << 53) as f64;
    -uniform.ln()
}

/// SplitMix64.
fn next(state: &mut u64) -> u64 {
    *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *state;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spread_of_a_sum_is_that_of_its_blocks() {
        let values: Vec<f64> = (0..100).map(|k| f64::from(k % 10)).collect();
        let bootstrap = Bootstrap::new(values.len());
        let middle = bootstrap.quantile_of_sum(&values, 0.5);
        let width = bootstrap.quantile_of_sum(&values, 0.975) - bootstrap.quantile_of_sum(&values, 0.025);
        // Sum 450; standard deviation of 0..9 is 2.872, times sqrt(100), times 2 * 1.96.
        assert!((middle - 450.0).abs() < 5.0, "{middle}");
        assert!((width - 112.6).abs() < 12.0, "{width}");
    }
}
