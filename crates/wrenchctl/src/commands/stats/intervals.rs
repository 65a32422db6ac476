//! Intervals between frames: mean, extremes, spread and a high percentile, in bounded memory.

/// Relative width of a class of the histogram.
const CLASS: f64 = 0.002;

/// Shortest and longest interval that have a class of their own, s.
const SHORTEST_S: f64 = 1e-6;
const LONGEST_S: f64 = 1e4;

/// Intervals so far.
#[derive(Clone, Debug, Default)]
pub(super) struct Intervals {
    count: u64,
    mean_s: f64,
    /// Sum of squares about the mean, s^2
    squares_s2: f64,
    min_s: f64,
    max_s: f64,
    classes: Vec<u32>,
}

impl Intervals {
    /// Takes in one interval, s.
    pub(super) fn add(&mut self, interval_s: f64) {
        self.count += 1;
        if self.count == 1 {
            (self.min_s, self.max_s) = (interval_s, interval_s);
        }
        self.min_s = self.min_s.min(interval_s);
        self.max_s = self.max_s.max(interval_s);
        let step_s = interval_s - self.mean_s;
        self.mean_s += step_s / self.count as f64;
        self.squares_s2 += step_s * (interval_s - self.mean_s);
        let class = class_of(interval_s);
        if class >= self.classes.len() {
            self.classes.resize(class + 1, 0);
        }
        self.classes[class] = self.classes[class].saturating_add(1);
    }

    /// Number of intervals.
    pub(super) fn count(&self) -> u64 {
        self.count
    }

    /// Mean, s.
    pub(super) fn mean_s(&self) -> f64 {
        self.mean_s
    }

    /// Shortest and longest, s.
    pub(super) fn extremes_s(&self) -> (f64, f64) {
        (self.min_s, self.max_s)
    }

    /// Standard deviation, s.
    pub(super) fn std_s(&self) -> f64 {
        if self.count < 2 { 0.0 } else { (self.squares_s2 / (self.count - 1) as f64).sqrt() }
    }

    /// What 99 of 100 intervals do not exceed, s, to 0.1 %.
    pub(super) fn p99_s(&self) -> f64 {
        let rank = (self.count as f64 * 0.99).ceil() as u64;
        let mut below = 0;
        for (class, &count) in self.classes.iter().enumerate() {
            below += u64::from(count);
            if below >= rank {
                let middle_s = SHORTEST_S * ((class as f64 + 0.5) * CLASS).exp();
                return middle_s.clamp(self.min_s, self.max_s);
            }
        }
        self.max_s
    }
}

fn class_of(interval_s: f64) -> usize {
    ((interval_s.clamp(SHORTEST_S, LONGEST_S) / SHORTEST_S).ln() / CLASS) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_of_known_intervals() {
        let mut intervals = Intervals::default();
        for k in 0..1000 {
            intervals.add(if k % 50 == 0 { 5e-3 } else { 1e-3 + 1e-6 * f64::from(k % 10) });
        }
        assert_eq!((intervals.count(), intervals.extremes_s()), (1000, (1e-3, 5e-3)));
        assert!((intervals.p99_s() / 5e-3 - 1.0).abs() < 1.1e-3, "one in fifty is long");
        let mean_s = intervals.mean_s();
        assert!((mean_s - 1.0844e-3).abs() < 1e-6, "{mean_s}");
        assert!((intervals.std_s() - 5.6e-4).abs() < 1e-5, "{}", intervals.std_s());
    }

    #[test]
    fn a_percentile_is_never_outside_the_extremes() {
        let mut intervals = Intervals::default();
        for interval_s in [1e-9, 0.0, 1e7] {
            intervals.add(interval_s);
            let (min_s, max_s) = intervals.extremes_s();
            assert!((min_s..=max_s).contains(&intervals.p99_s()));
        }
        assert!(intervals.classes.len() < 12_000, "memory is bounded");
    }
}
