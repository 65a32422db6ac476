//! Phase and period of rounds that come periodically, from stamps with scatter of which some are very late.

/// A stamp further than this from its round, in standard deviations, says less about the clock.
const CLIP_SIGMA: f64 = 3.0;

/// With so many more rounds late beyond the clip than in time the rhythm is lost.
const LATE_AT_MOST: u32 = 20;

/// No host keeps rounds back for longer, s: then it is the period that is too short, as one found within a burst is.
pub(super) const LATE_BY_AT_MOST_S: f64 = 0.5;

/// A stamp cannot be early but where the phase was wrong; after so many in a row the period is another one.
const EARLY_AT_MOST: u32 = 3;

/// How sure the period still is where the phase was lost, as a share of it.
const PERIOD_SIGMA: f64 = 1e-3;

/// What a quartz wanders: instant and period, per round, as shares of the period.
const WANDER: (f64, f64) = (2e-5, 2e-7);

/// Time between two rounds by the boards' clock.
#[derive(Clone, Copy, Debug)]
pub(super) struct Step {
    pub(super) s: f64,
    pub(super) variance_s2: f64,
    /// Standard deviation of a stamp, s.
    pub(super) scatter_s: f64,
}

/// A Kalman filter over phase and period.
#[derive(Clone, Debug)]
pub(super) struct Rhythm {
    period_s: f64,
    /// The last stamp after its round's instant, s.
    late_s: f64,
    /// Covariance of instant and period, s^2.
    instant2: f64,
    both: f64,
    period2: f64,
    /// Variance of a stamp's lateness, s^2.
    scatter2: f64,
    rounds: u32,
    /// Rounds that were late beyond the clip, less those in time.
    late: u32,
    early_in_a_row: u32,
    /// Cycles that passed without a round, nobody knows whether lost or still to come in a burst.
    owed: u32,
    /// What was kept back during a silence is still coming: each round is less late than the one before.
    catching_up: bool,
}

/// What passed since the round before, in cycles: on the stamps' grid, by the boards, and the doubt about the latter.
struct Passed {
    on_grid: f64,
    cycles: f64,
    doubt: f64,
}

impl Rhythm {
    /// From a first period and the intervals that gave it, s.
    pub(super) fn new(period_s: f64, intervals: &mut [f64]) -> Self {
        /// Less scatter than this share of the period is not believed of so few.
        const LEAST: f64 = 0.02;
        intervals.iter_mut().for_each(|interval| *interval = (*interval - period_s).abs());
        // The median of Gaussian magnitudes is 0.67 sigma; an interval has the scatter of two stamps.
        let scatter_s = median(intervals) / 0.6745 / std::f64::consts::SQRT_2;
        let scatter2 = scatter_s.max(LEAST * period_s).powi(2);
        Self {
            period_s,
            late_s: 0.0,
            instant2: scatter2,
            both: 0.5 * scatter2,
            period2: scatter2,
            scatter2,
            rounds: 0,
            late: 0,
            early_in_a_row: 0,
            owed: 0,
            catching_up: false,
        }
    }

    /// With period and scatter that are known from before: only the phase is to be found.
    pub(super) fn again(former: &Self) -> Self {
        Self {
            late_s: 0.0,
            instant2: former.scatter2,
            both: 0.0,
            period2: (PERIOD_SIGMA * former.period_s).powi(2),
            late: 0,
            early_in_a_row: 0,
            owed: 0,
            catching_up: true,
            ..former.clone()
        }
    }

    pub(super) fn period_s(&self) -> f64 {
        self.period_s
    }

    /// Whether the stamps contradict it for so long that it must be found anew.
    pub(super) fn is_lost(&self) -> bool {
        self.late > LATE_AT_MOST || self.late_s > LATE_BY_AT_MOST_S || self.early_in_a_row >= EARLY_AT_MOST
    }

