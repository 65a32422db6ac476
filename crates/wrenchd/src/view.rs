//! What people and programs see of a running daemon, as JSON: the control socket, the live page and the terminal view share it.
//!
//! SI units throughout, in the names. A quantity that is not known is `null`.

use serde::{Deserialize, Serialize};

use crate::board::{Board, GaugeReadback};
use crate::published::Published;
use rig::cycle::{GaugeState, PARITY_LIMIT_SIGMA};

/// One instant with the state of everything that it came from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Live {
    /// Number of the record.
    pub sequence: u64,
    /// When it was published, s since the Unix epoch.
    pub published_s: f64,
    /// From the instant to its publication, s.
    pub age_s: f64,
    /// From the last frame's stamp to the publication, s.
    pub latency_s: f64,
    /// The status byte.
    pub status: u8,
    /// Names of its bits; "good" where none is set.
    pub status_names: Vec<String>,
    /// Why there is no wrench; absent where there is one.
    pub reason: Option<String>,
    /// The environment's wrench about the tip's origin, in tip axes: Fx Fy Fz (N), Tx Ty Tz (Nm).
    pub wrench: Option<[f64; 6]>,
    /// Its standard deviations.
    pub sigma: Option<[f64; 6]>,
    /// Their whole covariance, rows and columns as in `wrench`: N^2, N Nm, Nm^2.
    #[serde(default)]
    pub covariance: Option<[[f64; 6]; 6]>,
    /// Singular values of the weighted problem with moments over 0.1 m, 1/N, largest first: a direction of value s has the standard
    /// deviation 1/s N.
    #[serde(default)]
    pub singular_values_per_n: Option<[f64; 6]>,
    /// Protection level: the largest error that one faulty gauge can hide from the spare ones, for each component as in `wrench`; `null` where
    /// it can hide anything.
    pub protection: Option<[Option<f64>; 6]>,
    /// The parity check; absent without a wrench.
    pub parity: Option<Parity>,
    /// Every gauge.
    pub gauges: Vec<Gauge>,
    /// The tare that is applied.
    pub tare: Option<Tare>,
    /// The payload that is subtracted.
    pub payload: Option<Payload>,
}

/// How well the spare gauges agree.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parity {
    /// Sum of squares of the residuals in units of their standard deviations.
    pub chi2: f64,
    /// Spare gauges: what the sum is expected to be.
    pub dof: usize,
    /// Above this it is flagged.
    pub limit: f64,
}

/// One gauge at the last instant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Gauge {
    /// Its name in the configuration.
    pub name: String,
    /// "used", or why not.
    pub state: String,
    /// Whether it may be at fault: the gauges disagree, and it is not clear which of them is wrong.
    pub suspect: bool,
    /// Its last reading that was used, counts.
    pub counts: f64,
    /// Its part of the parity residual, standard deviations.
    pub residual_sigma: f64,
    /// What a tare subtracts, counts.
    pub zero_shift_counts: f64,
}

/// A tare that is applied.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tare {
    /// When it was taken, s since the Unix epoch.
    pub taken_s: f64,
    /// How long ago, s.
    pub age_s: f64,
}

/// A payload that is subtracted.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Payload {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass in the tip frame, m.
    pub com_m: [f64; 3],
}

/// A gauge's state in a word or two.
pub fn state_name(state: GaugeState) -> String {
    match state {
        GaugeState::Used => "used".into(),
        GaugeState::Absent(absence) => absence.to_string(),
        GaugeState::Stuck => "stuck".into(),
        GaugeState::NotTared => "not tared".into(),
        GaugeState::Isolated => "isolated".into(),
    }
}

impl Live {
    /// The view of a record; `names` are the gauges', `monotonic_ns` is now.
    pub fn new(record: &Published, board: &Board, names: &[String], monotonic_ns: i64) -> Self {
        let solution = record.outcome.ok();
        let gauge = |(name, gauge): (&String, GaugeReadback)| Gauge {
            name: name.clone(),
            state: state_name(gauge.state),
            suspect: gauge.suspect,
            counts: gauge.counts,
            residual_sigma: gauge.residual_sigma,
            zero_shift_counts: gauge.zero_shift_counts,
        };
        let seconds = |ns: i64| ns as f64 * 1e-9;
        Self {
            sequence: record.sequence,
            published_s: seconds(record.published_ns),
            age_s: seconds(record.age_ns),
            latency_s: seconds((record.published_ns - record.last_stamp_ns).max(0)),
            status: record.status.bits(),
            status_names: record.status.names().map(str::to_owned).collect(),
            reason: record.outcome.err().map(|why| why.to_string()),
            wrench: solution.map(|s| s.wrench.to_vector().into()),
            sigma: solution.map(|s| std::array::from_fn(|k| s.covariance[(k, k)].max(0.0).sqrt())),
            covariance: solution.map(|s| s.covariance.into()),
            singular_values_per_n: solution.map(|s| s.singular_values_per_n),
            protection: solution.map(|s| s.protection.map(|level| level.is_finite().then_some(level))),
            parity: solution.map(|s| Parity {
                chi2: s.parity_chi2,
                dof: s.parity_dof,
                limit: PARITY_LIMIT_SIGMA.powi(2) + s.parity_dof as f64,
            }),
            gauges: names.iter().zip(board.gauges()).map(gauge).collect(),
            tare: board.tared().map(|at| Tare {
                taken_s: seconds(at.realtime_ns),
                age_s: seconds(monotonic_ns - at.monotonic_ns),
            }),
            payload: Payload::of(board),
        }
    }
}

impl Payload {
    /// What a board says is subtracted.
    pub fn of(board: &Board) -> Option<Self> {
        let body = board.payload();
        body.com_m().map(|com_m| Self { mass_kg: body.mass_kg, com_m: com_m.into() })
    }
}

/// The daemon as a whole.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct DaemonStatus {
    /// Version of the program.
    pub version: String,
    /// The configuration file.
    pub config: String,
    /// The model file.
    pub model: String,
    /// SHA-256 (hex) of the model's text.
    pub model_sha256: String,
    /// "fixed" or "event".
    pub mode: String,
    /// Rate of the grid in fixed mode, Hz.
    pub rate_hz: f64,
    /// Since the start, s.
    pub uptime_s: f64,
    /// Records published in the last second, Hz.
    pub published_hz: f64,
    /// Frames received in the last second, Hz.
    pub frames_hz: f64,
    /// From last frame to publication, 99 % of all since the start are below, s.
    pub latency_p99_s: Option<f64>,
    /// Counters since the start, by name.
    pub totals: std::collections::BTreeMap<String, u64>,
    /// The newest instant; absent before the first.
    pub live: Option<Live>,
}
