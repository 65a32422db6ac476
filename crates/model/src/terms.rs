//! What a gauge adds to its reading beside the load's share: temperature, nonlinearity, creep and hysteresis.
//!
//! ```text
//! z = C . L + b + sum_k c_k phi_k + e
//! ```
//!
//! Every regressor `phi_k` is a causal function of the gauge's own readings and its thermometer's, so the same [`Conditioner`]
//! serves calibration and cycle, and the coefficients `c_k` enter linearly. The readings stand for the strain behind them: to
//! first order in the (small) coefficients the two regressors agree. With `u = (z - centre) / scale`, smoothed:
//!
//! - temperature: the thermometer's reading, smoothed, through a first-order lag, less a reference
//! - power: `u^n`
//! - creep: `lag(u) - u`, one time constant a term; a power law is a sum of such (Findley; Schapery)
//! - hysteresis: `play(u) - u`, one width a term (Prandtl and Ishlinskii; M. Krasnosel'skii, A. Pokrovskii, Systems with Hysteresis)
//!
//! A state that is not known after a start has an uncertainty, which falls as the past is forgotten.

/// Most terms that one gauge can have.
pub const MOST_TERMS: usize = 9;

/// Values of a gauge's terms at one instant (K, or without unit); unused ones are zero.
pub type Regressors = [f64; MOST_TERMS];

/// Readings are smoothed over this time before they drive power, creep and hysteresis, s: their noise is none of the load's.
const SMOOTHING_S: f64 = 0.1;

/// Thermometers are smoothed over this time before their lag, s; over as long after a start the gauge counts as warm as they say.
const THERMOMETER_SMOOTHING_S: f64 = 2.0;

/// How far a temperature that was never read may be from the reference, K: a hall in summer against one in winter.
const UNKNOWN_TEMPERATURE_K: f64 = 10.0;

/// After a gap longer than this the states say nothing of the present, ns.
const FORGET_NS: i64 = 10_000_000_000;

/// One thing that a gauge adds to its reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Effect {
    /// Lagged temperature less a reference, K.
    Temperature {
        /// Time constant from the thermometer to the gauge, s.
        lag_s: f64,
        /// Temperature at which the term is zero, degC.
        reference_c: f64,
    },
    /// A power of the scaled reading.
    Power {
        /// The exponent, 2 or 3.
        order: i32,
    },
    /// The lagged scaled reading less the present one.
    Creep {
        /// Time constant, s.
        tau_s: f64,
    },
    /// A play operator's output less its input, both scaled.
    Hysteresis {
        /// Half the play, as a share of the scale.
        width: f64,
    },
}

/// One effect with its strength.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term {
    /// The effect.
    pub effect: Effect,
    /// Counts for a regressor of one (counts/K for temperature, else counts).
    pub coefficient_counts: f64,
    /// Standard deviation of the regressor after a start, when its past is unknown.
    pub start_sigma: f64,
}

/// All terms of one gauge (counts).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct GaugeTerms {
    /// Reading that counts as the middle, counts.
    pub centre_counts: f64,
    /// Change of reading that counts as one, counts; positive where there are terms.
    pub scale_counts: f64,
    /// The terms; at most [`MOST_TERMS`].
    pub terms: Vec<Term>,
}

impl GaugeTerms {
    /// What the terms add to a reading, counts.
    #[must_use]
    pub fn counts(&self, regressors: &Regressors) -> f64 {
        self.terms.iter().zip(regressors).map(|(term, value)| term.coefficient_counts * value).sum()
    }
}

/// State of one effect.
#[derive(Clone, Copy, Debug, Default)]
struct State {
    value: f64,
    started: bool,
    /// Share of the start's uncertainty that is left, 1 to 0.
    unsettled: f64,
}

/// Follows one gauge's readings and temperature; allocates at construction only.
#[derive(Clone, Debug)]
pub struct Conditioner {
    terms: GaugeTerms,
    states: [State; MOST_TERMS],
    regressors: Regressors,
    smooth: Option<f64>,
    /// Smoothed temperature, and for how long it has been read, s.
    thermometer: Option<(f64, f64)>,
    last_ns: Option<i64>,
}

impl Conditioner {
    /// For a gauge with these terms, before its first reading.
    #[must_use]
    pub fn new(terms: &GaugeTerms) -> Self {
        let mut terms = terms.clone();
        terms.terms.truncate(MOST_TERMS);
        Self {
            terms,
            states: [State::default(); MOST_TERMS],
            regressors: [0.0; MOST_TERMS],
            smooth: None,
            thermometer: None,
            last_ns: None,
        }
    }

