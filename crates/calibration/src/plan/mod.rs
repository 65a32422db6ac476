//! What to record next: the poses and weights that shrink the worst uncertainty of the published wrench most.
//!
//! ```text
//! cov(gauge i) -> variance of its reading at a workspace pose -> generalised least squares -> cov(W)
//! ```
//!
//! A held pose under a known weight loads section i by `x_i = [L_i, 1]` (about S, in S, then the bias) and is one reading of
//! variance `s_i^2`: its information on gauge i is `x_i x_i' / s_i^2`. The criterion is the mean over a workspace of the trace of the
//! calibration's part of `cov(W)` (moments over the characteristic length); noise, which no pose takes away, is not in it. The squared
//! trace, which weighs the worst places more, leaves more in all of them and, from some twenty poses up, in the worst as well. With the
//! estimator as it is weighted so far, the criterion's change is linear in the gauges' covariances P, so that one matrix M a gauge tells
//! what a candidate is worth: `x' P M P x / (s^2 + x' P x)`. Poses are added greedily, then each is exchanged for a better one (V. V.
//! Fedorov, Theory of Optimal Experiments, 1972, with this criterion in place of the determinant) and moved joint by joint to its best.
//!
//! How much there is to gain: on the example arm tilted by 45 degrees, 12 planned poses are worth some 20 random ones and 24 some 37 where
//! one mass hangs at three points. No choice among 1500 more poses makes 24 much better: by the bound of Kiefer and Wolfowitz it has at
//! least 0.96 of this criterion, where 48 random ones have 0.72. With masses to choose from, 12 planned poses are worth some 28 random
//! ones of which each mass has its share, and 24 some 48.
//!
//! Not in it: errors of the arm's masses and lengths, temperature, collisions. Poses are within the joints' limits and no more.

mod candidates;
mod design;
mod gauge;
mod workspace;

use model::dynamics::Dynamics;
use model::spatial::{RigidBody, Tip};
use nalgebra::{Matrix3, Vector3};
use rig::{ModelFile, Rig};
use serde::Serialize;

pub use candidates::spread_poses;
pub use gauge::{GaugeState, HOLD_S};
pub use workspace::{Accuracy, Workspace};

use crate::error::Error;
use crate::observability::{Remedies, words};
use candidates::Candidates;
use design::Design;

/// Poses to choose from; each may be held bare or under any of the weights.
const CANDIDATE_POSES: usize = 600;

/// No plan is longer than this, poses: each candidate is held once at most.
pub const LONGEST: usize = 400;

/// A sensitivity known worse than this share of a gauge's whole sensitivity is called not determined.
const DETERMINED_TO: f64 = 0.1;

/// A weight that can hang on the tip.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Weight {
    /// Its mass, kg.
    pub mass_kg: f64,
    /// Where it hangs, m in the tip frame.
    pub com_m: [f64; 3],
}

/// What the plan is to reach.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Goal {
    /// So many poses.
    Count(usize),
    /// As few poses as bring the worst force deviation below this, N.
    ForceSigma(f64),
}

/// A pose to hold.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlannedPose {
    /// Place in the order of worth: 1 helps most.
    pub rank: usize,
    /// Position of each moving joint, base to tip, rad.
    pub joints_rad: Vec<f64>,
    /// What hangs on the tip; nothing where absent.
    pub load: Option<Weight>,
}

/// A direction of a gauge that stays undetermined.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NotHelped {
    /// The gauge.
    pub sensor: String,
    /// Unit direction of load in S; moments over the characteristic length 0.1 m.
    pub direction: [f64; 6],
    /// The direction in physical words.
    pub words: String,
    /// What would show it.
    pub remedy: String,
}

/// `wrenchctl plan --json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plan {
    format: u32,
    /// How long each pose is to be held, s.
    pub hold_s: f64,
    /// Names of the moving joints, base to tip.
    pub joints: Vec<String>,
    /// The poses, those of one weight together, the most worth first.
    pub poses: Vec<PlannedPose>,
    /// Before any of them.
    pub before: Accuracy,
    /// After all of them.
    pub after: Accuracy,
    /// What noise alone would leave of a perfect calibration.
    pub noise_alone: Accuracy,
    /// After the first, the first two, ... in the order of rank.
    pub progress: Vec<Accuracy>,
    /// What these poses and weights cannot show.
    pub not_helped: Vec<NotHelped>,
}

