//! Taring: every gauge's zero found again while nothing touches the tip.
//!
//! What a gauge's reading holds beside the arm's own load, averaged over half a second, becomes the shift of its zero. So the
//! residuals at zero wrench vanish, and they do in every pose, which subtracting a wrench would not achieve: a zero that
//! drifted reads as another wrench in every pose. Never begun by itself; gone after a restart.

use model::estimator::{Excitation, GaugeReading, WrenchEstimator, Zero};
use model::motion::JointMotion;
use model::spatial::Wrench;

use crate::cycle::Refusal;

/// How long a tare averages, ns.
pub const TARE_NS: i64 = 500_000_000;

/// A joint that is faster than this (rad/s) is in motion.
pub const MOVING_ABOVE_RAD_S: f64 = 5e-3;

/// The noise's slow part is taken as independent from one such part of the average to the next.
const PARTS: usize = 5;

/// Fewer instants are no average.
const LEAST_INSTANTS: u32 = 10;

/// A tare that was done.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tared {
    /// Instants averaged.
    pub instants: u32,
    /// Gauges that had too few readings for a zero: they are left out as long as the tare is applied.
    pub left_out: u32,
}

/// Why a tare was not done; everything stays as it was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TareRefusal {
    /// This coordinate moves.
    Moving(usize),
    /// There was no wrench at some instant.
    NoWrench(Refusal),
    /// No or too few snapshots came.
    Silent,
    /// Fewer than six gauges would have a zero.
    TooFewGauges,
    /// It was taken back, or configuration or model were exchanged meanwhile.
    Interrupted,
}

impl std::fmt::Display for TareRefusal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Moving(k) => {
                write!(f, "coordinate {} is in motion; hold the arm still and tare again", k + 1)
            }
            Self::NoWrench(refusal) => write!(f, "there is no valid wrench: {refusal}"),
            Self::Silent => f.write_str("too few snapshots came while averaging; is the bus alive?"),
            Self::TooFewGauges => f.write_str("fewer than six gauges had readings while averaging"),
            Self::Interrupted => f.write_str("it was interrupted by an untare or a reload; tare again"),
        }
    }
}

/// Sums over one gauge's readings, in parts of the averaging time.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    parts: [(u32, f64); PARTS],
    excitation: Excitation,
}

/// The tare of one cycle: being taken, applied, or not. Allocates at construction only.
#[derive(Clone, Debug)]
pub(crate) struct Tare {
    /// First instant of the average that runs, ns; `Some(None)` before the first.
    running: Option<Option<i64>>,
    instants: u32,
    sums: Vec<Sums>,
    /// Smallest and largest position of each coordinate, rad.
    positions: Vec<(f64, f64)>,
    /// Which gauges the applied tare leaves out; none where no tare is applied.
    applied: Option<Tared>,
    left_out: Vec<bool>,
    outcome: Option<Result<Tared, TareRefusal>>,
}

impl Tare {
    pub(crate) fn new(gauges: usize, coordinates: usize) -> Self {
        Self {
            running: None,
            instants: 0,
            sums: vec![Sums::default(); gauges],
            positions: vec![(0.0, 0.0); coordinates],
            applied: None,
            left_out: vec![false; gauges],
            outcome: None,
        }
    }

    pub(crate) fn begin(&mut self) {
        self.running = Some(None);
    }

    /// Ends an average that runs.
    pub(crate) fn refuse(&mut self, refusal: TareRefusal) {
        if self.running.take().is_some() {
            self.outcome = Some(Err(refusal));
        }
    }

    /// Takes the calibration's zeros again.
    pub(crate) fn undo(&mut self, estimator: &mut WrenchEstimator) {
        self.refuse(TareRefusal::Interrupted);
        self.applied = None;
        self.left_out.fill(false);
        (0..self.sums.len()).for_each(|gauge| estimator.set_zero(gauge, Zero::CALIBRATED));
    }

    pub(crate) fn applied(&self) -> Option<Tared> {
        self.applied
    }

    pub(crate) fn is_left_out(&self, gauge: usize) -> bool {
        self.left_out[gauge]
    }

    pub(crate) fn take_outcome(&mut self) -> Option<Result<Tared, TareRefusal>> {
        self.outcome.take()
    }

    /// Applies what another cycle had applied: its estimator's gauges are these.
    pub(crate) fn take_over(&mut self, other: &Self) {
        self.applied = other.applied;
        self.left_out.copy_from_slice(&other.left_out);
    }

