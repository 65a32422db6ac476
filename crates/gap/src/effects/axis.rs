//! Sensitivity to loads that the channel should not see: the sensing axis is not where it was meant to be.
//!
//! The compliance vector of a section is `r [l x R, R]` (Y.-L. Kim, J.-J. Park, J.-B. Song, J. Mech. Sci. Technol. 24(8), 2010); a
//! small turn or shift adds multiples of the other load components. With load columns given each is a column here.

use super::*;

/// Crosstalk of loads.
pub(super) struct SensingAxis;

impl Effect for SensingAxis {
    fn id(&self) -> &'static str {
        "sensing_axis"
    }

    fn words(&self) -> &'static str {
        "crosstalk of other load components (a sensing axis off its place)"
    }

    fn remedy(&self) -> &'static str {
        "calibrate the full compliance of the sensor"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        if session.loads.len() < 2 {
            return Some("the other components of the load ([covariates] load = [columns])".to_owned());
        }
        None
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        every_channel(session)
    }

    fn columns(&self, session: &Session, place: Place, _shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let span = deviation(&own.simulated).max(own.rms_gap());
        let mut columns = Vec::new();
        for load in session.loads.iter().filter(|load| deviation(&load.values) > 0.0) {
            let plausible = span / deviation(&load.values);
            let column =
                Column::value(&format!("c_{}", load.name), "1", plausible, channel, load.values.clone());
            // An axis that turns loses some of its own load, and what hangs on a lever loads several components at once.
            let is_own = is_same(&load.values, &own.simulated);
            columns.push(if is_own { column.role(Role::Nuisance) } else { column });
        }
        columns
    }

    fn experiment(&self) -> &'static str {
        "loads in other directions at other points"
    }
}

/// Whether one column repeats the other but for rounding.
fn is_same(a: &[f64], b: &[f64]) -> bool {
    let tolerance = 1e-9 * a.iter().fold(0.0_f64, |m, v| m.max(v.abs()));
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance)
}
