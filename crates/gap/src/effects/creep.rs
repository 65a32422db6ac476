//! A signal that goes on changing under a constant load: a first-order lag of the signal added to it, 0.02..1 %.

use super::*;

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
        geometric((20.0 * step_s).max(1.0), longest_s.max(40.0 * step_s).max(2.0), 6)
    }

    fn is_continuous(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let values = lagged(session, &own.simulated, shape[0]);
        let values = values.iter().zip(&own.simulated).map(|(slow, signal)| slow - signal).collect();
        vec![Column::value("relative", "1", 0.1, channel, values)]
    }

    fn experiment(&self) -> &'static str {
        "a load put on at once and left for ten minutes"
    }
}
