//! Noise of a gauge that holds still: a white part and a slow part, and rows whitened by it.
//!
//! `e = w + s`: `w` white with variance `white`, `s` a first-order Markov process with variance `slow` and correlation
//! time `tau`. Counting correlated samples as independent would make every uncertainty too small.

/// Noise of one gauge: white part, slow part and the slow part's correlation time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseModel {
    /// Variance of the part that is independent from reading to reading, counts^2.
    pub white_counts2: f64,
    /// Variance of the part that is correlated in time, counts^2.
    pub slow_counts2: f64,
    /// Correlation time of the slow part, s.
    pub tau_s: f64,
}

impl NoiseModel {
    /// White noise of a variance, counts^2.
    pub fn white(variance_counts2: f64) -> Self {
        Self { white_counts2: variance_counts2, slow_counts2: 0.0, tau_s: 0.2 }
    }

    /// Standard deviation of one reading, counts.
    pub fn sigma_counts(&self) -> f64 {
        (self.white_counts2 + self.slow_counts2).sqrt()
    }

    /// The noise under which pieces of residuals are most likely, by maximum likelihood over the share and
    /// the correlation time of the slow part; the total variance follows from each pair.
    ///
    /// A piece is `(times in s, residuals in counts)`, in order of time; pieces are independent of each other.
    pub fn fit(pieces: &[(&[f64], &[f64])]) -> Option<Self> {
        let n: usize = pieces.iter().map(|(t, _)| t.len()).sum();
        if n < 8 {
            return None;
        }
        let score = |share: f64, tau_s: f64| -> (f64, f64) {
            let unit = Self { white_counts2: 1.0 - share, slow_counts2: share, tau_s };
            let (mut squares, mut log) = (0.0, 0.0);
            for (times, residuals) in pieces {
                let mut whitener = Whitener::<1>::new(&unit);
                for (t, e) in times.iter().zip(*residuals) {
                    let step = whitener.step(*t, 0.0);
                    let [white] = whitener.apply(&step, &[*e]);
                    squares += white * white;
                    log += step.variance.ln();
                }
            }
            let variance = squares / n as f64;
            (n as f64 * variance.ln() + log, variance)
        };
        // Anything that lives shorter than two readings is white noise to these readings.
        let (share, tau_s) = minimise(2.0 * typical_interval_s(pieces), |share, tau| score(share, tau).0);
        let variance = score(share, tau_s).1;
        (variance.is_finite() && variance > 0.0).then_some(Self {
            white_counts2: variance * (1.0 - share),
            slow_counts2: variance * share,
            tau_s,
        })
    }
}

/// Mean time between readings within the pieces, s.
fn typical_interval_s(pieces: &[(&[f64], &[f64])]) -> f64 {
    let (mut span, mut steps) = (0.0, 0.0);
    for (times, _) in pieces {
        if let (Some(first), Some(last)) = (times.first(), times.last()) {
            span += last - first;
            steps += times.len() as f64 - 1.0;
        }
    }
    if steps > 0.0 { span / steps } else { 0.0 }
}

/// Coarse grid over share and correlation time (from `shortest_s` up) of the slow part, then a shrinking pattern
/// search around its best.
fn minimise(shortest_s: f64, cost: impl Fn(f64, f64) -> f64) -> (f64, f64) {
    // The share through its logit and the time through its logarithm: both are free there.
    let floor = shortest_s.max(1e-6).ln();
    let value = |p: [f64; 2]| cost(1.0 / (1.0 + (-p[0]).exp()), p[1].exp());
    let inside = |p: [f64; 2]| (-9.0..=6.0).contains(&p[0]) && (floor..=4.5).contains(&p[1]);
    let mut best = ([-9.0, floor], f64::INFINITY);
    for share in [-9.0, -4.0, -2.5, -1.5, -0.5, 1.0, 3.0] {
        for tau in [floor, floor + 1.2, floor + 2.4, floor + 3.6, floor + 4.8, floor + 6.0] {
            let v = value([share, tau]);
            if v < best.1 {
                best = ([share, tau], v);
            }
        }
    }
    let mut step = 0.6;
    while step > 0.03 {
        let around = [[step, 0.0], [-step, 0.0], [0.0, step], [0.0, -step]];
        let next = around
            .iter()
            .map(|d| [best.0[0] + d[0], best.0[1] + d[1]])
            .filter(|p| inside(*p))
            .map(|p| (p, value(p)))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        match next {
            Some(found) if found.1 < best.1 => best = found,
            _ => step *= 0.5,
        }
    }
    (1.0 / (1.0 + (-best.0[0]).exp()), best.0[1].exp())
}

/// Turns rows `[regressors, reading]` with a gauge's noise into rows whose noise is white with variance one.
///
/// It is the innovation form of the Kalman filter of the slow part, applied to every column alike; times may be irregular.
#[derive(Clone, Copy, Debug)]
pub struct Whitener<const N: usize> {
    noise: NoiseModel,
    predicted: [f64; N],
    variance: f64,
    last_s: Option<f64>,
}

