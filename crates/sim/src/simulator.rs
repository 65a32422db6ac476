//! The simulator: cycle by cycle from motion to frames.

use std::collections::VecDeque;

use can::assembly::SignalBinding;
use can::frame::Stamped;
use model::spatial::{Tip, Wrench};
use nalgebra::Vector6;
use rand::rngs::StdRng;
use rig::Rig;
use rig::binding::BitRates;
use rig::run::Loads;

use crate::SimError;
use crate::bus::{Bus, Sample};
use crate::climate::Climate;
use crate::effects::{Contact, GaugeState, Now};
use crate::gauge::{NoiseState, normal};
use crate::imperfect::{Body, StrainState};
use crate::mechanics::Mechanics;
use crate::random::{Purpose, stream};
use crate::scenario::Scenario;
use crate::truth::{Truth, range_si};

/// First stamp of a simulation unless told, ns since the Unix epoch.
pub const START_NS: i64 = 1_790_000_000_000_000_000;
/// Time between two messages of temperatures, s.
const TEMPERATURES_EVERY_S: f64 = 0.1;
/// Noise of the thermometers of an arm as it is built, K.
const THERMOMETER_SIGMA_K: f64 = 0.1;
/// Fastest rate, Hz: beyond it no CAN bus carries even one frame a cycle.
const MAX_RATE_HZ: f64 = 20_000.0;

/// How a scenario is run.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Seed of all noise and jitter; the poses of presets have been drawn before.
    pub seed: u64,
    /// Rate of gauges and joints, Hz; the scenario's where none.
    pub rate_hz: Option<f64>,
    /// Instant of the first cycle, ns since the Unix epoch.
    pub start_ns: i64,
    /// Bit rates of the buses.
    pub bit_rates: BitRates,
}

impl Default for Options {
    fn default() -> Self {
        Self { seed: 1, rate_hz: None, start_ns: START_NS, bit_rates: BitRates::default() }
    }
}

/// The arm of a configuration in a scenario, as an iterator of the frames that its boards send, in the order of stamps.
#[derive(Debug)]
pub struct Simulator {
    truth: Truth,
    mechanics: Mechanics,
    probe: Mechanics,
    bus: Bus,
    climate: Climate,
    noise: Vec<NoiseState>,
    /// Faults of the gauges; none for linear ones.
    strains: Vec<StrainState>,
    /// Effects of gauges that were put in, and touches of links.
    faults: Vec<GaugeState>,
    contacts: Vec<Contact>,
    rig: Rig,
    /// Range of each gauge's signal, counts.
    ranges: Vec<(f64, f64)>,
    gauge_rng: StdRng,
    encoder_rng: StdRng,
    bus_rng: StdRng,
    options: Options,
    rate_hz: f64,
    cycles: u64,
    cycle: u64,
    slow_every: u64,
    loads: Vec<Vector6<f64>>,
    samples: Vec<Sample>,
    fresh: Vec<Stamped>,
    pending: VecDeque<Stamped>,
}

