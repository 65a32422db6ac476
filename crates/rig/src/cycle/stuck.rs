//! Tells a sensor that stands still from one that is quiet.

use super::STUCK_AFTER;

/// Noise of so many steps of the reading makes equal readings in a row rarer than one in a million.
const NOISY_STEPS: f64 = 10.0;

/// One sensor's last readings.
#[derive(Clone, Copy, Debug)]
pub(super) struct StuckWatch {
    /// Whether the noise is large enough for equal readings to mean something.
    noisy: bool,
    last: f64,
    /// The last one that was another.
    before: f64,
    repeats: u32,
}

impl StuckWatch {
    /// For a sensor with this noise (standard deviation) and resolution, in its unit.
    pub(super) fn new(sigma: f64, resolution: f64) -> Self {
        Self { noisy: sigma > NOISY_STEPS * resolution, last: f64::NAN, before: f64::NAN, repeats: 0 }
    }

    /// Whether the last reading was one of the two values before, from a sensor whose noise makes that rare: it may be no news.
    pub(super) fn repeats(&self) -> bool {
        self.noisy && self.repeats > 0
    }

    /// Takes in the next reading; whether the sensor is stuck.
    pub(super) fn is_stuck(&mut self, reading: f64) -> bool {
        // One that is wrong in between does not make the others news.
        let again = reading == self.last || reading == self.before;
        self.repeats = if again { self.repeats.saturating_add(1) } else { 0 };
        if reading != self.last {
            self.before = std::mem::replace(&mut self.last, reading);
        }
        self.noisy && self.repeats >= STUCK_AFTER
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_noisy_sensor_that_repeats_itself_is_stuck_until_it_moves() {
        let mut watch = StuckWatch::new(700.0, 1.0);
        let stuck: Vec<bool> = [3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 3.0, 4.0].map(|c| watch.is_stuck(c)).into();
        assert_eq!(stuck, [false, false, false, false, false, true, true, false]);
    }

    #[test]
    fn the_same_again_is_noticed_at_once() {
        let mut watch = StuckWatch::new(700.0, 1.0);
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
        let mut watch = StuckWatch::new(700.0, 1.0);
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
        let mut watch = StuckWatch::new(0.5, 1.0);
        assert!((0..100).all(|_| !watch.is_stuck(3.0)));
    }
}
