//! Single readings far from their neighbours: a loose contact, a disturbed transfer.
//!
//! Judged by the median of the neighbourhood (J. Tukey's running medians, Exploratory Data Analysis, 1977): a reading that departs
//! from it by many times what readings usually do is one. When spikes come is not to be foretold; that they are taken out by the
//! same rule on data left out is what counts.

use super::*;

/// Single readings far off.
pub(super) struct Spikes;

/// Neighbours to each side.
const REACH: usize = 3;
/// A spike departs from the median of its neighbourhood by so many times what readings usually do.
const FAR: [f64; 3] = [6.5, 9.0, 13.0];
/// Fewer than so many in all recordings are no fault of the sensor.
const FEWEST: usize = 10;
/// And by more than so many of the sensor's steps.
const STEPS: f64 = 2.5;
/// Median magnitude of a Gaussian number over its standard deviation.
const MEDIAN_MAGNITUDE: f64 = 0.674_489_75;

impl Effect for Spikes {
    fn id(&self) -> &'static str {
        "spikes"
    }

    fn words(&self) -> &'static str {
        "single readings far from their neighbours"
    }

    fn remedy(&self) -> &'static str {
        "look for loose contacts; leave such readings out"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        let known = session.channels.iter().any(|channel| channel.gauge.is_some());
        (!known).then(|| "single instants as they were sampled (a run with its model)".to_owned())
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        every_channel(session)
    }

    fn shapes(&self, _session: &Session, _place: Place) -> Vec<Shape> {
        FAR.map(|far| vec![far]).to_vec()
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let Place::Channel(channel) = place else { return Vec::new() };
        if session.channels[channel].gauge.is_none() {
            return Vec::new();
        }
        let spikes = departures(session, channel, shape[0]);
        let count = spikes.iter().filter(|value| **value != 0.0).count();
        if count < FEWEST { Vec::new() } else { vec![Column::pinned(channel, spikes)] }
    }

    fn report(&self, session: &Session, term: &Fitted<'_>) -> Option<Vec<Reported>> {
        let Place::Channel(channel) = term.place else { return None };
        let own = &session.channels[channel];
        let spikes: Vec<f64> =
            departures(session, channel, term.shape[0]).into_iter().filter(|value| *value != 0.0).collect();
        let span_s = session.step_s()? * own.count() as f64;
        let count = spikes.len() as f64;
        Some(vec![
            ("rate_hz".to_owned(), count / span_s, Some(count.sqrt() / span_s), "Hz".to_owned()),
            ("amplitude".to_owned(), crate::session::rms(&spikes), None, own.unit.clone()),
        ])
    }

    fn experiment(&self) -> &'static str {
        "a recording at rest: spikes come there too"
    }
}

/// How far every spike is from the median of its neighbours (channel's unit); 0 at all other rows.
fn departures(session: &Session, channel: usize, far: f64) -> Vec<f64> {
    let own = &session.channels[channel];
    let mut values = vec![0.0; session.rows()];
    let mut around = Vec::with_capacity(2 * REACH);
    for rows in &session.segments {
        for row in rows.clone().filter(|row| own.is_read(*row)) {
            around.clear();
            let near = row.saturating_sub(REACH).max(rows.start)..(row + REACH + 1).min(rows.end);
            around.extend(near.filter(|k| *k != row && own.is_read(*k)).map(|k| own.gap[k]));
            values[row] = if around.len() < REACH { 0.0 } else { own.gap[row] - median(&mut around) };
        }
    }
    let read = values.iter().enumerate().filter(|(row, _)| own.is_read(*row));
    let mut sizes: Vec<f64> = read.map(|(_, value)| value.abs()).collect();
    let usual = median(&mut sizes) / MEDIAN_MAGNITUDE;
    // Where a signal in coarse steps goes from one to the next is no spike.
    let step = readings::resolution(session, channel).unwrap_or(0.0);
    let beyond = (far * usual).max(STEPS * step);
    let is_far = |row: usize| values[row].abs() > beyond;
    let is_spike = |row: usize| is_far(row) && is_alone(session, own, row, &is_far);
    (0..values.len()).map(|row| if is_spike(row) { values[row] } else { 0.0 }).collect()
}

/// Whether at most one of the readings nearby is far off too, and all were usable: what lasts longer is motion or load.
fn is_alone(
    session: &Session,
    own: &crate::session::Channel,
    row: usize,
    is_far: &impl Fn(usize) -> bool,
) -> bool {
    let near = row.saturating_sub(REACH)..(row + REACH + 1).min(session.rows());
    near.clone().all(|k| own.is_read(k)) && near.filter(|k| is_far(*k)).count() <= 2
}

fn median(values: &mut [f64]) -> f64 {
    let middle = values.len() / 2;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(middle, f64::total_cmp).1 }
}