    /// Takes in the gauge's reading (counts) and temperature (degC) at an instant (ns); `None` where absent.
    pub fn push(&mut self, at_ns: i64, counts: Option<f64>, temperature_c: Option<f64>) {
        if self.terms.terms.is_empty() {
            return;
        }
        let since_ns = self.last_ns.map_or(0, |last| at_ns.saturating_sub(last));
        if !(0..=FORGET_NS).contains(&since_ns) {
            self.states = [State::default(); MOST_TERMS];
            self.smooth = None;
            self.thermometer = None;
        }
        self.last_ns = Some(at_ns);
        let step_s = since_ns.max(0) as f64 * 1e-9;
        if let Some(counts) = counts {
            let u = (counts - self.terms.centre_counts) / self.terms.scale_counts;
            self.smooth = Some(self.smooth.map_or(u, |s| s + (u - s) * share(step_s, SMOOTHING_S)));
        }
        let warmth_c = temperature_c.map(|now_c| self.smoothed_c(step_s, now_c));
        let settling = self.thermometer.is_some_and(|(_, age_s)| age_s < THERMOMETER_SMOOTHING_S);
        for (k, term) in self.terms.terms.iter().enumerate() {
            let input = match term.effect {
                Effect::Temperature { .. } => warmth_c,
                _ => self.smooth,
            };
            if settling && warmth_c.is_some() && matches!(term.effect, Effect::Temperature { .. }) {
                self.states[k].started = false;
            }
            self.states[k].advance(&term.effect, step_s, input);
            self.regressors[k] = self.states[k].regressor(&term.effect, self.smooth.unwrap_or(0.0));
        }
    }

    /// Takes in the thermometer: the mean of its first readings, then a first-order lag.
    fn smoothed_c(&mut self, step_s: f64, now_c: f64) -> f64 {
        let (before_c, age_s) = self.thermometer.unwrap_or((now_c, 0.0));
        // Of k readings so far the newest has a share of 1 / k.
        let of_all = step_s / (age_s + 2.0 * step_s).max(f64::MIN_POSITIVE);
        let gain =
            if age_s < THERMOMETER_SMOOTHING_S { of_all } else { share(step_s, THERMOMETER_SMOOTHING_S) };
        let smooth_c = before_c + (now_c - before_c) * gain;
        self.thermometer = Some((smooth_c, age_s + step_s));
        smooth_c
    }

    /// The terms' values at the last instant (K, or without unit).
    #[must_use]
    pub fn regressors(&self) -> &Regressors {
        &self.regressors
    }

    /// Variance that the unknown past gives to the terms' sum, counts^2.
    ///
    /// Terms of one kind are driven by one past: what is unknown of them adds up with its sign.
    #[must_use]
    pub fn unsettled_counts2(&self) -> f64 {
        let mut by_kind = [0.0; 3];
        for (term, state) in self.terms.terms.iter().zip(&self.states) {
            let left = if state.started { state.unsettled } else { 1.0 };
            let (kind, sigma) = match term.effect {
                Effect::Temperature { .. } if !state.started => {
                    (0, term.start_sigma.max(UNKNOWN_TEMPERATURE_K))
                }
                Effect::Temperature { .. } => (0, term.start_sigma),
                Effect::Creep { .. } => (1, term.start_sigma),
                Effect::Hysteresis { .. } => (2, term.start_sigma),
                // A power has no past; before the first reading there is nothing to correct.
                Effect::Power { .. } => continue,
            };
            by_kind[kind] += term.coefficient_counts * sigma * left;
        }
        by_kind.iter().map(|sum| sum * sum).sum()
    }
}

/// Share of a step that a first-order lag follows within a time.
fn share(step_s: f64, tau_s: f64) -> f64 {
    1.0 - (-step_s / tau_s).exp()
}

impl State {
    /// An absent input leaves the state as it was.
    fn advance(&mut self, effect: &Effect, step_s: f64, input: Option<f64>) {
        let Some(input) = input else { return };
        if !self.started {
            let unsettled = if matches!(effect, Effect::Power { .. }) { 0.0 } else { 1.0 };
            *self = Self { value: input, started: true, unsettled };
            return;
        }
        match *effect {
            Effect::Temperature { lag_s: tau_s, .. } | Effect::Creep { tau_s } => {
                let follow = share(step_s, tau_s);
                self.value += (input - self.value) * follow;
                self.unsettled *= 1.0 - follow;
            }
            Effect::Hysteresis { width } => {
                let dragged = self.value.clamp(input - width, input + width);
                // Dragged by its whole width, a play has forgotten where it began.
                self.unsettled = (self.unsettled - (dragged - self.value).abs() / (2.0 * width)).max(0.0);
                self.value = dragged;
            }
            Effect::Power { .. } => self.value = input,
        }
    }

