//! A constant added to a signal: the zero of an amplifier, 5 % of the range on cheap gauges.

use super::*;

/// A constant added to a signal: the zero of an amplifier, 5 % of the range on cheap gauges.
pub(super) struct ZeroOffset;

impl Effect for ZeroOffset {
    fn id(&self) -> &'static str {
        "zero_offset"
    }

    fn words(&self) -> &'static str {
        "a zero that is off"
    }

    fn remedy(&self) -> &'static str {
        "tare, or calibrate the zeros again"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        let _ = session;
        None
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        every_channel(session)
    }

    fn columns(&self, session: &Session, place: Place, _shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let plausible = (0.05 * own.extent()).max(3.0 * own.rms_gap());
        vec![Column::value("offset", &own.unit, plausible, channel, vec![1.0; session.rows()])]
    }

    fn compensate(&self, _session: &Session, term: &Fitted<'_>) -> Vec<Compensation> {
        let Place::Channel(gauge) = term.place else { return Vec::new() };
        term.values.first().map(|counts| Compensation::Bias { gauge, counts: *counts }).into_iter().collect()
    }

    fn experiment(&self) -> &'static str {
        "a recording after a tare"
    }
}
