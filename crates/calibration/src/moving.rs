//! What the moving parts of recordings tell: sensitivities that no held pose shows, and how late the gauges are against the joints.
//!
//! Between two held poses under the same load, readings `z` and section loads `l` (Newton and Euler over the arm as its URDF has it, joints
//! smoothed) are taken against the line from the pose before to the pose after: zero, drift and creep fall out. With `c` what held poses
//! told of the compliance, `U` the directions that they left open, and `tau` the gauge's lateness:
//!
//! ```text
//! z - c . l  =  (U u) . l  -  tau d/dt (c + U u) . l  +  e        var(e) = noise^2 + sum_k (c . dl/dqdd_k)^2 var(qdd_k)
//! ```
//!
//! Only what held poses left open is taken from here: links' inertias are less well known than their weights.

use std::ops::Range;

use model::dynamics::Dynamics;
use model::motion::{JointMotion, smooth};
use nalgebra::{DMatrix, DVector, Vector6};
use rig::Rig;

use crate::dataset::{Dataset, Window};
use crate::gauges::in_parallel;
use crate::recording::Recording;
use crate::solve::scaled;
use crate::triangle::Triangle;

/// Held poses further apart than this in time do not tell the zero between them, s.
const APART_S: f64 = 20.0;

/// Instants of the held poses beside a move that its smoothing takes in.
const BESIDE: usize = 60;

/// Moves that are looked at, evenly over all there are: more of them tell the same again.
const MOST_MOVES: usize = 80;

/// Errors of smoothed accelerations go together over this time, s.
const TOGETHER_S: f64 = 0.05;

/// Instants between two at which the loads' answer to accelerations is computed: it changes as slowly as the pose.
const LOOK_EVERY: usize = 8;

/// Columns: six loads, the rate, and the reading.
const WIDTH: usize = 8;

/// What the links' inertias may be off by, as a share of what motion tells.
const INERTIA_SHARE: f64 = 0.05;

/// Another arm's faults (yielding joints, hysteresis) leave at least this share of a gauge's typical sensitivity open.
const LEFT_SHARE: f64 = 0.03;

/// Sensitivities beyond so many usual ones are not expected, nor lateness beyond so much.
const LOOSE: f64 = 10.0;
const LOOSE_S: f64 = 1.0;

/// With fewer independent rows than this nothing is told.
const FEWEST: f64 = 30.0;

/// What is known of a gauge beforehand.
#[derive(Clone, Debug)]
pub(crate) struct Known {
    /// Scaled compliance as far as held poses showed it, counts/N.
    pub seen: Vector6<f64>,
    /// Orthonormal directions that they left open (scaled).
    pub open: Vec<Vector6<f64>>,
    /// A gauge's usual sensitivity, counts/N.
    pub typical_counts_per_n: f64,
    /// Standard deviation of one reading, counts.
    pub noise_counts: f64,
}

/// What motion told of a gauge.
#[derive(Clone, Debug, Default)]
pub(crate) struct Told {
    /// As many orthonormal directions as were open (scaled): sensitivity along each and its standard deviation, counts/N.
    pub directions: Vec<(Vector6<f64>, f64, f64)>,
    /// How much later the gauge is than the joints, and its standard deviation, s; `None` where no move tells.
    pub late_s: Option<(f64, f64)>,
}

/// A move between two held poses.
struct Move<'a> {
    recording: &'a Recording,
    before: &'a Window,
    after: &'a Window,
    instants: Range<usize>,
}

/// Hears all gauges over the moves of all recordings.
pub(crate) fn hear(rig: &Rig, dataset: &Dataset, recordings: &[Recording], known: &[Known]) -> Vec<Told> {
    let moves = moves(dataset, recordings);
    let mut told = vec![Told::default(); known.len()];
    // Where something is open a second pass knows how sure accelerations must be along what the first one found.
    let passes = if known.iter().all(|known| known.open.is_empty()) { 1 } else { 2 };
    for _ in 0..passes {
        let now: Vec<Vector6<f64>> = known
            .iter()
            .zip(&told)
            .map(|(known, told)| {
                known.seen + told.directions.iter().map(|(d, value, _)| d * *value).sum::<Vector6<f64>>()
            })
            .collect();
        let heard = in_parallel(moves.len(), |k| hear_move(rig, dataset, &moves[k], known, &now));
        for (gauge, told) in told.iter_mut().enumerate() {
            let mut sum = Triangle::<WIDTH>::default();
            heard.iter().flatten().for_each(|gauges| sum.merge(&gauges[gauge].0));
            let weight = heard.iter().flatten().map(|gauges| gauges[gauge].1).sum();
            *told = solve(&known[gauge], &sum.finish(), weight);
        }
    }
    told
}

