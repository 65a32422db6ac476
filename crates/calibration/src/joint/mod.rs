//! Gauges and arm estimated together: what the arm is other than its URDF, and what gauges add beside the load's share.
//!
//! [`rows`] cuts the still windows, [`parameters`] lists what can be other than declared, with prior widths, [`effects`] what
//! gauges may add, [`loads`] predicts, [`system`] solves the linearised problem, [`admission`] chooses what is worth having on
//! held-out poses and times, [`lags`] finds what enters in no linear way, and [`outcome`] brings it into the stored model. Gauss-Newton: loads and their derivatives
//! are taken anew at each step.

pub mod admission;
pub mod effects;
pub mod lags;
pub mod loads;
pub mod outcome;
pub mod parameters;
pub mod rows;
pub mod system;
#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
pub mod told;

use model::sensing::CHARACTERISTIC_LENGTH_M;
use model::terms::{Effect, MOST_TERMS};
use nalgebra::{DMatrix, Matrix6, Vector6};
use rig::Rig;

use crate::dataset::Dataset;
use crate::gauges::Gauge;
use crate::noise::NoiseModel;
use crate::recording::Recording;
use crate::solve::Estimate;
use admission::Admitted;
use effects::Values;
use lags::{Fitted, Lags};
use parameters::{Group, Parameters};
use rows::Row;
use system::{GaugeRows, Selection, Solution, System};

const LENGTH_M: f64 = CHARACTERISTIC_LENGTH_M;

/// Compliance: six own numbers of a gauge; then a bias a session, then the terms.
const COMPLIANCE: usize = 6;

/// Gauss-Newton steps with everything free, and with what was admitted: the problem is nearly bilinear, so each step takes
/// all but a hundredth of what is left away.
const STEPS: usize = 3;

/// Steps with what was admitted after which the lags are sought again: with the arm known they are seen better.
const RELAGS: usize = 2;

/// A row further off than this (standard deviations) is trusted in inverse proportion (P. Huber, Robust Statistics, 1981).
const HUBER_SIGMA: f64 = 3.0;

/// Everything about a calibration that does not change while it is solved.
struct Problem<'a> {
    rig: &'a Rig,
    dataset: &'a Dataset,
    rows: Vec<Row>,
    parameters: Parameters,
    noise: Vec<NoiseModel>,
    effects: Vec<([Effect; MOST_TERMS], Values, (f64, f64))>,
    /// Information on each gauge's scaled compliance beside the held poses, and what it says.
    beside: Vec<(Matrix6<f64>, Vector6<f64>)>,
    /// Which encoder number of the list belongs to each coordinate.
    zeros: Vec<Option<usize>>,
}

/// Where the problem is linearised.
#[derive(Clone, Debug)]
struct Point {
    arm: Vec<f64>,
    /// Scaled compliances, counts/N.
    compliances: Vec<Vector6<f64>>,
    misfits: Vec<f64>,
    /// Weight against outliers: `[gauge][row of the gauge]`; empty for all of them.
    trust: Vec<Vec<f64>>,
}

/// What was found.
pub struct Joint {
    rows: Vec<Row>,
    parameters: Parameters,
    admitted: Admitted,
    system: System,
    solution: Solution,
    noise: Vec<NoiseModel>,
    effects: Vec<([Effect; MOST_TERMS], Values, (f64, f64))>,
    /// How each gauge's numbers move with its lag.
    lags: Lags,
    /// What else is in doubt about each gauge's drift: `[gauge][doubt][own number]`.
    doubts: Vec<Vec<Vec<f64>>>,
    sessions: usize,
}

