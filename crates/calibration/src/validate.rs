//! Scores a recording's wrench against its truth, beside the two baselines.
//!
//! Truth: the reference (zero where none is given) plus weight and inertia of the loads at the tip. The estimate
//! subtracts the arm and its tool only.

use can::assembly::{Assembler, Snapshot};
use model::dynamics::Dynamics;
use model::estimator::Gls;
use model::motion::{JointMotion, smooth};
use model::spatial::{Tip, Wrench};
use nalgebra::Vector6;
use rig::cycle::{Estimate, MotionTracker, Stage};
use rig::{ModelFile, Rig, Run, Status};
use serde::Serialize;
use std::collections::BTreeMap;

use crate::error::Error;
use crate::recording::{Recording, for_each_frame};
use crate::still::still_instants;

/// `wrenchctl validate --json`.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Validation {
    format: u32,
    /// Instants at which the arm holds still.
    pub still: Score,
    /// All others.
    pub moving: Score,
    /// Both.
    pub all: Score,
    /// The published five-parameter method on the same instants.
    pub five_parameter: Baseline,
    /// No crosstalk correction, on the same instants.
    pub nominal_axes: Baseline,
    /// Largest force component of the truth, N.
    pub full_scale_n: f64,
    /// Instants without a valid wrench.
    pub invalid: u64,
    /// Scored instants by what their status says: none of the flags, or each flag by its name.
    pub status: BTreeMap<&'static str, u64>,
}

/// Scores of a baseline.
#[derive(Clone, Debug, Default, Serialize)]
#[allow(missing_docs)]
pub struct Baseline {
    pub still: Score,
    pub moving: Score,
    pub all: Score,
}

/// Errors over a set of instants; `None` (null) where there is none.
#[derive(Clone, Debug, Default, Serialize)]
#[allow(missing_docs)]
pub struct Score {
    pub n: u64,
    pub force_rms_n: Option<[f64; 3]>,
    pub force_rms_all_n: Option<f64>,
    pub torque_rms_nm: Option<[f64; 3]>,
    pub torque_rms_all_nm: Option<f64>,
    pub force_rms_percent_fs: Option<f64>,
    /// Mean squared error over reported variance of each component; null for the baselines, which report none.
    pub nees: Option<[f64; 6]>,
    /// The published five-parameter method on the same instants; none in the scores of a baseline.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub five_parameter: Option<Box<Score>>,
    /// No crosstalk correction, on the same instants; none in the scores of a baseline.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nominal_axes: Option<Box<Score>>,
}

/// One published instant, for `--csv`.
#[derive(Clone, Debug)]
pub struct Row {
    /// s from the log's first frame.
    pub t_s: f64,
    /// The estimate.
    pub estimate: Estimate,
    /// The truth, about E's origin, in E.
    pub truth: Wrench<Tip>,
    /// Whether the arm holds still.
    pub still: bool,
}

/// Between instants farther apart the motion is not known, ns.
const LONGEST_STEP_NS: i64 = 100_000_000;

/// Running sums of one score.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    n: u64,
    square: [f64; 6],
    normalised: [f64; 6],
}

/// Sums over still and moving instants.
type Split = [Sums; 2];

/// Scores runs; `smoothed` takes the motion from an offline smoother instead of the cycle's causal filter.
pub fn validate(
    runs: &[(&Run, Recording)],
    rig: &Rig,
    model: &ModelFile,
    smoothed: bool,
    mut row: impl FnMut(&Row) -> Result<(), Error>,
) -> Result<Validation, Error> {
    let mut sums = [Split::default(); 3];
    let mut full_scale_n: f64 = 0.0;
    let mut invalid = 0;
    let mut status = BTreeMap::new();
    for (run, recording) in runs {
        let mut assembler = Assembler::new(&rig.layout)?;
        let mut scorer = Scorer::new(rig, model, recording, smoothed);
        let mut failed = None;
        for_each_frame(run, |frame, _| {
            if failed.is_some() {
                return;
            }
            for snapshot in assembler.push(frame) {
                scorer.push(snapshot, recording, |next, baseline_errors| {
                    if !recording.is_excluded(next.t_s) {
                        full_scale_n = full_scale_n.max(next.truth.force_n.amax());
                        invalid += u64::from(next.estimate.status.has(Status::INVALID));
                        next.estimate.status.names().for_each(|name| *status.entry(name).or_default() += 1);
                        score(&mut sums, next, baseline_errors);
                    }
                    failed = failed.take().or(row(next).err());
                });
            }
        })?;
        if let Some(error) = failed {
            return Err(error);
        }
    }
    if sums[0].iter().all(|s| s.n == 0) {
        let names: Vec<&str> = runs.iter().map(|(_, recording)| recording.name.as_str()).collect();
        let problem = format!(
            "nothing to score: {invalid} instants have no wrench, all others are in an [[exclude]]; look at the gauges with `wrenchctl stats --config`"
        );
        return Err(Error::data(names.join(", "), problem));
    }
    let scores = |s: &Split, honest: bool| {
        let both = s[0].plus(&s[1]);
        [s[0], s[1], both].map(|s| s.score(full_scale_n, honest))
    };
    let baseline = |s: &Split| {
        let [still, moving, all] = scores(s, false);
        Baseline { still, moving, all }
    };
    let (five_parameter, nominal_axes) = (baseline(&sums[1]), baseline(&sums[2]));
    let [still, moving, all] = scores(&sums[0], true);
    let beside = |own: Score, of: fn(&Baseline) -> &Score| Score {
        five_parameter: Some(Box::new(of(&five_parameter).clone())),
        nominal_axes: Some(Box::new(of(&nominal_axes).clone())),
        ..own
    };
    Ok(Validation {
        format: 1,
        still: beside(still, |b| &b.still),
        moving: beside(moving, |b| &b.moving),
        all: beside(all, |b| &b.all),
        five_parameter,
        nominal_axes,
        full_scale_n,
        invalid,
        status,
    })
}

