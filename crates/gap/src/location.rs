//! Where the gap lies: by channel, time, temperature, joint angle, speed, load, before and after.

use std::collections::BTreeMap;

use crate::attribute::Chosen;
use crate::diagnosis::{Bin, Location, Raw, SensorByJoint, SensorGap};
use crate::fit::Design;
use crate::library::Library;
use crate::session::{Channel, Session};

const BINS: usize = 10;

/// The gap by place, and pooled in the channels' own unit.
pub(crate) struct Located {
    pub(crate) location: Location,
    pub(crate) raw: Raw,
    /// Per channel the mean square over its scale that noise leaves.
    pub(crate) floors: Vec<f64>,
    pub(crate) left: Residuals,
}

/// Per channel and row what is left over its scale; none where the row was not scored.
pub(crate) type Residuals = Vec<Vec<Option<f64>>>;

/// Takes the gap of left-out rows apart.
pub(crate) fn locate(library: &Library<'_>, chosen: &[Chosen]) -> Located {
    let session = library.session;
    let after = residuals(library, chosen);
    let before: Residuals = session
        .channels
        .iter()
        .zip(&after)
        .map(|(channel, after)| {
            let gap = channel.gap.iter().zip(after);
            gap.map(|(gap, scored)| scored.map(|_| gap / channel.scale)).collect()
        })
        .collect();
    let floors: Vec<f64> = session
        .channels
        .iter()
        .zip(&after)
        .map(|(channel, after)| {
            let told = channel.floor * channel.floor;
            // More than that is no noise, but something that did not repeat.
            from_repeats(session, after).map_or(told, |repeats| repeats.min(MOST_OVER_TOLD * told))
        })
        .collect();
    let sensors: Vec<SensorGap> = session
        .channels
        .iter()
        .zip(before.iter().zip(&after))
        .zip(&floors)
        .map(|((channel, (before, after)), floor)| sensor(channel, [rms(before), rms(after)], floor.sqrt()))
        .collect();
    let raw = pooled(&session.channels, &sensors);
    let profiles = profiles(session, &before, &after);
    let sensor_by_joint = by_joint(session, &before, &after);
    let location = Location { sensors, sensor_by_joint, loops: Vec::new(), profiles };
    Located { location, raw, floors, left: after }
}

/// Time over which repeats are compared after taking out what differs between them at large (s): drift, creep and temperature do not
/// repeat, but are no noise.
const WINDOW_S: f64 = 10.0;

/// What repeats differ by is noise up to so many times what was foretold (mean squares).
const MOST_OVER_TOLD: f64 = 1.5;

/// Mean square that noise leaves of a channel, from what its repeats differ by; none where there are no repeats.
fn from_repeats(session: &Session, after: &[Option<f64>]) -> Option<f64> {
    let window = (WINDOW_S / session.step_s()?).max(2.0) as usize;
    let (mut squares, mut freedom) = (0.0, 0.0);
    for (a, b) in &session.repeats {
        let differences: Vec<Option<f64>> =
            a.clone().zip(b.clone()).map(|(a, b)| Some(after[a]? - after[b]?)).collect();
        for part in differences.chunks(window) {
            let known: Vec<f64> = part.iter().flatten().copied().collect();
            if known.len() > 1 {
                let mean = known.iter().sum::<f64>() / known.len() as f64;
                squares += known.iter().map(|d| (d - mean) * (d - mean)).sum::<f64>() / 2.0;
                freedom += known.len() as f64 - 1.0;
            }
        }
    }
    (freedom > 0.0).then(|| squares / freedom)
}

fn sensor(channel: &Channel, [before, after]: [f64; 2], floor: f64) -> SensorGap {
    SensorGap {
        name: channel.name.clone(),
        before,
        after,
        floor,
        before_raw: before * channel.scale,
        after_raw: after * channel.scale,
        unit: channel.unit.clone(),
    }
}

