//! A characteristic that bends: a power of the signal, 0.02..2 % of the range on cheap gauges.

use super::*;

/// A characteristic that bends: a power of the signal, 0.02..2 % of the range on cheap gauges.
pub(super) struct Nonlinearity;

impl Effect for Nonlinearity {
    fn id(&self) -> &'static str {
        "nonlinearity"
    }

    fn words(&self) -> &'static str {
        "a bent characteristic"
    }

    fn remedy(&self) -> &'static str {
        "calibrate with more loads and store the curve"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_signal(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        moving_channels(session)
    }

    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[("order", "1")]
    }

    fn shapes(&self, session: &Session, _place: Place) -> Vec<Shape> {
        let _ = session;
        vec![vec![2.0], vec![3.0]]
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let extent = own.extent();
        let bend = |signal: &f64| extent * (signal / extent).abs().powf(shape[0] - 1.0) * (signal / extent);
        let even = |signal: &f64| extent * (signal / extent).powi(2);
        let values = if shape[0] == 2.0 {
            own.simulated.iter().map(even).collect()
        } else {
            own.simulated.iter().map(bend).collect()
        };
        vec![Column::value("relative", "1", 0.1, channel, values)]
    }

    fn experiment(&self) -> &'static str {
        "loads of twice the size in the same poses"
    }
}