    /// Takes in an instant with a wrench: the readings that are fit for a zero, and the joints' motion.
    pub(crate) fn observe(
        &mut self,
        instant_ns: i64,
        readings: impl Iterator<Item = Option<GaugeReading>>,
        motion: &[JointMotion],
        estimator: &mut WrenchEstimator,
    ) {
        let Some(begun_ns) = self.running else { return };
        let begun_ns = begun_ns
            .filter(|begun_ns| instant_ns >= *begun_ns)
            .unwrap_or_else(|| self.restart(instant_ns, motion));
        if let Some(moving) = self.moving(motion) {
            return self.refuse(TareRefusal::Moving(moving));
        }
        let part = ((instant_ns - begun_ns) * PARTS as i64 / TARE_NS).clamp(0, PARTS as i64 - 1) as usize;
        for ((gauge, reading), sums) in readings.enumerate().zip(&mut self.sums) {
            let Some(reading) = reading else { continue };
            let (count, sum) = &mut sums.parts[part];
            *count += 1;
            *sum += estimator.unexplained_counts(gauge, &reading);
            sums.excitation += estimator.excitation(gauge, &reading, &Wrench::zero());
        }
        self.instants += 1;
        if instant_ns - begun_ns >= TARE_NS {
            let outcome = self.apply(estimator);
            self.running = None;
            self.outcome = Some(outcome);
        }
    }

    fn restart(&mut self, instant_ns: i64, motion: &[JointMotion]) -> i64 {
        self.running = Some(Some(instant_ns));
        self.instants = 0;
        self.sums.fill(Sums::default());
        for (range, joint) in self.positions.iter_mut().zip(motion) {
            *range = (joint.position_rad, joint.position_rad);
        }
        instant_ns
    }

    /// The first coordinate that moves: fast, or far over the time.
    fn moving(&mut self, motion: &[JointMotion]) -> Option<usize> {
        const FAR_RAD: f64 = MOVING_ABOVE_RAD_S * TARE_NS as f64 * 1e-9;
        let ranges = self.positions.iter_mut().zip(motion);
        ranges
            .map(|((least, most), joint)| {
                (*least, *most) = (least.min(joint.position_rad), most.max(joint.position_rad));
                let sigma_rad_s = joint.covariance[(1, 1)].max(0.0).sqrt();
                *most - *least > FAR_RAD
                    || joint.velocity_rad_s.abs() - 3.0 * sigma_rad_s > MOVING_ABOVE_RAD_S
            })
            .position(|moves| moves)
    }

    fn apply(&mut self, estimator: &mut WrenchEstimator) -> Result<Tared, TareRefusal> {
        if self.instants < LEAST_INSTANTS {
            return Err(TareRefusal::Silent);
        }
        let zero = |gauge: usize| self.sums[gauge].zero(estimator.gauges()[gauge].noise_counts2);
        let found = (0..self.sums.len()).filter(|gauge| zero(*gauge).is_some()).count();
        if found < 6 {
            return Err(TareRefusal::TooFewGauges);
        }
        for (gauge, (sums, left_out)) in self.sums.iter().zip(&mut self.left_out).enumerate() {
            let zero = sums.zero(estimator.gauges()[gauge].noise_counts2);
            *left_out = zero.is_none();
            estimator.set_zero(gauge, zero.unwrap_or(Zero::CALIBRATED));
        }
        let tared = Tared { instants: self.instants, left_out: (self.sums.len() - found) as u32 };
        self.applied = Some(tared);
        Ok(tared)
    }
}

impl Sums {
    /// The zero, unless most parts of the time have no reading.
    ///
    /// Its variance is that of the mean of the parts, and no smaller than if the gauge's calibrated noise changed from part
    /// to part only: a few parts alone cannot prove less.
    fn zero(&self, noise_counts2: f64) -> Option<Zero> {
        let heard = || self.parts.iter().filter(|(count, _)| *count > 0);
        let parts = heard().count() as f64;
        if 2.0 * parts <= PARTS as f64 {
            return None;
        }
        let (count, sum) = heard().fold((0, 0.0), |(n, s), (count, sum)| (n + count, s + sum));
        let mean = sum / f64::from(count);
        let spread: f64 = heard().map(|(count, sum)| (sum / f64::from(*count) - mean).powi(2)).sum();
        Some(Zero {
            shift_counts: mean,
            variance_counts2: (spread / (parts - 1.0)).max(noise_counts2) / parts,
            found_at: Some(self.excitation / f64::from(count)),
        })
    }
}
