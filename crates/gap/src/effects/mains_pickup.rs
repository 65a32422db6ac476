//! A sine of fixed frequency: mains, or its alias `|f - k fs|`. In runs, whose clocks and pauses nobody knows, the frequency is
//! free (lines of the gap's spectrum) and the phase is each stretch's own.

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
            return lines(session, channel);
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
            return by_stretch(session, channel, plausible, &turn);
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
/// Steps longer than so many usual ones are a gap.
const GAP: f64 = 1.5;
/// Turns by which neighbouring frequencies of a search differ over the longest stretch, and between the shapes that are tried.
const FINE_TURNS: f64 = 0.1;

/// Frequencies (Hz) of the gap's strongest lines: from spectra of what was sampled evenly, then by the stamps themselves, since the
/// phase must hold over all of a stretch; each with a little less and a little more, so that it can be searched between.
fn lines(session: &Session, channel: usize) -> Vec<Shape> {
    let (Some(time_s), Some(usual_s)) = (&session.time_s, session.step_s()) else { return Vec::new() };
    let gap = &session.channels[channel].gap;
    let pieces = evenly_sampled(session, time_s, GAP * usual_s);
    let steps = pieces.iter().map(|rows| rows.len() - 1).sum::<usize>().max(1);
    // Stamps scatter: the mean step is exact, the median of them is off by more than a line is wide.
    let step_s =
        pieces.iter().map(|rows| time_s[rows.end - 1] - time_s[rows.start]).sum::<f64>() / steps as f64;
    let values: Vec<&[f64]> = pieces.iter().map(|rows| &gap[rows.clone()]).collect();
    let longest_s = pieces.iter().map(std::ops::Range::len).max().unwrap_or(0) as f64 * step_s;
    let stretches = stretches(session);
    let length_s = |(_, rows): &(usize, std::ops::Range<usize>)| time_s[rows.end - 1] - time_s[rows.start];
    let fine_hz = FINE_TURNS / stretches.iter().map(length_s).fold(longest_s, f64::max).max(step_s);
    let mut shapes = Vec::new();
    for coarse_hz in crate::spectrum::lines_hz(&values, step_s, SLOWEST_HZ, LINES) {
        let tried = (0.5 / longest_s / fine_hz).ceil() as i64;
        let power = |step: &i64| -> f64 {
            let turn = std::f64::consts::TAU * (coarse_hz + *step as f64 * fine_hz);
            stretches.iter().map(|(_, rows)| power_at(turn, &time_s[rows.clone()], &gap[rows.clone()])).sum()
        };
        let powers: Vec<(f64, i64)> = (-tried..=tried).map(|step| (power(&step), step)).collect();
        let best = powers.iter().max_by(|a, b| a.0.total_cmp(&b.0)).map_or(0, |(_, step)| *step);
        let near = |step: i64| vec![coarse_hz + step as f64 * fine_hz];
        shapes.extend([best - 1, best, best + 1].map(near));
    }
    shapes
}

/// Stretches of rows that are no further apart than `gap_s`.
fn evenly_sampled(session: &Session, time_s: &[f64], gap_s: f64) -> Vec<std::ops::Range<usize>> {
    let segments = session.segments.iter().filter(|rows| !rows.is_empty());
    let pieces = segments.flat_map(|rows| {
        let is_gap = |row: &usize| time_s[*row] - time_s[*row - 1] > gap_s;
        let cuts = (rows.start + 1..rows.end).filter(is_gap);
        let starts: Vec<usize> = std::iter::once(rows.start).chain(cuts).collect();
        let ends = starts.iter().skip(1).copied().chain([rows.end]).collect::<Vec<_>>();
        starts.into_iter().zip(ends).map(|(from, to)| from..to)
    });
    pieces.collect()
}

/// Units and rows of what lies together and in one unit: over these a phase holds.
fn stretches(session: &Session) -> Vec<(usize, std::ops::Range<usize>)> {
    let unit = |row: usize| session.hold_out.unit_of_block[session.hold_out.block_of_row[row]];
    let mut out: Vec<(usize, std::ops::Range<usize>)> = Vec::new();
    for rows in &session.segments {
        for row in rows.clone() {
            match out.last_mut() {
                Some((own, last)) if row > rows.start && *own == unit(row) => last.end = row + 1,
                _ => out.push((unit(row), row..row + 1)),
            }
        }
    }
    out
}

/// `|sum of g exp(-i turn t)|^2` (turn in rad/s).
fn power_at(turn: f64, time_s: &[f64], gap: &[f64]) -> f64 {
    let add = |(re, im): (f64, f64), (t_s, value): (&f64, &f64)| {
        let (sin, cos) = (turn * t_s).sin_cos();
        (re + value * cos, im + value * sin)
    };
    let (re, im) = time_s.iter().zip(gap).fold((0.0, 0.0), add);
    re * re + im * im
}

/// A sine and a cosine for every stretch.
fn by_stretch(session: &Session, channel: usize, plausible: f64, turn: &impl Fn(&f64) -> f64) -> Vec<Column> {
    let Some(time_s) = &session.time_s else { return Vec::new() };
    let own = &session.channels[channel];
    let mut columns = Vec::new();
    for (unit, rows) in stretches(session) {
        for function in [f64::sin, f64::cos] {
            let mut values = vec![0.0; session.rows()];
            for row in rows.clone() {
                values[row] = function(turn(&time_s[row]));
            }
            let column = Column::value("", &own.unit, plausible, channel, values);
            columns.push(Column { unit_only: Some(unit), ..column });
        }
    }
    columns
}
