//! Effects of a gauge and of what is in parallel with it: what they add to its counts, instant by instant.

use std::collections::VecDeque;

use model::sensing::Compliance;
use nalgebra::Vector6;
use rand::RngExt;
use rand::rngs::StdRng;
use rig::Rig;

use super::{Effect, Kind, Now, Place};
use crate::climate::Climate;
use crate::gauge::normal;
use crate::imperfect::{Hysteresis, Strain, StrainState};
use crate::random::{Purpose, stream};
use crate::truth::Truth;

/// One effect on one gauge, with its state.
#[derive(Debug)]
pub(crate) struct GaugeState {
    effect: Effect,
    gauge: usize,
    /// Counts per Nm about the joint's axis, for what is in parallel with the sensor.
    per_nm: f64,
    /// Half the gauge's usual range, counts.
    half_counts: f64,
    /// Change of the compliance.
    change: Vector6<f64>,
    strain: Option<StrainState>,
    past: VecDeque<(f64, f64)>,
    slow: Option<f64>,
    warm_c: Option<[f64; 2]>,
    walk: f64,
    phase: f64,
    /// The last reading that was transferred, of each sampling instant of a cycle; when readings are lost, and when again.
    last: Vec<Option<f64>>,
    lost_s: [f64; 2],
    again_s: f64,
    rng: StdRng,
}

impl GaugeState {
    /// None for effects of the arm.
    pub(super) fn new(effect: &Effect, rig: &Rig, truth: &Truth, rng: &mut StdRng) -> Option<Self> {
        let gauge = match effect.place {
            Place::Gauge(gauge) => gauge,
            Place::Joint(joint) if is_parallel(effect.kind) => {
                let is_own = |k: &usize| rig.chain.joints[rig.sections[*k].joint].coordinate == Some(joint);
                (0..rig.sections.len()).find(is_own)?
            }
            _ => return None,
        };
        let compliance = truth.gauges[gauge].compliance;
        let section = &rig.sections[gauge];
        let axis = section.r_cs.tr_mul(&rig.chain.joints[section.joint].axis);
        let moment = compliance.vector().fixed_rows::<3>(3).into_owned();
        let mut own = stream(effect.seed, Purpose::Effects);
        let phase = own.random_range(0.0..std::f64::consts::TAU);
        Some(Self {
            effect: effect.clone(),
            gauge,
            per_nm: moment.dot(&axis),
            half_counts: HALF_RANGE_NM * moment.norm(),
            change: change(effect, &compliance, phase),
            strain: strain(effect, moment.norm()).map(|strain| StrainState::new(&strain, rng)),
            past: VecDeque::new(),
            slow: None,
            warm_c: None,
            walk: 0.0,
            phase,
            last: Vec::new(),
            lost_s: [0.0; 2],
            again_s: FIRST_LOST_S,
            rng: stream(effect.seed ^ 0x5bd1, Purpose::Effects),
        })
    }

