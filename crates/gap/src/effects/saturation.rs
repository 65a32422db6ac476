//! A signal that ends at a limit: amplifier or converter at its rail, or at both.

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
        let tried = parts.map(|part| middle + part * half);
        let reached = outermost(session, channel);
        let both = if let [low, high] = reached[..] { vec![vec![high, low]] } else { Vec::new() };
        tried.into_iter().chain(reached).map(|limit| vec![limit]).chain(both).collect()
    }

    fn is_continuous(&self) -> bool {
        true
    }

    fn is_read_off(&self, shape: &[f64]) -> bool {
        shape.len() == 2
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let [low, high] = match *shape {
            [high, low] => [low, high],
            [limit] if limit > span(&own.simulated).0 => [f64::NEG_INFINITY, limit],
            [limit] => [limit, f64::INFINITY],
            _ => return Vec::new(),
        };
        vec![Column::pinned(channel, own.simulated.iter().map(|s| s.max(low).min(high) - s).collect())]
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

/// Readings that make a limit, on each side.
const AT_THE_LIMIT: usize = 25;

/// Lowest and highest of what was read (channel's unit), by the median of the outermost readings: a limit that is reached is where these
/// are, even if only one recording reaches it.
fn outermost(session: &Session, channel: usize) -> Vec<f64> {
    let read = readings::sorted(session, channel);
    if read.len() < 4 * AT_THE_LIMIT {
        return Vec::new();
    }
    vec![read[AT_THE_LIMIT / 2], read[read.len() - 1 - AT_THE_LIMIT / 2]]
}
