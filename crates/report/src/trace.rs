//! Long series as few points: what a line through every sample would have covered, column by column.

use std::fmt::Write;

use crate::scale::{Scale, extent};

/// Line of a long series, decimated as it comes: each column keeps its first, lowest, highest and last sample, which draw the same
/// picture as all of them where a column is a pixel.
///
/// Source: U. Jugel, Z. Jerzak, G. Hackenbroich, V. Markl, "M4: a visualization-oriented time series data aggregation",
/// Proc. VLDB Endowment 7(10), 2014.
#[derive(Clone, Debug)]
pub struct Trace {
    grid: Grid,
    columns: Vec<Option<Column>>,
    gap: f64,
    last_x: f64,
    broken: bool,
}

/// Area between two long series, decimated to its outermost values.
#[derive(Clone, Debug)]
pub struct Band {
    grid: Grid,
    columns: Vec<Option<(f64, f64)>>,
}

#[derive(Clone, Copy, Debug)]
struct Grid {
    from: f64,
    width: f64,
    last: usize,
}

#[derive(Clone, Copy, Debug)]
struct Column {
    first: (f64, f64),
    low: (f64, f64),
    high: (f64, f64),
    last: (f64, f64),
    /// The line does not come from the column before.
    begins: bool,
}

impl Grid {
    fn new(from: f64, to: f64, columns: usize) -> Self {
        let columns = columns.max(1);
        let width = if to > from { (to - from) / columns as f64 } else { 1.0 };
        Self { from, width, last: columns - 1 }
    }

    fn column(&self, x: f64) -> usize {
        // A negative or too large quotient saturates.
        (((x - self.from) / self.width) as usize).min(self.last)
    }

    fn middle(&self, column: usize) -> f64 {
        self.from + (column as f64 + 0.5) * self.width
    }
}

impl Trace {
    /// For samples between `from` and `to`, in `columns` columns; samples further apart than `gap` are not joined.
    #[must_use]
    pub fn new(from: f64, to: f64, columns: usize, gap: f64) -> Self {
        let grid = Grid::new(from, to, columns);
        Self { grid, columns: vec![None; grid.last + 1], gap, last_x: f64::NEG_INFINITY, broken: true }
    }

    /// A short series as it is: each sample a point of the line.
    #[must_use]
    pub fn of(points: &[(f64, f64)]) -> Self {
        let (from, to) = extent(points.iter().map(|p| p.0));
        let mut trace = Self::new(from, to, (4 * points.len()).clamp(1, 2000), f64::INFINITY);
        points.iter().for_each(|(x, y)| trace.add(*x, *y));
        trace
    }

    /// Adds the next sample (x rises); one that is not finite breaks the line.
    pub fn add(&mut self, x: f64, y: f64) {
        if !(x.is_finite() && y.is_finite()) {
            self.broken = true;
            return;
        }
        let begins = self.broken || x - self.last_x > self.gap;
        (self.last_x, self.broken) = (x, false);
        let p = (x, y);
        let slot = &mut self.columns[self.grid.column(x)];
        match slot {
            None => *slot = Some(Column { first: p, low: p, high: p, last: p, begins }),
            Some(column) => {
                column.last = p;
                if y < column.low.1 {
                    column.low = p;
                }
                if y > column.high.1 {
                    column.high = p;
                }
            }
        }
    }

    pub(crate) fn extent_x(&self) -> (f64, f64) {
        extent(self.columns.iter().flatten().flat_map(|c| [c.first.0, c.last.0]))
    }

    pub(crate) fn extent_y(&self) -> (f64, f64) {
        extent(self.columns.iter().flatten().flat_map(|c| [c.low.1, c.high.1]))
    }

    pub(crate) fn path(&self, x: &Scale, y: &Scale) -> String {
        let mut d = String::new();
        for column in self.columns.iter().flatten() {
            let mut points = [column.first, column.low, column.high, column.last];
            points[1..3].sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut before = None;
            for (k, point) in points.into_iter().enumerate() {
                if before == Some(point) {
                    continue;
                }
                before = Some(point);
                let command = if k == 0 && column.begins { 'M' } else { 'L' };
                let _ = write!(d, "{command}{:.1} {:.1}", x.at(point.0), y.at(point.1));
            }
            if column.begins && column.first == column.last && column.low == column.high {
                // A line of one point is drawn as a dot by its round ends.
                d.push_str("h0");
            }
        }
        d
    }
}

impl Band {
    /// For samples between `from` and `to`, in `columns` columns.
    #[must_use]
    pub fn new(from: f64, to: f64, columns: usize) -> Self {
        let grid = Grid::new(from, to, columns);
        Self { grid, columns: vec![None; grid.last + 1] }
    }

    /// Adds a sample; one that is not finite is left out.
    pub fn add(&mut self, x: f64, low: f64, high: f64) {
        if x.is_finite() && low.is_finite() && high.is_finite() {
            let slot = &mut self.columns[self.grid.column(x)];
            let (a, b) = slot.unwrap_or((low, high));
            *slot = Some((a.min(low), b.max(high)));
        }
    }

    pub(crate) fn extent_y(&self) -> (f64, f64) {
        extent(self.columns.iter().flatten().flat_map(|(a, b)| [*a, *b]))
    }

    pub(crate) fn path(&self, x: &Scale, y: &Scale) -> String {
        let mut d = String::new();
        let indexed: Vec<(usize, (f64, f64))> =
            self.columns.iter().enumerate().filter_map(|(k, c)| Some((k, (*c)?))).collect();
        for run in indexed.chunk_by(|a, b| b.0 == a.0 + 1) {
            let there = run.iter().map(|(k, (_, high))| (*k, *high));
            let back = run.iter().rev().map(|(k, (low, _))| (*k, *low));
            for (i, (k, value)) in there.chain(back).enumerate() {
                let command = if i == 0 { 'M' } else { 'L' };
                let _ = write!(d, "{command}{:.1} {:.1}", x.at(self.grid.middle(k)), y.at(value));
            }
            d.push('Z');
        }
        d
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_spike_is_lost_and_the_path_stays_short() {
        let mut trace = Trace::new(0.0, 1e6, 300, 10.0);
        for k in 0..1_000_000 {
            let spike = if k == 412_345 { 9.0 } else { 0.0 };
            trace.add(f64::from(k), (f64::from(k) * 0.37).sin() + spike);
        }
        let (low, high) = trace.extent_y();
        assert!(low < -0.999 && high > 8.0 && high < 10.0);
        let (x, y) =
            (Scale::new((0.0, 1e6), 5).onto(0.0, 300.0), Scale::new((-1.0, 10.0), 5).onto(100.0, 0.0));
        let path = trace.path(&x, &y);
        assert!(path.len() < 300 * 4 * 14, "{}", path.len());
        assert_eq!(path.matches('M').count(), 1, "one line without a gap");
    }

    #[test]
    fn lines_break_where_samples_are_missing() {
        let mut trace = Trace::new(0.0, 100.0, 100, 1.5);
        for k in (0..40).chain(60..100) {
            trace.add(f64::from(k), if k == 80 { f64::NAN } else { 1.0 });
        }
        let scale = Scale::new((0.0, 100.0), 5).onto(0.0, 100.0);
        assert_eq!(trace.path(&scale, &scale).matches('M').count(), 3);
        let mut band = Band::new(0.0, 100.0, 100);
        (0..30).chain(50..80).for_each(|k| band.add(f64::from(k), -1.0, 1.0));
        assert_eq!(band.path(&scale, &scale).matches('Z').count(), 2);
        assert_eq!(band.extent_y(), (-1.0, 1.0));
    }
}
