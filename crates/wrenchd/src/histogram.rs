//! Durations sorted into fixed classes, always on: written by the cycle alone, read by anybody.

use std::sync::atomic::{AtomicU64, Ordering};

/// Upper ends of the classes, ns: 10 us to 1 s, three to a decade; what is longer is counted beside them.
pub const BOUNDS_NS: [i64; 16] = [
    10_000,
    20_000,
    50_000,
    100_000,
    200_000,
    500_000,
    1_000_000,
    2_000_000,
    5_000_000,
    10_000_000,
    20_000_000,
    50_000_000,
    100_000_000,
    200_000_000,
    500_000_000,
    1_000_000_000,
];

const CLASSES: usize = BOUNDS_NS.len() + 1;

/// A histogram of durations.
#[derive(Debug)]
pub struct Histogram {
    classes: [AtomicU64; CLASSES],
    sum_ns: AtomicU64,
}

/// What a histogram held at one moment.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Distribution {
    /// Durations in each class, and beyond the last one.
    pub classes: [u64; CLASSES],
    /// Their sum, ns.
    pub sum_ns: u64,
}

impl Default for Histogram {
    fn default() -> Self {
        Self { classes: [const { AtomicU64::new(0) }; CLASSES], sum_ns: AtomicU64::new(0) }
    }
}

impl Histogram {
    /// Counts a duration, ns; a negative one (the clock was set back) counts as none. For one writer.
    pub(crate) fn note(&self, duration_ns: i64) {
        let class = BOUNDS_NS.iter().position(|bound| duration_ns <= *bound).unwrap_or(CLASSES - 1);
        let add = |place: &AtomicU64, more: u64| {
            place.store(place.load(Ordering::Relaxed).wrapping_add(more), Ordering::Relaxed);
        };
        add(&self.classes[class], 1);
        add(&self.sum_ns, u64::try_from(duration_ns).unwrap_or(0));
    }

    /// What it holds now.
    pub fn read(&self) -> Distribution {
        Distribution {
            classes: std::array::from_fn(|k| self.classes[k].load(Ordering::Relaxed)),
            sum_ns: self.sum_ns.load(Ordering::Relaxed),
        }
    }
}

impl Distribution {
    /// Durations counted.
    pub fn count(&self) -> u64 {
        self.classes.iter().sum()
    }

    /// What was added since `before`.
    #[must_use]
    pub fn since(&self, before: &Self) -> Self {
        Self {
            classes: std::array::from_fn(|k| self.classes[k].saturating_sub(before.classes[k])),
            sum_ns: self.sum_ns.saturating_sub(before.sum_ns),
        }
    }

    /// Upper end of the class that holds this quantile (0 to 1), s; none where it lies beyond the last class or nothing was
    /// counted.
    pub fn quantile_s(&self, quantile: f64) -> Option<f64> {
        let wanted = (quantile * self.count() as f64).ceil().max(1.0) as u64;
        let mut passed = 0;
        let class = self.classes.iter().position(|count| {
            passed += count;
            passed >= wanted
        })?;
        BOUNDS_NS.get(class).map(|bound| *bound as f64 * 1e-9)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_fall_into_their_classes_and_quantiles_bound_them() {
        let histogram = Histogram::default();
        let empty = histogram.read();
        assert_eq!(empty.quantile_s(0.5), None);
        for duration_ns in [-5, 10_000, 10_001, 80_000, 90_000, 2_000_000_000] {
            histogram.note(duration_ns);
        }
        let all = histogram.read();
        assert_eq!((all.count(), all.classes[0], all.classes[1], all.classes[3]), (6, 2, 1, 2));
        assert_eq!(all.sum_ns, 2_000_190_001);
        assert_eq!((all.quantile_s(0.5), all.quantile_s(0.8)), (Some(2e-5), Some(1e-4)));
        assert_eq!(all.quantile_s(1.0), None, "beyond all classes");
        assert_eq!(all.since(&all), empty);
        assert!(BOUNDS_NS.is_sorted());
    }
}
