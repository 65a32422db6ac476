//! A signal that ends at a limit: amplifier or converter at its rail.

use super::*;

/// A signal that ends at a limit: amplifier or converter at its rail.
pub(super) struct Saturation;

impl Effect for Saturation {
    fn id(&self) -> &'static str {
        "saturation"
    }

    fn words(&self) -> &'static str {
        "a signal that ends at a limit"
    }

    fn remedy(&self) -> &'static str {
        "lower the amplifier's gain"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_signal(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        moving_channels(session)
    }

    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[("limit", "channel's unit")]
    }

    fn shapes(&self, session: &Session, place: Place) -> Vec<Shape> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let (middle, half) = span(&session.channels[channel].simulated);
        let parts = [-0.95, -0.9, -0.8, -0.7, -0.6, -0.4, 0.4, 0.6, 0.7, 0.8, 0.9, 0.95];
        parts.map(|part| vec![middle + part * half]).to_vec()
    }

    fn is_continuous(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let limit = shape[0];
        let is_upper = limit > span(&own.simulated).0;
        let beyond = |signal: &f64| if is_upper { limit.min(*signal) } else { limit.max(*signal) };
        vec![Column::pinned(channel, own.simulated.iter().map(|s| beyond(s) - s).collect())]
    }

    fn experiment(&self) -> &'static str {
        "loads up to the sensor's limit"
    }
}

/// Middle of the values and half their span.
fn span(values: &[f64]) -> (f64, f64) {
    let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
    ((low + high) / 2.0, (high - low) / 2.0)
}