fn score(sums: &mut [Split; 3], row: &Row, baseline_errors: [Option<Vector6<f64>>; 2]) {
    let class = usize::from(!row.still);
    if let Ok(solution) = &row.estimate.outcome {
        let variance = solution.covariance.diagonal();
        sums[0][class].add(&(solution.wrench.to_vector() - row.truth.to_vector()), Some(&variance));
    }
    for (split, error) in sums[1..].iter_mut().zip(baseline_errors) {
        error.iter().for_each(|error| split[class].add(error, None));
    }
}

impl Sums {
    fn add(&mut self, error: &Vector6<f64>, variance: Option<&Vector6<f64>>) {
        self.n += 1;
        for k in 0..6 {
            self.square[k] += error[k] * error[k];
            self.normalised[k] += variance.map_or(0.0, |v| error[k] * error[k] / v[k]);
        }
    }

    fn plus(&self, other: &Self) -> Self {
        Self {
            n: self.n + other.n,
            square: std::array::from_fn(|k| self.square[k] + other.square[k]),
            normalised: std::array::from_fn(|k| self.normalised[k] + other.normalised[k]),
        }
    }

    fn score(&self, full_scale_n: f64, honest: bool) -> Score {
        if self.n == 0 {
            return Score::default();
        }
        let n = self.n as f64;
        let rms = |k: usize| (self.square[k] / n).sqrt();
        let rms_of_three = |from: usize| (self.square[from..from + 3].iter().sum::<f64>() / (3.0 * n)).sqrt();
        Score {
            n: self.n,
            force_rms_n: Some([rms(0), rms(1), rms(2)]),
            force_rms_all_n: Some(rms_of_three(0)),
            torque_rms_nm: Some([rms(3), rms(4), rms(5)]),
            torque_rms_all_nm: Some(rms_of_three(3)),
            force_rms_percent_fs: (full_scale_n > 0.0).then(|| 100.0 * rms_of_three(0) / full_scale_n),
            nees: honest.then(|| self.normalised.map(|v| v / n)),
            ..Score::default()
        }
    }
}

/// Everything that turns one run's snapshots into scored rows.
struct Scorer {
    tracker: MotionTracker,
    stage: Stage,
    reference: Reference,
    /// The motion is the reference's, too.
    smoothed: bool,
}

/// What a wrench is held against at any time.
struct Reference {
    truth: Dynamics,
    nominal: Dynamics,
    baselines: [BaselineEstimator; 2],
    still: Vec<bool>,
    /// Motion without lag at each instant of the recording: `[coordinate][instant]`.
    motion: Vec<Vec<JointMotion>>,
}

impl Scorer {
    fn new(rig: &Rig, model: &ModelFile, recording: &Recording, smoothed: bool) -> Self {
        let motion = recording
            .positions_rad
            .iter()
            .enumerate()
            .map(|(k, q)| smooth(&recording.sampled, q, model.encoder(k).position_sigma_rad))
            .collect();
        let dynamics = Dynamics::new(&rig.chain, &rig.sections);
        let five = model.sensors.iter().map(|s| {
            let five = &s.five_parameter;
            (five.compliance().vector(), five.bias_counts, five.r_counts_per_nm)
        });
        let nominal = model.sensors.iter().map(|s| {
            let k = s.nominal_axes.k_counts_per_nm;
            (Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, k), s.nominal_axes.bias_counts, k)
        });
        let reference = Reference {
            truth: dynamics.clone(),
            nominal: dynamics,
            baselines: [BaselineEstimator::new(five.collect()), BaselineEstimator::new(nominal.collect())],
            still: still_instants(&recording.at_ns, &recording.positions_rad),
            motion,
        };
        let (tracker, stage) =
            (MotionTracker::new(rig, model), Stage::of_model(rig, model).taken_for_proven());
        Self { tracker, stage, reference, smoothed }
    }

    /// The next snapshot of the recording; each row that is ready, with the baselines' errors.
    fn push(
        &mut self,
        snapshot: &Snapshot,
        recording: &Recording,
        mut out: impl FnMut(&Row, [Option<Vector6<f64>>; 2]),
    ) {
        let Self { tracker, stage, reference, smoothed } = self;
        let lagless = reference.motion_at(recording, snapshot.instant_ns).filter(|_| *smoothed);
        let mut ready = |estimate: &Estimate, snapshot: &Snapshot, motion: &[JointMotion]| {
            // The baselines know the arm as its URDF has it, at the encoders' positions.
            let errors = match estimate.outcome {
                Ok(_) => reference.baseline_errors(recording, snapshot, motion),
                Err(_) => [None, None],
            };
            out(&reference.row(estimate.clone(), recording), errors);
        };
        match lagless {
            Some(motion) => ready(&stage.estimate(snapshot, &motion, Status::GOOD), snapshot, &motion),
            None => tracker.advance(snapshot, stage, |instant| {
                ready(&instant.estimate, instant.snapshot, instant.motion);
            }),
        }
    }
}

