//! What a cheap gauge adds to the strain it should show: bent characteristic, hysteresis, creep, drift with temperature.

use rand::RngExt;
use rand::rngs::StdRng;

use super::{log_uniform, sign, uniform};

/// Departure from a straight line, as a share of half the gauge's span.
const BEND: (f64, f64) = (0.0003, 0.001);
/// Half the height of the hysteresis loop, likewise.
const LOOP: (f64, f64) = (0.0005, 0.0015);
/// Strain within which a loop turns round, likewise.
const TURNS_WITHIN: (f64, f64) = (0.05, 0.3);
/// Creep after `CREEP_AT_S`, as a share of the strain.
const CREEP: (f64, f64) = (0.0005, 0.004);
const CREEP_AT_S: f64 = 300.0;
/// Exponent of time in the creep.
const CREEP_EXPONENT: (f64, f64) = (0.1, 0.3);
/// Retardation time beyond which little is left of it, s.
const CREEP_ENDS_S: (f64, f64) = (40.0, 160.0);
/// Drift a kelvin, as a share of half the span.
const DRIFT_PER_K: (f64, f64) = (0.0005, 0.008);
/// Lags one after the other from thermometer to gauge, s.
const LAGS_S: [(f64, f64); 2] = [(40.0, 70.0), (8.0, 20.0)];
/// Elements of a Maxwell chain, and their widths.
const SLIPS: usize = 5;
const SLIP_WIDTH: (f64, f64) = (0.01, 0.4);

/// Retardation times of the creep: dense enough that their sum follows a power of time within a percent, s.
const RETARDATIONS: usize = 14;
const SHORTEST_S: f64 = 0.2;
const RETARDATION_STEP: f64 = 2.3;

/// Faults of one gauge. Strain is counts beyond the bias, less `centre_counts`, over `half_counts`.
#[derive(Clone, Debug, PartialEq)]
pub struct Strain {
    /// Counts beyond the bias in the middle of the span.
    pub centre_counts: f64,
    /// Half the span, counts.
    pub half_counts: f64,
    /// Which curve the characteristic follows beside the line, and how much of it.
    pub bend: (Curve, f64),
    /// The loop, and half its height.
    pub hysteresis: (Hysteresis, f64),
    /// Creep after five minutes as a share of the strain, and the exponent of time.
    pub creep: (f64, f64),
    /// Retardation time beyond which little is left of the creep, s.
    pub creep_ends_s: f64,
    /// Drift a kelvin.
    pub drift_per_k: f64,
    /// Lags one after the other, s.
    pub lags_s: [f64; 2],
}

/// Shapes of a characteristic's departure from a line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Curve {
    /// x^3.
    Cubic,
    /// x |x|.
    Bowed,
    /// sin 2x.
    Wavy,
    /// tanh of twice a shifted x: one side saturates first.
    Lopsided,
    /// x tanh 1.5x: to the same side for both signs, and nothing without load, whose reading is the bias.
    Hollow,
}

/// Kinds of hysteresis; all give -1 .. 1.
#[derive(Clone, Debug, PartialEq)]
pub enum Hysteresis {
    /// R. Bouc (1967), Y.-K. Wen (J. Eng. Mech. 102, 1976): width, exponent, share of the part that opposes unloading.
    BoucWen {
        /// Strain within which the loop turns round.
        width: f64,
        /// Sharpness of the turn.
        exponent: f64,
        /// gamma / (beta + gamma).
        unloading: f64,
    },
    /// Springs that slip in parallel (Maxwell; Iwan 1966).
    Maxwell(Maxwell),
}

/// Width and share of each slipping spring.
#[derive(Clone, Debug, PartialEq)]
pub struct Maxwell {
    /// (width, share); shares sum to one.
    pub slips: [(f64, f64); SLIPS],
}

impl Strain {
    /// A gauge without any fault, whose strain is counted in this half range (counts).
    #[must_use]
    pub fn straight(half_counts: f64) -> Self {
        Self {
            centre_counts: 0.0,
            half_counts,
            bend: (Curve::Cubic, 0.0),
            hysteresis: (Hysteresis::BoucWen { width: 0.1, exponent: 1.0, unloading: 0.5 }, 0.0),
            creep: (0.0, 0.2),
            creep_ends_s: f64::INFINITY,
            drift_per_k: 0.0,
            lags_s: [1.0, 1.0],
        }
    }

    /// A characteristic bent by a share of the half range: to one side for an even order, to both for an odd one.
    pub fn bend_by(&mut self, order: i32, share: f64) {
        let curve = if order % 2 == 0 { Curve::Hollow } else { Curve::Cubic };
        self.bend = (curve, share);
    }

