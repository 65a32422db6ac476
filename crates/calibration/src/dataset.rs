//! Recordings to samples: stretches in which the arm holds still under a known load.

use model::dynamics::Dynamics;
use model::spatial::{RigidBody, Tip, Wrench};
use nalgebra::{Matrix6, Vector6};
use rig::Rig;
use rig::model_file::Encoder;

use crate::error::Error;
use crate::recording::Recording;
use crate::still::still_instants;

/// A stretch is cut where readings are further apart than this, ns.
const CUT_NS: i64 = 200_000_000;

/// A stretch is cut after this many readings, so that slow movements of the arm stay visible.
const LONGEST: usize = 1024;

/// A stretch shorter than this has too little to average, readings.
const SHORTEST: usize = 4;

/// The arm holding one pose under one kind of load.
#[derive(Clone, Debug)]
pub struct Window {
    /// Index of its session.
    pub session: usize,
    /// Index of its recording.
    pub recording: usize,
    /// Index of its first instant in the recording; its instants follow one another.
    pub first: usize,
    /// Times of the readings, s from the log's first frame.
    pub times_s: Vec<f64>,
    /// Mean joint positions, rad.
    pub pose_rad: Vec<f64>,
    /// Load of each gauge's section from the arm and what hangs on it, about S, in S.
    pub loads: Vec<Vector6<f64>>,
    /// What hangs on the tip.
    pub body: RigidBody,
    /// Wrench at the tip beside the loads at each time, where a reference was mounted; else empty.
    pub reference: Vec<Wrench<Tip>>,
    /// Takes a tip wrench in E to each gauge's section load in S; empty where there is no reference.
    pub adjoints: Vec<Matrix6<f64>>,
    /// Readings of each gauge: `[gauge][time]`, counts.
    pub counts: Vec<Vec<Option<f64>>>,
}

impl Window {
    /// Load of a gauge's section at a time, about S, in S.
    pub fn load(&self, gauge: usize, k: usize) -> Vector6<f64> {
        match self.reference.get(k) {
            Some(wrench) => self.loads[gauge] + self.adjoints[gauge] * wrench.to_vector(),
            None => self.loads[gauge],
        }
    }
}

/// All still samples of a calibration.
#[derive(Clone, Debug)]
pub struct Dataset {
    /// The stretches.
    pub windows: Vec<Window>,
    /// Names of the recordings.
    pub recordings: Vec<String>,
    /// Names of the sessions; gauges have one zero in each.
    pub sessions: Vec<String>,
    /// Noise of each coordinate's encoder.
    pub encoders: Vec<Encoder>,
    /// Covariance of one reading of the reference (white), in E; zero where there is none.
    pub reference_covariance: Matrix6<f64>,
    /// Number of still instants in the windows.
    pub samples: u64,
}

impl Dataset {
    /// Collects the still stretches of recordings of one robot.
    pub fn new(rig: &Rig, recordings: &[Recording]) -> Result<Self, Error> {
        let mut dataset = Self {
            windows: Vec::new(),
            recordings: recordings.iter().map(|r| r.name.clone()).collect(),
            sessions: Vec::new(),
            encoders: Vec::new(),
            reference_covariance: reference_noise(recordings),
            samples: 0,
        };
        let mut dynamics = Dynamics::new(&rig.chain, &rig.sections);
        for (index, recording) in recordings.iter().enumerate() {
            let session = dataset.session(&recording.session);
            let still = still_instants(&recording.at_ns, &recording.positions_rad);
            for (from, to) in stretches(recording, &still) {
                let window = window(recording, (index, session), from, to, &mut dynamics);
                dataset.samples += window.times_s.len() as u64;
                dataset.windows.push(window);
            }
        }
        if dataset.windows.is_empty() {
            let names: Vec<&str> = recordings.iter().map(|r| r.name.as_str()).collect();
            let problem =
                "the arm never holds still (every joint below 5 mrad/s for 0.3 s); record held poses";
            return Err(Error::data(names.join(", "), problem));
        }
        dataset.encoders = encoder_noise(rig, recordings, &dataset.windows);
        Ok(dataset)
    }

    fn session(&mut self, name: &str) -> usize {
        self.sessions.iter().position(|s| s == name).unwrap_or_else(|| {
            self.sessions.push(name.to_owned());
            self.sessions.len() - 1
        })
    }
}

/// Ranges of instants that are still, used, without a gap, and under one load.
fn stretches(recording: &Recording, still: &[bool]) -> Vec<(usize, usize)> {
    let kind = |k: usize| {
        let t_s = recording.time_s(k);
        let mounted = recording.reference.as_ref().is_some_and(|r| r.at(t_s).is_some());
        (recording.loads.at(t_s), mounted)
    };
    let usable = |k: usize| still[k] && !recording.is_excluded(recording.time_s(k));
    let mut out = Vec::new();
    let mut from = 0;
    for k in 0..=recording.len() {
        let cut = k == recording.len()
            || !usable(k)
            || k > from
                && (recording.at_ns[k] - recording.at_ns[k - 1] > CUT_NS
                    || k - from >= LONGEST
                    || kind(k) != kind(from));
        if !cut {
            continue;
        }
        if k - from >= SHORTEST {
            out.push((from, k));
        }
        from = if k < recording.len() && usable(k) { k } else { k + 1 };
    }
    out
}

