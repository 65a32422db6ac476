//! A signal that depends on where it comes from: a play operator less the signal itself.
//!
//! The stop operator `Play_r(z) - z`, of which any rate-independent hysteresis is a sum (M. Brokate, J. Sprekels, Hysteresis and Phase
//! Transitions, 1996, ch. 2); the width is a share of half the signal's span.

use super::*;

/// Hysteresis of a sensor.
pub(super) struct Hysteresis;

impl Effect for Hysteresis {
    fn id(&self) -> &'static str {
        "hysteresis"
    }

    fn words(&self) -> &'static str {
        "hysteresis of the sensor"
    }

    fn remedy(&self) -> &'static str {
        "approach every load from the same side, or replace the sensor"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_time_or_signal(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        moving_channels(session)
    }

    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[("width", "1")]
    }

    fn shapes(&self, session: &Session, _place: Place) -> Vec<Shape> {
        let _ = session;
        geometric(0.02, 0.6, 6)
    }

    fn is_continuous(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let radius = shape[0] * own.extent();
        let mut values = vec![0.0; session.rows()];
        for rows in &session.segments {
            let mut play = own.simulated[rows.start];
            for row in rows.clone() {
                let signal = own.simulated[row];
                play = play.clamp(signal - radius, signal + radius);
                values[row] = play - signal;
            }
        }
        vec![Column::value("relative", "1", 0.5, channel, values).positive()]
    }

    fn experiment(&self) -> &'static str {
        "the same load approached from both sides, slowly"
    }
}
