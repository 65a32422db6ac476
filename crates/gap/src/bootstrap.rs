//! Intervals from drawing blocks again and again.
//!
//! The paired block bootstrap: a difference between two models is taken block by block, so that what both miss alike
//! cancels, and blocks are drawn with replacement (B. Efron, R. Tibshirani, An Introduction to the Bootstrap, 1993, ch. 8).

/// How often blocks are drawn.
const DRAWS: usize = 600;

/// Numbers of times that each block was drawn, the same draws for all questions.
pub(crate) struct Bootstrap {
    draws: Vec<Vec<u16>>,
}

impl Bootstrap {
    /// Draws for so many blocks.
    pub(crate) fn new(blocks: usize) -> Self {
        let mut state: u64 = 0x5EED_0F0B_10C5;
        let draw = |_| {
            let mut counts = vec![0; blocks];
            for _ in 0..blocks {
                counts[(next(&mut state) % blocks.max(1) as u64) as usize] += 1;
            }
            counts
        };
        Self { draws: (0..DRAWS).map(draw).collect() }
    }

    /// How often every block was drawn, draw by draw.
    pub(crate) fn draws(&self) -> &[Vec<u16>] {
        &self.draws
    }

    /// A statistic of weighted sums, for every draw, in ascending order; draws without a value are left out.
    pub(crate) fn distribution(&self, mut statistic: impl FnMut(&[u16]) -> Option<f64>) -> Vec<f64> {
        let mut values: Vec<f64> = self.draws.iter().filter_map(|counts| statistic(counts)).collect();
        values.sort_by(f64::total_cmp);
        values
    }

    /// The value below which this share of the drawn sums lies.
    pub(crate) fn quantile_of_sum(&self, values: &[f64], share: f64) -> f64 {
        let sums = self.distribution(|counts| Some(weighted(counts, values)));
        quantile(&sums, share)
    }
}

/// Sum of values, each as often as it was drawn.
pub(crate) fn weighted(counts: &[u16], values: &[f64]) -> f64 {
    counts.iter().zip(values).map(|(count, value)| f64::from(*count) * value).sum()
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