    /// What it adds at the next instant, counts.
    pub(crate) fn counts(&mut self, now: &Now<'_>) -> f64 {
        let x = now.counts[self.gauge];
        let a = self.effect.strength;
        let position = |joint: usize| now.state.positions_rad[joint];
        match (self.effect.kind, self.effect.place) {
            (Kind::ZeroOffset, _) => a,
            (Kind::Gain, _) => a * x,
            (Kind::SensingAxis | Kind::AxialForce, _) => self.change.dot(&now.loads[self.gauge]),
            (Kind::TemperatureOffset, _) => {
                a * (self.warmth(now, self.effect.number("lag_s")) - Climate::MIDDLE_C)
            }
            (Kind::TemperatureGain, _) => a * x * (self.warmth(now, 0.0) - Climate::MIDDLE_C),
            (Kind::Drift, _) => a * (1.0 + now.t_s / self.effect.number("tau_s")).ln(),
            (Kind::Nonlinearity | Kind::Hysteresis | Kind::Creep, _) => self
                .strain
                .as_mut()
                .map_or(0.0, |strain| strain.next(now.step_s, x, Climate::MIDDLE_C, Climate::MIDDLE_C)),
            (Kind::Saturation, _) => x.clamp(-a.abs(), a.abs()) - x,
            (Kind::Spikes, _) => {
                let hit = self.rng.random_bool((self.effect.number("rate_hz") * now.step_s).clamp(0.0, 1.0));
                let sign = if self.rng.random_bool(0.5) { 1.0 } else { -1.0 };
                if hit { sign * a * self.rng.random_range(0.7..1.6) } else { 0.0 }
            }
            (Kind::MainsPickup, _) => {
                a * (std::f64::consts::TAU * self.effect.number("hz") * now.t_s + self.phase).sin()
            }
            (Kind::Delay, _) => self.late(now.t_s, x, a.max(0.0)) - x,
            (Kind::Lowpass, _) => {
                let slow = self.slow.get_or_insert(x);
                *slow += (x - *slow) * -(-now.step_s / a.max(1e-6)).exp_m1();
                *slow - x
            }
            (Kind::ChannelCoupling, _) => a * now.counts[self.effect.number("source") as usize],
            (Kind::TorqueRipple, Place::Joint(joint)) => {
                let wave = (self.effect.number("cycles_per_rev") * position(joint) + self.phase).sin();
                let by_load = self.effect.number("by_load");
                self.per_nm * a * wave * (1.0 - by_load + by_load * (x / self.half_counts).abs())
            }
            (Kind::Friction, Place::Joint(joint)) => {
                let speed = now.state.velocities_rad_s[joint];
                let (viscous, stribeck) =
                    (self.effect.number("viscous"), self.effect.number("stribeck_rad_s"));
                // As D. Hess and A. Soom have it (J. Tribology 112, 1990).
                let dip = 1.0 + 0.4 / (1.0 + (speed / stribeck).powi(2));
                -self.per_nm * a * (dip * (speed / 0.01).tanh() + viscous * speed)
            }
            (Kind::CableDrag, Place::Joint(joint)) => {
                let bent = position(joint) - 0.3 * self.phase.cos();
                -self.per_nm * a * (CABLE_STIFFENS * bent).sinh() / CABLE_STIFFENS
            }
            (Kind::RandomWalk, _) => {
                self.walk += normal(&mut self.rng) * now.step_s.sqrt();
                a * self.walk
            }
            (Kind::ZeroJumps, _) => {
                let often = now.step_s / self.effect.number("every_s").max(now.step_s);
                if self.rng.random_bool(often.clamp(0.0, 1.0)) {
                    self.walk = normal(&mut self.rng);
                }
                a * self.walk
            }
            (Kind::GainWalk, _) => {
                let decay = (-now.step_s / self.effect.number("time_s").max(now.step_s)).exp();
                self.walk = decay * self.walk + (1.0 - decay * decay).sqrt() * normal(&mut self.rng);
                a * self.walk * x
            }
            (Kind::Product, _) => {
                a * x * now.counts[self.effect.number("source") as usize] / self.half_counts
            }
            _ => 0.0,
        }
    }

    /// What the converter or the transfer makes of a reading with its noise (counts), at this sampling instant of the cycle.
    pub(crate) fn converted(&mut self, t_s: f64, sample: usize, reading: f64) -> f64 {
        match self.effect.kind {
            Kind::Quantisation => {
                let step = self.effect.strength.abs().max(1.0);
                let level = self.phase / std::f64::consts::TAU;
                ((reading / step - level).round() + level) * step
            }
            Kind::FrameLoss => {
                self.last.resize(self.last.len().max(sample + 1), None);
                if !self.is_lost(t_s) {
                    self.last[sample] = Some(reading);
                }
                self.last[sample].unwrap_or(reading)
            }
            _ => reading,
        }
    }