fn window(
    recording: &Recording,
    (index, session): (usize, usize),
    from: usize,
    to: usize,
    dynamics: &mut Dynamics,
) -> Window {
    let n = (to - from) as f64;
    let pose_rad: Vec<f64> =
        recording.positions_rad.iter().map(|q| q[from..to].iter().sum::<f64>() / n).collect();
    dynamics.update_static(&pose_rad);
    let times_s: Vec<f64> = (from..to).map(|k| recording.time_s(k)).collect();
    let body = recording.loads.at(times_s[0]);
    let hanging = dynamics.payload_wrench(&body);
    let gauges = recording.counts.len();
    let loads = (0..gauges)
        .map(|g| dynamics.load(g) + dynamics.load_of_tip_wrench(g, &hanging).to_vector())
        .collect();
    let reference: Vec<Wrench<Tip>> =
        recording.reference.iter().flat_map(|r| times_s.iter().filter_map(|t| r.at(*t))).collect();
    let adjoints = if reference.is_empty() {
        Vec::new()
    } else {
        (0..gauges).map(|g| dynamics.tip_adjoint(g)).collect()
    };
    Window {
        session,
        recording: index,
        first: from,
        times_s,
        pose_rad,
        loads,
        body,
        reference,
        adjoints,
        counts: recording.counts.iter().map(|z| z[from..to].to_vec()).collect(),
    }
}

/// White noise of the reference, axis by axis, from second differences of successive rows (robustly: a push that
/// changes smoothly has next to none).
fn reference_noise(recordings: &[Recording]) -> Matrix6<f64> {
    let rows: Vec<_> = recordings.iter().filter_map(|r| r.reference.as_ref()).map(|r| r.rows()).collect();
    Matrix6::from_diagonal(&Vector6::from_fn(|axis, _| {
        let differences = rows.iter().flat_map(|rows| rows.windows(3)).filter_map(|w| {
            let (a, b) = (w[1].t_s - w[0].t_s, w[2].t_s - w[1].t_s);
            let even = (a - b).abs() < 0.1 * a;
            let at = |k: usize| w[k].wrench.to_vector()[axis];
            even.then(|| (at(0) - 2.0 * at(1) + at(2)).abs())
        });
        robust_sigma(differences.collect()).powi(2) / 6.0
    }))
}

/// Noise of the encoders from second differences of successive positions while still; at least a tenth of a count.
fn encoder_noise(rig: &Rig, recordings: &[Recording], windows: &[Window]) -> Vec<Encoder> {
    let still = |columns: &dyn Fn(&Recording) -> &Vec<f64>, width: usize| -> Vec<f64> {
        let mut out = Vec::new();
        for window in windows {
            let recording = &recordings[window.recording];
            let column = columns(recording);
            let from = recording
                .at_ns
                .partition_point(|t| (*t - recording.start_ns) as f64 * 1e-9 < window.times_s[0] - 1e-9);
            let to = (from + window.times_s.len()).min(column.len());
            if from < to {
                let piece = &column[from..to];
                match width {
                    1 => out.extend(piece.iter().map(|v| v.abs())),
                    _ => out.extend(piece.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).abs())),
                }
            }
        }
        out
    };
    let names = rig.chain.coordinate_names();
    rig.layout
        .joints
        .iter()
        .enumerate()
        .map(|(k, joint)| {
            let step = (joint.position.spec.scale * joint.position.to_si).abs();
            let noise = root_mean_square(&still(&|r| &r.positions_rad[k], 3)) / 6f64.sqrt();
            let velocity = joint.velocity.as_ref().map(|signal| {
                let step = (signal.spec.scale * signal.to_si).abs();
                root_mean_square(&still(&|r| &r.velocities_rad_s[k], 1)).max(step / 12f64.sqrt())
            });
            Encoder {
                name: names[k].to_owned(),
                position_sigma_rad: noise.max(step / 12f64.sqrt()),
                velocity_sigma_rad_s: velocity,
            }
        })
        .collect()
}

fn root_mean_square(values: &[f64]) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    (values.iter().map(|v| v * v).sum::<f64>() / values.len() as f64).sqrt()
}

/// Standard deviation of Gaussian numbers from the median of their magnitudes.
fn robust_sigma(mut magnitudes: Vec<f64>) -> f64 {
    if magnitudes.is_empty() {
        return 0.0;
    }
    let middle = magnitudes.len() / 2;
    let (_, median, _) = magnitudes.select_nth_unstable_by(middle, f64::total_cmp);
    *median / 0.674_489_75
}
