//! A sine of fixed frequency: mains, or its alias `|f - k fs|`. In runs, whose clocks and pauses nobody knows, the frequency is
//! free (lines of the gap's spectrum) and the phase is each run's own.

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

    fn shapes(&self, session: &Session, place: Place) -> Vec<Shape> {
        let (Some(step_s), Some(longest_s)) = (session.step_s(), session.longest_s()) else {
            return Vec::new();
        };
        let Place::Channel(channel) = place else { return Vec::new() };
        if session.channels[channel].gauge.is_some() {
            return lines(session, channel, step_s);
        }
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
        if own.gauge.is_some() {
            return by_unit(session, channel, plausible, &turn);
        }
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

    fn report(&self, session: &Session, term: &Fitted<'_>) -> Option<Vec<Reported>> {
        let Place::Channel(channel) = term.place else { return None };
        let own = &session.channels[channel];
        own.gauge.as_ref()?;
        let units = (term.values.len() / 2).max(1) as f64;
        let mean_square = |values: &[f64]| values.iter().map(|value| value * value).sum::<f64>() / units;
        let amplitude = mean_square(term.values).sqrt();
        let sigma = (mean_square(term.sigmas) / 2.0 / units).sqrt();
        Some(vec![("amplitude".to_owned(), amplitude, Some(sigma), own.unit.clone())])
    }

    fn experiment(&self) -> &'static str {
        "a recording with the drives off"
    }
}

/// Slower than this is motion, Hz.
const SLOWEST_HZ: f64 = 4.0;
/// Lines of a spectrum that are tried.
const LINES: usize = 2;

fn lines(session: &Session, channel: usize, step_s: f64) -> Vec<Shape> {
    let own = &session.channels[channel];
    let pieces: Vec<&[f64]> = session.segments.iter().map(|rows| &own.gap[rows.clone()]).collect();
    let found = crate::spectrum::lines_hz(&pieces, step_s, SLOWEST_HZ, LINES);
    // A little beside the line on either side, so that it can be searched between.
    let width_hz = session.longest_s().map_or(0.0, |longest_s| 0.25 / longest_s);
    found.into_iter().flat_map(|hz| [hz - width_hz, hz, hz + width_hz]).map(|hz| vec![hz]).collect()
}

/// A sine and a cosine for every unit.
fn by_unit(session: &Session, channel: usize, plausible: f64, turn: &impl Fn(&f64) -> f64) -> Vec<Column> {
    let Some(time_s) = &session.time_s else { return Vec::new() };
    let own = &session.channels[channel];
    let hold_out = &session.hold_out;
    let mut columns = Vec::new();
    for unit in 0..hold_out.units.len() {
        let is_here = |row: usize| hold_out.unit_of_block[hold_out.block_of_row[row]] == unit;
        for function in [f64::sin, f64::cos] {
            let value = |(row, t_s): (usize, &f64)| if is_here(row) { function(turn(t_s)) } else { 0.0 };
            let values = time_s.iter().enumerate().map(value).collect();
            let column = Column::value("", &own.unit, plausible, channel, values);
            columns.push(Column { unit_only: Some(unit), ..column });
        }
    }
    columns
}
