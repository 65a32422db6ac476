//! Lags between thermometers and gauges: the one number of a gauge that enters in no linear way.
//!
//! The rows' weighted squares are taken at lags over two decades, everything linear of the gauge fitted anew at each and the arm held;
//! a parabola through the lowest ones gives the lag and how sure it is. What the gauge's other numbers change with it (a
//! drift with temperature most of all) is part of their uncertainty; so is what they change if heat comes to the gauge in two stages, and what
//! stretches of the recording contradict each other about the drift.

use model::terms::{Effect, MOST_TERMS};

use super::effects::{LAGS_S, Values};
use super::system::{Selection, Solution, System};
use crate::gauges::in_parallel;

/// How far the lags of one arm's gauges are from each other, as a logarithm.
const LAG_SPREAD: f64 = 0.2;

/// Of two stages that heat may come in, the first one's share of the whole lag.
const STAGED_SHARE: f64 = 0.25;

/// Stretches of the recordings that may contradict each other about a drift: of some minutes each, longer than creep lasts.
const STRETCHES: usize = 12;

/// The lag of one gauge.
#[derive(Clone, Debug)]
pub struct Lag {
    /// From its thermometer, s.
    pub lag_s: f64,
    /// Change of the gauge's own numbers with one standard deviation of the lag.
    pub own: Vec<f64>,
}

/// The lags of all gauges.
#[derive(Clone, Debug)]
pub struct Lags {
    /// What all have about in common, s.
    pub common_s: f64,
    /// Each gauge's.
    pub gauges: Vec<Lag>,
}

/// What the drift of an arm's gauges is fitted to.
#[derive(Clone, Copy)]
pub struct Fitted<'a> {
    /// The linearised problem.
    pub system: &'a System,
    /// Its solution.
    pub solution: &'a Solution,
    /// Which numbers are free.
    pub selection: &'a Selection,
}

/// Weighted squares that are left with one lag, and the gauge's own numbers there.
#[derive(Clone, Debug)]
struct Trial {
    cost: f64,
    own: Vec<f64>,
}

/// Lowest place of a curve, and by how much it rises there over one unit of the logarithm.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Lowest {
    index: usize,
    place: f64,
    /// None at an end, or where the curve does not rise to both sides.
    curvature: Option<f64>,
}

/// Regressors of all gauges, as [`super::effects::all`] gives them.
pub type Effects = Vec<([Effect; MOST_TERMS], Values, (f64, f64))>;

/// Finds each gauge's lag; `effects` gives all gauges' regressors for one lag (s).
pub fn search(fitted: Fitted, effects: impl Fn(f64) -> Effects) -> Lags {
    // `[lag][gauge]`
    let trials: Vec<Vec<Trial>> = LAGS_S.iter().map(|lag_s| try_all(fitted, &effects(*lag_s))).collect();
    // Gauges of one arm are built alike: one lag for all, from which each departs as far as its own rows insist.
    let together: Vec<f64> =
        trials.iter().map(|of_lag| of_lag.iter().map(|trial| trial.cost).sum()).collect();
    let common = lowest(&LAGS_S, &together).place;
    let of_gauge = |gauge: usize| {
        let apart = |lag_s: &f64| ((lag_s / common).ln() / LAG_SPREAD).powi(2);
        let cost: Vec<f64> =
            LAGS_S.iter().zip(&trials).map(|(lag_s, of)| of[gauge].cost + apart(lag_s)).collect();
        let found = lowest(&LAGS_S, &cost);
        // Squares rise by one at one standard deviation.
        let sigma_ln = found.curvature.map_or(LAG_SPREAD, |curvature| curvature.sqrt().recip());
        let (from, to) = (found.index.saturating_sub(1), (found.index + 1).min(LAGS_S.len() - 1));
        let share = sigma_ln.min(LAG_SPREAD) / (LAGS_S[to] / LAGS_S[from]).ln();
        Lag { lag_s: found.place, own: change(&trials[to][gauge], &trials[from][gauge], share) }
    };
    Lags { common_s: common, gauges: (0..fitted.system.gauges.len()).map(of_gauge).collect() }
}

/// What else is in doubt about each gauge's drift, as changes of its own numbers: `[gauge][doubt][own number]`. What comes of it at run time
/// shows in the rows' misfit. `effects` gives all gauges' regressors for one lag and one ahead of it (s).
pub fn doubts(fitted: Fitted, common_s: f64, effects: impl Fn(f64, f64) -> Effects) -> Vec<Vec<Vec<f64>>> {
    // The same delay in all, in one stage and in two.
    let whole = try_all(fitted, &effects(common_s, 0.0));
    let staged = try_all(fitted, &effects((1.0 - STAGED_SHARE) * common_s, STAGED_SHARE * common_s));
    let of_gauge = |gauge: usize| {
        let by_stages = change(&staged[gauge], &whole[gauge], 1.0);
        [by_stages].into_iter().chain(by_stretches(fitted.system, fitted.solution, gauge)).collect()
    };
    (0..fitted.system.gauges.len()).map(of_gauge).collect()
}

/// All gauges' rows fitted anew with these regressors.
fn try_all(fitted: Fitted, effects: &Effects) -> Vec<Trial> {
    in_parallel(effects.len(), |gauge| trial(fitted, gauge, &effects[gauge].1))
}

