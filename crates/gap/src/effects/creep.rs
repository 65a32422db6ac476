//! A signal that goes on changing under a constant load: a first-order lag of the signal added to it, 0.02..1 %.
//!
//! What was calibrated is either what is there at once (then the lag is added) or what is there in the end (then the lag less the
//! signal is); which of them is part of the shape. W. Findley, J. Lai, K. Onaran, Creep and Relaxation of Nonlinear Viscoelastic
//! Materials, 1976.

use super::*;

/// What is there at once was calibrated.
const AT_ONCE: f64 = 0.0;
/// What is there in the end was.
const IN_THE_END: f64 = 1.0;

/// A signal that goes on changing under a constant load: a first-order lag of the signal added to it, 0.02..1 %.
pub(super) struct Creep;

impl Effect for Creep {
    fn id(&self) -> &'static str {
        "creep"
    }

    fn words(&self) -> &'static str {
        "creep of the sensor"
    }

    fn remedy(&self) -> &'static str {
        "wait before reading, or compensate by the load's history"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_time_or_signal(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        moving_channels(session)
    }

    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[("tau_s", "s")]
    }

    fn shapes(&self, session: &Session, _place: Place) -> Vec<Shape> {
        let (Some(step_s), Some(longest_s)) = (session.step_s(), session.longest_s()) else {
            return Vec::new();
        };
        let times = geometric((20.0 * step_s).max(1.0), longest_s.max(40.0 * step_s).max(2.0), 7);
        let kinds = [IN_THE_END, AT_ONCE];
        kinds.iter().flat_map(|kind| times.iter().map(|tau| vec![tau[0], *kind])).collect()
    }

    fn is_continuous(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let values = lagged(session, &own.simulated, shape[0]);
        let share = if shape[1] == IN_THE_END { 1.0 } else { 0.0 };
        let values = values.iter().zip(&own.simulated).map(|(slow, signal)| slow - share * signal).collect();
        vec![Column::value("relative", "1", 0.1, channel, values)]
    }

    fn experiment(&self) -> &'static str {
        "a load put on at once and left for ten minutes"
    }
}
