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
use crate::solve::{scaled, unscaled};
use crate::triangle::Triangle;

/// Held poses further apart than this in time do not tell the zero between them, s.
const APART_S: f64 = 20.0;

/// A pause in the recording longer than this is a gap, ns.
const GAP_NS: i64 = 200_000_000;

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
            heard.iter().for_each(|gauges| sum.merge(&gauges[gauge].triangle));
            let weight = heard.iter().map(|gauges| gauges[gauge].weight).sum();
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
            && is_whole(recording, &instants)
            && instants.clone().all(|k| is_free(recording, before, k));
        usable.then_some(Move { recording, before, after, instants })
    };
    let all: Vec<Move> = dataset.windows.windows(2).filter_map(between).collect();
    let every = all.len().div_ceil(MOST_MOVES).max(1);
    all.into_iter().step_by(every).collect()
}

/// Whether the recording goes on without a gap over a move: what the joints did in one is not known.
fn is_whole(recording: &Recording, instants: &Range<usize>) -> bool {
    let around = &recording.sampled[instants.start - 1..=instants.end];
    around.windows(2).all(|pair| pair[1].at_ns - pair[0].at_ns <= GAP_NS)
}

/// Whether nothing but the body of the held pose acts at an instant.
fn is_free(recording: &Recording, held: &Window, instant: usize) -> bool {
    let t_s = recording.time_s(instant);
    !recording.is_excluded(t_s)
        && recording.loads.at(t_s) == held.body
        && recording.reference.as_ref().is_none_or(|reference| reference.at(t_s).is_none())
}

/// What a gauge feels along a move.
struct Felt {
    /// Section load (scaled), N.
    load: Vector6<f64>,
    /// Variance of what uncertain accelerations make of it, counts^2.
    motion_counts2: f64,
}

/// A gauge's rows of one or more moves, and how many independent ones they are worth.
#[derive(Clone, Debug, Default)]
struct Rows {
    triangle: Triangle<WIDTH>,
    weight: f64,
}

/// Rows of one move for every gauge.
fn hear_move(rig: &Rig, dataset: &Dataset, this: &Move, known: &[Known], now: &[Vector6<f64>]) -> Vec<Rows> {
    let felt = along(rig, dataset, this, now);
    let rows = |gauge: usize| match Line::new(this, gauge) {
        Some(line) => rows(this, gauge, &line, &felt, &known[gauge], &now[gauge]),
        None => Rows::default(),
    };
    (0..known.len()).map(rows).collect()
}

/// Squares of a gauge's answers to the joints' accelerations, (counts s^2/rad)^2.
fn squares(dynamics: &Dynamics, gauge: usize, sensitivity: &Vector6<f64>) -> Vec<f64> {
    let row = dynamics.row_to_tip(gauge, &unscaled(sensitivity));
    dynamics.row_by_motion(gauge, &row).map(|[_, _, by_acceleration]| by_acceleration.powi(2)).collect()
}

/// Section loads along a move, `[instant][gauge]`, with the sensitivities as they are known now.
fn along(rig: &Rig, dataset: &Dataset, this: &Move, now: &[Vector6<f64>]) -> Vec<Vec<Felt>> {
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
    let mut felt = Vec::with_capacity(instants.len());
    let mut by_acceleration2: Vec<Vec<f64>> = Vec::new();
    for (row, k) in instants.clone().enumerate() {
        let all = |f: fn(&JointMotion) -> f64| joints.iter().map(|j| f(&j[k - from])).collect::<Vec<f64>>();
        dynamics.update(
            &all(|m| m.position_rad),
            &all(|m| m.velocity_rad_s),
            &all(|m| m.acceleration_rad_s2),
        );
        let loads: Vec<Vector6<f64>> = (0..now.len()).map(|g| scaled(&dynamics.load(g))).collect();
        if row % LOOK_EVERY == 0 {
            dynamics.differentiate();
            by_acceleration2 = (0..now.len()).map(|gauge| squares(&dynamics, gauge, &now[gauge])).collect();
        }
        let by = |gauge: usize, joint: usize| {
            by_acceleration2[gauge][joint] * joints[joint][k - from].covariance[(2, 2)]
        };
        let of = |(gauge, load): (usize, Vector6<f64>)| Felt {
            load,
            motion_counts2: (0..joints.len()).map(|joint| by(gauge, joint)).sum(),
        };
        felt.push(loads.into_iter().enumerate().map(of).collect());
    }
    felt
}

/// A gauge's rows of one move.
fn rows(
    this: &Move,
    gauge: usize,
    held: &Line,
    felt: &[Vec<Felt>],
    known: &Known,
    now: &Vector6<f64>,
) -> Rows {
    let recording = this.recording;
    let mut rows = Rows::default();
    for row in 1..felt.len().saturating_sub(1) {
        let k = this.instants.start + row;
        let Some(counts) = recording.counts[gauge][k] else { continue };
        let step_s = (recording.sampled[k + 1].at_ns - recording.sampled[k - 1].at_ns) as f64 * 1e-9;
        let share = (0.5 * step_s / TOGETHER_S).min(1.0);
        let (at, rested) = (&felt[row][gauge], held.at(recording.time_s(k)));
        let moved = at.load - rested.load;
        let rate = now.dot(&(felt[row + 1][gauge].load - felt[row - 1][gauge].load)) / step_s;
        let left = counts - rested.counts - known.seen.dot(&moved);
        let scale = (share / (known.noise_counts.powi(2) + at.motion_counts2)).sqrt();
        let mut line = [0.0; WIDTH];
        line[..6].copy_from_slice(moved.as_slice());
        (line[6], line[7]) = (-rate, left);
        rows.triangle.add(&line.map(|value| value * scale));
        rows.weight += share;
    }
    rows
}

/// Means of a gauge over a held pose, or between two.
struct Rested {
    middle_s: f64,
    /// Section load (scaled), N.
    load: Vector6<f64>,
    counts: f64,
}

/// The line on which a gauge would go from the held pose before a move to the one after.
struct Line {
    from: Rested,
    to: Rested,
}

impl Line {
    /// `None` where the gauge is silent in one of them.
    fn new(this: &Move, gauge: usize) -> Option<Self> {
        let rested = |window: &Window| {
            let counts: Vec<f64> = window.counts[gauge].iter().flatten().copied().collect();
            let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
            let load = scaled(&window.loads[gauge]);
            (!counts.is_empty()).then(|| Rested {
                middle_s: mean(&window.times_s),
                load,
                counts: mean(&counts),
            })
        };
        Some(Self { from: rested(this.before)?, to: rested(this.after)? })
    }

    fn at(&self, t_s: f64) -> Rested {
        let (from, to) = (&self.from, &self.to);
        let share = (t_s - from.middle_s) / (to.middle_s - from.middle_s);
        let counts = from.counts + share * (to.counts - from.counts);
        Rested { middle_s: t_s, load: from.load.lerp(&to.load, share), counts }
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