    /// Goes on to the round of the next stamp, `interval_s` after the last one; the boards' step to it.
    pub(super) fn advance(&mut self, interval_s: f64, cycles: Option<u32>) -> Step {
        let passed = self.passed(interval_s, cycles);
        self.predict(passed.on_grid);
        let s = passed.cycles * self.period_s;
        let before_s = self.late_s;
        let late_s = before_s + interval_s - passed.on_grid * self.period_s;
        let limit_s = CLIP_SIGMA * (self.instant2 + self.scatter2).sqrt();
        self.catching_up &= late_s < -limit_s;
        // The sender was delayed, or the boards themselves paused: half of either.
        let doubt_s = if late_s > limit_s {
            0.5 * (late_s - before_s.max(0.0)).max(0.0)
        } else if late_s < -limit_s && !self.catching_up {
            0.5 * (late_s - before_s.min(0.0)).abs()
        } else {
            0.0
        };
        let variance_s2 = passed.cycles * passed.cycles * self.period2
            + passed.cycles * (WANDER.0 * self.period_s).powi(2)
            + (passed.doubt * self.period_s).powi(2)
            + doubt_s * doubt_s;
        // A burst after a delay comes back to the rhythm by itself.
        let returning = late_s < before_s - limit_s;
        if late_s > limit_s && !returning {
            self.late += 1;
        } else if late_s <= limit_s {
            self.late = self.late.saturating_sub(1);
        }
        let early = late_s < -limit_s && !self.catching_up;
        self.early_in_a_row = if early { self.early_in_a_row + 1 } else { 0 };
        if !self.catching_up {
            self.learn_scatter(late_s.clamp(-limit_s, limit_s));
        }
        self.late_s = late_s;
        if late_s < -limit_s {
            self.set_phase();
        } else if late_s <= limit_s {
            self.correct();
        }
        Step { s, variance_s2, scatter_s: self.scatter2.sqrt() }
    }

    /// Cycles since the round before. Where nobody counts them, a long interval may be rounds that were lost or a delay
    /// whose rounds will follow in a burst.
    fn passed(&mut self, interval_s: f64, cycles: Option<u32>) -> Passed {
        if let Some(cycles) = cycles.map(f64::from) {
            return Passed { on_grid: cycles, cycles, doubt: 0.0 };
        }
        // A stamp may be late by nearly a period, but early by no more than its scatter.
        let early_s = (CLIP_SIGMA * (self.instant2 + self.scatter2).sqrt()).min(0.5 * self.period_s);
        let places = ((self.late_s + interval_s + early_s) / self.period_s).floor();
        if self.owed > 0 && interval_s < 0.5 * self.period_s {
            let on_grid = places.max(0.0);
            self.owed = (self.owed + on_grid as u32).saturating_sub(1);
            return Passed { on_grid, cycles: 1.0, doubt: 0.0 };
        }
        let on_grid = places.max(1.0);
        let without = on_grid - 1.0;
        self.owed = if without > 0.0 { self.owed.saturating_add(without as u32) } else { 0 };
        Passed { on_grid, cycles: 1.0 + 0.5 * without, doubt: 0.5 * without }
    }

    fn predict(&mut self, cycles: f64) {
        self.instant2 += 2.0 * cycles * self.both + cycles * cycles * self.period2;
        self.both += cycles * self.period2;
        self.instant2 += cycles * (WANDER.0 * self.period_s).powi(2);
        self.period2 += cycles * (WANDER.1 * self.period_s).powi(2);
    }

    fn correct(&mut self) {
        let variance = self.instant2 + self.scatter2;
        let (gain, period_gain) = (self.instant2 / variance, self.both / variance);
        self.period_s = (self.period_s + period_gain * self.late_s).max(1e-6);
        self.late_s -= gain * self.late_s;
        self.period2 -= period_gain * self.both;
        self.instant2 -= gain * self.instant2;
        self.both -= gain * self.both;
    }

    /// The phase was found on late stamps: this one is the best so far. So the period is less sure, too.
    fn set_phase(&mut self) {
        self.late_s = 0.0;
        self.instant2 = self.scatter2;
        self.both = 0.0;
        self.period2 = self.period2.max((PERIOD_SIGMA * self.period_s).powi(2));
    }

    /// The stamps' scatter from what the prediction missed, over the last hundred rounds or so.
    fn learn_scatter(&mut self, missed_s: f64) {
        /// The grain of a log with microseconds.
        const LEAST_S: f64 = 0.3e-6;
        self.rounds = (self.rounds + 1).min(100);
        let share = 1.0 / f64::from(self.rounds + 4);
        let seen = self.scatter2 * missed_s * missed_s / (self.instant2 + self.scatter2);
        self.scatter2 = (self.scatter2 + share * (seen - self.scatter2)).max(LEAST_S * LEAST_S);
    }
}

/// Median of some numbers, which are put in order; zero of none.
pub(super) fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    match (values.len() / 2, values.len() % 2) {
        (0, 0) => 0.0,
        (middle, 1) => values[middle],
        (middle, _) => 0.5 * (values[middle - 1] + values[middle]),
    }
}
