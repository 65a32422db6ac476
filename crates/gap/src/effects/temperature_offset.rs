//! A zero that moves with temperature: 0.05..0.5 % of the range per K on uncompensated bridges, with the lag of whatever is between the
//! thermometer and the gauge.

use super::*;

/// Zero against temperature.
pub(super) struct TemperatureOffset;

impl Effect for TemperatureOffset {
    fn id(&self) -> &'static str {
        "temperature_offset"
    }

    fn words(&self) -> &'static str {
        "a zero that moves with temperature"
    }

    fn remedy(&self) -> &'static str {
        "compensate the zero by the measured temperature"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_temperature(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        every_channel(session)
    }

    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[("lag_s", "s")]
    }

    fn shapes(&self, session: &Session, _place: Place) -> Vec<Shape> {
        let lags_s = match (session.step_s(), session.longest_s()) {
            (Some(step_s), Some(longest_s)) => {
                geometric(2.0 * step_s, (longest_s / 10.0).max(4.0 * step_s), 7)
            }
            _ => Vec::new(),
        };
        std::iter::once(vec![0.0]).chain(lags_s).collect()
    }

    fn is_continuous(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let Some(temperature) = session.temperature_of(channel) else { return Vec::new() };
        let span = deviation(temperature);
        if span <= 0.0 {
            return Vec::new();
        }
        let slow = lagged(session, temperature, shape[0]);
        let reference = mean(&slow);
        let plausible = (0.005 * own.extent()).max(3.0 * own.rms_gap() / span);
        // The temperature of the calibration is not known: a constant comes along.
        vec![
            Column::value(
                "per_k",
                &format!("{}/K", own.unit),
                plausible,
                channel,
                slow.iter().map(|t| t - reference).collect(),
            ),
            Column::value("", &own.unit, plausible * span, channel, vec![1.0; session.rows()])
                .role(Role::Nuisance),
        ]
    }

    fn compensate(&self, session: &Session, term: &Fitted<'_>) -> Vec<Compensation> {
        let Place::Channel(gauge) = term.place else { return Vec::new() };
        let (Some(temperature), [per_k, constant]) = (session.temperature_of(gauge), term.values) else {
            return Vec::new();
        };
        let lag_s = term.shape[0].max(session.step_s().unwrap_or(1e-3));
        let reference_c = mean(&lagged(session, temperature, term.shape[0]));
        let own = &session.channels[gauge];
        vec![
            Compensation::Bias { gauge, counts: *constant },
            Compensation::Term {
                gauge,
                effect: model::terms::Effect::Temperature { lag_s, reference_c },
                counts: *per_k,
                scaling: [0.0, own.extent()],
            },
        ]
    }

    fn experiment(&self) -> &'static str {
        "the same load while the room warms and cools again"
    }
}