/// What the chosen terms leave on left-out rows.
pub(crate) fn residuals(library: &Library<'_>, chosen: &[Chosen]) -> Residuals {
    let session = library.session;
    let mut out: Residuals = vec![vec![None; session.rows()]; session.channels.len()];
    for part in chosen {
        let design = Design::new(library, &part.terms);
        let parameters = design.solve_fold(&part.fold);
        let mut scored = vec![false; session.blocks()];
        part.fold.score.iter().for_each(|block| scored[*block] = true);
        let rows: Vec<usize> =
            (0..session.rows()).filter(|row| scored[session.hold_out.block_of_row[*row]]).collect();
        for (channel, left) in session.channels.iter().zip(&mut out) {
            let read = rows.iter().filter(|row| channel.is_read(**row));
            read.for_each(|row| left[*row] = Some(channel.gap[*row] / channel.scale));
        }
        for (index, id) in part.terms.iter().enumerate() {
            for (k, column) in library.columns(*id).iter().enumerate() {
                let parameter = parameters[design.offsets[index] + k];
                for part in &column.parts {
                    let first = rows.partition_point(|row| *row < part.first);
                    let shown = rows[first..].iter().map(|row| (*row, row - part.first));
                    for (row, value) in shown.map_while(|(row, k)| Some((row, part.values.get(k)?))) {
                        if let Some(left) = &mut out[part.channel][row] {
                            *left -= parameter * value;
                        }
                    }
                }
            }
        }
    }
    out
}

/// Squared residual on left-out rows by channel.
pub(crate) fn by_channel(library: &Library<'_>, chosen: &[Chosen]) -> Vec<f64> {
    let squares = |left: Vec<Option<f64>>| left.into_iter().flatten().map(|value| value * value).sum();
    residuals(library, chosen).into_iter().map(squares).collect()
}

fn rms(values: &[Option<f64>]) -> f64 {
    let (sum, count) = values.iter().flatten().fold((0.0, 0.0), |(s, n), v| (s + v * v, n + 1.0));
    (sum / f64::max(count, 1.0)).sqrt()
}

fn pooled(channels: &[Channel], sensors: &[SensorGap]) -> Raw {
    let has_length = channels.iter().any(|channel| channel.raw_factor != 1.0);
    let first = &channels[0].unit;
    let alike = channels.iter().all(|channel| &channel.unit == first);
    if !alike && !has_length {
        return Raw { before: None, after: None, unit: None };
    }
    let pool = |of: &dyn Fn(&SensorGap) -> f64| {
        let squares = channels.iter().zip(sensors).map(|(c, s)| (of(s) * c.raw_factor).powi(2));
        (squares.sum::<f64>() / channels.len() as f64).sqrt()
    };
    Raw {
        before: Some(pool(&|s| s.before_raw)),
        after: Some(pool(&|s| s.after_raw)),
        unit: Some(if alike { first.clone() } else { "N".to_owned() }),
    }
}

/// The gap over each quantity that is known at every instant.
fn profiles(session: &Session, before: &Residuals, after: &Residuals) -> BTreeMap<String, Vec<Bin>> {
    let mut profiles: BTreeMap<String, Vec<Bin>> = BTreeMap::new();
    let every: Vec<usize> = (0..session.channels.len()).collect();
    let mut add = |key: &str, name: &str, unit: &str, values: &[f64], channels: &[usize]| {
        profiles.entry(key.to_owned()).or_default().extend(bins(name, unit, values, channels, before, after));
    };
    if let Some(time_s) = &session.time_s {
        add("time", "time", "s", time_s, &every);
    }
    if let Some(temperature) = &session.temperature {
        add("temperature", &temperature.name, "degC", &temperature.values, &every);
    }
    for (index, channel) in session.channels.iter().enumerate() {
        if let Some(temperature_c) = channel.gauge.as_ref().and_then(|gauge| gauge.temperature_c.as_ref()) {
            add("temperature", &channel.name, "degC", temperature_c, &[index]);
        }
    }
    for load in &session.loads {
        add("load", &load.name, "", &load.values, &every);
    }
    for (index, channel) in session.channels.iter().enumerate().filter(|(_, channel)| channel.gauge.is_some())
    {
        add("load", &channel.name, &channel.unit, &channel.simulated, &[index]);
    }
    for (index, joint) in session.joints.iter().enumerate() {
        let own: Vec<usize> =
            every.iter().copied().filter(|c| session.channels[*c].joint == Some(index)).collect();
        let channels = if own.is_empty() { &every } else { &own };
        add("joint", &joint.name, "rad", &joint.position_rad, channels);
        if let Some(velocity) = &joint.velocity_rad_s {
            add("speed", &joint.name, "rad/s", velocity, channels);
        }
    }
    if let Some(bands) = frequencies(session, before, after) {
        profiles.insert("frequency".to_owned(), bands);
    }
    let orders = crate::orders::bands(session, before, after);
    if !orders.is_empty() {
        profiles.insert("order".to_owned(), orders);
    }
    profiles
}

/// Lowest frequency of the bands, Hz; each band is an octave.
const LOWEST_HZ: f64 = 0.1;

