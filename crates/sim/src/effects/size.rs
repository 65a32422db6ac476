//! The strength at which an effect has a size: RMS over the scenario of the change it makes, over the noise floor, on the gauge that
//! shows it most.

use rig::Rig;

use super::{Effect, Effects, Kind, Place};
use crate::SimError;
use crate::scenario::Scenario;
use crate::simulator::{Options, Simulator};
use crate::truth::Truth;

/// Rounds of proportional correction: enough for what is nearly linear, and for limits and delays.
const ROUNDS: usize = 6;
/// Strengths change by at most this factor a round.
const MOST: f64 = 30.0;

pub(super) fn scaled(
    rig: &Rig,
    truth: &Truth,
    scenario: &Scenario,
    mut effect: Effect,
    size: f64,
) -> Result<Effect, SimError> {
    let nominal = counts(rig, truth, scenario, None)?;
    for _ in 0..ROUNDS {
        let found = largest(&nominal, &counts(rig, truth, scenario, Some(&effect))?, truth);
        if found > 0.0 && (found / size - 1.0).abs() < 0.02 && is_above_noise(&effect, truth) {
            return Ok(effect);
        }
        let factor = if found > 0.0 { (size / found).clamp(1.0 / MOST, MOST) } else { MOST };
        // A limit shows the more the lower it is.
        let is_limit = effect.kind == Kind::Saturation;
        effect.strength *= if is_limit { factor.powf(-0.15).clamp(0.5, 2.0) } else { factor };
    }
    let found = largest(&nominal, &counts(rig, truth, scenario, Some(&effect))?, truth);
    if found > 0.0 && (0.3..3.0).contains(&(found / size)) && is_above_noise(&effect, truth) {
        return Ok(effect);
    }
    Err(SimError::Option(format!(
        "--effect {}: does not show in this motion at size {size}; give a motion that loads or moves its place",
        effect.kind.id()
    )))
}

/// Steps of less than five deviations of the noise are mostly noise themselves: less than half of their sawtooth is left (Widrow and Kollár).
fn is_above_noise(effect: &Effect, truth: &Truth) -> bool {
    let (Kind::Quantisation, Place::Gauge(gauge)) = (effect.kind, effect.place) else { return true };
    effect.strength > 5.0 * truth.gauges[gauge].noise.sigma_counts
}

/// RMS of the difference of the gauge that shows it most, over its noise floor.
fn largest(nominal: &[Vec<f64>], changed: &[Vec<f64>], truth: &Truth) -> f64 {
    let of = |gauge: usize| {
        let sum: f64 = nominal.iter().zip(changed).map(|(a, b)| (b[gauge] - a[gauge]).powi(2)).sum();
        (sum / nominal.len().max(1) as f64).sqrt() / truth.gauges[gauge].noise.sigma_counts.max(1e-9)
    };
    (0..truth.gauges.len()).map(of).fold(0.0, f64::max)
}

/// Counts of every gauge at every instant without noise.
fn counts(
    rig: &Rig,
    truth: &Truth,
    scenario: &Scenario,
    effect: Option<&Effect>,
) -> Result<Vec<Vec<f64>>, SimError> {
    let mut clean = truth.clone().without_noise();
    clean.imperfections = None;
    clean.effects = Effects { list: effect.cloned().into_iter().collect() };
    let mut simulator = Simulator::new(rig, clean, scenario, Options::default())?;
    Ok(simulator.clean_counts())
}