impl Simulator {
    /// A robot with true gauges in a scenario.
    ///
    /// # Errors
    /// Truth or scenario of another arm, a rate that the buses cannot carry, or a joint whose signal cannot say where it
    /// goes.
    pub fn new(rig: &Rig, truth: Truth, scenario: &Scenario, options: Options) -> Result<Self, SimError> {
        let rate_hz = options.rate_hz.unwrap_or(scenario.rate_hz);
        check_sizes(rig, &truth, scenario)?;
        check_positions(rig, scenario)?;
        let bus = Bus::new(&rig.layout, options.bit_rates)?;
        check_rate(rig, &bus, rate_hz)?;
        let mut gauge_rng = stream(options.seed, Purpose::GaugeNoise);
        let noise =
            truth.gauges.iter().map(|g| NoiseState::new(&g.noise, rate_hz.recip(), &mut gauge_rng)).collect();
        let mechanics = mechanics(rig, &truth, scenario);
        let mut start_rng = stream(options.seed, Purpose::FaultStart);
        let strains = truth.imperfections.iter().flat_map(|faults| &faults.strains);
        let sample = Sample {
            counts: vec![0.0; truth.gauges.len()],
            saturated: vec![false; truth.gauges.len()],
            temperatures_c: vec![0.0; truth.gauges.len()],
            positions_rad: vec![0.0; truth.encoders.len()],
            velocities_rad_s: vec![0.0; truth.encoders.len()],
        };
        Ok(Self {
            climate: match (&truth.imperfections, scenario.warming) {
                (_, Some(warming)) => Climate::warming(truth.gauges.len(), options.seed, warming),
                (Some(_), None) => Climate::some_day(truth.gauges.len(), options.seed),
                (None, None) => Climate::new(truth.gauges.len(), options.seed),
            },
            contacts: truth.effects.contacts(rig, scenario),
            faults: truth.effects.states(rig, &truth, &mut stream(options.seed, Purpose::Effects)),
            rig: rig.clone(),
            strains: strains.map(|strain| StrainState::new(strain, &mut start_rng)).collect(),
            noise,
            ranges: rig.layout.gauges.iter().map(|gauge| range_si(&gauge.counts)).collect(),
            gauge_rng,
            encoder_rng: stream(options.seed, Purpose::EncoderNoise),
            bus_rng: stream(options.seed, Purpose::Bus),
            rate_hz,
            // The last cycle is at the end of the motion or just before; rounding does not take it away.
            cycles: (scenario.duration_s() * rate_hz + 1e-6).floor() as u64 + 1,
            cycle: 0,
            slow_every: (TEMPERATURES_EVERY_S * rate_hz).round().max(1.0) as u64,
            samples: vec![sample; bus.offsets_ns().len()],
            fresh: Vec::new(),
            pending: VecDeque::new(),
            probe: mechanics.clone(),
            loads: Vec::new(),
            mechanics,
            bus,
            truth,
            options,
        })
    }

    /// The true gauges (counts/N, counts/Nm, counts).
    #[must_use]
    pub fn truth(&self) -> &Truth {
        &self.truth
    }

    /// Rate of gauges and joints, Hz.
    #[must_use]
    pub fn rate_hz(&self) -> f64 {
        self.rate_hz
    }

    /// Number of sampling instants in all.
    #[must_use]
    pub fn cycles(&self) -> u64 {
        self.cycles
    }

    /// Sampling instant of a cycle, s since the beginning.
    #[must_use]
    pub fn instant_s(&self, cycle: u64) -> f64 {
        cycle as f64 / self.rate_hz
    }

    /// Share of the simulation that is done, 0 .. 1.
    #[must_use]
    pub fn progress(&self) -> f64 {
        self.cycle as f64 / self.cycles as f64
    }

    /// The mechanics by themselves, for another thread: loads, motion and true wrench at any instant (s; N, Nm, rad).
    #[must_use]
    pub fn mechanics(&self) -> Mechanics {
        self.probe.clone()
    }

    /// What the environment applies to the end-effector at an instant (s since the beginning): N, Nm about E's origin, in E.
    pub fn truth_at(&mut self, t_s: f64) -> Wrench<Tip> {
        self.probe.update(t_s);
        self.probe.tip_wrench()
    }

    /// The true wrench (N, Nm about E's origin, in E) at a stamp, ns since the Unix epoch.
    pub fn truth_at_ns(&mut self, stamp_ns: i64) -> Wrench<Tip> {
        self.truth_at((stamp_ns - self.options.start_ns) as f64 * 1e-9)
    }

    fn cycle_ns(&self, cycle: u64) -> i64 {
        self.options.start_ns + (cycle as f64 * 1e9 / self.rate_hz).round() as i64
    }

    /// One cycle: sample, add noise, send.
    fn step(&mut self) {
        let t_s = self.instant_s(self.cycle);
        self.sample(t_s);
        self.strain();
        self.fault(t_s);
        self.disturb();
        self.misread(t_s);
        self.convert();
        self.fresh.clear();
        let slow = self.cycle.is_multiple_of(self.slow_every);
        let cycle_ns = self.cycle_ns(self.cycle);
        self.bus.cycle(cycle_ns, &self.samples, slow, &mut self.bus_rng, &mut self.fresh);
        self.pending.extend(&self.fresh);
        self.pending.make_contiguous().sort_by_key(|stamped| stamped.stamp_ns);
        self.cycle += 1;
    }

