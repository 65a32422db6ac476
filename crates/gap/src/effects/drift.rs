//! A slow change with time alone: an approach to another value since the recording began, or a straight line.

use super::*;

/// A slow change with time alone: an approach to another value since the recording began, or a straight line.
pub(super) struct Drift;

impl Effect for Drift {
    fn id(&self) -> &'static str {
        "drift"
    }

    fn words(&self) -> &'static str {
        "a slow change with time alone"
    }

    fn remedy(&self) -> &'static str {
        "let the electronics warm up; tare from time to time"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        session.step_s().is_none().then(|| NO_TIME.to_owned())
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        every_channel(session)
    }

    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[("tau_s", "s")]
    }

    fn shapes(&self, session: &Session, _place: Place) -> Vec<Shape> {
        let Some(longest_s) = session.longest_s() else { return Vec::new() };
        let times = geometric(0.1 * longest_s, 3.0 * longest_s, 5);
        // Where recordings tell when their session began, the drift began there, from nothing.
        let kinds = if is_of_runs(session) { &[FROM_NOTHING, FROM_ANYWHERE][..] } else { &[FROM_ANYWHERE] };
        kinds.iter().flat_map(|kind| times.iter().map(|tau| vec![tau[0], *kind])).collect()
    }

    fn is_continuous(&self) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let Some(time_s) = &session.time_s else { return Vec::new() };
        let mut values = vec![0.0; session.rows()];
        for (rows, began_s) in session.segments.iter().zip(&session.began_s) {
            rows.clone().for_each(|row| values[row] = -(-(time_s[row] - began_s) / shape[0]).exp_m1());
        }
        let plausible = (0.05 * own.extent()).max(3.0 * own.rms_gap());
        let amplitude = Column::value("amplitude", &own.unit, plausible, channel, values);
        if shape[1] == FROM_NOTHING {
            return vec![amplitude];
        }
        let constant =
            Column::value("", &own.unit, plausible, channel, vec![1.0; session.rows()]).role(Role::Nuisance);
        vec![amplitude, constant]
    }

    fn experiment(&self) -> &'static str {
        "the same load and pose held for an hour"
    }
}

/// The drift is nothing when the session begins.
const FROM_NOTHING: f64 = 0.0;
/// It comes with a constant.
const FROM_ANYWHERE: f64 = 1.0;

fn is_of_runs(session: &Session) -> bool {
    session.channels.iter().any(|channel| channel.gauge.is_some())
}
