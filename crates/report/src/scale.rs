//! A linear axis: what it spans, where its marks stand, and what they are called.

/// One axis on the drawing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scale {
    low: f64,
    high: f64,
    /// Where `low` and `high` are drawn, px.
    from: f64,
    to: f64,
    step: f64,
}

impl Scale {
    /// An axis over these values, with a little room and some `marks` marks at round numbers.
    pub(crate) fn new((low, high): (f64, f64), marks: usize) -> Self {
        let (mut low, mut high) = if low.is_finite() && high.is_finite() { (low, high) } else { (0.0, 1.0) };
        if high - low <= 1e-12 * low.abs().max(high.abs()) || high <= low {
            // One value only: some room about it.
            let room = if low == 0.0 { 1.0 } else { 0.1 * low.abs() };
            (low, high) = (low - room, high + room);
        }
        let step = round_step((high - low) / marks.max(1) as f64);
        Self { low, high, from: 0.0, to: 1.0, step }
    }

    /// The same with both ends at marks.
    pub(crate) fn widened(mut self) -> Self {
        self.low = (self.low / self.step - 1e-9).floor() * self.step;
        self.high = (self.high / self.step + 1e-9).ceil() * self.step;
        self
    }

    /// The same, drawn between these places, px.
    pub(crate) fn onto(mut self, from: f64, to: f64) -> Self {
        (self.from, self.to) = (from, to);
        self
    }

    /// Where a value is drawn, px.
    pub(crate) fn at(&self, value: f64) -> f64 {
        self.from + (value - self.low) / (self.high - self.low) * (self.to - self.from)
    }

    /// Where the axis begins, px.
    pub(crate) fn at_low(&self) -> f64 {
        self.from
    }

    /// The values of the marks.
    pub(crate) fn marks(&self) -> Vec<f64> {
        let first = (self.low / self.step - 1e-6).ceil() as i64;
        let last = (self.high / self.step + 1e-6).floor() as i64;
        (first..=last).map(|k| k as f64 * self.step).collect()
    }

    /// What a mark is called: as many decimals as the step needs.
    pub(crate) fn name(&self, mark: f64) -> String {
        let largest = self.low.abs().max(self.high.abs());
        if !(1e-4..1e6).contains(&largest) {
            let text = if mark == 0.0 { "0".into() } else { format!("{mark:.1e}") };
            return text.replace('-', "\u{2212}");
        }
        let decimals = (-self.step.log10().floor()).max(0.0) as usize;
        format!("{mark:.decimals$}").replace('-', "\u{2212}")
    }

    /// The longest name of a mark, in characters.
    pub(crate) fn longest_name(&self) -> String {
        let names = self.marks().into_iter().map(|mark| self.name(mark));
        names.max_by_key(|name| name.chars().count()).unwrap_or_default()
    }
}

/// The nearest of 1, 2, 5 times a power of ten at or above a rough step.
fn round_step(rough: f64) -> f64 {
    let power = 10f64.powf(rough.log10().floor());
    let lead = rough / power;
    let round = [1.0, 2.0, 5.0].into_iter().find(|r| lead <= r * (1.0 + 1e-9)).unwrap_or(10.0);
    round * power
}

/// Lowest and highest of finite values.
pub(crate) fn extent(values: impl IntoIterator<Item = f64>) -> (f64, f64) {
    let all = (f64::INFINITY, f64::NEG_INFINITY);
    values
        .into_iter()
        .filter(|v| v.is_finite())
        .fold(all, |(low, high), value| (low.min(value), high.max(value)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn marks_are_few_round_and_inside(low in -1e5..1e5f64, width in 1e-3..1e5f64) {
            let scale = Scale::new((low, low + width), 5).widened().onto(10.0, 110.0);
            let marks = scale.marks();
            prop_assert!((2..=8).contains(&marks.len()), "{marks:?}");
            prop_assert!(marks[0] <= low + 1e-9 * width && *marks.last().unwrap() >= low + width * (1.0 - 1e-9));
            for m in marks {
                prop_assert!((10.0 - 1e-6..=110.0 + 1e-6).contains(&scale.at(m)));
            }
        }
    }

    #[test]
    fn one_value_has_room_about_it() {
        let scale = Scale::new(extent([3.0, f64::NAN, 3.0]), 4);
        assert!(scale.at(3.0) == 0.5 && scale.marks().len() >= 2);
        assert_eq!(Scale::new(extent([]), 4).at(0.5), 0.5);
        assert_eq!(Scale::new((0.0, 0.1), 5).name(0.04), "0.04");
    }
}
