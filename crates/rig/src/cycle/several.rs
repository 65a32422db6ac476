//! Whether several sensors go astray at once.
//!
//! The protection level says what one faulty sensor can hide. Where one after the other says what cannot be, readings are corrupted on their way (or
//! gauges fail together): then two faults may hide each other, and nothing bounds the error.

/// Sensors that go astray within this time do so together, ns; on slow buses within so many instants.
const TOGETHER_NS: i64 = 50_000_000;
const TOGETHER_INSTANTS: u32 = 5;

/// Who went astray lately. Allocates at construction only.
#[derive(Clone, Debug)]
pub(super) struct Several {
    /// Which sensors alone can be the cause of all that was seen since there was last nothing.
    may: Vec<bool>,
    /// The last time that one went astray, and instants since.
    last: Option<(i64, u32)>,
    /// The last time that no single one could be the cause, and instants since.
    last_of_several: Option<(i64, u32)>,
    now_ns: Option<i64>,
}

impl Several {
    /// For so many sensors.
    pub(super) fn new(sensors: usize) -> Self {
        Self { may: vec![true; sensors], last: None, last_of_several: None, now_ns: None }
    }

    /// Begins an instant; the same may come twice.
    pub(super) fn begin(&mut self, now_ns: i64) {
        if self.now_ns.replace(now_ns) == Some(now_ns) {
            return;
        }
        let older = |seen: &mut Option<(i64, u32)>| {
            *seen = seen.map(|(at_ns, instants)| (at_ns, instants.saturating_add(1))).filter(
                |(at_ns, instants)| {
                    now_ns.abs_diff(*at_ns) <= TOGETHER_NS as u64 || *instants <= TOGETHER_INSTANTS
                },
            );
        };
        older(&mut self.last);
        older(&mut self.last_of_several);
    }

    /// A sensor goes astray at this instant, and one of those for which `may` holds is the cause, if it is one alone.
    pub(super) fn note(&mut self, may: impl Fn(usize) -> bool) {
        let now_ns = self.now_ns.unwrap_or_default();
        if self.last.replace((now_ns, 0)).is_none() {
            self.may.fill(true);
        }
        self.may.iter_mut().enumerate().for_each(|(sensor, before)| *before &= may(sensor));
        if !self.may.contains(&true) {
            self.last_of_several = Some((now_ns, 0));
            // The last one alone, for those to come.
            self.may.iter_mut().enumerate().for_each(|(sensor, before)| *before = may(sensor));
        }
    }

    /// Whether several go astray.
    pub(super) fn holds(&self) -> bool {
        self.last_of_several.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether several went astray after each instant, 8 ms apart, in which these sensors may have been the cause of something.
    fn after(events: &[Option<&[usize]>]) -> Vec<bool> {
        let mut several = Several::new(4);
        let mut at = |(k, event): (usize, &Option<&[usize]>)| {
            several.begin(k as i64 * 8_000_000);
            if let Some(event) = event {
                several.note(|sensor| event.contains(&sensor));
            }
            several.holds()
        };
        events.iter().enumerate().map(&mut at).collect()
    }

    #[test]
    fn one_sensor_may_go_astray_again_and_again() {
        let one = Some([0, 2].as_slice());
        assert_eq!(after(&[one, None, Some(&[2]), Some(&[2, 3])]), [false; 4]);
    }

    #[test]
    fn two_sensors_one_after_the_other_are_several_for_a_while() {
        let held = after(&[Some(&[0]), None, Some(&[1]), None, None, None, None, None, None, None, None]);
        let expected = [false, false, true, true, true, true, true, true, true, false, false];
        assert_eq!(held, expected);
    }

    #[test]
    fn what_nobody_alone_can_cause_is_of_several() {
        assert_eq!(after(&[Some(&[]), None]), [true, true]);
    }

    #[test]
    fn what_is_long_past_does_not_count() {
        let mut events = vec![None; 12];
        (events[0], events[10]) = (Some([0].as_slice()), Some([1].as_slice()));
        assert_eq!(after(&events), [false; 12]);
    }
}