fn moves<'a>(dataset: &'a Dataset, recordings: &'a [Recording]) -> Vec<Move<'a>> {
    let between = |pair: &'a [Window]| {
        let [before, after] = pair else { return None };
        let recording = &recordings[before.recording];
        let instants = before.first + before.times_s.len()..after.first;
        let free = before.reference.is_empty() && after.reference.is_empty();
        let same = before.recording == after.recording && before.body == after.body && free;
        let usable = same
            && !instants.is_empty()
            && recording.time_s(instants.end) - recording.time_s(instants.start) < APART_S
            && instants.clone().all(|k| is_free(recording, before, k));
        usable.then_some(Move { recording, before, after, instants })
    };
    let all: Vec<Move> = dataset.windows.windows(2).filter_map(between).collect();
    let every = all.len().div_ceil(MOST_MOVES).max(1);
    all.into_iter().step_by(every).collect()
}

/// Whether nothing but the body of the held pose acts at an instant.
fn is_free(recording: &Recording, held: &Window, instant: usize) -> bool {
    let t_s = recording.time_s(instant);
    !recording.is_excluded(t_s)
        && recording.loads.at(t_s) == held.body
        && recording.reference.as_ref().is_none_or(|reference| reference.at(t_s).is_none())
}

/// Rows of one move for every gauge, and how many independent ones they are worth.
fn hear_move(
    rig: &Rig,
    dataset: &Dataset,
    this: &Move,
    known: &[Known],
    now: &[Vector6<f64>],
) -> Option<Vec<(Triangle<WIDTH>, f64)>> {
    let (recording, instants) = (this.recording, &this.instants);
    let from = instants.start.saturating_sub(BESIDE.min(this.before.times_s.len()));
    let to = instants.end + BESIDE.min(this.after.times_s.len());
    let sampled = &recording.sampled[from..to];
    let joints: Vec<Vec<JointMotion>> = recording
        .positions_rad
        .iter()
        .zip(&dataset.encoders)
        .map(|(q, encoder)| smooth(sampled, &q[from..to], encoder.position_sigma_rad))
        .collect();
    let mut dynamics = Dynamics::new(&rig.chain, &rig.sections);
    dynamics.set_payload(&this.before.body);
    let mut loads = Vec::with_capacity(instants.len());
    let mut motion_counts2 = Vec::with_capacity(instants.len());
    for (row, k) in instants.clone().enumerate() {
        let part = |f: fn(&JointMotion) -> f64| joints.iter().map(|j| f(&j[k - from])).collect::<Vec<f64>>();
        dynamics.update(
            &part(|m| m.position_rad),
            &part(|m| m.velocity_rad_s),
            &part(|m| m.acceleration_rad_s2),
        );
        loads.push((0..known.len()).map(|g| scaled(&dynamics.load(g))).collect::<Vec<_>>());
        if row % LOOK_EVERY == 0 {
            dynamics.differentiate();
        }
        let by = |gauge: usize, joint: usize| {
            now[gauge].dot(&scaled(dynamics.by_acceleration(gauge, joint))).powi(2)
                * joints[joint][k - from].covariance[(2, 2)]
        };
        let of = |gauge: usize| (0..joints.len()).map(|joint| by(gauge, joint)).sum::<f64>();
        motion_counts2.push((0..known.len()).map(of).collect::<Vec<f64>>());
    }
    let lines: Vec<Line> = (0..known.len()).map(|gauge| Line::new(this, gauge)).collect::<Option<_>>()?;
    let mut out = vec![(Triangle::<WIDTH>::default(), 0.0); known.len()];
    for row in 1..loads.len().saturating_sub(1) {
        let k = instants.start + row;
        let step_s = (recording.sampled[k + 1].at_ns - recording.sampled[k - 1].at_ns) as f64 * 1e-9;
        let share = (0.5 * step_s / TOGETHER_S).min(1.0);
        for (gauge, (triangle, weight)) in out.iter_mut().enumerate() {
            let Some(counts) = recording.counts[gauge][k] else { continue };
            let (load, held_counts) = lines[gauge].at(recording.time_s(k));
            let moved = loads[row][gauge] - load;
            let rate = now[gauge].dot(&(loads[row + 1][gauge] - loads[row - 1][gauge])) / step_s;
            let left = counts - held_counts - known[gauge].seen.dot(&moved);
            let variance = known[gauge].noise_counts.powi(2) + motion_counts2[row][gauge];
            let scale = (share / variance).sqrt();
            let mut line = [0.0; WIDTH];
            line[..6].copy_from_slice(moved.as_slice());
            (line[6], line[7]) = (-rate, left);
            triangle.add(&line.map(|value| value * scale));
            *weight += share;
        }
    }
    Some(out)
}

