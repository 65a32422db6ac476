//! `[[sensor.term]]` of a model: what a gauge adds to its readings beside the load's share.

use model::terms::{Effect, GaugeTerms, MOST_TERMS, Term};
use serde::{Deserialize, Serialize};

/// One effect on one gauge: temperature, power, creep or hysteresis.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorTerm {
    /// Which effect, with its shape.
    pub effect: EffectShape,
    /// Its strength: counts/K for temperature, else counts for a regressor of one.
    pub coefficient_counts: f64,
    /// Standard deviation of the strength, same unit.
    pub coefficient_sigma_counts: f64,
    /// Standard deviation of the regressor after a start, K or without unit.
    pub start_sigma: f64,
    /// Covariance of the strength with fx fy fz tx ty tz, bias and the terms up to this one (its own variance last).
    pub covariance: Vec<f64>,
}

/// An effect with its shape; powers, creep and hysteresis act on (reading - centre) / scale.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "snake_case")]
pub enum EffectShape {
    /// Lagged temperature less a reference, K.
    Temperature {
        /// From the thermometer to the gauge, s.
        lag_s: f64,
        /// Where the term is zero, degC.
        reference_c: f64,
    },
    /// A power of the reading.
    Power {
        /// 2 or 3.
        order: i32,
    },
    /// The lagged reading less the present one.
    Creep {
        /// Time constant, s.
        tau_s: f64,
    },
    /// A play operator's output less its input.
    Hysteresis {
        /// Half the play.
        width: f64,
    },
}

impl From<Effect> for EffectShape {
    fn from(effect: Effect) -> Self {
        match effect {
            Effect::Temperature { lag_s, reference_c } => Self::Temperature { lag_s, reference_c },
            Effect::Power { order } => Self::Power { order },
            Effect::Creep { tau_s } => Self::Creep { tau_s },
            Effect::Hysteresis { width } => Self::Hysteresis { width },
        }
    }
}

impl From<EffectShape> for Effect {
    fn from(shape: EffectShape) -> Self {
        match shape {
            EffectShape::Temperature { lag_s, reference_c } => Self::Temperature { lag_s, reference_c },
            EffectShape::Power { order } => Self::Power { order },
            EffectShape::Creep { tau_s } => Self::Creep { tau_s },
            EffectShape::Hysteresis { width } => Self::Hysteresis { width },
        }
    }
}

/// The terms as the conditioner takes them.
pub(super) fn gauge_terms(centre_counts: f64, scale_counts: f64, terms: &[SensorTerm]) -> GaugeTerms {
    let term = |term: &SensorTerm| Term {
        effect: term.effect.into(),
        coefficient_counts: term.coefficient_counts,
        start_sigma: term.start_sigma,
    };
    GaugeTerms { centre_counts, scale_counts, terms: terms.iter().map(term).collect() }
}

/// Whether the terms of a gauge can be used.
pub(super) fn check(scale_counts: f64, terms: &[SensorTerm]) -> Result<(), String> {
    if terms.len() > MOST_TERMS {
        return Err(format!("has {} terms, more than {MOST_TERMS}", terms.len()));
    }
    let scaled = scale_counts > 0.0 && scale_counts.is_finite();
    if !terms.is_empty() && !scaled {
        return Err(format!("scale_counts = {scale_counts} is not positive, but it has terms"));
    }
    terms.iter().enumerate().try_for_each(|(index, term)| term.check(index))
}

impl SensorTerm {
    fn check(&self, index: usize) -> Result<(), String> {
        let positive = |v: f64| v > 0.0 && v.is_finite();
        let shaped = match self.effect {
            EffectShape::Temperature { lag_s, reference_c } => positive(lag_s) && reference_c.is_finite(),
            EffectShape::Power { order } => (2..=3).contains(&order),
            EffectShape::Creep { tau_s } => positive(tau_s),
            EffectShape::Hysteresis { width } => positive(width),
        };
        let n = index + 1;
        if !shaped {
            return Err(format!("term {n}: {:?} is out of range", self.effect));
        }
        let sigmas = [self.coefficient_sigma_counts, self.start_sigma];
        if !self.coefficient_counts.is_finite() || !sigmas.iter().all(|s| *s >= 0.0 && s.is_finite()) {
            return Err(format!("term {n}: a number is not finite or a standard deviation is negative"));
        }
        if self.covariance.len() != 8 + index || !self.covariance.iter().all(|c| c.is_finite()) {
            return Err(format!("term {n}: its covariance must be {} finite numbers", 8 + index));
        }
        Ok(())
    }
}
