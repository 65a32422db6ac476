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
        [ALONE, BESIDE_A_LINE].iter().flat_map(|kind| [2.0, 3.0].map(|order| vec![order, *kind])).collect()
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
        let bent = Column::value("relative", "1", 0.1, channel, values);
        if shape[1] == ALONE {
            return vec![bent];
        }
        let line = Column::value("", "1", 0.1, channel, own.simulated.clone()).role(Role::Nuisance);
        let constant = Column::value("", &own.unit, 0.1 * extent, channel, vec![1.0; session.rows()]);
        vec![bent, line, constant.role(Role::Nuisance)]
    }

    fn experiment(&self) -> &'static str {
        "loads of twice the size in the same poses"
    }
}

/// The power by itself.
const ALONE: f64 = 0.0;
/// What a straight line leaves of it: the line was calibrated over the bend.
const BESIDE_A_LINE: f64 = 1.0;
