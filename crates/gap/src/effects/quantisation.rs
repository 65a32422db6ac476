//! A signal in steps: a converter with few bits, or a message that carries few.
//!
//! What rounding does to a noisy signal on average is a sawtooth whose harmonics the noise takes away (B. Widrow, I. Kollár, Quantization
//! Noise, 2008): `sum of (-1)^k D / (pi k) sin(2 pi k u / D) exp(-2 (pi k s / D)^2)` with the step D, the noise's deviation s and the
//! distance u from a level.

use std::f64::consts::{PI, TAU};

use super::*;

/// A signal in steps.
pub(super) struct Quantisation;

/// Steps smaller than this, over the noise, are lost in it.
const COARSE: f64 = 1.0;
/// Levels that make a staircase, and readings on each of them as a rule.
const LEVELS: usize = 3;
const READINGS_A_LEVEL: usize = 4;
/// Share of the differences between levels that are whole steps, and how exactly, in steps.
const WHOLE: f64 = 0.98;
const EXACTLY: f64 = 0.02;
/// Harmonics of the sawtooth.
const HARMONICS: usize = 12;
/// The nearest level is taken, or the next below.
const ROUNDED: f64 = 0.0;
const CUT: f64 = 1.0;

impl Effect for Quantisation {
    fn id(&self) -> &'static str {
        "quantisation"
    }

    fn words(&self) -> &'static str {
        "a signal in coarse steps"
    }

    fn remedy(&self) -> &'static str {
        "use more of the converter's range, or more bits of it"
    }

    fn missing(&self, session: &Session) -> Option<String> {
        without_signal(session)
    }

    fn places(&self, session: &Session) -> Vec<Place> {
        moving_channels(session)
    }

    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[("step", "channel's unit")]
    }

    fn shapes(&self, session: &Session, place: Place) -> Vec<Shape> {
        let Place::Channel(channel) = place else { return Vec::new() };
        let own = &session.channels[channel];
        let step = staircase(session, channel).filter(|(step, _)| *step > COARSE * own.scale * own.floor);
        step.map_or_else(Vec::new, |(step, level)| {
            [ROUNDED, CUT].map(|kind| vec![step, level, kind]).to_vec()
        })
    }

    fn searched(&self, _shape: &[f64]) -> usize {
        0
    }

    fn is_read_off(&self, _shape: &[f64]) -> bool {
        true
    }

    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column> {
        let (Place::Channel(channel), &[step, level, kind]) = (place, shape) else { return Vec::new() };
        let own = &session.channels[channel];
        let noise = own.scale * own.floor;
        let below = if kind == CUT { step / 2.0 } else { 0.0 };
        let changed = |value: &f64| sawtooth(value - level - below, step, noise) - below;
        vec![Column::pinned(channel, own.simulated.iter().map(changed).collect())]
    }

    fn experiment(&self) -> &'static str {
        "a load that grows slowly through several steps"
    }
}

/// What rounding adds on average at this distance from a level.
fn sawtooth(from_level: f64, step: f64, noise: f64) -> f64 {
    let harmonic = |k: usize| {
        let (order, sign) = (k as f64, if k.is_multiple_of(2) { 1.0 } else { -1.0 });
        let left = (-2.0 * (PI * order * noise / step).powi(2)).exp();
        sign * step / (PI * order) * left * (TAU * order * from_level / step).sin()
    };
    (1..=HARMONICS).map(harmonic).sum()
}

/// Step and one level of the staircase that the readings stand on, if they do.
fn staircase(session: &Session, channel: usize) -> Option<(f64, f64)> {
    let read = readings::sorted(session, channel);
    let step = readings::smallest_step(session, channel, &read)?;
    let apart: Vec<f64> =
        read.windows(2).map(|pair| (pair[1] - pair[0]) / step).filter(|steps| *steps > 0.5).collect();
    let whole = apart.iter().filter(|steps| (*steps - steps.round()).abs() < EXACTLY).count();
    let is_staircase = apart.len() + 1 >= LEVELS
        && read.len() >= READINGS_A_LEVEL * (apart.len() + 1)
        && whole as f64 >= WHOLE * apart.len() as f64;
    is_staircase.then(|| (step, read[read.len() / 2]))
}