/// The gap by octaves of frequency, over all channels; none where there is no time or nothing above the lowest octave.
fn frequencies(session: &Session, before: &Residuals, after: &Residuals) -> Option<Vec<Bin>> {
    let nyquist_hz = 0.5 / session.step_s()?;
    let octaves = (nyquist_hz / LOWEST_HZ).log2().floor().max(0.0) as i32;
    let mut edges_hz = vec![0.0];
    edges_hz.extend((0..=octaves).map(|k| LOWEST_HZ * 2.0_f64.powi(k)));
    *edges_hz.last_mut().filter(|_| octaves > 0)? = nyquist_hz;
    let of = |residuals: &Residuals| {
        let mut sums = vec![0.0; edges_hz.len() - 1];
        for left in residuals {
            let values: Vec<f64> = left.iter().map(|value| value.unwrap_or(0.0)).collect();
            let pieces: Vec<&[f64]> = session.segments.iter().map(|rows| &values[rows.clone()]).collect();
            let bands = crate::spectrum::bands(&pieces, 2.0 * nyquist_hz, &edges_hz);
            sums.iter_mut().zip(bands).for_each(|(sum, band)| *sum += band);
        }
        sums.into_iter().map(|sum| (sum / residuals.len().max(1) as f64).sqrt()).collect::<Vec<f64>>()
    };
    let (before, after) = (of(before), of(after));
    let bin = |k: usize| Bin {
        name: "frequency".to_owned(),
        from: edges_hz[k],
        to: edges_hz[k + 1],
        unit: "Hz".to_owned(),
        before: before[k],
        after: after[k],
    };
    Some((0..before.len()).map(bin).collect())
}

/// How much of each channel's gap goes with each joint's angle.
fn by_joint(session: &Session, before: &Residuals, after: &Residuals) -> Vec<SensorByJoint> {
    let mut out = Vec::with_capacity(session.joints.len() * session.channels.len());
    for joint in &session.joints {
        let mut order: Vec<usize> = (0..session.rows()).collect();
        order.sort_by(|a, b| joint.position_rad[*a].total_cmp(&joint.position_rad[*b]));
        let intervals: Vec<&[usize]> = order.chunks(order.len().div_ceil(BINS).max(1)).collect();
        for (index, channel) in session.channels.iter().enumerate() {
            out.push(SensorByJoint {
                sensor: channel.name.clone(),
                joint: joint.name.clone(),
                before: correlation_ratio(&before[index], &intervals),
                after: correlation_ratio(&after[index], &intervals),
            });
        }
    }
    out
}

/// Share of the mean square that lies in the means over intervals of rows; 0 of nothing.
fn correlation_ratio(values: &[Option<f64>], intervals: &[&[usize]]) -> f64 {
    let (mut between, mut all) = (0.0, 0.0);
    for rows in intervals {
        let known = || rows.iter().filter_map(|row| values[*row]);
        let (sum, squares) = known().fold((0.0, 0.0), |(sum, squares), v| (sum + v, squares + v * v));
        between += sum * sum / known().count().max(1) as f64;
        all += squares;
    }
    if all > 0.0 { between / all } else { 0.0 }
}

/// Intervals of a quantity with equally many scored rows.
fn bins(
    name: &str,
    unit: &str,
    values: &[f64],
    channels: &[usize],
    before: &Residuals,
    after: &Residuals,
) -> Vec<Bin> {
    if channels.is_empty() {
        return Vec::new();
    }
    let scored = |row: &usize| channels.iter().any(|channel| after[*channel][*row].is_some());
    let mut rows: Vec<usize> = (0..values.len()).filter(scored).collect();
    rows.sort_by(|a, b| values[*a].total_cmp(&values[*b]));
    let count = BINS.min(rows.len());
    let mut out = Vec::with_capacity(count);
    for k in 0..count {
        let part = &rows[rows.len() * k / count..rows.len() * (k + 1) / count];
        let (Some(&low), Some(&high)) = (part.first(), part.last()) else { continue };
        let of = |residuals: &Residuals| {
            let mut all = Vec::with_capacity(part.len() * channels.len());
            channels.iter().for_each(|c| all.extend(part.iter().map(|row| residuals[*c][*row])));
            rms(&all)
        };
        out.push(Bin {
            name: name.to_owned(),
            from: values[low],
            to: values[high],
            unit: unit.to_owned(),
            before: of(before),
            after: of(after),
        });
    }
    out
}
