//! When a round was really sampled: the boards' steady clock, seen through stamps that come late by varying amounts.
//!
//! A stamp that is 1 ms late makes a joint at 3 rad/s seem 3 mrad elsewhere, a hundred times its encoder's noise. Boards
//! sample on a quartz clock, so phase and period of the rounds are tracked by a small Kalman filter and the
//! stamps' scatter averages out.

/// Scatter beyond this share of the period means that rounds do not come periodically: stamps are taken as they are.
const PERIODIC_UP_TO: f64 = 0.25;

/// Scatter assumed of a single stamp where rounds are not periodic, s.
const STAMP_SIGMA_S: f64 = 20e-6;

/// A stamp further than this from its round, in standard deviations, says less about the clock.
const CLIP_SIGMA: f64 = 3.0;

/// After so many rounds in a row that were all late, or all early, beyond the clip, the clock is found anew.
const LOST_AFTER: u32 = 20;

/// So many rounds in a row that seem not periodic, and the clock is found anew: it may have been found on a bad start.
const DOUBTED_AFTER: u32 = 50;

/// Stamps from which the period is first taken (the median of their intervals, which one late stamp does not move).
const FIRST: usize = 9;

/// After a longer silence than this the clock is found anew, ns.
const FORGET_NS: i64 = 500_000_000;

/// Phase and period of the rounds, from their stamps.
#[derive(Clone, Debug, Default)]
pub struct RoundClock {
    state: Option<State>,
}

/// When a round was sampled, on the stamps' clock but for their common lateness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampled {
    /// The instant, ns since the Unix epoch.
    pub at_ns: i64,
    /// Its standard deviation, s.
    pub sigma_s: f64,
}

#[derive(Clone, Debug)]
struct State {
    stamp_ns: i64,
    /// Estimated instant less the last stamp, s.
    ahead_s: f64,
    /// The intervals so far, until there are enough to know the period, s.
    intervals: [f64; FIRST - 1],
    known: usize,
    rhythm: Option<Rhythm>,
    /// Rounds in a row that seemed not periodic.
    doubted: u32,
}

#[derive(Clone, Debug)]
struct Rhythm {
    period_s: f64,
    /// Covariance of instant and period, s^2.
    instant2: f64,
    both: f64,
    period2: f64,
    /// Variance of a stamp's lateness, s^2.
    scatter2: f64,
    rounds: u32,
    /// Signed number of rounds in a row beyond the clip.
    astray: i32,
}

impl RoundClock {
    /// Takes in the stamp of the next round; when that round was sampled.
    pub fn observe(&mut self, stamp_ns: i64) -> Sampled {
        let Some(state) = &mut self.state else { return self.restart(stamp_ns) };
        let step_ns = stamp_ns - state.stamp_ns;
        if step_ns <= 0 || step_ns > FORGET_NS {
            return self.restart(stamp_ns);
        }
        let step_s = step_ns as f64 * 1e-9;
        state.stamp_ns = stamp_ns;
        let Some(rhythm) = &mut state.rhythm else {
            state.gather(step_s);
            return Sampled { at_ns: stamp_ns, sigma_s: STAMP_SIGMA_S };
        };
        let ahead_s = rhythm.advance(state.ahead_s - step_s);
        if rhythm.astray.unsigned_abs() > LOST_AFTER {
            return self.restart(stamp_ns);
        }
        state.ahead_s = ahead_s;
        let scatter_s = rhythm.scatter2.sqrt();
        if scatter_s > PERIODIC_UP_TO * rhythm.period_s {
            state.doubted += 1;
            if state.doubted > DOUBTED_AFTER {
                self.restart(stamp_ns);
            }
            return Sampled { at_ns: stamp_ns, sigma_s: scatter_s.max(STAMP_SIGMA_S) };
        }
        state.doubted = 0;
        Sampled { at_ns: stamp_ns + (ahead_s * 1e9).round() as i64, sigma_s: rhythm.instant2.sqrt() }
    }

    fn restart(&mut self, stamp_ns: i64) -> Sampled {
        self.state = Some(State {
            stamp_ns,
            ahead_s: 0.0,
            intervals: [0.0; FIRST - 1],
            known: 0,
            rhythm: None,
            doubted: 0,
        });
        Sampled { at_ns: stamp_ns, sigma_s: STAMP_SIGMA_S }
    }
}

impl State {
    /// Takes in one of the first intervals; with the last of them the period is known.
    fn gather(&mut self, step_s: f64) {
        self.intervals[self.known] = step_s;
        self.known += 1;
        if self.known == self.intervals.len() {
            self.intervals.sort_unstable_by(f64::total_cmp);
            let middle = self.intervals.len() / 2;
            self.rhythm = Some(Rhythm::new(0.5 * (self.intervals[middle - 1] + self.intervals[middle])));
            self.ahead_s = 0.0;
        }
    }
}

impl Rhythm {
    fn new(period_s: f64) -> Self {
        let scatter2 = (0.1 * period_s).powi(2);
        Self {
            period_s,
            instant2: scatter2,
            both: scatter2,
            period2: 2.0 * scatter2,
            scatter2,
            rounds: 0,
            astray: 0,
        }
    }

