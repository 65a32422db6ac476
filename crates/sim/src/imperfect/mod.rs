//! The arm as it was built, with every small fault of a cheap one at once: links, zeros, springs, base, gauges, weights, reference.
//!
//! What a calibration is tried on. The forms are those of the books on each fault, not those that an estimator likes: joints
//! stiffen under torque, hysteresis is Bouc and Wen's or Maxwell's, creep follows a power of time, a gauge's warmth lags its thermometer
//! twice. Sizes are the usual ones of cheap arms and gauges.

mod body;
mod strain;

use model::spatial::{RigidBody, Tip, Wrench};
use nalgebra::{Matrix3, Rotation3, Vector3};
use rand::RngExt;
use rand::rngs::StdRng;
use rig::Rig;
use rig::run::LoadInterval;

use crate::SimError;
use crate::gauge::normal;
use crate::motion::MotionLimits;
use crate::random::{Purpose, stream};
use crate::truth::TrueGauge;

pub use body::{Body, Spring};
pub(crate) use strain::StrainState;
pub use strain::{Hysteresis, Maxwell, Strain};

/// Standard deviation of a weight's mass against what is written on it.
const WEIGHT_SHARE: f64 = 0.002;
/// Standard deviation of where it hangs, m, each axis.
const WEIGHT_PLACE_M: f64 = 0.0005;
/// Standard deviation of the reference's gains.
const REFERENCE_GAIN: f64 = 0.004;
/// Standard deviation of its mounting, rad, each axis.
const REFERENCE_TURN_RAD: f64 = 0.004;
/// Standard deviation of its zero, N, and Nm over a tenth of a metre.
const REFERENCE_ZERO_N: f64 = 0.01;

/// Everything that is not as declared.
#[derive(Clone, Debug, PartialEq)]
pub struct Imperfections {
    /// Links, joints and base.
    pub body: Body,
    /// Faults of each gauge.
    pub strains: Vec<Strain>,
    /// Mass of all weights over the declared one.
    pub weight_factor: f64,
    /// Where each weight hangs less where it is said to, by its number in the scenario (m, in E); the last one for all that follow.
    pub weight_places_m: Vec<Vector3<f64>>,
    /// The reference sensor of calibrations.
    pub reference: ReferenceFault,
}

/// A reference sensor that is a little off: says `gain * R^T * wrench + zero`.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceFault {
    /// Gains, force then moment.
    pub gain: [f64; 6],
    /// Turn of the sensor against E (a rotation vector), rad.
    pub turn_rad: Vector3<f64>,
    /// What it says without load: N, Nm.
    pub zero: [f64; 6],
}

impl Imperfections {
    /// Faults for an arm whose gauges are these, from a seed.
    ///
    /// # Errors
    /// A joint whose limits leave no motion.
    pub fn draw(rig: &Rig, gauges: &[TrueGauge], seed: u64) -> Result<Self, SimError> {
        let mut rng = stream(seed, Purpose::Faults);
        let body = Body::draw(&rig.chain, &mut rng);
        let spans = spans(rig, gauges, &MotionLimits::of(&rig.chain)?, &mut rng);
        let strains = spans.into_iter().map(|(centre, half)| Strain::draw(centre, half, &mut rng)).collect();
        let mut spread = |sigma: f64| sigma * normal(&mut rng);
        let reference = ReferenceFault {
            gain: std::array::from_fn(|_| 1.0 + spread(REFERENCE_GAIN)),
            turn_rad: Vector3::from_fn(|_, _| spread(REFERENCE_TURN_RAD)),
            zero: std::array::from_fn(|k| spread(REFERENCE_ZERO_N) * if k < 3 { 1.0 } else { 0.1 }),
        };
        Ok(Self {
            body,
            strains,
            weight_factor: 1.0 + spread(WEIGHT_SHARE),
            weight_places_m: (0..3).map(|_| Vector3::from_fn(|_, _| spread(WEIGHT_PLACE_M))).collect(),
            reference,
        })
    }

    /// What really hangs where this is declared (kg, m in E).
    #[must_use]
    pub fn hanging(&self, declared: &[LoadInterval]) -> Vec<LoadInterval> {
        let last = self.weight_places_m.len().saturating_sub(1);
        let real = |(index, load): (usize, &LoadInterval)| {
            let off = self.weight_places_m.get(index.min(last)).copied().unwrap_or_default();
            let mut load = *load;
            load.mass_kg *= self.weight_factor;
            load.com_m = std::array::from_fn(|k| load.com_m[k] + off[k]);
            load
        };
        declared.iter().enumerate().map(real).collect()
    }
}

impl ReferenceFault {
    /// What it says of a wrench (N, Nm about E's origin, in E).
    #[must_use]
    pub fn says(&self, wrench: &Wrench<Tip>) -> Wrench<Tip> {
        let back = Rotation3::new(self.turn_rad).inverse();
        let (force, moment) = (back * wrench.force_n, back * wrench.moment_nm);
        let part = |turned: &Vector3<f64>, from: usize| {
            Vector3::from_fn(|k, _| self.gain[from + k] * turned[k] + self.zero[from + k])
        };
        Wrench::new(part(&force, 0), part(&moment, 3))
    }
}

/// Middle and half-width of what each gauge reads beyond its bias (counts) over poses, bare and with half a kilogram.
fn spans(rig: &Rig, gauges: &[TrueGauge], limits: &MotionLimits, rng: &mut StdRng) -> Vec<(f64, f64)> {
    const POSES: usize = 200;
    let mut dynamics = model::dynamics::Dynamics::new(&rig.chain, &rig.sections);
    let weight = RigidBody::from_com(0.5, Vector3::new(0.0, 0.0, 0.05), Matrix3::zeros());
    let mut spans = vec![(f64::INFINITY, f64::NEG_INFINITY); gauges.len()];
    for pose in 0..POSES {
        dynamics.update_static(&limits.random_pose(rng, 0.9));
        let tip = if pose % 2 == 0 { Wrench::zero() } else { dynamics.payload_wrench(&weight) };
        for (index, (gauge, span)) in gauges.iter().zip(&mut spans).enumerate() {
            let load = dynamics.load(index) + dynamics.load_of_tip_wrench(index, &tip).to_vector();
            let counts = gauge.compliance.vector().dot(&load);
            *span = (span.0.min(counts), span.1.max(counts));
        }
    }
    // A gauge that weight hardly loads still answers to pushes of some newtons.
    let least = |gauge: &TrueGauge| 1.0 + gauge.compliance.vector().fixed_rows::<3>(3).norm();
    let mut middle_and_half = Vec::with_capacity(gauges.len());
    for ((low, high), gauge) in spans.into_iter().zip(gauges) {
        middle_and_half.push((0.5 * (low + high), (0.5 * (high - low)).max(least(gauge))));
    }
    middle_and_half
}

fn uniform(rng: &mut StdRng, low: f64, high: f64) -> f64 {
    rng.random_range(low..high)
}

fn log_uniform(rng: &mut StdRng, low: f64, high: f64) -> f64 {
    uniform(rng, low.ln(), high.ln()).exp()
}

fn sign(rng: &mut StdRng) -> f64 {
    if rng.random_bool(0.5) { 1.0 } else { -1.0 }
}
