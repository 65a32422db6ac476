//! All gauges of an arm from the still samples: noise, compliance, bias, what was seen, and covariance.

use model::sensing::{CHARACTERISTIC_LENGTH_M, Compliance};
use nalgebra::{Matrix6, SMatrix, Vector6};
use rig::Rig;

use crate::dataset::{Dataset, Window};
use crate::error::Error;
use crate::moving::{self, Known};
use crate::noise::NoiseModel;
use crate::observability::Directions;
use crate::recording::Recording;
use crate::solve::{self, Estimate, Information, unscaled};

/// Covariance of compliance (counts/N, counts/Nm) and bias (counts) of one gauge.
pub type LinearCovariance = SMatrix<f64, 7, 7>;

/// Widths assumed of line offset and pitch where too few gauges tell, m.
const ASSUMED_OFFSET_M: f64 = 0.02;
const ASSUMED_PITCH_M: f64 = 0.003;

/// One gauge as calibrated.
#[derive(Clone, Debug)]
pub struct Gauge {
    /// Compliance with unseen directions at zero, counts/N and counts/Nm in S.
    pub compliance: Vector6<f64>,
    /// Bias of the last session, counts.
    pub bias_counts: f64,
    /// Bias of each session, counts; `None` where it has no reading of this gauge.
    pub biases: Vec<Option<f64>>,
    /// Covariance of compliance and bias, the assumed width of unseen directions included.
    pub covariance: LinearCovariance,
    /// The part of it that the data determined.
    pub seen_covariance: LinearCovariance,
    /// Noise of one reading.
    pub noise: NoiseModel,
    /// What was seen.
    pub directions: Directions,
    /// Width assumed along each unseen direction, counts/N.
    pub assumed_counts_per_n: Vec<f64>,
    /// RMS of the residuals of all samples used, counts.
    pub residual_rms_counts: f64,
    /// Ordinary least squares on the same samples, for the baselines.
    pub ordinary: Estimate,
    /// Sensitivity to the nominal torque alone, by ordinary least squares.
    pub nominal: Estimate,
    /// Readings used.
    pub readings: u64,
    /// Readings left out as outliers.
    pub outliers: u64,
    /// How much later it is than the joints, and the standard deviation, s; `None` where no move tells.
    pub late_s: Option<(f64, f64)>,
}

impl Gauge {
    /// The scaled estimate with the biases of all sessions.
    pub fn estimate(&self) -> Estimate {
        Estimate { scaled: self.directions.seen_compliance(), biases: self.biases.clone() }
    }

    /// Information (scaled) on the directions that held poses do not show, and what it says of the compliance: assumed widths about zero, and
    /// what motion told.
    pub fn beside_held_poses(&self) -> (Matrix6<f64>, Vector6<f64>) {
        let widths = self.assumed_counts_per_n.iter();
        let assumed = self.directions.unseen().zip(widths).map(|(d, width)| (d, 0.0, *width));
        let of = |k: usize| {
            let (value, sigma) = (self.directions.value[k], self.directions.sigma_counts_per_n[k]);
            (self.directions.basis.column(k).into_owned(), value, sigma)
        };
        let told = (0..6).filter(|k| self.directions.by_motion[*k]).map(of);
        let (mut information, mut says) = (Matrix6::zeros(), Vector6::zeros());
        for (direction, value, sigma) in assumed.chain(told) {
            information += direction * direction.transpose() / sigma.powi(2);
            says += direction * value;
        }
        (information, says)
    }

    /// What of a covariance concerns directions that were seen.
    pub fn seen_part(&self, covariance: &LinearCovariance) -> LinearCovariance {
        let mut project = LinearCovariance::identity();
        for direction in self.directions.unseen() {
            // Components along an unseen direction of scaled sensitivity vanish.
            let unit = |k: usize| if k < 3 { 1.0 } else { CHARACTERISTIC_LENGTH_M.recip() };
            for i in 0..6 {
                for k in 0..6 {
                    project[(i, k)] -= unit(i) * direction[i] * direction[k] / unit(k);
                }
            }
        }
        project * covariance * project.transpose()
    }
}

/// One gauge after the passes over the data, before gauges are compared.
struct Pass {
    information: Information,
    ordinary: Estimate,
    nominal: Estimate,
    noise: NoiseModel,
}