/// Estimates arm and gauges together; `None` where nothing beyond compliances and biases is worth having.
pub fn estimate(rig: &Rig, dataset: &Dataset, recordings: &[Recording], gauges: &[Gauge]) -> Option<Joint> {
    let mut problem = Problem::new(rig, dataset, recordings, gauges)?;
    let linear = COMPLIANCE + dataset.sessions.len();
    let own = linear + MOST_TERMS;
    let groups: Vec<Group> = problem.parameters.list.iter().map(|p| p.group).collect();
    let all = Admitted::everything(gauges.len()).selection(&groups, linear, own);
    let mut point = Point {
        arm: vec![0.0; groups.len()],
        compliances: gauges.iter().map(|gauge| gauge.directions.seen_compliance()).collect(),
        misfits: vec![0.0; gauges.len()],
        trust: Vec::new(),
    };
    let mut fitted = problem.step(&mut point, &all)?;
    problem.take_lags(recordings, &fitted, &all);
    for _ in 1..STEPS {
        fitted = problem.step(&mut point, &all)?;
    }
    let mut admitted = admission::admit(&mut fitted.0, &problem.rows, &groups, linear);
    admitted.complete_slow();
    if admitted.is_nothing() {
        return None;
    }
    let selection = admitted.selection(&groups, linear, own);
    let held_out: Vec<f64> = fitted.0.gauges.iter().map(|gauge| gauge.misfit).collect();
    point.arm.iter_mut().zip(&selection.arm).filter(|(_, free)| !**free).for_each(|(value, _)| *value = 0.0);
    for step in 0..STEPS {
        fitted = problem.step(&mut point, &selection)?;
        if step < RELAGS {
            problem.take_lags(recordings, &fitted, &selection);
        }
        // Held-out poses know better than the fitted ones how much does not fit.
        point.misfits.iter_mut().zip(&held_out).for_each(|(own, other)| *own = own.max(*other));
    }
    let lags = problem.lags(recordings, &fitted, &selection);
    let doubts = problem.doubts(recordings, &fitted, &selection, lags.common_s);
    let (system, solution) = fitted;
    Some(Joint {
        lags,
        doubts,
        sessions: dataset.sessions.len(),
        rows: problem.rows,
        parameters: problem.parameters,
        noise: problem.noise,
        effects: problem.effects,
        admitted,
        system,
        solution,
    })
}

impl<'a> Problem<'a> {
    fn new(rig: &'a Rig, dataset: &'a Dataset, recordings: &[Recording], gauges: &[Gauge]) -> Option<Self> {
        let estimates: Vec<Estimate> = gauges.iter().map(Gauge::estimate).collect();
        let noise: Vec<NoiseModel> = (0..gauges.len())
            .map(|g| rows::noise_within(dataset, g, &estimates[g]))
            .collect::<Option<_>>()?;
        let rows = rows::cut(dataset, &estimates.iter().collect::<Vec<_>>(), &noise);
        let parameters = Parameters::new(&rig.chain, &rows);
        let lags = vec![effects::LAGS_S[effects::FIRST_LAG]; gauges.len()];
        let zeros = rig
            .chain
            .coordinate_names()
            .iter()
            .map(|name| parameters.list.iter().position(|p| p.name == format!("{name}.zero_rad")))
            .collect();
        Some(Self {
            effects: effects::all(
                recordings,
                &rows,
                &lags,
                &reference_temperatures(recordings, gauges.len()),
                0.0,
            ),
            beside: gauges.iter().map(Gauge::beside_held_poses).collect(),
            rig,
            dataset,
            rows,
            parameters,
            noise,
            zeros,
        })
    }

