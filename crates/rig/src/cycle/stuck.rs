//! Tells a sensor that stands still from one that is quiet.

use super::STUCK_AFTER;

/// Noise of so many steps of the reading makes equal readings in a row rarer than one in a million.
const NOISY_STEPS: f64 = 10.0;

/// So rare, per reading, is a sound gauge that seems stuck.
const RARE: f64 = 1e-9;

/// A gauge's noise may be so many times smaller than it was calibrated.
const CALMER: f64 = 2.0;

/// After more readings than this the load would have to stand still as well.
const MOST_REPEATS: f64 = 1000.0;

/// One sensor's last readings.
#[derive(Clone, Copy, Debug)]
pub(super) struct StuckWatch {
    /// So many readings in a row, none of them news, say that it is stuck; none where its noise is too small to tell.
    after: Option<u32>,
    last: f64,
    /// The last one that was another.
    before: f64,
    repeats: u32,
}

impl StuckWatch {
    /// For an encoder with this noise (standard deviation) and resolution, in its unit.
    pub(super) fn of_encoder(sigma: f64, resolution: f64) -> Self {
        Self::after((sigma > NOISY_STEPS * resolution).then_some(STUCK_AFTER))
    }

    /// For a gauge with this noise from one reading to the next (standard deviation) and resolution, in its unit.
    ///
    /// Of Gaussian noise no two values next to each other have more than `2 / sqrt(2 pi)` of the resolution over the noise: so often is a reading one
    /// of the two before.
    pub(super) fn of_gauge(sigma: f64, resolution: f64) -> Self {
        let often = (2.0 / std::f64::consts::TAU.sqrt()) * resolution * CALMER / sigma;
        let repeats = (RARE.ln() / often.min(1.0).ln()).ceil();
        let repeats = (often < 1.0 && repeats <= MOST_REPEATS).then_some(repeats as u32);
        Self::after(repeats.map(|repeats| repeats.max(STUCK_AFTER)))
    }

    fn after(after: Option<u32>) -> Self {
        Self { after, last: f64::NAN, before: f64::NAN, repeats: 0 }
    }

    /// Whether the last reading was one of the two values before, from a sensor whose noise makes that rare: it may be no news.
    pub(super) fn repeats(&self) -> bool {
        self.after.is_some() && self.repeats > 0
    }

    /// Takes in the next reading; whether the sensor is stuck.
    pub(super) fn is_stuck(&mut self, reading: f64) -> bool {
        // One that is wrong in between does not make the others news.
        let again = reading == self.last || reading == self.before;
        self.repeats = if again { self.repeats.saturating_add(1) } else { 0 };
        if reading != self.last {
            self.before = std::mem::replace(&mut self.last, reading);
        }
        self.after.is_some_and(|after| self.repeats >= after)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_noisy_sensor_that_repeats_itself_is_stuck_until_it_moves() {
        let mut watch = StuckWatch::of_encoder(700.0, 1.0);
        let stuck: Vec<bool> = [3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 4.0].map(|c| watch.is_stuck(c)).into();
        assert_eq!(stuck, [false, false, false, false, false, true, true, false]);
    }

    #[test]
    fn the_same_again_is_noticed_at_once() {
        let mut watch = StuckWatch::of_encoder(700.0, 1.0);
        let again: Vec<bool> = [3.0, 3.0, 4.0]
            .map(|reading| {
                watch.is_stuck(reading);
                watch.repeats()
            })
            .into();
        assert_eq!(again, [false, true, false]);
    }

    #[test]
    fn a_wrong_reading_in_between_does_not_make_the_same_news() {
        let mut watch = StuckWatch::of_encoder(700.0, 1.0);
        let again: Vec<bool> = [3.0, 3.0, 9.0, 3.0, 3.0, 4.0, 5.0, 3.0]
            .map(|reading| {
                watch.is_stuck(reading);
                watch.repeats()
            })
            .into();
        assert_eq!(again, [false, true, false, true, true, false, false, false]);
    }

    #[test]
    fn a_quiet_sensor_may_repeat_itself() {
        let mut watch = StuckWatch::of_encoder(0.5, 1.0);
        assert!((0..100).all(|_| !watch.is_stuck(3.0)));
    }

    /// Readings of Gaussian noise about a level, rounded to whole steps.
    fn readings(sigma: f64, seed: u64) -> impl Iterator<Item = f64> {
        let mut state = seed;
        std::iter::repeat_with(move || {
            let mut sum = 0.0;
            for _ in 0..12 {
                state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                sum += (state >> 33) as f64 / (1u64 << 31) as f64;
            }
            ((sum - 6.0) * sigma + 0.5).round()
        })
    }

    #[test]
    fn coarse_steps_make_no_sound_gauge_stuck() {
        for sigma in [0.1, 0.5, 1.0, 1.7, 2.0, 3.0, 10.0, 30.0, 600.0] {
            // Half as noisy as it was calibrated.
            let mut watch = StuckWatch::of_gauge(sigma, 1.0);
            let stuck =
                readings(sigma / 2.0, 7).take(1_000_000).filter(|counts| watch.is_stuck(*counts)).count();
            assert_eq!(stuck, 0, "{sigma} steps");
        }
    }

    #[test]
    fn a_gauge_that_stands_still_is_found_as_soon_as_its_noise_allows() {
        let found = |sigma: f64| {
            let mut watch = StuckWatch::of_gauge(sigma, 1.0);
            (0..2000).position(|_| watch.is_stuck(3.0))
        };
        assert_eq!(
            [600.0, 60.0, 10.0, 3.0, 2.0, 1.0].map(found),
            [Some(5), Some(6), Some(12), Some(33), Some(92), None]
        );
    }
}