    pub(super) fn draw(centre_counts: f64, half_counts: f64, rng: &mut StdRng) -> Self {
        let curves = [Curve::Cubic, Curve::Bowed, Curve::Wavy, Curve::Lopsided];
        let curve = curves[rng.random_range(0..curves.len())];
        let hysteresis = if rng.random_bool(0.5) {
            Hysteresis::BoucWen {
                width: log_uniform(rng, TURNS_WITHIN.0, TURNS_WITHIN.1),
                exponent: uniform(rng, 1.0, 2.0),
                unloading: uniform(rng, 0.4, 0.9),
            }
        } else {
            Hysteresis::Maxwell(Maxwell::draw(rng))
        };
        Self {
            centre_counts,
            half_counts,
            bend: (curve, sign(rng) * log_uniform(rng, BEND.0, BEND.1)),
            hysteresis: (hysteresis, log_uniform(rng, LOOP.0, LOOP.1)),
            creep: (
                sign(rng) * log_uniform(rng, CREEP.0, CREEP.1),
                uniform(rng, CREEP_EXPONENT.0, CREEP_EXPONENT.1),
            ),
            creep_ends_s: log_uniform(rng, CREEP_ENDS_S.0, CREEP_ENDS_S.1),
            drift_per_k: sign(rng) * log_uniform(rng, DRIFT_PER_K.0, DRIFT_PER_K.1),
            lags_s: LAGS_S.map(|(low, high)| uniform(rng, low, high)),
        }
    }
}

impl Maxwell {
    fn draw(rng: &mut StdRng) -> Self {
        let mut slips: [(f64, f64); SLIPS] = std::array::from_fn(|_| {
            (log_uniform(rng, SLIP_WIDTH.0, SLIP_WIDTH.1), rng.random_range(0.2..1.0))
        });
        let sum: f64 = slips.iter().map(|slip| slip.1).sum();
        slips.iter_mut().for_each(|slip| slip.1 /= sum);
        Self { slips }
    }
}

impl Curve {
    fn at(self, x: f64) -> f64 {
        match self {
            Self::Cubic => x.powi(3),
            Self::Bowed => x * x.abs(),
            Self::Wavy => (2.0 * x).sin(),
            Self::Lopsided => (2.0 * x - 1.0).tanh(),
            Self::Hollow => x * (1.5 * x).tanh(),
        }
    }
}

/// One gauge's faults over time.
#[derive(Clone, Debug)]
pub(crate) struct StrainState {
    fault: Strain,
    /// Share of each retardation time.
    weights: [f64; RETARDATIONS],
    crept: [f64; RETARDATIONS],
    slip: [f64; SLIPS],
    bouc: f64,
    warmth_c: [f64; 2],
    strain: f64,
    started: bool,
}

impl StrainState {
    /// Somewhere inside its loop, and otherwise at rest for long: crept to its end, and as warm as its thermometer.
    pub(crate) fn new(fault: &Strain, rng: &mut StdRng) -> Self {
        let exponent = fault.creep.1;
        // t^n is the sum of 1 - exp(-t / tau) with weights tau^n over the logarithm of tau; what is cut off of them ends it.
        let weight = |tau_s: f64| tau_s.powf(exponent) * (-tau_s / fault.creep_ends_s).exp();
        let raw: [f64; RETARDATIONS] = std::array::from_fn(|k| weight(tau_s(k)));
        let at: f64 = (0..RETARDATIONS).map(|k| raw[k] * -(-CREEP_AT_S / tau_s(k)).exp_m1()).sum();
        Self {
            weights: raw.map(|w| w / at),
            crept: [0.0; RETARDATIONS],
            slip: std::array::from_fn(|_| rng.random_range(-1.0..1.0)),
            bouc: rng.random_range(-1.0..1.0),
            warmth_c: [0.0; 2],
            strain: 0.0,
            started: false,
            fault: fault.clone(),
        }
    }

    /// What the faults add (counts) `step_s` later, under this strain (counts beyond the bias) and temperature (degC).
    pub(crate) fn next(&mut self, step_s: f64, counts: f64, temperature_c: f64, room_c: f64) -> f64 {
        let x = (counts - self.fault.centre_counts) / self.fault.half_counts;
        if !self.started {
            self.started = true;
            self.crept = [x; RETARDATIONS];
            self.strain = x;
            self.warmth_c = [temperature_c; 2];
        }
        self.relax(step_s, x, temperature_c);
        self.turn(x - self.strain);
        self.strain = x;
        let looped = match &self.fault.hysteresis.0 {
            Hysteresis::BoucWen { .. } => self.bouc,
            Hysteresis::Maxwell(chain) => chain.slips.iter().zip(&self.slip).map(|(s, z)| s.1 * z).sum(),
        };
        let crept: f64 = self.weights.iter().zip(&self.crept).map(|(w, lagged)| w * lagged).sum();
        let (curve, bend) = self.fault.bend;
        let share = bend * curve.at(x)
            + self.fault.hysteresis.1 * looped
            + self.fault.creep.0 * crept
            + self.fault.drift_per_k * (self.warmth_c[1] - room_c);
        share * self.fault.half_counts
    }