    /// One Gauss-Newton step: loads and derivatives at the point, the solution, and the point moved there.
    fn step(&self, point: &mut Point, selection: &Selection) -> Option<(System, Solution)> {
        let mut system = self.linearise(point);
        let everything = |system: &System| -> Vec<DMatrix<f64>> {
            crate::gauges::in_parallel(system.gauges.len(), |g| system.normal(g, |_| true))
        };
        let mut solution = system.solve(&everything(&system), selection)?;
        // Weights and solution depend on each other: three rounds bring both to rest within a percent.
        for _ in 0..3 {
            let arm_share = solution.arm_numbers(&system.widths) / system.gauges.len() as f64;
            for gauge in 0..system.gauges.len() {
                let residuals = system.residuals(gauge, &solution);
                let own = solution.conditional[gauge].0.len() as f64;
                let misfit = system.misfit(gauge, &residuals, own + arm_share);
                system.gauges[gauge].misfit = misfit.max(point.misfits[gauge].min(misfit * 4.0));
                let trust = |(k, r): (usize, &f64)| {
                    let off = r.abs() / system.gauges[gauge].total_variance(k).sqrt();
                    (HUBER_SIGMA / off.max(HUBER_SIGMA)).min(1.0)
                };
                let trust: Vec<f64> = residuals.iter().enumerate().map(trust).collect();
                system.gauges[gauge].trust = trust;
            }
            solution = system.solve(&everything(&system), selection)?;
        }
        point.arm.clone_from(&solution.arm);
        for (gauge, own) in solution.own.iter().enumerate() {
            point.compliances[gauge] = Vector6::from_column_slice(&own[..COMPLIANCE]);
            point.misfits[gauge] = system.gauges[gauge].misfit;
        }
        point.trust = system.gauges.iter().map(|gauge| gauge.trust.clone()).collect();
        Some((system, solution))
    }

    fn linearise(&self, point: &Point) -> System {
        let (sessions, gauges) = (self.dataset.sessions.len(), self.noise.len());
        let loads = loads::loads(self.rig, &self.parameters, &self.rows, &point.arm);
        let by_arm =
            loads::by_parameters(self.rig, &self.parameters, &self.rows, &point.arm, &point.compliances);
        let own = COMPLIANCE + sessions + MOST_TERMS;
        let gauge = |gauge: usize| {
            let present: Vec<usize> =
                (0..self.rows.len()).filter(|k| self.rows[*k].readings[gauge].is_some()).collect();
            let mut rows = GaugeRows {
                a: Vec::with_capacity(present.len() * (own + by_arm.len())),
                z: Vec::with_capacity(present.len()),
                variance: Vec::with_capacity(present.len()),
                trust: vec![1.0; present.len()],
                prior: self.prior(gauge, own, sessions),
                misfit: point.misfits[gauge],
                index: present,
            };
            if let Some(trust) = point.trust.get(gauge) {
                rows.trust.clone_from(trust);
            }
            for k in rows.index.clone() {
                let row = &self.rows[k];
                let Some(reading) = row.readings[gauge] else { continue };
                let at = |p: usize| f64::from(by_arm[p][k * gauges + gauge]);
                rows.a.extend(loads[k][gauge].iter());
                rows.a.extend((0..sessions).map(|s| f64::from(u8::from(s == row.session))));
                rows.a.extend(self.effects[gauge].1.rows[k]);
                rows.a.extend((0..by_arm.len()).map(at));
                let moved: f64 = point.arm.iter().enumerate().map(|(p, x)| at(p) * x).sum();
                rows.z.push(reading.counts + moved);
                let noise = reading.noise_counts2
                    + self.reference_variance(row, &loads[k][gauge], gauge, &point.compliances[gauge])
                    + self.encoder_variance(row, &at);
                rows.variance.push((noise, row.shared));
            }
            rows
        };
        System {
            gauges: (0..gauges).map(gauge).collect(),
            own,
            widths: self.parameters.list.iter().map(|p| p.width).collect(),
        }
    }

    /// Prior information of a gauge's own numbers; as last column that times what it says of them.
    fn prior(&self, gauge: usize, own: usize, sessions: usize) -> DMatrix<f64> {
        let (effects, _, (_, scale_counts)) = &self.effects[gauge];
        let mut prior = DMatrix::zeros(own, own + 1);
        let (information, says) = &self.beside[gauge];
        prior.view_mut((0, 0), (COMPLIANCE, COMPLIANCE)).copy_from(information);
        prior.view_mut((0, own), (COMPLIANCE, 1)).copy_from(&(information * says));
        for session in 0..sessions {
            // As good as none, but a session without readings of this gauge must not make the equations singular.
            prior[(COMPLIANCE + session, COMPLIANCE + session)] = (1e3 * scale_counts).powi(-2);
        }
        for (k, effect) in effects.iter().enumerate() {
            let slot = COMPLIANCE + sessions + k;
            prior[(slot, slot)] = (effects::width(effect) * scale_counts).powi(-2);
        }
        prior
    }

