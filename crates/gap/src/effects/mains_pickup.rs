//! A sine of fixed frequency: mains, or its alias `|f - k fs|`.

use super::*;

/// A sine of fixed frequency: mains, or its alias `|f - k fs|`.
pub(super) struct MainsPickup;

impl Effect for MainsPickup {
    fn id(&self) -> &'static str {
        "mains_pickup"
    }

    fn words(&self) -> &'static str {
        "a sine picked up from the mains or a machine"
    }

    fn remedy(&self) -> &'static str {
        "shield and ground the cable, or sample at a multiple of the mains period"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        session.step_s().is_none().then(|| NO_TIME.to_owned())
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        every_channel(session)
    }

    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[("hz", "Hz")]
    }

    fn shapes(&self, session: &Session, _place: Place) -> Vec<Shape> {
        let (Some(step_s), Some(longest_s)) = (session.step_s(), session.longest_s()) else {
            return Vec::new();
        };
        // A frequency is only a mains' if it can be told from slow motion: several tens of periods in the recording.
        let nyquist_hz = 0.5 / step_s;
        let aliases = [50.0, 60.0, 100.0, 120.0].map(|hz: f64| {
            let folded = hz.rem_euclid(2.0 * nyquist_hz);
            folded.min(2.0 * nyquist_hz - folded)
        });
        let seen = aliases.iter().filter(|hz| **hz * longest_s > 30.0 && **hz < 0.98 * nyquist_hz);
        seen.map(|hz| vec![*hz]).collect()
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let Some(time_s) = &session.time_s else { return Vec::new() };
        let turn = |t_s: &f64| std::f64::consts::TAU * shape[0] * t_s;
        let plausible = 3.0 * own.rms_gap();
        let sine = Column::value(
            "amplitude",
            &own.unit,
            plausible,
            channel,
            time_s.iter().map(|t| turn(t).sin()).collect(),
        );
        let cosine =
            Column { parts: vec![(channel, time_s.iter().map(|t| turn(t).cos()).collect())], ..sine.clone() };
        vec![sine.role(Role::Sine), cosine.role(Role::Cosine)]
    }

    fn experiment(&self) -> &'static str {
        "a recording with the drives off"
    }
}
