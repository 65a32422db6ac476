//! One gauge's compliance and bias from the still windows, by streaming QR in scaled units.
//!
//! Loads are scaled to newtons (moments over the characteristic length), so that columns compare. Each session's bias is
//! eliminated in a triangle of its own; the rest of the sessions' triangles add up to one for the compliance.

use model::sensing::CHARACTERISTIC_LENGTH_M;
use nalgebra::{Matrix6, Vector6};

use crate::dataset::{Dataset, Window};
use crate::noise::{NoiseModel, Whitener};
use crate::triangle::Triangle;

/// Bias, six loads, reading.
const COLUMNS: usize = 8;

/// A reading further than this from the prediction is left out, in standard deviations.
const OUTLIER_SIGMA: f64 = 7.0;

/// All information of the still samples on one gauge, whitened: what the data say and nothing else.
#[derive(Clone, Debug)]
pub struct Information {
    /// Upper triangle over the six scaled sensitivities (counts/N) after the biases are eliminated.
    pub triangle: Matrix6<f64>,
    /// Right-hand side that belongs to it.
    pub target: Vector6<f64>,
    /// First row of each session's triangle: weight of the bias, of the six sensitivities, and the target.
    pub bias_rows: Vec<[f64; COLUMNS]>,
    /// Readings used.
    pub readings: u64,
    /// Readings left out because they are too far off.
    pub outliers: u64,
}

/// A solution under the gauge's information: scaled compliance (counts/N) and each session's bias (counts).
#[derive(Clone, Debug)]
pub struct Estimate {
    /// Compliance, moments over the characteristic length, counts/N.
    pub scaled: Vector6<f64>,
    /// Bias of each session, counts; `None` where the session has no reading of this gauge.
    pub biases: Vec<Option<f64>>,
}

/// Load in S with moments over the characteristic length, N.
pub fn scaled(load: &Vector6<f64>) -> Vector6<f64> {
    Vector6::from_fn(|k, _| if k < 3 { load[k] } else { load[k] / CHARACTERISTIC_LENGTH_M })
}

/// Compliance in counts/N and counts/Nm from the scaled one.
pub fn unscaled(compliance: &Vector6<f64>) -> Vector6<f64> {
    Vector6::from_fn(|k, _| if k < 3 { compliance[k] } else { compliance[k] / CHARACTERISTIC_LENGTH_M })
}

impl Estimate {
    /// Reading less prediction at a window's reading, counts; `None` where there is no reading.
    pub fn residual(&self, window: &Window, gauge: usize, k: usize) -> Option<f64> {
        let bias = self.biases[window.session]?;
        let load = scaled(&window.load(gauge, k));
        Some(window.counts[gauge][k]? - bias - self.scaled.dot(&load))
    }

    /// Variance that the reference's noise brings into a reading, counts^2.
    pub fn reference_variance(&self, dataset: &Dataset, window: &Window, gauge: usize) -> f64 {
        let Some(adjoint) = window.adjoints.get(gauge) else { return 0.0 };
        let row = adjoint.transpose() * unscaled(&self.scaled);
        (row.transpose() * dataset.reference_covariance * row)[0]
    }
}

/// Collects the information of all windows on one gauge, whitened by its noise; with an earlier estimate the
/// reference's noise is weighed in and outliers are left out.
pub fn collect(
    dataset: &Dataset,
    gauge: usize,
    noise: &NoiseModel,
    earlier: Option<&Estimate>,
) -> Information {
    let mut sessions = vec![Triangle::<COLUMNS>::default(); dataset.sessions.len()];
    let mut outliers = 0;
    for window in &dataset.windows {
        let extra = earlier.map_or(0.0, |e| e.reference_variance(dataset, window, gauge));
        let limit = OUTLIER_SIGMA * (noise.sigma_counts().powi(2) + extra).sqrt();
        let mut whitener = Whitener::<COLUMNS>::new(noise);
        for (k, t_s) in window.times_s.iter().enumerate() {
            let Some(counts) = window.counts[gauge][k] else { continue };
            if earlier.and_then(|e| e.residual(window, gauge, k)).is_some_and(|r| r.abs() > limit) {
                outliers += 1;
                continue;
            }
            let load = scaled(&window.load(gauge, k));
            let row = [1.0, load[0], load[1], load[2], load[3], load[4], load[5], counts];
            let step = whitener.step(*t_s, extra);
            sessions[window.session].add(&whitener.apply(&step, &row));
        }
    }
    let readings = sessions.iter().map(Triangle::rows).sum();
    let mut bias_rows = Vec::with_capacity(sessions.len());
    let mut rest = Triangle::<7>::default();
    for session in sessions {
        let rows = session.finish();
        bias_rows.push(rows[0]);
        for row in &rows[1..] {
            rest.add(&std::array::from_fn(|k| row[k + 1]));
        }
    }
    let rest = rest.finish();
    Information {
        triangle: Matrix6::from_fn(|i, k| rest[i][k]),
        target: Vector6::from_fn(|i, _| rest[i][6]),
        bias_rows,
        readings,
        outliers,
    }
}