    fn regressor(&self, effect: &Effect, smooth: f64) -> f64 {
        match *effect {
            _ if !self.started => 0.0,
            Effect::Temperature { reference_c, .. } => self.value - reference_c,
            Effect::Power { order } => self.value.powi(order),
            Effect::Creep { .. } | Effect::Hysteresis { .. } => self.value - smooth,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP_NS: i64 = 20_000_000;

    fn conditioner(effects: &[Effect]) -> Conditioner {
        let term = |effect: &Effect| Term { effect: *effect, coefficient_counts: 100.0, start_sigma: 0.5 };
        Conditioner::new(&GaugeTerms {
            centre_counts: 1000.0,
            scale_counts: 2000.0,
            terms: effects.iter().map(term).collect(),
        })
    }

    #[test]
    fn a_lag_follows_a_step_as_an_exponential_and_forgets_its_start() {
        let mut c = conditioner(&[
            Effect::Temperature { lag_s: 60.0, reference_c: 20.0 },
            Effect::Creep { tau_s: 30.0 },
        ]);
        c.push(0, Some(1000.0), Some(20.0));
        assert_eq!(c.unsettled_counts2(), 2.0 * 50.0 * 50.0);
        // The gauge is as warm as its thermometer says at first, and starts to lag after that.
        let hold = (THERMOMETER_SMOOTHING_S * 1e9) as i64 / STEP_NS;
        for k in 1..=hold {
            c.push(k * STEP_NS, Some(1000.0), Some(20.0));
        }
        assert_eq!(c.regressors()[0], 0.0);
        for k in hold + 1..=hold + 3000 {
            c.push(k * STEP_NS, Some(3000.0), Some(30.0));
        }
        // After 60 s: one time constant of the temperature, less what the thermometer's smoothing holds back; two of the creep.
        let (lag_s, smoothing_s) = (60.0, THERMOMETER_SMOOTHING_S);
        let left = |tau_s: f64| (-60.0 / tau_s).exp() * tau_s / (lag_s - smoothing_s);
        let expected = 10.0 * (1.0 - left(lag_s) + left(smoothing_s));
        assert!((c.regressors()[0] - expected).abs() < 0.01, "{:?} {expected}", c.regressors());
        assert!((c.regressors()[1] + (-2.0f64).exp()).abs() < 1e-3, "{:?}", c.regressors());
        let expected = 2500.0 * ((-2.0f64).exp() + (-(120.0 + 2.0 * smoothing_s) / 30.0).exp());
        assert!((c.unsettled_counts2() / expected - 1.0).abs() < 0.01);
    }

    #[test]
    fn a_noisy_thermometer_starts_at_the_mean_of_its_first_readings() {
        let mut c = conditioner(&[Effect::Temperature { lag_s: 60.0, reference_c: 20.0 }]);
        for k in 0..101 {
            c.push(k * STEP_NS, Some(1000.0), Some(if k % 2 == 0 { 25.0 } else { 23.0 }));
        }
        assert!((c.regressors()[0] - 4.0).abs() < 0.02, "{:?}", c.regressors());
    }

    #[test]
    fn a_play_lags_by_its_width_after_either_turn() {
        let mut c = conditioner(&[Effect::Hysteresis { width: 0.1 }, Effect::Power { order: 2 }]);
        let mut at_ns = 0;
        let mut hold = |c: &mut Conditioner, counts: f64| {
            for _ in 0..500 {
                at_ns += STEP_NS;
                c.push(at_ns, Some(counts), None);
            }
        };
        hold(&mut c, 1000.0);
        assert!(c.unsettled_counts2() > 2499.0);
        hold(&mut c, 2000.0);
        assert!((c.regressors()[0] + 0.1).abs() < 1e-9 && (c.regressors()[1] - 0.25).abs() < 1e-9);
        assert_eq!(c.unsettled_counts2(), 0.0);
        hold(&mut c, 1600.0);
        assert!((c.regressors()[0] - 0.1).abs() < 1e-9);
    }

    #[test]
    fn absent_inputs_hold_and_a_long_gap_forgets() {
        let mut c = conditioner(&[
            Effect::Temperature { lag_s: 60.0, reference_c: 20.0 },
            Effect::Creep { tau_s: 30.0 },
        ]);
        c.push(0, None, None);
        assert_eq!((c.regressors()[0], c.unsettled_counts2()), (0.0, 1_002_500.0));
        c.push(STEP_NS, Some(3000.0), Some(25.0));
        c.push(2 * STEP_NS, None, None);
        assert_eq!(c.regressors()[0], 5.0);
        for k in 3..30_000 {
            c.push(k * STEP_NS, Some(3000.0), Some(25.0));
        }
        assert!(c.unsettled_counts2() < 1.0);
        c.push(30_000 * STEP_NS + FORGET_NS, Some(2000.0), Some(22.0));
        assert_eq!((c.regressors()[0], c.unsettled_counts2()), (2.0, 5000.0));
    }
}