    fn relax(&mut self, step_s: f64, x: f64, temperature_c: f64) {
        for (k, lagged) in self.crept.iter_mut().enumerate() {
            *lagged += (x - *lagged) * -(-step_s / tau_s(k)).exp_m1();
        }
        let mut input = temperature_c;
        for (warmth, lag_s) in self.warmth_c.iter_mut().zip(self.fault.lags_s) {
            *warmth += (input - *warmth) * -(-step_s / lag_s).exp_m1();
            input = *warmth;
        }
    }

    fn turn(&mut self, change: f64) {
        match &self.fault.hysteresis.0 {
            Hysteresis::Maxwell(chain) => {
                for (z, (width, _)) in self.slip.iter_mut().zip(chain.slips) {
                    *z = (*z + change / width).clamp(-1.0, 1.0);
                }
            }
            Hysteresis::BoucWen { width, exponent, unloading } => {
                // Small steps: the loop is a differential equation in the strain.
                let pieces = (change.abs() / (0.02 * width)).ceil().clamp(1.0, 1000.0);
                for _ in 0..pieces as usize {
                    let z = self.bouc;
                    let opposing = unloading * (change * z).signum() + (1.0 - unloading);
                    let slope = (1.0 - z.abs().powf(*exponent) * opposing) / width;
                    self.bouc = (z + slope * change / pieces).clamp(-1.0, 1.0);
                }
            }
        }
    }
}

fn tau_s(k: usize) -> f64 {
    SHORTEST_S * RETARDATION_STEP.powi(k as i32)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn quiet() -> Strain {
        Strain { lags_s: [60.0, 10.0], ..Strain::straight(1000.0) }
    }

    fn state(fault: &Strain) -> StrainState {
        StrainState::new(fault, &mut crate::random::stream(4, crate::random::Purpose::FaultStart))
    }

    #[test]
    fn creep_follows_a_power_of_time() {
        let mut s = state(&Strain { creep: (0.01, 0.2), ..quiet() });
        let before = s.next(0.0, 0.0, 20.0, 20.0);
        let mut t_s = 0.0;
        for _ in 0..6000 {
            t_s += 0.1;
            let share = (s.next(0.1, 1000.0, 20.0, 20.0) - before) / 10.0;
            if t_s > 2.0 {
                let law = (t_s / CREEP_AT_S).powf(0.2);
                // The shortest times are missing, which a constant stands for.
                assert!(
                    (share - law).abs() < 0.25 && (t_s < 100.0 || (share - law).abs() < 0.1),
                    "{t_s} {share} {law}"
                );
            }
        }
    }

    #[test]
    fn loops_close_at_their_height_and_differ_on_the_way_back() {
        let chain = Maxwell { slips: [(0.01, 0.2), (0.03, 0.2), (0.06, 0.2), (0.1, 0.2), (0.2, 0.2)] };
        for hysteresis in
            [Hysteresis::BoucWen { width: 0.1, exponent: 1.5, unloading: 0.6 }, Hysteresis::Maxwell(chain)]
        {
            let mut s = state(&Strain { hysteresis: (hysteresis, 0.001), ..quiet() });
            let sweep = |s: &mut StrainState, to: f64| {
                let from = s.strain * 1000.0;
                (1..=100)
                    .map(|k| s.next(0.01, from + (to - from) * f64::from(k) / 100.0, 20.0, 20.0))
                    .collect::<Vec<_>>()
            };
            sweep(&mut s, 1000.0);
            let down = sweep(&mut s, -1000.0);
            let up = sweep(&mut s, 1000.0);
            assert!((down[99] + 1.0).abs() < 0.02 && (up[99] - 1.0).abs() < 0.02, "{down:?}");
            assert!(down[49] < -0.9 && up[49] > 0.9, "{} {}", down[49], up[49]);
        }
    }

    #[test]
    fn warmth_lags_twice() {
        let mut s = state(&Strain { drift_per_k: 0.01, ..quiet() });
        let start = s.next(0.0, 0.0, 20.0, 20.0);
        let soon = s.next(1.0, 0.0, 30.0, 20.0) - start;
        for _ in 0..600 {
            s.next(1.0, 0.0, 30.0, 20.0);
        }
        let late = s.next(1.0, 0.0, 30.0, 20.0);
        assert!(soon.abs() < 1.0 && (late - 100.0).abs() < 0.1, "{soon} {late}");
    }
}