/// Load (scaled) and reading of a gauge on the line from the held pose before a move to the one after.
struct Line {
    from: (f64, Vector6<f64>, f64),
    to: (f64, Vector6<f64>, f64),
}

impl Line {
    /// `None` where the gauge is silent in one of them.
    fn new(this: &Move, gauge: usize) -> Option<Self> {
        let held = |window: &Window| {
            let counts: Vec<f64> = window.counts[gauge].iter().flatten().copied().collect();
            let n = counts.len() as f64;
            let middle_s = window.times_s.iter().sum::<f64>() / window.times_s.len() as f64;
            (n > 0.0).then(|| (middle_s, scaled(&window.loads[gauge]), counts.iter().sum::<f64>() / n))
        };
        Some(Self { from: held(this.before)?, to: held(this.after)? })
    }

    fn at(&self, t_s: f64) -> (Vector6<f64>, f64) {
        let share = (t_s - self.from.0) / (self.to.0 - self.from.0);
        (self.from.1.lerp(&self.to.1, share), self.from.2 + share * (self.to.2 - self.from.2))
    }
}

/// What is open, and the lateness, by least squares on a triangle that stands for `weight` independent rows.
fn solve(known: &Known, r: &[[f64; WIDTH]; WIDTH], weight: f64) -> Told {
    let open = known.open.len();
    let free = weight - open as f64 - 1.0;
    // Next to nothing is known beforehand, so that what no move shows comes out as not known.
    let loose = |k: usize| if k < open { LOOSE * known.typical_counts_per_n } else { LOOSE_S };
    let columns = DMatrix::from_fn(WIDTH + open + 1, open + 1, |i, k| match known.open.get(k) {
        _ if i >= WIDTH => f64::from(u8::from(i - WIDTH == k)),
        Some(direction) => loose(k) * (0..6).map(|c| r[i][c] * direction[c]).sum::<f64>(),
        None => loose(k) * r[i][6],
    });
    let readings = DVector::from_fn(WIDTH + open + 1, |i, _| if i < WIDTH { r[i][7] } else { 0.0 });
    let scale = DVector::from_fn(open + 1, |k, _| loose(k));
    let Ok(inverse) = columns.clone().pseudo_inverse(0.0) else { return Told::default() };
    let shares = &inverse * &readings;
    let left2 = (&columns * &shares - &readings).norm_squared();
    if free < FEWEST || !left2.is_finite() {
        return Told::default();
    }
    let spread = DMatrix::from_diagonal(&scale) * &inverse;
    let covariance = &spread * spread.transpose() * (left2 / free).max(1.0);
    let found = scale.component_mul(&shares);
    Told {
        directions: directions(known, &found, &covariance),
        late_s: Some((found[open], covariance[(open, open)].sqrt())),
    }
}

/// The open directions turned so that what is told of them is independent: direction, sensitivity and its standard deviation.
fn directions(
    known: &Known,
    found: &DVector<f64>,
    covariance: &DMatrix<f64>,
) -> Vec<(Vector6<f64>, f64, f64)> {
    let open = known.open.len();
    if open == 0 {
        return Vec::new();
    }
    let turned = covariance.view((0, 0), (open, open)).into_owned().symmetric_eigen();
    let direction = |j: usize| {
        let along = turned.eigenvectors.column(j);
        let value = along.dot(&found.rows(0, open));
        let direction: Vector6<f64> = known.open.iter().zip(along.iter()).map(|(d, share)| d * *share).sum();
        let systematic = (INERTIA_SHARE * value).hypot(LEFT_SHARE * known.typical_counts_per_n);
        (direction, value, turned.eigenvalues[j].max(0.0).sqrt().hypot(systematic))
    };
    (0..open).map(direction).collect()
}
