//! A share of another channel's signal: crosstalk in cables or multiplexer, 0.1..1 %.
//!
//! The shape is the index of the source; the last shape takes all sources at once.

use super::*;

/// Signals of other channels.
pub(super) struct ChannelCoupling;

impl Effect for ChannelCoupling {
    fn id(&self) -> &'static str {
        "channel_coupling"
    }

    fn words(&self) -> &'static str {
        "signals of other channels leaking in"
    }

    fn remedy(&self) -> &'static str {
        "separate the cables; slow the multiplexer down"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        if session.channels.len() < 2 {
            return Some("a second channel".to_owned());
        }
        without_signal(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        every_channel(session)
    }

    fn shapes(&self, session: &Session, _place: Place) -> Vec<Shape> {
        let single = (0..session.channels.len()).map(|source| vec![source as f64]);
        single.chain([vec![ALL]]).collect()
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let span = deviation(&own.simulated).max(own.rms_gap());
        let sources = (0..session.channels.len())
            .filter(|source| *source != channel && (shape[0] == ALL || shape[0] == *source as f64))
            .filter(|source| moves(session, *source));
        sources
            .map(|source| {
                let values = &session.channels[source].simulated;
                let name = format!("relative[{}]", session.channels[source].name);
                Column::value(&name, "1", 0.05 * span / deviation(values), channel, values.clone())
            })
            .collect()
    }

    fn experiment(&self) -> &'static str {
        "one channel loaded at a time"
    }
}

/// Not an index: every other channel.
const ALL: f64 = -1.0;