impl Information {
    /// Bias of each session for a scaled compliance, counts.
    pub fn biases(&self, scaled: &Vector6<f64>) -> Vec<Option<f64>> {
        self.bias_rows
            .iter()
            .map(|row| {
                let explained: f64 = (0..6).map(|k| row[k + 1] * scaled[k]).sum();
                (row[0] != 0.0).then(|| (row[7] - explained) / row[0])
            })
            .collect()
    }

    /// How the bias of a session follows the compliance (d bias / d scaled compliance), and its own variance, counts^2.
    pub fn bias_dependence(&self, session: usize) -> (Vector6<f64>, f64) {
        let row = &self.bias_rows[session];
        (Vector6::from_fn(|k, _| -row[k + 1] / row[0]), 1.0 / (row[0] * row[0]))
    }

    /// Least squares with the smallest compliance where the data leave it open (singular values below
    /// `tolerance` times the largest): the first look, and the baselines' ordinary least squares.
    pub fn smallest(&self, tolerance: f64) -> Estimate {
        let svd = self.triangle.svd(true, true);
        let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
            return Estimate { scaled: Vector6::zeros(), biases: self.biases(&Vector6::zeros()) };
        };
        let largest = svd.singular_values.max();
        let coordinates = u.transpose() * self.target;
        let solved = Vector6::from_fn(|k, _| {
            let s = svd.singular_values[k];
            if s > tolerance * largest && s > 0.0 { coordinates[k] / s } else { 0.0 }
        });
        let scaled = v_t.transpose() * solved;
        Estimate { scaled, biases: self.biases(&scaled) }
    }

    /// Least squares for a sensitivity to the nominal z torque alone.
    pub fn nominal(&self) -> Estimate {
        let column = self.triangle.column(5);
        let square = column.norm_squared();
        let k = if square > 0.0 { column.dot(&self.target) / square } else { 0.0 };
        let scaled = Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, k);
        Estimate { scaled, biases: self.biases(&scaled) }
    }
}

/// Noise of a gauge from the residuals of windows without reference (of all, where there are no others).
pub fn noise(dataset: &Dataset, gauge: usize, estimate: &Estimate) -> Option<NoiseModel> {
    /// Enough to know the noise to a percent or so.
    const ENOUGH: usize = 40_000;
    let bare = dataset.windows.iter().any(|w| w.reference.is_empty() && has_readings(w, gauge));
    let mut pieces: Vec<(Vec<f64>, Vec<f64>)> = Vec::new();
    let total: usize = dataset.windows.iter().map(|w| w.times_s.len()).sum();
    let every = total.div_ceil(ENOUGH).max(1);
    let chosen = dataset.windows.iter().filter(|w| !bare || w.reference.is_empty());
    for window in chosen.step_by(every) {
        pieces.push(
            (0..window.times_s.len())
                .filter_map(|k| Some((window.times_s[k], estimate.residual(window, gauge, k)?)))
                .unzip(),
        );
    }
    trim(&mut pieces);
    let views: Vec<(&[f64], &[f64])> = pieces.iter().map(|(t, e)| (&t[..], &e[..])).collect();
    NoiseModel::fit(&views)
}

/// Whether a gauge says the same all the time.
pub fn is_constant(dataset: &Dataset, gauge: usize) -> bool {
    let mut readings = dataset.windows.iter().flat_map(|w| w.counts[gauge].iter().flatten());
    readings.next().is_none_or(|first| readings.all(|reading| reading == first))
}

fn has_readings(window: &Window, gauge: usize) -> bool {
    window.counts[gauge].iter().any(Option::is_some)
}

/// Leaves out what is far beyond the bulk: a spike must not pass for noise.
fn trim(pieces: &mut [(Vec<f64>, Vec<f64>)]) {
    let mut magnitudes: Vec<f64> = pieces.iter().flat_map(|(_, e)| e.iter().map(|v| v.abs())).collect();
    if magnitudes.is_empty() {
        return;
    }
    let middle = magnitudes.len() / 2;
    let (_, median, _) = magnitudes.select_nth_unstable_by(middle, f64::total_cmp);
    let limit = OUTLIER_SIGMA * *median / 0.674_489_75;
    for (times, residuals) in pieces {
        let keep: Vec<bool> = residuals.iter().map(|e| e.abs() <= limit).collect();
        let mut kept = keep.iter();
        times.retain(|_| *kept.next().expect("one flag a time"));
        let mut kept = keep.iter();
        residuals.retain(|_| *kept.next().expect("one flag a residual"));
    }
}
