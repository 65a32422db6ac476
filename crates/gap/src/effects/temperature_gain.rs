//! Sensitivity that changes with temperature, 0.02..0.05 % per K on uncompensated bridges.

use super::*;

/// Sensitivity that changes with temperature, 0.02..0.05 % per K on uncompensated bridges.
pub(super) struct TemperatureGain;

/// Plausible change of a scale, 1/K; and how far from a recording's temperature one was calibrated, K.
const PER_K: f64 = 0.0125;
const AWAY_K: f64 = 20.0;

impl Effect for TemperatureGain {
    fn id(&self) -> &'static str {
        "temperature_gain"
    }

    fn words(&self) -> &'static str {
        "a sensitivity that changes with temperature"
    }

    fn remedy(&self) -> &'static str {
        "compensate the scale by the measured temperature"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_temperature(session).or_else(|| without_signal(session))
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        moving_channels(session)
    }

    fn columns(&self, session: &Session, place: Place, _shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let Some(temperature) = session.temperature_of(channel) else { return Vec::new() };
        let reference = mean(temperature);
        // The temperature of the calibration is not known: a factor comes along.
        let values = own.simulated.iter().zip(temperature).map(|(s, t)| s * (t - reference)).collect();
        vec![
            Column::value("per_k", "1/K", PER_K, channel, values),
            Column::value("", "1", PER_K * AWAY_K, channel, own.simulated.clone()).role(Role::Nuisance),
        ]
    }

    fn experiment(&self) -> &'static str {
        "the same loads at two temperatures"
    }
}