/// Plans for a robot whose gauges are known as well as `gauges` say; the same seed gives the same plan.
///
/// # Errors
/// A goal below what noise alone leaves, or beyond [`LONGEST`] poses.
pub fn plan(
    rig: &Rig,
    gauges: &[GaugeState],
    weights: &[Weight],
    goal: Goal,
    seed: u64,
) -> Result<Plan, Error> {
    let mut dynamics = Dynamics::new(&rig.chain, &rig.sections);
    let workspace = Workspace::new(rig, gauges, &mut dynamics, seed);
    let candidates = Candidates::new(rig, weights, CANDIDATE_POSES, seed);
    let noise_alone = workspace.noise_alone(gauges);
    if let Goal::ForceSigma(wanted_n) = goal
        && noise_alone.force_sigma_n >= wanted_n
    {
        let problem = format!(
            "noise alone leaves {:.4} N in the worst pose of the workspace: no calibration reaches {wanted_n} N; ask for more than that, or filter the wrench",
            noise_alone.force_sigma_n
        );
        return Err(Error::data(rig.config.file.display(), problem));
    }
    let mut design = Design::new(gauges, candidates, &workspace);
    let reached = |accuracy: &Accuracy, poses: usize| match goal {
        Goal::Count(count) => poses >= count.min(LONGEST),
        Goal::ForceSigma(wanted_n) => accuracy.force_sigma_n <= wanted_n,
    };
    let progress = design.find(&reached);
    let after = progress.last().copied().unwrap_or_else(|| workspace.accuracy(gauges));
    if !reached(&after, progress.len()) {
        let problem = format!(
            "{} poses with these weights leave {:.4} N in the worst pose of the workspace; ask for more than that, or give other weights (--weights), or see what they cannot show with --count",
            progress.len(),
            after.force_sigma_n
        );
        return Err(Error::data(rig.config.file.display(), problem));
    }
    Ok(Plan {
        format: 1,
        hold_s: HOLD_S,
        joints: rig.chain.coordinate_names().into_iter().map(str::to_owned).collect(),
        poses: grouped(&design, weights),
        before: workspace.accuracy(gauges),
        after,
        noise_alone,
        progress,
        not_helped: not_helped(rig, &design.gauges()),
    })
}

/// What is known after these poses (rad) were held, each with nothing or a weight on the tip.
pub fn after<'a>(
    rig: &Rig,
    gauges: &[GaugeState],
    holds: impl IntoIterator<Item = (&'a [f64], Option<&'a Weight>)>,
) -> Vec<GaugeState> {
    let mut dynamics = Dynamics::new(&rig.chain, &rig.sections);
    let mut gauges = gauges.to_vec();
    for (pose_rad, weight) in holds {
        dynamics.update_static(pose_rad);
        let wrench = weight.map_or_else(TipWrench::zero, |weight| dynamics.payload_wrench(&body(weight)));
        for (gauge, x) in gauges.iter_mut().zip(candidates::loaded(&dynamics, &wrench)) {
            gauge.hold(&x);
        }
    }
    gauges
}

/// Poses of one weight together, so that weights are changed as seldom as possible.
fn grouped(design: &Design, weights: &[Weight]) -> Vec<PlannedPose> {
    let candidates = design.candidates();
    let mut ranked: Vec<(usize, usize)> = design.chosen().iter().copied().enumerate().collect();
    ranked.sort_by_key(|(rank, chosen)| (candidates.weight(*chosen), *rank));
    ranked
        .into_iter()
        .map(|(rank, chosen)| PlannedPose {
            rank: rank + 1,
            joints_rad: candidates.pose_rad(chosen).to_vec(),
            // The first choice is nothing at all.
            load: candidates.weight(chosen).checked_sub(1).map(|k| weights[k]),
        })
        .collect()
}

fn not_helped(rig: &Rig, gauges: &[GaugeState]) -> Vec<NotHelped> {
    let mut out = Vec::new();
    let mut remedies = None;
    for (k, (gauge, entry)) in gauges.iter().zip(&rig.config.sensors).enumerate() {
        for direction in gauge.undetermined(DETERMINED_TO) {
            let remedies = remedies.get_or_insert_with(|| Remedies::new(rig));
            out.push(NotHelped {
                sensor: entry.name.clone(),
                direction: direction.into(),
                words: words(&entry.name, &direction),
                remedy: remedies.remedy(k, &direction),
            });
        }
    }
    out
}

/// What is known of the gauges of a calibrated model.
///
/// # Errors
/// A baseline model, which states no covariance.
pub fn known(model: &ModelFile) -> Result<Vec<GaugeState>, Error> {
    let of = |sensor: &rig::model_file::Sensor| {
        GaugeState::of_model(sensor).ok_or_else(|| {
            let problem =
                "has no covariance (a baseline, or a model that was edited); calibrate with --axes full";
            Error::data(format!("the model of sensor \"{}\"", sensor.name), problem)
        })
    };
    model.sensors.iter().map(of).collect()
}

/// What is known of gauges that were never calibrated: that they are more or less where they were meant to be.
pub fn unknown(rig: &Rig) -> Vec<GaugeState> {
    vec![GaugeState::uncalibrated(); rig.sections.len()]
}

fn body(weight: &Weight) -> RigidBody {
    RigidBody::from_com(weight.mass_kg, Vector3::from(weight.com_m), Matrix3::zeros())
}

/// Marker for the frame that tip wrenches are in.
type TipWrench = model::spatial::Wrench<Tip>;