    /// Goes on from an instant `from_s` (less the new stamp) to the round of the new stamp; its instant less the stamp.
    fn advance(&mut self, from_s: f64) -> f64 {
        /// What a quartz wanders: instant and period, per round, as shares of the period.
        const WANDER: (f64, f64) = (2e-5, 2e-7);
        let rounds = (-from_s / self.period_s).round().max(1.0);
        let predicted_s = from_s + rounds * self.period_s;
        self.instant2 += 2.0 * rounds * self.both + rounds * rounds * self.period2;
        self.both += rounds * self.period2;
        self.instant2 += rounds * (WANDER.0 * self.period_s).powi(2);
        self.period2 += rounds * (WANDER.1 * self.period_s).powi(2);
        // The stamp stands at zero.
        let late_s = -predicted_s;
        let variance = self.instant2 + self.scatter2;
        let limit = CLIP_SIGMA * variance.sqrt();
        self.count_astray(late_s, limit);
        let clipped = late_s.clamp(-limit, limit);
        let (gain, period_gain) = (self.instant2 / variance, self.both / variance);
        self.period_s = (self.period_s + period_gain * clipped).max(1e-6);
        self.period2 -= period_gain * self.both;
        self.instant2 -= gain * self.instant2;
        self.both -= gain * self.both;
        self.learn_scatter(clipped, variance);
        predicted_s + gain * clipped
    }

    fn count_astray(&mut self, late_s: f64, limit: f64) {
        let side = if late_s > limit {
            1
        } else if late_s < -limit {
            -1
        } else {
            0
        };
        self.astray = if side != 0 && self.astray.signum() != -side { self.astray + side } else { side };
    }

    /// The stamps' scatter from what the prediction missed, over the last hundred rounds or so.
    fn learn_scatter(&mut self, missed_s: f64, variance: f64) {
        /// The grain of a log with microseconds.
        const LEAST_S: f64 = 0.3e-6;
        self.rounds = (self.rounds + 1).min(100);
        let share = 1.0 / f64::from(self.rounds + 4);
        let seen = self.scatter2 * missed_s * missed_s / variance;
        self.scatter2 = (self.scatter2 + share * (seen - self.scatter2)).max(LEAST_S * LEAST_S);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn uniform(seed: &mut u64) -> f64 {
        *seed = seed.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (*seed >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Error of the instants against the truth less its mean (a common lateness is no error), RMS, s.
    fn error_s(stamps: &[(i64, i64)]) -> f64 {
        let mut clock = RoundClock::default();
        let errors: Vec<f64> = stamps
            .iter()
            .map(|(true_ns, stamp)| (clock.observe(*stamp).at_ns - true_ns) as f64 * 1e-9)
            .collect();
        let settled = &errors[stamps.len() / 4..];
        let mean = settled.iter().sum::<f64>() / settled.len() as f64;
        (settled.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / settled.len() as f64).sqrt()
    }

    #[test]
    fn scatter_averages_out_also_with_a_drifting_clock_and_lost_rounds() {
        let mut seed = 3;
        let stamps: Vec<(i64, i64)> = (0..4000i64)
            .filter(|k| k % 37 != 5)
            .map(|k| {
                let true_ns = k * 8_000_400;
                (true_ns, true_ns + (uniform(&mut seed) * 1e6) as i64)
            })
            .collect();
        // A stamp alone would be 290 us off.
        let error = error_s(&stamps);
        assert!(error < 25e-6, "{error}");
    }

    #[test]
    fn exact_stamps_stay_exact() {
        let stamps: Vec<(i64, i64)> = (0..500).map(|k| (k * 1_000_000, k * 1_000_000)).collect();
        assert!(error_s(&stamps) < 1e-7);
    }

    #[test]
    fn rounds_that_are_not_periodic_keep_their_stamps() {
        let (mut seed, mut now) = (9, 0);
        let stamps: Vec<(i64, i64)> = (0..500)
            .map(|_| {
                now += 1_000_000 + (uniform(&mut seed) * 20e6) as i64;
                (now, now)
            })
            .collect();
        let mut clock = RoundClock::default();
        let same = stamps.iter().filter(|(_, stamp)| clock.observe(*stamp).at_ns == *stamp).count();
        assert!(same > 400, "{same}");
    }

    #[test]
    fn a_step_of_the_clock_and_a_new_rate_are_found() {
        let mut clock = RoundClock::default();
        for k in 0..200i64 {
            clock.observe(k * 8_000_000);
        }
        let stepped = -3_600_000_000_000;
        for k in 0..100i64 {
            let stamp = stepped + k * 8_000_000;
            assert!((clock.observe(stamp).at_ns - stamp).abs() < 10_000);
        }
        let mut last = 0;
        for k in 0..300i64 {
            let stamp = stepped + 800_000_000 + k * 5_000_000;
            last = clock.observe(stamp).at_ns - stamp;
        }
        assert!(last.abs() < 100_000, "{last}");
    }
}