    /// Variance that the reference's noise brings into a row, counts^2.
    fn reference_variance(
        &self,
        row: &Row,
        load: &Vector6<f64>,
        gauge: usize,
        compliance: &Vector6<f64>,
    ) -> f64 {
        let Some(said) = row.reference.filter(|_| load.norm() > 0.0) else { return 0.0 };
        debug_assert!(said.iter().all(|v| v.is_finite()));
        let windows = &self.dataset.windows;
        let Some(window) = windows.iter().find(|w| {
            w.recording == row.recording
                && w.first <= row.instants.0
                && row.instants.0 < w.first + w.times_s.len()
        }) else {
            return 0.0;
        };
        let Some(adjoint) = window.adjoints.get(gauge) else { return 0.0 };
        let covariance = adjoint * self.dataset.reference_covariance * adjoint.transpose();
        let unscaled = crate::solve::unscaled(compliance);
        let n = (row.instants.1 - row.instants.0) as f64;
        (unscaled.transpose() * covariance * unscaled)[0] / n
    }

    /// Variance that the encoders' noise brings into a row through the arm's weight, counts^2.
    fn encoder_variance(&self, row: &Row, by_arm: &dyn Fn(usize) -> f64) -> f64 {
        let zeros = self.zeros.iter().zip(&self.dataset.encoders);
        let of = |(zero, encoder): (&Option<usize>, &rig::model_file::Encoder)| {
            zero.map_or(0.0, |p| (by_arm(p) * encoder.position_sigma_rad).powi(2))
        };
        zeros.map(of).sum::<f64>() / row.positions as f64 * row.shared
    }

    /// Takes the lags between thermometers and gauges with which each gauge's rows fit best, the arm as it was found.
    fn take_lags(&mut self, recordings: &[Recording], fitted: &(System, Solution), selection: &Selection) {
        let found = self.lags(recordings, fitted, selection).gauges;
        let found: Vec<f64> = found.iter().map(|lag| lag.lag_s).collect();
        let reference_c = reference_temperatures(recordings, self.noise.len());
        self.effects = effects::all(recordings, &self.rows, &found, &reference_c, 0.0);
    }

    fn lags(
        &self,
        recordings: &[Recording],
        (system, solution): &(System, Solution),
        selection: &Selection,
    ) -> Lags {
        let trial = self.trial(recordings);
        lags::search(Fitted { system, solution, selection }, |lag_s| trial(lag_s, 0.0))
    }

    fn doubts(
        &self,
        recordings: &[Recording],
        (system, solution): &(System, Solution),
        selection: &Selection,
        common_s: f64,
    ) -> Vec<Vec<Vec<f64>>> {
        lags::doubts(Fitted { system, solution, selection }, common_s, self.trial(recordings))
    }

    /// Regressors of all gauges for one lag of all, and one ahead of it (s).
    fn trial(&self, recordings: &[Recording]) -> impl Fn(f64, f64) -> lags::Effects {
        let reference_c = reference_temperatures(recordings, self.noise.len());
        move |lag_s, ahead_s| {
            let lags = vec![lag_s; self.noise.len()];
            effects::all(recordings, &self.rows, &lags, &reference_c, ahead_s)
        }
    }
}

/// Mean temperature of each gauge over all recordings, degC.
fn reference_temperatures(recordings: &[Recording], gauges: usize) -> Vec<f64> {
    (0..gauges)
        .map(|gauge| {
            let all = recordings.iter().flat_map(|r| r.temperatures_c[gauge].iter().flatten());
            let (sum, n) = all.fold((0.0, 0.0), |(sum, n), t| (sum + t, n + 1.0));
            if n > 0.0 { sum / n } else { 0.0 }
        })
        .collect()
}