    /// Whether readings are lost then: for a while, again and again.
    fn is_lost(&mut self, t_s: f64) -> bool {
        if t_s >= self.again_s {
            let held_s = self.effect.strength.abs() * self.rng.random_range(0.5..1.5);
            let pause_s = -self.effect.number("every_s") * self.rng.random_range(f64::EPSILON..1.0).ln();
            self.lost_s = [t_s, t_s + held_s];
            self.again_s = t_s + held_s + pause_s;
        }
        (self.lost_s[0]..self.lost_s[1]).contains(&t_s)
    }

    /// What was there `late_s` ago, between instants.
    fn late(&mut self, t_s: f64, x: f64, late_s: f64) -> f64 {
        self.past.push_back((t_s, x));
        while self.past.len() > 2 && self.past[1].0 <= t_s - late_s {
            self.past.pop_front();
        }
        let (from, to) = (self.past[0], self.past[self.past.len().min(2) - 1]);
        let part =
            if to.0 > from.0 { ((t_s - late_s - from.0) / (to.0 - from.0)).clamp(0.0, 1.0) } else { 0.0 };
        from.1 + part * (to.1 - from.1)
    }

    /// Temperature of the gauge itself: its thermometer's through two lags, the second a quarter of the first.
    fn warmth(&mut self, now: &Now<'_>, lag_s: f64) -> f64 {
        let thermometer_c = now.temperatures_c[self.gauge];
        let warm = self.warm_c.get_or_insert([thermometer_c; 2]);
        let mut input = thermometer_c;
        for (warmth, lag_s) in warm.iter_mut().zip([lag_s, 0.25 * lag_s]) {
            let share = if lag_s > 0.0 { -(-now.step_s / lag_s).exp_m1() } else { 1.0 };
            *warmth += (input - *warmth) * share;
            input = *warmth;
        }
        input
    }

    /// The gauge that it changes.
    pub(crate) fn gauge(&self) -> usize {
        self.gauge
    }
}

fn is_parallel(kind: Kind) -> bool {
    matches!(kind, Kind::TorqueRipple | Kind::Friction | Kind::CableDrag)
}

/// Change of the compliance by an axis that moved, or by a pitch.
fn change(effect: &Effect, compliance: &Compliance, phase: f64) -> Vector6<f64> {
    let Some(mut frame) = compliance.actual_frame() else { return Vector6::zeros() };
    match effect.kind {
        Kind::SensingAxis => {
            frame.a_x_rad += effect.strength;
            frame.a_y_rad += effect.strength * phase.cos();
            frame.l_x_m += 0.1 * effect.strength * phase.sin();
            frame.l_y_m += 0.05 * effect.strength;
        }
        Kind::AxialForce => frame.pitch_m += effect.strength,
        _ => return Vector6::zeros(),
    }
    frame.compliance().vector() - compliance.vector()
}

/// How a cable stiffens, per rad: with the hyperbolic sine, as soft tissue and rubber do (Y. Fung, Am. J. Physiol. 213, 1967); for a small bend
/// that is three tenths more a square radian.
const CABLE_STIFFENS: f64 = 1.34;

/// Nothing is lost before, s.
const FIRST_LOST_S: f64 = 0.5;

/// Half a gauge's usual range, Nm.
const HALF_RANGE_NM: f64 = 4.0;

/// Bent characteristic, loop and creep, as an arm as it is built has them.
fn strain(effect: &Effect, counts_per_nm: f64) -> Option<Strain> {
    let a = effect.strength;
    let mut strain = Strain::straight(HALF_RANGE_NM * counts_per_nm);
    match effect.kind {
        Kind::Nonlinearity => strain.bend_by(effect.number("order") as i32, a),
        Kind::Hysteresis => {
            let width = effect.number("width");
            strain.hysteresis = (Hysteresis::BoucWen { width, exponent: 1.4, unloading: 0.7 }, a);
        }
        Kind::Creep => {
            // The mean retardation time of tau^n exp(-tau / T), over the logarithm of tau, is n T.
            let exponent = 0.2;
            strain.creep = (a, exponent);
            strain.creep_ends_s = effect.number("tau_s") / exponent;
        }
        _ => return None,
    }
    Some(strain)
}
