//! The still windows cut into rows: means over times in which the load is nearly constant.

use model::spatial::RigidBody;
use nalgebra::Vector6;

use crate::dataset::{Dataset, Window};
use crate::noise::NoiseModel;
use crate::solve::Estimate;

/// Longest row under a constant load, s.
const LONGEST_S: f64 = 2.0;

/// Longest row while a person pushes, s: faster than hands move.
const LONGEST_PUSH_S: f64 = 0.25;

/// What does not fit keeps its sign for about so long while a push changes, s.
const MISFIT_TIME_S: f64 = 2.0;

/// More rows than this are not looked at: windows, evenly spread, are left out of longer calibrations, and memory stays bounded. Some ten
/// times what a careful calibration has.
const MOST_ROWS: usize = 20_000;

/// A reading further than this from its neighbours is left out, in standard deviations.
const OUTLIER_SIGMA: f64 = 7.0;

/// The arm at rest for a moment.
#[derive(Clone, Debug)]
pub struct Row {
    /// Index of its session.
    pub session: usize,
    /// Index of its recording.
    pub recording: usize,
    /// Index of its window: rows of one window share its pose.
    pub pose: usize,
    /// Its first instant in the recording and the one after its last.
    pub instants: (usize, usize),
    /// Mean positions over the whole window, rad.
    pub positions_rad: Vec<f64>,
    /// Number of positions that these are the mean of.
    pub positions: usize,
    /// What hangs on the tip as declared.
    pub body: RigidBody,
    /// What the reference said (N, Nm, in E), where one was mounted.
    pub reference: Option<Vector6<f64>>,
    /// Mean reading of each gauge, counts, with the number of readings and the variance of their noise, counts^2.
    pub readings: Vec<Option<Reading>>,
    /// How many rows share what does not fit: it is no noise that would average out over them.
    pub shared: f64,
}

/// Mean reading of one gauge in a row.
#[derive(Clone, Copy, Debug)]
pub struct Reading {
    /// Mean, counts.
    pub counts: f64,
    /// Variance of its noise, counts^2.
    pub noise_counts2: f64,
    /// Number of readings.
    pub n: usize,
}

/// Cuts all windows; `estimates` and `noise` (one a gauge) tell outliers from readings under a changing load.
pub fn cut(dataset: &Dataset, estimates: &[&Estimate], noise: &[NoiseModel]) -> Vec<Row> {
    let mut rows = Vec::new();
    let total: usize = dataset.windows.iter().map(|window| pieces(window).0).sum();
    let every = total.div_ceil(MOST_ROWS).max(1);
    for (pose, window) in dataset.windows.iter().enumerate().step_by(every) {
        let n = window.times_s.len();
        let (pieces, span_s) = pieces(window);
        let piece_s = (span_s / pieces as f64).max(f64::MIN_POSITIVE);
        let shared = (pieces as f64).min((MISFIT_TIME_S / piece_s).max(1.0));
        for piece in 0..pieces {
            let (from, to) = (piece * n / pieces, (piece + 1) * n / pieces);
            let reading = |gauge: usize| mean(window, gauge, (from, to), estimates[gauge], &noise[gauge]);
            let said = window.reference.get(from..to).filter(|said| !said.is_empty());
            rows.push(Row {
                session: window.session,
                recording: window.recording,
                pose,
                instants: (window.first + from, window.first + to),
                positions_rad: window.pose_rad.clone(),
                positions: n,
                body: window.body,
                reference: said
                    .map(|said| said.iter().map(|w| w.to_vector()).sum::<Vector6<f64>>() / said.len() as f64),
                readings: (0..estimates.len()).map(reading).collect(),
                shared,
            });
        }
    }
    rows
}

/// Into how many rows a window is cut, and its length, s.
fn pieces(window: &Window) -> (usize, f64) {
    let n = window.times_s.len();
    let span_s = window.times_s[n - 1] - window.times_s[0];
    let longest_s = if window.reference.is_empty() { LONGEST_S } else { LONGEST_PUSH_S };
    (((span_s / longest_s).ceil() as usize).clamp(1, n), span_s)
}