/// What the whitener does to one row; the same for every column.
#[derive(Clone, Copy, Debug)]
pub struct WhiteningStep {
    carry: f64,
    gain: f64,
    /// Variance of the reading given those before it, counts^2.
    pub variance: f64,
}

impl<const N: usize> Whitener<N> {
    /// At the beginning of a piece.
    pub fn new(noise: &NoiseModel) -> Self {
        Self { noise: *noise, predicted: [0.0; N], variance: noise.slow_counts2, last_s: None }
    }

    /// Advances to `t_s`, for a reading with `extra_counts2` of white noise beyond the gauge's own.
    pub fn step(&mut self, t_s: f64, extra_counts2: f64) -> WhiteningStep {
        let carry = self.last_s.map_or(0.0, |last| (-(t_s - last).max(0.0) / self.noise.tau_s).exp());
        self.last_s = Some(t_s);
        let prior = carry * carry * self.variance + self.noise.slow_counts2 * (1.0 - carry * carry);
        let variance = prior + self.noise.white_counts2 + extra_counts2;
        let gain = prior / variance;
        self.variance = prior - gain * prior;
        WhiteningStep { carry, gain, variance }
    }

    /// Whitens one row with the step of its time.
    pub fn apply(&mut self, step: &WhiteningStep, row: &[f64; N]) -> [f64; N] {
        let scale = 1.0 / step.variance.sqrt();
        let mut white = [0.0; N];
        for k in 0..N {
            let expected = step.carry * self.predicted[k];
            let innovation = row[k] - expected;
            white[k] = innovation * scale;
            self.predicted[k] = expected + step.gain * innovation;
        }
        white
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector};
    use rand::{SeedableRng, rngs::StdRng};
    use rand_distr::{Distribution, StandardNormal};

    fn recording(seed: u64, n: usize, noise: &NoiseModel, dt: f64) -> (Vec<f64>, Vec<f64>) {
        let mut rng = StdRng::seed_from_u64(seed);
        let mut normal = || -> f64 { StandardNormal.sample(&mut rng) };
        let carry = (-dt / noise.tau_s).exp();
        let mut slow = normal() * noise.slow_counts2.sqrt();
        (0..n)
            .map(|k| {
                let reading = slow + normal() * noise.white_counts2.sqrt();
                slow = carry * slow + normal() * (noise.slow_counts2 * (1.0 - carry * carry)).sqrt();
                (k as f64 * dt, reading)
            })
            .unzip()
    }

    #[test]
    fn whitening_equals_the_dense_generalised_least_squares() {
        let noise = NoiseModel { white_counts2: 4.0, slow_counts2: 9.0, tau_s: 0.05 };
        let times: [f64; 6] = [0.0, 0.01, 0.03, 0.035, 0.1, 0.4];
        let column = [1.0, -2.0, 0.5, 3.0, 1.0, 2.0];
        let v = DMatrix::from_fn(6, 6, |i, k| {
            let slow = 9.0 * (-(times[i] - times[k]).abs() / 0.05).exp();
            slow + if i == k { 4.0 } else { 0.0 }
        });
        let x = DVector::from_column_slice(&column);
        let dense = (x.transpose() * v.try_inverse().unwrap() * &x)[(0, 0)];
        let mut whitener = Whitener::<1>::new(&noise);
        let mut sum = 0.0;
        for k in 0..6 {
            let step = whitener.step(times[k], 0.0);
            sum += whitener.apply(&step, &[column[k]])[0].powi(2);
        }
        assert!((sum - dense).abs() < 1e-12 * dense, "{sum} {dense}");
    }

    #[test]
    fn finds_white_and_slow_noise_again() {
        let truth =
            NoiseModel { white_counts2: 0.85 * 490_000.0, slow_counts2: 0.15 * 490_000.0, tau_s: 0.2 };
        let recordings: Vec<_> = (0..100).map(|k| recording(k, 150, &truth, 0.02)).collect();
        let pieces: Vec<(&[f64], &[f64])> = recordings.iter().map(|(t, e)| (&t[..], &e[..])).collect();
        let found = NoiseModel::fit(&pieces).unwrap();
        assert!((found.sigma_counts() / 700.0 - 1.0).abs() < 0.03, "{found:?}");
        assert!((found.slow_counts2 / truth.slow_counts2 - 1.0).abs() < 0.2, "{found:?}");
        assert!((found.tau_s / 0.2 - 1.0).abs() < 0.3, "{found:?}");
    }

    #[test]
    fn white_noise_is_found_white_and_silence_is_no_noise() {
        let truth = NoiseModel::white(100.0);
        let (t, e) = recording(3, 5000, &truth, 0.01);
        let found = NoiseModel::fit(&[(&t, &e)]).unwrap();
        assert!(found.slow_counts2 < 4.0, "{found:?}");
        assert_eq!(NoiseModel::fit(&[(&t, &vec![0.0; 5000])]), None);
        assert_eq!(NoiseModel::fit(&[]), None);
    }
}
