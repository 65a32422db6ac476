//! Effects that a simulated arm can have beyond its declared one, each at a chosen place and size, several at once.
//!
//! The forms are those of the books on each effect and not those that a diagnosis fits: hysteresis is Bouc and Wen's, creep follows a
//! power of time, friction has Stribeck's dip, a cable stiffens, warmth lags twice. Amplitudes are in the units of the
//! contract's parameters; a *size* is instead the RMS change over the scenario, in noise floors, of the gauge that shows it most.

mod arm;
mod gauge;
mod size;
mod spec;

use nalgebra::Vector6;
use rand::rngs::StdRng;
use rig::Rig;

use crate::SimError;
use crate::imperfect::Body;
use crate::motion::JointState;
use crate::scenario::Scenario;
use crate::truth::Truth;

pub(crate) use arm::Contact;
pub(crate) use gauge::GaugeState;
pub use spec::{Kind, Place, Spec};

/// An effect with its place and all its numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Effect {
    /// Which one.
    pub kind: Kind,
    /// Where it sits.
    pub place: Place,
    /// How strong it is, in the unit of [`Kind::strength`].
    pub strength: f64,
    /// Further numbers by name.
    pub numbers: Vec<(&'static str, f64)>,
    /// Seed of its own phases and directions.
    pub seed: u64,
    /// What was asked for in noise floors, if it was.
    pub size: Option<f64>,
}

impl Effect {
    /// A further number.
    #[must_use]
    pub fn number(&self, name: &str) -> f64 {
        self.numbers.iter().find(|(known, _)| *known == name).map_or(0.0, |(_, value)| *value)
    }
}

/// Everything that a run's effects need.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Effects {
    /// The effects, in the order in which they were asked for.
    pub list: Vec<Effect>,
}

/// What the gauges' effects see at an instant.
pub(crate) struct Now<'a> {
    pub(crate) t_s: f64,
    pub(crate) step_s: f64,
    /// Counts beyond the bias that each gauge shows so far.
    pub(crate) counts: &'a [f64],
    /// Load of every section (N, Nm about S, in S).
    pub(crate) loads: &'a [Vector6<f64>],
    pub(crate) state: &'a JointState,
    pub(crate) temperatures_c: &'a [f64],
}

impl Effects {
    /// Effects as they were asked for, at the sizes that were asked for in this scenario.
    ///
    /// # Errors
    /// A place that the arm does not have, or an effect that does not show there.
    pub fn new(
        rig: &Rig,
        truth: &Truth,
        scenario: &Scenario,
        specs: &[Spec],
        seed: u64,
    ) -> Result<Self, SimError> {
        let mut list = Vec::with_capacity(specs.len());
        for (index, spec) in specs.iter().enumerate() {
            let own_seed = seed.wrapping_mul(1009).wrapping_add(index as u64);
            let effect = spec.resolve(rig, own_seed)?;
            list.push(match spec.size {
                Some(size) => size::scaled(rig, truth, scenario, effect, size)?,
                None => effect,
            });
        }
        Ok(Self { list })
    }

    /// The arm as these effects make it of another.
    pub(crate) fn body(&self, mut body: Body) -> Body {
        self.list.iter().for_each(|effect| arm::change(effect, &mut body));
        body
    }

    /// What really hangs at the tip where something was declared, and what touches links.
    pub(crate) fn scenario(&self, scenario: &Scenario) -> Scenario {
        let mut changed = scenario.clone();
        self.list.iter().for_each(|effect| arm::change_loads(effect, &mut changed));
        changed
    }

    pub(crate) fn contacts(&self, rig: &Rig, scenario: &Scenario) -> Vec<Contact> {
        self.list.iter().filter_map(|effect| Contact::new(effect, rig, scenario)).collect()
    }

    pub(crate) fn states(&self, rig: &Rig, truth: &Truth, rng: &mut StdRng) -> Vec<GaugeState> {
        self.list.iter().filter_map(|effect| GaugeState::new(effect, rig, truth, rng)).collect()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