/// By how much a gauge's own numbers differ between two trials, times a share.
fn change(to: &Trial, from: &Trial, share: f64) -> Vec<f64> {
    to.own.iter().zip(&from.own).map(|(to, from)| (to - from) * share).collect()
}

/// What stretches of the recordings contradict each other about a gauge's drift, beyond what its variance says: rows that are off together for
/// minutes (creep of another form, hysteresis) say less than as many independent ones. The variance of the stretches' influences (P. Huber,
/// The behavior of maximum likelihood estimates under nonstandard conditions, 1967, stretches as clusters).
fn by_stretches(system: &System, solution: &Solution, gauge: usize) -> Option<Vec<f64>> {
    let (rows, n) = (&system.gauges[gauge], system.columns());
    let (free, covariance, _) = &solution.conditional[gauge];
    let drift = free.iter().position(|own| *own == system.own - MOST_TERMS)?;
    let residuals = system.residuals(gauge, solution);
    let influence = |k: usize| {
        let row = &rows.a[k * n..(k + 1) * n];
        let along: f64 = free.iter().enumerate().map(|(i, own)| covariance[(drift, i)] * row[*own]).sum();
        along * residuals[k] * rows.trust[k] / rows.total_variance(k)
    };
    let stretch = residuals.len().div_ceil(STRETCHES).max(1);
    let influences: Vec<f64> = (0..residuals.len()).map(influence).collect();
    let squares: f64 = influences.chunks(stretch).map(|of| of.iter().sum::<f64>().powi(2)).sum();
    let variance = squares * STRETCHES as f64 / (STRETCHES - 1) as f64;
    let own_variance = covariance[(drift, drift)];
    (variance > own_variance).then(|| {
        let size = (variance - own_variance).sqrt() / own_variance;
        let mut own = vec![0.0; system.own];
        free.iter().enumerate().for_each(|(i, index)| own[*index] = covariance[(drift, i)] * size);
        own
    })
}

/// A gauge's rows fitted anew with these regressors, the arm's numbers held.
fn trial(fitted: Fitted, gauge: usize, values: &Values) -> Trial {
    let Fitted { system, solution, selection } = fitted;
    let (rows, n) = (&system.gauges[gauge], system.columns());
    let mut alone = System { gauges: vec![rows.clone()], own: system.own, widths: Vec::new() };
    let mut a = Vec::with_capacity(rows.z.len() * system.own);
    for (k, row) in rows.a.chunks_exact(n).enumerate() {
        let (own, arm) = row.split_at(system.own);
        a.extend(&own[..system.own - MOST_TERMS]);
        a.extend(values.rows[rows.index[k]]);
        alone.gauges[0].z[k] -= arm.iter().zip(&solution.arm).map(|(a, x)| a * x).sum::<f64>();
    }
    alone.gauges[0].a = a;
    let selection = Selection { own: vec![selection.own[gauge].clone()], arm: Vec::new() };
    let normal = alone.normal(0, |_| true);
    let Some(found) = alone.solve(&[normal], &selection) else {
        return Trial { cost: f64::INFINITY, own: solution.own[gauge].clone() };
    };
    let squares = alone.residuals(0, &found).into_iter().enumerate();
    let cost = squares.map(|(k, r)| rows.trust[k] * r * r / rows.total_variance(k)).sum();
    Trial { cost, own: found.own[0].clone() }
}

/// Where a curve over the logarithm of its places is lowest, by a parabola through the lowest place and its neighbours.
fn lowest(places: &[f64], costs: &[f64]) -> Lowest {
    let index = (0..costs.len()).min_by(|a, b| costs[*a].total_cmp(&costs[*b])).unwrap_or(0);
    let at_one = Lowest { index, place: places[index], curvature: None };
    if index == 0 || index + 1 == costs.len() {
        return at_one;
    }
    let x: [f64; 3] = std::array::from_fn(|k| places[index + k - 1].ln());
    let y: [f64; 3] = std::array::from_fn(|k| costs[index + k - 1]);
    let (left, right) = ((y[1] - y[0]) / (x[1] - x[0]), (y[2] - y[1]) / (x[2] - x[1]));
    let curvature = (right - left) / (x[2] - x[0]);
    if !(curvature > 0.0 && curvature.is_finite()) {
        return at_one;
    }
    let place = (0.5 * (x[0] + x[1]) - 0.5 * left / curvature).clamp(x[0], x[2]).exp();
    Lowest { index, place, curvature: Some(curvature) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_parabola_s_lowest_place_is_found_between_the_tried_ones() {
        let costs: Vec<f64> = LAGS_S.iter().map(|lag_s| 3.0 + 2.0 * (lag_s / 62.0).ln().powi(2)).collect();
        let found = lowest(&LAGS_S, &costs);
        assert!((found.place - 62.0).abs() < 1e-9, "{found:?}");
        assert!((found.curvature.unwrap_or(0.0) - 2.0).abs() < 1e-9, "{found:?}");
        assert_eq!(lowest(&[1.0, 2.0], &[1.0, 2.0]), Lowest { index: 0, place: 1.0, curvature: None });
    }
}
