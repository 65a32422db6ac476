//! What gauges may add to their readings: the candidates, and their regressors in every row.

use model::terms::{Conditioner, Effect, GaugeTerms, MOST_TERMS, Regressors, Term};

use super::rows::Row;
use crate::gauges::in_parallel;
use crate::recording::Recording;

/// Effects that are admitted or left out together, gauge by gauge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// Drift with lagged temperature.
    Temperature,
    /// Plays of several widths.
    Hysteresis,
    /// Lags of several times.
    Creep,
    /// Square and cube.
    Nonlinearity,
}

impl Family {
    /// All families.
    pub const ALL: [Self; 4] = [Self::Temperature, Self::Hysteresis, Self::Creep, Self::Nonlinearity];

    /// The family's name in messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Temperature => "temperature",
            Self::Hysteresis => "hysteresis",
            Self::Creep => "creep",
            Self::Nonlinearity => "nonlinearity",
        }
    }

    /// Where its effects stand among the candidates.
    pub fn range(self) -> std::ops::Range<usize> {
        match self {
            Self::Temperature => 0..1,
            Self::Hysteresis => 1..4,
            Self::Creep => 4..7,
            Self::Nonlinearity => 7..9,
        }
    }
}

/// Lags that are tried between thermometer and gauge, s.
pub const LAGS_S: [f64; 14] =
    [4.0, 8.0, 14.0, 20.0, 27.0, 35.0, 45.0, 56.0, 70.0, 90.0, 120.0, 160.0, 220.0, 300.0];

/// Where the search for the lag begins (index).
pub const FIRST_LAG: usize = 7;

/// The candidates. Plays and relaxations are spread by factors of three to four: sums of such come near any smooth hysteresis
/// and any creep between seconds and minutes. Slower relaxations are no candidates: over a recording of half an hour they look like
/// drift, and what is wrongly taken for one is carried into every other day.
pub fn candidates(lag_s: f64, reference_c: f64) -> [Effect; MOST_TERMS] {
    [
        Effect::Temperature { lag_s, reference_c },
        Effect::Hysteresis { width: 0.02 },
        Effect::Hysteresis { width: 0.06 },
        Effect::Hysteresis { width: 0.18 },
        Effect::Creep { tau_s: 4.0 },
        Effect::Creep { tau_s: 16.0 },
        Effect::Creep { tau_s: 64.0 },
        Effect::Power { order: 2 },
        Effect::Power { order: 3 },
    ]
}

/// Share of its typical size by which a state may be off after a start: an arm that is switched on has mostly rested where it is,
/// which settles its creep and leaves its hysteresis somewhere inside its loop.
const REST_SHARE: f64 = 0.5;

/// Prior standard deviation of a candidate's strength as a share of the gauge's scale: the upper end of what cheap gauges do.
pub fn width(effect: &Effect) -> f64 {
    match effect {
        // 0.05..0.5 % of range per K.
        Effect::Temperature { .. } => 0.01,
        // 0.02..2 % of range each.
        Effect::Hysteresis { .. } | Effect::Power { .. } => 0.02,
        Effect::Creep { .. } => 0.01,
    }
}

/// Regressors of one gauge in every row, and their typical size (RMS over the rows about nothing; against the present for lags).
#[derive(Clone, Debug)]
pub struct Values {
    /// Mean of each regressor in each row.
    pub rows: Vec<Regressors>,
    /// How far each state may be from what it starts as.
    pub start_sigma: Regressors,
}

/// Runs a gauge's conditioner over all recordings, on temperatures that were lagged by `ahead_s` before (0: as recorded).
pub fn values(
    recordings: &[Recording],
    rows: &[Row],
    gauge: usize,
    (centre_counts, scale_counts): (f64, f64),
    effects: &[Effect; MOST_TERMS],
    ahead_s: f64,
) -> Values {
    let term = |effect: &Effect| Term { effect: *effect, coefficient_counts: 0.0, start_sigma: 0.0 };
    let terms = GaugeTerms { centre_counts, scale_counts, terms: effects.iter().map(term).collect() };
    let mut out = vec![[0.0; MOST_TERMS]; rows.len()];
    let mut squares = [0.0; MOST_TERMS];
    let mut n = 0.0;
    for (index, recording) in recordings.iter().enumerate() {
        let mut conditioner = Conditioner::new(&terms);
        let mine: Vec<usize> = (0..rows.len()).filter(|k| rows[*k].recording == index).collect();
        let mut next = mine.iter().copied().peekable();
        let mut ahead = Ahead { lag_s: ahead_s, last: None };
        for k in 0..recording.len() {
            let temperature =
                recording.temperatures_c[gauge][k].map(|t_c| ahead.follow(recording.at_ns[k], t_c));
            conditioner.push(recording.at_ns[k], recording.counts[gauge][k], temperature);
            let regressors = conditioner.regressors();
            n += 1.0;
            for (slot, effect) in effects.iter().enumerate() {
                let apart = match effect {
                    Effect::Temperature { reference_c, .. } => {
                        temperature.map_or(0.0, |t| t - reference_c - regressors[slot])
                    }
                    _ => regressors[slot],
                };
                squares[slot] += apart * apart;
            }
            while next.peek().is_some_and(|row| rows[*row].instants.1 <= k) {
                next.next();
            }
            if let Some(row) = next.peek().copied().filter(|row| rows[*row].instants.0 <= k) {
                let (from, to) = rows[row].instants;
                for (sum, value) in out[row].iter_mut().zip(regressors) {
                    *sum += value / (to - from) as f64;
                }
            }
        }
    }
    Values { rows: out, start_sigma: squares.map(|s| REST_SHARE * f64::sqrt(s / f64::max(n, 1.0))) }
}

/// A lag between a thermometer and where the gauge's own lag begins.
struct Ahead {
    lag_s: f64,
    /// Instant (ns) and temperature behind the lag, degC.
    last: Option<(i64, f64)>,
}

impl Ahead {
    fn follow(&mut self, at_ns: i64, temperature_c: f64) -> f64 {
        let behind_c = match self.last {
            Some((last_ns, last_c)) if self.lag_s > 0.0 => {
                let share = -((last_ns - at_ns) as f64 * 1e-9 / self.lag_s).exp_m1();
                last_c + share * (temperature_c - last_c)
            }
            _ => temperature_c,
        };
        self.last = Some((at_ns, behind_c));
        behind_c
    }
}

/// Middle and half-width of a gauge's still readings, counts.
pub fn scale(rows: &[Row], gauge: usize) -> (f64, f64) {
    let counts: Vec<f64> = rows.iter().filter_map(|row| Some(row.readings[gauge]?.counts)).collect();
    let low = counts.iter().copied().fold(f64::INFINITY, f64::min);
    let high = counts.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    (crate::gauges::median(&counts), (0.5 * (high - low)).max(1.0))
}

/// The candidates of all gauges with their values; each gauge has its own lag (s), behind one of `ahead_s` that all have.
pub fn all(
    recordings: &[Recording],
    rows: &[Row],
    lags_s: &[f64],
    reference_c: &[f64],
    ahead_s: f64,
) -> Vec<([Effect; MOST_TERMS], Values, (f64, f64))> {
    in_parallel(lags_s.len(), |gauge| {
        let effects = candidates(lags_s[gauge], reference_c[gauge]);
        let scale = scale(rows, gauge);
        (effects, values(recordings, rows, gauge, scale, &effects, ahead_s), scale)
    })
}