/// Calibrates every gauge from the held poses of `recordings` and the moves between them; `names` are for messages.
pub fn calibrate(
    rig: &Rig,
    dataset: &Dataset,
    recordings: &[Recording],
    names: &[&str],
) -> Result<Vec<Gauge>, Error> {
    let passes = in_parallel(names.len(), |gauge| pass(dataset, gauge, names[gauge]))
        .into_iter()
        .collect::<Result<Vec<Pass>, Error>>()?;
    let rough: Vec<f64> = passes.iter().map(|p| p.information.smallest(1e-6).scaled.norm()).collect();
    let typical = median(&rough);
    let mut directions: Vec<Directions> = passes
        .iter()
        .zip(&rough)
        .map(|(pass, own)| Directions::new(&pass.information, own.max(typical)))
        .collect();
    let known: Vec<Known> = passes
        .iter()
        .zip(&rough)
        .zip(&directions)
        .map(|((pass, own), directions)| Known {
            seen: directions.seen_compliance(),
            open: directions.unseen().collect(),
            typical_counts_per_n: own.max(typical),
            noise_counts: pass.noise.sigma_counts(),
        })
        .collect();
    let told = moving::hear(rig, dataset, recordings, &known);
    for ((directions, told), known) in directions.iter_mut().zip(&told).zip(&known) {
        directions.take_motion(&told.directions, known.typical_counts_per_n);
    }
    let widths = Widths::new(&directions);
    let mut gauges: Vec<Gauge> = passes
        .into_iter()
        .zip(directions)
        .enumerate()
        .map(|(gauge, (pass, directions))| finish(dataset, gauge, pass, directions, &widths))
        .collect();
    gauges.iter_mut().zip(told).for_each(|(gauge, told)| gauge.late_s = told.late_s);
    Ok(gauges)
}

/// Ordinary least squares, noise from its residuals, then twice generalised least squares.
fn pass(dataset: &Dataset, gauge: usize, name: &str) -> Result<Pass, Error> {
    let first = solve::collect(dataset, gauge, &NoiseModel::white(1.0), None);
    if first.readings < 16 {
        let problem = format!(
            "has {} readings in still windows; check its signal, its saturated flag and its sequence counter",
            first.readings
        );
        return Err(Error::data(format!("sensor \"{name}\""), problem));
    }
    const TOLERANCE: f64 = 1e-9;
    let (ordinary, nominal) = (first.smallest(TOLERANCE), first.nominal());
    let constant = || {
        let problem = "does not change at all: its readings are constant; check the gauge and its signal";
        Error::data(format!("sensor \"{name}\""), problem)
    };
    if solve::is_constant(dataset, gauge) {
        return Err(constant());
    }
    let find_noise = |estimate: &Estimate| solve::noise(dataset, gauge, estimate).ok_or_else(constant);
    let noise = find_noise(&ordinary)?;
    let second = solve::collect(dataset, gauge, &noise, Some(&ordinary)).smallest(TOLERANCE);
    let noise = find_noise(&second)?;
    let information = solve::collect(dataset, gauge, &noise, Some(&second));
    let all = information.readings + information.outliers;
    if information.outliers as f64 > MOST_OUTLIERS * all as f64 {
        return Err(misfit(dataset, gauge, name, &information, &noise, &second));
    }
    Ok(Pass { information, ordinary, nominal, noise })
}

/// A gauge of which more than this share of readings is far from any fit is not noisy: something else is wrong.
const MOST_OUTLIERS: f64 = 0.04;

/// Says where the readings fit least, and what makes them so.
fn misfit(
    dataset: &Dataset,
    gauge: usize,
    name: &str,
    information: &Information,
    noise: &NoiseModel,
    estimate: &Estimate,
) -> Error {
    let all = information.readings + information.outliers;
    let share = 100.0 * information.outliers as f64 / all as f64;
    let off = |window: &Window| {
        let residuals = (0..window.times_s.len()).filter_map(|k| estimate.residual(window, gauge, k));
        residuals.map(|r| (r / noise.sigma_counts()).powi(2)).sum::<f64>()
    };
    let worst = dataset.windows.iter().max_by(|a, b| off(a).total_cmp(&off(b)));
    let place = worst.map_or_else(String::new, |w| {
        let (from, to) = (w.times_s[0], w.times_s[w.times_s.len() - 1]);
        let pushed = if w.reference.is_empty() { "" } else { " and a reference" };
        format!(
            ", worst from {from:.1} to {to:.1} s of {} (with {:.3} kg{pushed} at the tip)",
            dataset.recordings[w.recording], w.body.mass_kg
        )
    });
    let problem = format!(
        "{share:.0} % of its readings are far from what any gauge could make of these loads{place}; check masses (kg), com (m) and times of the [[load]]s, sign and axes of the reference, signs of the joints and the URDF, and whether the gauge failed; [[exclude]] what is spoilt"
    );
    Error::data(format!("sensor \"{name}\""), problem)
}

fn finish(dataset: &Dataset, gauge: usize, pass: Pass, directions: Directions, widths: &Widths) -> Gauge {
    let scaled = directions.seen_compliance();
    let assumed: Vec<f64> = directions.unseen().map(|d| widths.along(&scaled, &d)).collect();
    let biases = pass.information.biases(&scaled);
    let session = biases.iter().rposition(Option::is_some).unwrap_or(0);
    let mut seen = Matrix6::zeros();
    for k in (0..6).filter(|k| directions.seen[*k]) {
        let d = directions.basis.column(k);
        seen += d * d.transpose() * directions.sigma_counts_per_n[k].powi(2);
    }
    let mut whole = seen;
    for (d, width) in directions.unseen().zip(&assumed) {
        whole += d * d.transpose() * width.powi(2);
    }
    let dependence = pass.information.bias_dependence(session);
    let estimate = Estimate { scaled, biases: biases.clone() };
    let bias_counts = biases[session].unwrap_or(0.0);
    Gauge {
        biases,
        compliance: unscaled(&scaled),
        bias_counts,
        covariance: with_bias(&whole, &dependence),
        seen_covariance: with_bias(&seen, &dependence),
        residual_rms_counts: residual_rms(dataset, gauge, &estimate),
        noise: pass.noise,
        assumed_counts_per_n: assumed,
        ordinary: pass.ordinary,
        nominal: pass.nominal,
        readings: pass.information.readings,
        outliers: pass.information.outliers,
        late_s: None,
        directions,
    }
}

