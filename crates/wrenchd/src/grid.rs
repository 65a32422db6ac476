//! A fixed grid of deadlines that does not drift, whatever the rate and however late a cycle is.

/// Deadlines at `start + k / rate`; points that passed unserved are skipped and counted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    start_ns: i64,
    rate_hz: f64,
    number: u64,
}

impl Grid {
    /// A grid whose first point is one period after `start_ns`.
    pub fn new(start_ns: i64, rate_hz: f64) -> Self {
        Self { start_ns, rate_hz, number: 1 }
    }

    /// The point that is due next, ns on the clock of `start_ns`.
    pub fn due_ns(&self) -> i64 {
        self.at(self.number)
    }

    /// Moves on to the first point after `now_ns`; how many points before it were skipped without being served.
    ///
    /// Called once the due point is being served, so that one is not counted.
    pub fn advance(&mut self, now_ns: i64) -> u64 {
        let served = self.number;
        let passed = ((now_ns - self.start_ns).max(0) as f64 * 1e-9 * self.rate_hz) as u64;
        self.number = (passed + 1).max(served + 1);
        // Rounding may leave one point at or before now.
        while self.number > served + 1 && self.at(self.number - 1) > now_ns {
            self.number -= 1;
        }
        while self.at(self.number) <= now_ns {
            self.number += 1;
        }
        self.number - served - 1
    }

    fn at(&self, number: u64) -> i64 {
        self.start_ns + (number as f64 * 1e9 / self.rate_hz).round() as i64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn on_time_no_point_is_missed_and_nothing_drifts() {
        let mut grid = Grid::new(1_000, 300.0);
        for k in 1..=30_000u64 {
            let due = grid.due_ns();
            assert_eq!(due, 1_000 + (k as f64 * 1e9 / 300.0).round() as i64);
            assert_eq!(grid.advance(due + 50_000), 0);
        }
        assert_eq!(grid.due_ns() - 1_000, 100_003_333_333);
    }

    #[test]
    fn late_points_are_skipped_and_counted() {
        let mut grid = Grid::new(0, 1000.0);
        assert_eq!(grid.due_ns(), 1_000_000);
        assert_eq!(grid.advance(1_000_000), 0);
        assert_eq!(grid.advance(4_500_000), 2, "3 and 4 ms passed while 2 ms was served");
        assert_eq!(grid.due_ns(), 5_000_000);
        assert_eq!(grid.advance(6_000_000), 1, "a point that is due now is too late for itself");
        assert_eq!(grid.due_ns(), 7_000_000);
        assert_eq!(grid.advance(0), 0, "served early: the next one all the same");
        assert_eq!(grid.due_ns(), 8_000_000);
    }
}