    /// What gauges and encoders would say without noise, at every sampling instant of the cycle.
    fn sample(&mut self, t_s: f64) {
        for (sample, offset_ns) in self.samples.iter_mut().zip(self.bus.offsets_ns()) {
            let at_s = t_s + *offset_ns as f64 * 1e-9;
            self.mechanics.update(at_s);
            self.loads.clear();
            self.loads.extend((0..self.truth.gauges.len()).map(|index| self.mechanics.load(index)));
            for contact in &self.contacts {
                contact.add(&self.rig, at_s, &self.mechanics.state().positions_rad, &mut self.loads);
            }
            for (index, gauge) in self.truth.gauges.iter().enumerate() {
                sample.counts[index] = gauge.counts(&self.loads[index]);
                sample.temperatures_c[index] = self.climate.at_c(index, at_s);
            }
            let state = self.mechanics.state();
            sample.positions_rad.copy_from_slice(&state.positions_rad);
            sample.velocities_rad_s.copy_from_slice(&state.velocities_rad_s);
        }
    }

    /// Adds what the gauges' faults add: slow against a cycle, so the same at all of its sampling instants.
    fn strain(&mut self) {
        let Some(first) = self.samples.first() else { return };
        let step_s = self.rate_hz.recip();
        let added: Vec<f64> = self
            .strains
            .iter_mut()
            .enumerate()
            .map(|(k, strain)| {
                let counts = first.counts[k] - self.truth.gauges[k].bias_counts;
                strain.next(step_s, counts, first.temperatures_c[k], Climate::MIDDLE_C)
            })
            .collect();
        for sample in &mut self.samples {
            sample.counts.iter_mut().zip(&added).for_each(|(counts, added)| *counts += added);
        }
    }

    /// Adds what was put in, one effect after the other: each sees what those before it have made of the signal.
    fn fault(&mut self, t_s: f64) {
        if self.samples.is_empty() {
            return;
        }
        let step_s = self.rate_hz.recip();
        for fault in &mut self.faults {
            let first = &self.samples[0];
            let signals: Vec<f64> =
                first.counts.iter().zip(&self.truth.gauges).map(|(z, gauge)| z - gauge.bias_counts).collect();
            let now = Now {
                t_s,
                step_s,
                counts: &signals,
                loads: &self.loads,
                state: self.mechanics.state(),
                temperatures_c: &first.temperatures_c,
            };
            let added = fault.counts(&now);
            self.samples.iter_mut().for_each(|sample| sample.counts[fault.gauge()] += added);
        }
    }

    /// Counts of every gauge at every instant before noise and the converters' ranges.
    pub(crate) fn clean_counts(&mut self) -> Vec<Vec<f64>> {
        let mut rows = Vec::with_capacity(self.cycles as usize);
        for cycle in 0..self.cycles {
            let t_s = self.instant_s(cycle);
            self.sample(t_s);
            self.strain();
            self.fault(t_s);
            self.misread(t_s);
            rows.extend(self.samples.first().map(|sample| sample.counts.clone()));
        }
        rows
    }

    /// What faulty converters and transfers make of the readings.
    fn misread(&mut self, t_s: f64) {
        for fault in &mut self.faults {
            let gauge = fault.gauge();
            for (number, sample) in self.samples.iter_mut().enumerate() {
                sample.counts[gauge] = fault.converted(t_s, number, sample.counts[gauge]);
            }
        }
    }

    /// Adds one cycle's noise.
    fn disturb(&mut self) {
        for (index, noise) in self.noise.iter_mut().enumerate() {
            let noise_counts = noise.next(&mut self.gauge_rng);
            self.samples.iter_mut().for_each(|sample| sample.counts[index] += noise_counts);
        }
        if self.truth.imperfections.is_some() {
            for index in 0..self.truth.gauges.len() {
                let noise_k = THERMOMETER_SIGMA_K * normal(&mut self.gauge_rng);
                self.samples.iter_mut().for_each(|sample| sample.temperatures_c[index] += noise_k);
            }
        }
        for (index, encoder) in self.truth.encoders.iter().enumerate() {
            let position_rad = encoder.position_sigma_rad * normal(&mut self.encoder_rng);
            let velocity_rad_s = encoder.velocity_sigma_rad_s * normal(&mut self.encoder_rng);
            for sample in &mut self.samples {
                sample.positions_rad[index] += position_rad;
                sample.velocities_rad_s[index] += velocity_rad_s;
            }
        }
    }

