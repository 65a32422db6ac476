//! A signal too large or too small by a factor: a bridge's sensitivity, a wrong scale of the simulation.

use super::*;

/// A signal too large or too small by a factor: a bridge's sensitivity, a wrong scale of the simulation.
pub(super) struct Gain;

impl Effect for Gain {
    fn id(&self) -> &'static str {
        "gain"
    }

    fn words(&self) -> &'static str {
        "a wrong scale"
    }

    fn remedy(&self) -> &'static str {
        "calibrate the scale again"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_signal(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        moving_channels(session)
    }

    fn is_exact(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, _shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        vec![Column::value("relative", "1", 0.2, channel, own.simulated.clone())]
    }

    fn compensate(&self, session: &Session, term: &Fitted<'_>) -> Vec<Compensation> {
        let Place::Channel(gauge) = term.place else { return Vec::new() };
        let own = session.channels[gauge].gauge.as_ref().zip(term.values.first());
        own.map(|(own, relative)| Compensation::Compliance { gauge, change: own.compliance * *relative })
            .into_iter()
            .collect()
    }

    fn experiment(&self) -> &'static str {
        "loads of twice the size in the same poses"
    }
}
