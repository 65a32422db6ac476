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
        let widths = geometric(0.02, 0.6, 6);
        [ONE, SEVERAL].iter().flat_map(|plays| widths.iter().map(|width| vec![width[0], *plays])).collect()
    }

    fn is_continuous(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        if shape[1] == ONE {
            return vec![Column::value("relative", "1", 0.5, channel, play(session, own, shape[0]))];
        }
        let columns = SPREAD.map(|(factor, name)| {
            Column::value(name, "1", 0.5, channel, play(session, own, shape[0] * factor))
        });
        columns.into_iter().collect()
    }

    fn experiment(&self) -> &'static str {
        "the same load approached from both sides, slowly"
    }
}

/// One play, or several of other widths beside it: a loop with round corners.
const ONE: f64 = 1.0;
const SEVERAL: f64 = 3.0;
/// Widths against the middle one, and what their shares are called.
const SPREAD: [(f64, &str); 3] = [(0.3, "relative_narrow"), (1.0, "relative"), (3.0, "relative_wide")];

/// A play operator's output less its input (channel's unit), per row, each segment from its beginning.
fn play(session: &Session, own: &crate::session::Channel, width: f64) -> Vec<f64> {
    let radius = width * own.extent();
    let mut values = vec![0.0; session.rows()];
    for rows in &session.segments {
        let mut play = own.simulated[rows.start];
        for row in rows.clone() {
            let signal = own.simulated[row];
            play = play.clamp(signal - radius, signal + radius);
            values[row] = play - signal;
        }
    }
    values
}