/// Mean of a gauge's readings in a part of a window, without those far from the others.
fn mean(
    window: &Window,
    gauge: usize,
    (from, to): (usize, usize),
    estimate: &Estimate,
    noise: &NoiseModel,
) -> Option<Reading> {
    let residuals: Vec<(f64, f64)> = (from..to)
        .filter_map(|k| Some((estimate.residual(window, gauge, k)?, window.counts[gauge][k]?)))
        .collect();
    let middle = crate::gauges::median(&residuals.iter().map(|r| r.0).collect::<Vec<_>>());
    let limit = OUTLIER_SIGMA * noise.sigma_counts();
    let kept: Vec<f64> = residuals.iter().filter(|r| (r.0 - middle).abs() <= limit).map(|r| r.1).collect();
    if kept.is_empty() {
        return None;
    }
    let n = kept.len() as f64;
    let span_s = window.times_s[to - 1] - window.times_s[from];
    Some(Reading {
        counts: kept.iter().sum::<f64>() / n,
        noise_counts2: noise.white_counts2 / n + noise.slow_counts2 * averaged(span_s / noise.tau_s, n),
        n: kept.len(),
    })
}

/// Variance of a first-order Markov process's mean over so many of its correlation times, relative to its variance;
/// with `n` readings at least 1/n.
fn averaged(times: f64, n: f64) -> f64 {
    let over_time = if times < 1e-3 { 1.0 } else { 2.0 * (times - 1.0 + (-times).exp()) / (times * times) };
    over_time.max(1.0 / n)
}

/// A gauge's noise within the windows, whatever it reads on average there: what does not fit a pose is not noise.
pub fn noise_within(dataset: &Dataset, gauge: usize, estimate: &Estimate) -> Option<NoiseModel> {
    /// Enough to know the noise to a percent or so.
    const ENOUGH: usize = 40_000;
    let quiet = dataset.windows.iter().any(|w| w.reference.is_empty());
    let windows: Vec<&Window> = dataset.windows.iter().filter(|w| !quiet || w.reference.is_empty()).collect();
    let total: usize = windows.iter().map(|w| w.times_s.len()).sum();
    let pieces: Vec<(Vec<f64>, Vec<f64>)> = windows
        .iter()
        .step_by(total.div_ceil(ENOUGH).max(1))
        .map(|window| {
            let residual = |k: usize| Some((window.times_s[k], estimate.residual(window, gauge, k)?));
            let (times, mut residuals): (Vec<f64>, Vec<f64>) =
                (0..window.times_s.len()).filter_map(residual).unzip();
            let middle = crate::gauges::median(&residuals);
            residuals.iter_mut().for_each(|r| *r -= middle);
            (times, residuals)
        })
        .collect();
    let all: Vec<f64> = pieces.iter().flat_map(|(_, e)| e.iter().map(|v| v.abs())).collect();
    let limit = OUTLIER_SIGMA * crate::gauges::median(&all) / 0.674_489_75;
    let kept: Vec<(Vec<f64>, Vec<f64>)> = pieces
        .into_iter()
        .map(|(times, residuals)| times.into_iter().zip(residuals).filter(|(_, r)| r.abs() <= limit).unzip())
        .collect();
    let centred: Vec<(Vec<f64>, Vec<f64>)> = kept
        .into_iter()
        .filter(|(times, _)| times.len() > 2)
        .map(|(times, residuals)| {
            // A mean takes one of n degrees of freedom away.
            let n = residuals.len() as f64;
            let mean = residuals.iter().sum::<f64>() / n;
            let scale = (n / (n - 1.0)).sqrt();
            (times, residuals.into_iter().map(|r| (r - mean) * scale).collect())
        })
        .collect();
    let views: Vec<(&[f64], &[f64])> = centred.iter().map(|(t, e)| (&t[..], &e[..])).collect();
    NoiseModel::fit(&views)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_of_slow_noise_is_as_uncertain_as_its_correlation_says() {
        // Dense sum over 1000 readings of exp(-|i - k| dt / tau) / n^2.
        let (n, times) = (1000.0, 8.0);
        let dense: f64 = (0..1000)
            .flat_map(|i: i32| (0..1000).map(move |k| f64::from((i - k).abs())))
            .map(|lag| (-lag * times / (n - 1.0)).exp())
            .sum::<f64>()
            / (n * n);
        assert!((averaged(times, n) / dense - 1.0).abs() < 0.01, "{dense}");
        assert_eq!((averaged(0.0, 5.0), averaged(1e9, 5.0)), (1.0, 0.2));
    }
}