/// Covariance of compliance (unscaled) and bias from that of the scaled compliance.
fn with_bias(scaled: &Matrix6<f64>, (dependence, own): &(Vector6<f64>, f64)) -> LinearCovariance {
    let unit = |k: usize| if k < 3 { 1.0 } else { CHARACTERISTIC_LENGTH_M.recip() };
    let mut jacobian = nalgebra::SMatrix::<f64, 7, 6>::zeros();
    for k in 0..6 {
        jacobian[(k, k)] = unit(k);
        jacobian[(6, k)] = dependence[k];
    }
    let mut covariance = jacobian * scaled * jacobian.transpose();
    covariance[(6, 6)] += own;
    (covariance + covariance.transpose()) * 0.5
}

fn residual_rms(dataset: &Dataset, gauge: usize, estimate: &Estimate) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for window in &dataset.windows {
        for k in 0..window.times_s.len() {
            if let Some(r) = estimate.residual(window, gauge, k) {
                sum += r * r;
                n += 1.0;
            }
        }
    }
    f64::sqrt(sum / f64::max(n, 1.0))
}

/// What the gauges that were seen wholly say about the others of their kind: how large an unseen sensitivity can be.
struct Widths {
    scale_counts_per_n: f64,
    offset_m: f64,
    pitch_m: f64,
}

impl Widths {
    fn new(directions: &[Directions]) -> Self {
        let whole: Vec<_> = directions
            .iter()
            .filter(|d| d.seen.iter().all(|s| *s))
            .filter_map(|d| Compliance::from_vector(&unscaled(&d.seen_compliance())).actual_frame())
            .collect();
        let rms = |values: Vec<f64>, otherwise: f64| {
            // Fewer than three gauges say little about a fourth.
            if values.len() < 3 {
                return otherwise;
            }
            (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt().max(2e-4)
        };
        let moments = |d: &Directions| d.seen_compliance().fixed_rows::<3>(3).norm();
        Self {
            scale_counts_per_n: directions.iter().map(moments).fold(0.0, f64::max),
            offset_m: rms(whole.iter().map(|f| f.l_x_m.hypot(f.l_y_m)).collect(), ASSUMED_OFFSET_M),
            pitch_m: rms(whole.iter().map(|f| f.pitch_m).collect(), ASSUMED_PITCH_M),
        }
    }

    /// Standard deviation assumed of a gauge's sensitivity along an unseen direction (scaled), counts/N.
    fn along(&self, seen: &Vector6<f64>, direction: &Vector6<f64>) -> f64 {
        let moments = seen.fixed_rows::<3>(3);
        let (scale, axis) = match moments.norm() {
            0.0 => (self.scale_counts_per_n, nalgebra::Vector3::z()),
            r => (r, moments / r),
        };
        let force = direction.fixed_rows::<3>(0);
        let along = force.dot(&axis);
        let across2 = (force.norm_squared() - along * along).max(0.0);
        // r in counts/Nm is the scaled one over the characteristic length.
        let per_m = scale.max(self.scale_counts_per_n) / CHARACTERISTIC_LENGTH_M;
        let by_force =
            per_m.powi(2) * (along * along * self.pitch_m.powi(2) + across2 * self.offset_m.powi(2));
        let by_moment = direction.fixed_rows::<3>(3).norm_squared() * self.scale_counts_per_n.powi(2);
        (by_force + by_moment).sqrt()
    }
}

pub(crate) fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
}

/// Runs `work` for `0..n` on the machine's cores, results in order.
pub(crate) fn in_parallel<T: Send>(n: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let cores = std::thread::available_parallelism().map_or(1, |c| c.get()).min(n.max(1));
    let next = std::sync::atomic::AtomicUsize::new(0);
    let mut results: Vec<(usize, T)> = std::thread::scope(|scope| {
        let workers: Vec<_> = (0..cores)
            .map(|_| {
                scope.spawn(|| {
                    let take = || next.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                    std::iter::repeat_with(take)
                        .take_while(|k| *k < n)
                        .map(|k| (k, work(k)))
                        .collect::<Vec<_>>()
                })
            })
            .collect();
        workers
            .into_iter()
            .flat_map(|w| w.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    });
    results.sort_by_key(|(k, _)| *k);
    results.into_iter().map(|(_, result)| result).collect()
}