impl Reference {
    fn row(&mut self, estimate: Estimate, recording: &Recording) -> Row {
        let at_ns = estimate.instant_ns;
        let after = recording.at_ns.partition_point(|t_ns| *t_ns < at_ns);
        let still = self.still.get(after).copied().unwrap_or(false);
        Row { t_s: seconds(at_ns, recording), truth: self.truth(recording, at_ns), still, estimate }
    }

    fn truth(&mut self, recording: &Recording, at_ns: i64) -> Wrench<Tip> {
        let t_s = seconds(at_ns, recording);
        let reference = recording.reference.as_ref().and_then(|r| r.at(t_s)).unwrap_or_else(Wrench::zero);
        let body = recording.loads.at(t_s);
        if body.mass_kg == 0.0 {
            return reference;
        }
        let Some(motion) = self.motion_at(recording, at_ns) else { return reference };
        update(&mut self.truth, &motion);
        reference + self.truth.payload_wrench(&body)
    }

    fn baseline_errors(
        &mut self,
        recording: &Recording,
        snapshot: &Snapshot,
        motion: &[JointMotion],
    ) -> [Option<Vector6<f64>>; 2] {
        update(&mut self.nominal, motion);
        let truth = self.truth(recording, snapshot.instant_ns).to_vector();
        self.baselines.each_mut().map(|b| Some(b.estimate(&self.nominal, snapshot)? - truth))
    }

    /// Motion without lag, between the instants of the recording by a straight line.
    fn motion_at(&self, recording: &Recording, at_ns: i64) -> Option<Vec<JointMotion>> {
        let after = recording.at_ns.partition_point(|t_ns| *t_ns < at_ns);
        let after_ns = *recording.at_ns.get(after)?;
        if after_ns == at_ns {
            return Some(self.motion.iter().map(|column| column[after]).collect());
        }
        let before = after.checked_sub(1)?;
        let step_ns = after_ns - recording.at_ns[before];
        let share = (at_ns - recording.at_ns[before]) as f64 / step_ns as f64;
        let between = |column: &Vec<JointMotion>| column[before].towards(&column[after], share);
        (step_ns <= LONGEST_STEP_NS).then(|| self.motion.iter().map(between).collect())
    }
}

/// Time from the log's first frame, s.
fn seconds(at_ns: i64, recording: &Recording) -> f64 {
    (at_ns - recording.start_ns) as f64 * 1e-9
}

fn update(dynamics: &mut Dynamics, motion: &[JointMotion]) {
    let part = |f: fn(&JointMotion) -> f64| motion.iter().map(f).collect::<Vec<_>>();
    dynamics.update(&part(|m| m.position_rad), &part(|m| m.velocity_rad_s), &part(|m| m.acceleration_rad_s2));
}

/// `W = (J' J'^T)^-1 J' t'`: unweighted, in Nm about each gauge's own sensing line.
struct BaselineEstimator {
    /// Compliance, bias and scale (counts/Nm) of each gauge.
    gauges: Vec<(Vector6<f64>, f64, f64)>,
    gls: Gls,
}

impl BaselineEstimator {
    fn new(gauges: Vec<(Vector6<f64>, f64, f64)>) -> Self {
        Self { gls: Gls::new(gauges.len()), gauges }
    }

    fn estimate(&mut self, dynamics: &Dynamics, snapshot: &Snapshot) -> Option<Vector6<f64>> {
        self.gls.clear();
        for (i, (compliance, bias, scale)) in self.gauges.iter().enumerate() {
            let Ok(reading) = snapshot.gauges[i] else { continue };
            if *scale == 0.0 {
                continue;
            }
            let torque_nm = (reading.value - bias - compliance.dot(&dynamics.load(i))) / scale;
            self.gls.push(&(dynamics.row_to_tip(i, compliance) / *scale), torque_nm, 1.0);
        }
        Some(self.gls.solve(&[1.0; 6]).ok()?.x)
    }
}