    /// The converters' ranges.
    fn convert(&mut self) {
        for sample in &mut self.samples {
            for (index, (low, high)) in self.ranges.iter().enumerate() {
                let counts = sample.counts[index];
                sample.saturated[index] = counts < *low || counts > *high;
                sample.counts[index] = counts.clamp(*low, *high);
            }
        }
    }
}

impl Iterator for Simulator {
    type Item = Stamped;

    fn next(&mut self) -> Option<Stamped> {
        loop {
            let ended = self.cycle >= self.cycles;
            let next_ns = self.cycle_ns(self.cycle);
            // No frame of a later cycle is through before that cycle's instant.
            if self.pending.front().is_some_and(|first| ended || first.stamp_ns < next_ns) {
                return self.pending.pop_front();
            }
            if ended {
                return None;
            }
            self.step();
        }
    }
}

/// The arm that was put together: as declared, as built, and with the effects of its mechanics.
fn mechanics(rig: &Rig, truth: &Truth, scenario: &Scenario) -> Mechanics {
    if truth.effects.list.is_empty() {
        return match &truth.imperfections {
            Some(faults) => Mechanics::imperfect(rig, scenario, faults),
            None => Mechanics::new(rig, scenario),
        };
    }
    let changed = truth.effects.scenario(scenario);
    let (body, hanging) = match &truth.imperfections {
        Some(faults) => (faults.body.clone(), faults.hanging(&changed.loads)),
        None => (Body::nominal(&rig.chain), changed.loads.clone()),
    };
    Mechanics::of_body(rig, scenario, &truth.effects.body(body), Loads::new(hanging))
}

fn check_sizes(rig: &Rig, truth: &Truth, scenario: &Scenario) -> Result<(), SimError> {
    let found = (truth.gauges.len(), truth.encoders.len(), scenario.trajectory.coordinates());
    let expected = (rig.layout.gauges.len(), rig.chain.coordinates(), rig.chain.coordinates());
    if found == expected {
        return Ok(());
    }
    let problem = format!(
        "{} gauges, {} encoders and a motion of {} joints were given for an arm that has {}, {} and {}; make all of them for this arm",
        found.0, found.1, found.2, expected.0, expected.1, expected.2
    );
    Err(SimError::signal("the simulation", problem))
}

/// Whether every joint's signal can say where the motion takes it.
fn check_positions(rig: &Rig, scenario: &Scenario) -> Result<(), SimError> {
    for (coordinate, joint) in rig.layout.joints.iter().enumerate() {
        let (low, high) = scenario.trajectory.extent(coordinate);
        let (lowest, highest) = range_si(&joint.position);
        if low < lowest || high > highest {
            let problem = format!(
                "moves over {low:.4} .. {high:.4} rad, but its signal {} can say {lowest:.4} .. {highest:.4} rad only; correct the DBC or the joint's limits",
                name(&joint.position)
            );
            return Err(SimError::signal(format!("joint \"{}\"", joint.name), problem));
        }
    }
    Ok(())
}

fn name(binding: &SignalBinding) -> String {
    binding.spec.full_name()
}

fn check_rate(rig: &Rig, bus: &Bus, rate_hz: f64) -> Result<(), SimError> {
    if !(rate_hz > 0.0 && rate_hz <= MAX_RATE_HZ) {
        let problem =
            format!("a rate of {rate_hz} Hz cannot be simulated; give one above 0, up to {MAX_RATE_HZ}");
        return Err(SimError::Option(problem));
    }
    let Some((interface, load)) = bus.overfull(rate_hz) else { return Ok(()) };
    let interfaces = &rig.config.bus.interfaces;
    let name = interfaces.get(usize::from(interface)).map_or("?", String::as_str);
    let problem = format!(
        "{rate_hz} Hz would take {:.0} % of its time; lower the rate, or spread the messages over more interfaces",
        load * 100.0
    );
    Err(SimError::signal(name, problem))
}
