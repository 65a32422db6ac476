//! A signal smoothed by a first-order lag that the simulation lacks: filter, slow sensor, servo.

use super::*;

/// A signal smoothed by a first-order lag that the simulation lacks: filter, slow sensor, servo.
pub(super) struct Lowpass;

impl Effect for Lowpass {
    fn id(&self) -> &'static str {
        "lowpass"
    }

    fn words(&self) -> &'static str {
        "a first-order lag between simulation and measurement"
    }

    fn remedy(&self) -> &'static str {
        "take the filter out, or put it into the simulation"
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
        latenesses(session)
    }

    fn is_continuous(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let values = lagged(session, &own.simulated, shape[0]);
        let values = values.iter().zip(&own.simulated).map(|(slow, signal)| slow - signal).collect();
        vec![Column::pinned(channel, values)]
    }

    fn experiment(&self) -> &'static str {
        "motion of several frequencies up to the fastest: a delay and a lag differ there"
    }
}
