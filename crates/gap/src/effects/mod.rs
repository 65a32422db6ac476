//! The catalogue: one file an effect with its physics and source, one line in [`CATALOGUE`].
//!
//! Every effect says, for a place and a *shape* (the parameters that enter nonlinearly), which *columns* it adds to the
//! simulation: change of each channel per unit of a linear parameter. Shapes are searched; the linear parameters are
//! profiled out. A column may be *pinned*: what the physics adds then has no free size (a delayed signal less itself).

mod arm;
mod axial_force;
mod axis;
mod backlash;
mod base_tilt;
mod cable_drag;
mod channel_coupling;
mod creep;
mod delay;
mod drift;
mod encoder_offset;
mod external_contact;
mod frame_loss;
mod friction;
mod gain;
mod hysteresis;
mod joint_flexibility;
mod link_mass;
mod link_offset;
mod lowpass;
mod mains_pickup;
mod nonlinearity;
mod payload;
mod quantisation;
mod readings;
mod saturation;
mod spikes;
mod temperature_gain;
mod temperature_offset;
mod torque_ripple;
mod zero_offset;

pub use arm::ArmColumns;

use crate::session::Session;

/// Every effect that is looked for.
pub static CATALOGUE: &[&dyn Effect] = &[
    &zero_offset::ZeroOffset,
    &gain::Gain,
    &axis::SensingAxis,
    &axial_force::AxialForce,
    &channel_coupling::ChannelCoupling,
    &temperature_offset::TemperatureOffset,
    &temperature_gain::TemperatureGain,
    &drift::Drift,
    &nonlinearity::Nonlinearity,
    &hysteresis::Hysteresis,
    &creep::Creep,
    &saturation::Saturation,
    &spikes::Spikes,
    &frame_loss::FrameLoss,
    &quantisation::Quantisation,
    &mains_pickup::MainsPickup,
    &delay::Delay,
    &lowpass::Lowpass,
    &torque_ripple::TorqueRipple,
    &link_mass::LinkMass,
    &link_offset::LinkOffset,
    &payload::Payload,
    &base_tilt::BaseTilt,
    &encoder_offset::EncoderOffset,
    &joint_flexibility::JointFlexibility,
    &backlash::Backlash,
    &friction::Friction,
    &cable_drag::CableDrag,
    &external_contact::ExternalContact,
];

/// Where an effect sits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Place {
    /// A channel, by index.
    Channel(usize),
    /// A joint of the session, by index; seen by the channels of that joint.
    Joint(usize),
    /// The child link of a joint of the chain, by index.
    Link(usize),
    /// The tip.
    Tip,
    /// The base.
    Base,
}

/// What a linear parameter is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// A parameter to report.
    Value,
    /// Fixed at one: the shape alone gives the size.
    Pinned,
    /// The sine part of an amplitude.
    Sine,
    /// The cosine part of an amplitude.
    Cosine,
    /// A parameter to report as one over it: a compliance for a stiffness.
    Inverse,
    /// Comes with the effect, is not reported.
    Nuisance,
}

/// What one unit of a linear parameter adds to the simulation.
#[derive(Debug, Clone)]
pub struct Column {
    /// The parameter's name; for a sine or cosine that of the amplitude.
    pub parameter: String,
    /// The parameter's unit.
    pub unit: String,
    /// What it is.
    pub role: Role,
    /// How large the parameter plausibly is (its unit): one standard deviation of a weak prior about zero.
    pub plausible: f64,
    /// Whether physics forbids it to be negative: springs pull back, friction brakes.
    pub is_positive: bool,
    /// Per touched channel the change (channel's unit per unit of the parameter), per row.
    pub parts: Vec<(usize, Vec<f64>)>,
    /// The only unit of the hold-out that it exists in, if it is an event there: then it is fitted on that unit's even seconds.
    pub unit_only: Option<usize>,
}

impl Column {
    /// A parameter to report, on one channel.
    fn value(parameter: &str, unit: &str, plausible: f64, channel: usize, values: Vec<f64>) -> Self {
        Self {
            parameter: parameter.to_owned(),
            unit: unit.to_owned(),
            role: Role::Value,
            plausible,
            is_positive: false,
            parts: vec![(channel, values)],
            unit_only: None,
        }
    }

    /// A parameter to report, on several channels.
    pub(crate) fn of_parts(
        parameter: &str,
        unit: &str,
        plausible: f64,
        parts: Vec<(usize, Vec<f64>)>,
    ) -> Self {
        Self { parts, ..Self::value(parameter, unit, plausible, 0, Vec::new()) }
    }

    /// What a shape adds, without a size of its own, on one channel.
    fn pinned(channel: usize, values: Vec<f64>) -> Self {
        Self { role: Role::Pinned, ..Self::value("", "", 1.0, channel, values) }
    }

    fn positive(self) -> Self {
        Self { is_positive: true, ..self }
    }

    /// Not negative on a simulator's torque, whose sign is known; a gauge's depends on how it was wired and built in.
    fn braking(self, session: &Session, channel: usize) -> Self {
        Self { is_positive: session.channels[channel].gauge.is_none(), ..self }
    }

    fn role(mut self, role: Role) -> Self {
        self.role = role;
        self
    }
}

/// Parameters that enter nonlinearly, in the order of [`Effect::shape_parameters`].
pub type Shape = Vec<f64>;

/// A term with the parameters that were found for its columns.
#[derive(Debug, Clone, Copy)]
pub struct Fitted<'a> {
    /// Where it sits.
    pub place: Place,
    /// Its shape.
    pub shape: &'a [f64],
    /// Value of each column's parameter.
    pub values: &'a [f64],
    /// Their standard deviations.
    pub sigmas: &'a [f64],
}

/// A parameter to report: name, value, standard deviation where it is known, unit.
pub type Reported = (String, f64, Option<f64>, String);

/// A change of a calibrated model that takes a found effect into account.
#[derive(Debug, Clone, PartialEq)]
pub enum Compensation {
    /// A gauge's bias, counts.
    Bias {
        /// Index of the gauge.
        gauge: usize,
        /// What is added, counts.
        counts: f64,
    },
    /// A gauge's compliance.
    Compliance {
        /// Index of the gauge.
        gauge: usize,
        /// What is added, counts/N and counts/Nm, in S.
        change: nalgebra::Vector6<f64>,
    },
    /// A further term of a gauge.
    Term {
        /// Index of the gauge.
        gauge: usize,
        /// Which, with its shape.
        effect: model::terms::Effect,
        /// Counts for a regressor of one.
        counts: f64,
        /// What the gauge's readings are scaled by in terms: centre and scale, counts.
        scaling: [f64; 2],
    },
    /// A joint's zero: true position less the encoder's.
    Zero {
        /// Coordinate of the joint.
        coordinate: usize,
        /// rad.
        rad: f64,
    },
}

/// A physical effect that a simulation may lack.
pub trait Effect: Sync {
    /// Its name in files and reports.
    fn id(&self) -> &'static str;

    /// What it is, in half a sentence that follows "because of".
    fn words(&self) -> &'static str;

    /// What to do about it at the robot or in the simulation.
    fn remedy(&self) -> &'static str;

    /// What the data lacks for it to be tested, if anything.
    fn missing(&self, session: &Session) -> Option<String>;

    /// Where it can sit.
    fn places(&self, session: &Session) -> Vec<Place>;

    /// Names and units of the parameters that enter nonlinearly and are to be reported, the first ones of a shape.
    fn shape_parameters(&self) -> &'static [(&'static str, &'static str)] {
        &[]
    }

    /// Shapes to try, neighbours next to each other.
    fn shapes(&self, _session: &Session, _place: Place) -> Vec<Shape> {
        vec![Shape::new()]
    }

    /// Whether the first nonlinear parameter may lie between two shapes that were tried.
    fn is_continuous(&self) -> bool {
        false
    }

    /// How many of a shape's numbers are searched for.
    fn searched(&self, shape: &[f64]) -> usize {
        shape.len()
    }

    /// Whether its columns hold for small parameters only, so that larger ones have to be asked for by [`Effect::straightened`].
    fn is_curved(&self) -> bool {
        false
    }

    /// The shape whose columns hold for parameters of this size, where the term's own do not.
    fn straightened(&self, _session: &Session, _term: &Fitted<'_>) -> Option<Shape> {
        None
    }

    /// Whether a shape is read off the even seconds' readings of every unit, so that parts which were not fitted on some of them may have it, too.
    fn is_read_off(&self, _shape: &[f64]) -> bool {
        false
    }

    /// Whether its form is the physics itself, so that nothing is left of it where its parameters are right.
    fn is_exact(&self) -> bool {
        false
    }

    /// What it adds to the simulation; nothing if that place and shape do not show in this data.
    fn columns(&self, session: &Session, place: Place, shape: &[f64]) -> Vec<Column>;

    /// The parameters to report, by name with value, standard deviation and unit, where they are others than the columns' own.
    fn report(&self, _session: &Session, _term: &Fitted<'_>) -> Option<Vec<Reported>> {
        None
    }

    /// What a calibrated model would have to be told so that it holds no gap of this kind any more; nothing where it cannot be told.
    fn compensate(&self, _session: &Session, _term: &Fitted<'_>) -> Vec<Compensation> {
        Vec::new()
    }

    /// What another recording would need in order to tell this effect from others.
    fn experiment(&self) -> &'static str;
}

/// The effect of this name.
#[must_use]
pub fn by_id(id: &str) -> Option<usize> {
    CATALOGUE.iter().position(|effect| effect.id() == id)
}

/// In which sense a gauge shows a torque that is in parallel with it: it takes load away from the gauge.
fn relief(session: &Session, channel: usize) -> f64 {
    if session.channels[channel].gauge.is_some() { -1.0 } else { 1.0 }
}

/// A place for every channel.
fn every_channel(session: &Session) -> Vec<Place> {
    (0..session.channels.len()).map(Place::Channel).collect()
}

/// Joints with a channel that a torque in parallel with it changes.
fn joints_with_moments(session: &Session) -> Vec<Place> {
    (0..session.joints.len())
        .filter(|joint| moment_channels(session, *joint).next().is_some())
        .map(Place::Joint)
        .collect()
}

/// Channels that a torque about this joint's axis in parallel with the sensor changes, with the change per Nm.
pub(crate) fn moment_channels(session: &Session, joint: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
    let of_joint =
        move |(_, c): &(usize, &crate::session::Channel)| c.joint == Some(joint) && c.per_nm != 0.0;
    session.channels.iter().enumerate().filter(of_joint).map(|(index, channel)| (index, channel.per_nm))
}

/// Several geometric steps from `low` to `high`, both included.
fn geometric(low: f64, high: f64, count: usize) -> Vec<Shape> {
    let steps = count.saturating_sub(1).max(1) as f64;
    (0..count).map(|k| vec![low * (high / low).powf(k as f64 / steps)]).collect()
}

/// Times (s) by which a signal may be late: from a hundredth of a step to sixty steps, as far as the recordings are long enough. Below a
/// quarter of a step what they make of a signal only grows with them, so that few will do.
fn latenesses(session: &Session) -> Vec<Shape> {
    let (Some(step_s), Some(longest_s)) = (session.step_s(), session.longest_s()) else {
        return Vec::new();
    };
    let mut shapes = geometric(0.01 * step_s, 0.1 * step_s, 3);
    shapes.extend(geometric(0.25 * step_s, (60.0 * step_s).min(longest_s / 4.0).max(step_s), 24));
    shapes
}

/// What a first-order lag (s) makes of a signal, each segment by itself, from its first value: exact for a signal that
/// goes straight from instant to instant.
fn lagged(session: &Session, values: &[f64], tau_s: f64) -> Vec<f64> {
    let Some(time_s) = &session.time_s else { return values.to_vec() };
    if tau_s <= 0.0 {
        return values.to_vec();
    }
    let mut out = values.to_vec();
    for rows in &session.segments {
        for row in rows.clone().skip(1) {
            let step_s = time_s[row] - time_s[row - 1];
            let decay = decay(step_s / tau_s);
            let slope = (values[row] - values[row - 1]) / step_s;
            let behind = out[row - 1] - values[row - 1] + slope * tau_s;
            out[row] = values[row] - slope * tau_s + behind * decay;
        }
    }
    out
}

/// `exp(-x)`; by its series where that is exact to twelve digits, which most of a lag's steps are small enough for.
fn decay(x: f64) -> f64 {
    if x > 0.03 {
        return (-x).exp();
    }
    1.0 - x * (1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0 * (1.0 - x / 6.0)))))
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// The largest magnitude among values.
fn largest(values: &[f64]) -> f64 {
    values.iter().fold(0.0, |most: f64, value| most.max(value.abs()))
}

fn deviation(values: &[f64]) -> f64 {
    let mean = mean(values);
    (values.iter().map(|v| (v - mean) * (v - mean)).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

const NO_TIME: &str = "the instants' time (time = \"COLUMN\")";
const NO_MOTION: &str = "the joints' positions and time ([[joint]] with position, time = \"COLUMN\")";
const NO_JOINT: &str = "joint torque channels ([[channel]] with unit = \"Nm\" and joint)";
const NO_SIGNAL: &str = "a simulated signal that changes";

/// Temperatures that stay within this deviation say nothing, K: thermometers have steps of a quarter.
const STEADY_K: f64 = 0.1;

fn without_temperature(session: &Session) -> Option<String> {
    if !session.has_temperature() {
        return Some("the temperature ([covariates] temperature = \"COLUMN\")".to_owned());
    }
    let spread_k =
        (0..session.channels.len()).filter_map(|channel| session.temperature_of(channel)).map(deviation);
    let most_k = spread_k.fold(0.0, f64::max);
    (most_k < STEADY_K).then(|| format!("a temperature that changes (it stayed within {most_k:.2} K)"))
}

/// The simulated signal changes enough to have a shape.
fn moves(session: &Session, channel: usize) -> bool {
    let channel = &session.channels[channel];
    deviation(&channel.simulated) > 1e-6 * (channel.rms_gap() + channel.simulated[0].abs())
}

/// A place for every channel whose simulated signal changes.
fn moving_channels(session: &Session) -> Vec<Place> {
    (0..session.channels.len()).filter(|channel| moves(session, *channel)).map(Place::Channel).collect()
}

fn without_signal(session: &Session) -> Option<String> {
    moving_channels(session).is_empty().then(|| NO_SIGNAL.to_owned())
}

fn without_time_or_signal(session: &Session) -> Option<String> {
    if session.time_s.is_none() { Some(NO_TIME.to_owned()) } else { without_signal(session) }
}

fn without_moving_joint(session: &Session) -> Option<String> {
    if session.joints.is_empty() || session.time_s.is_none() {
        return Some(NO_MOTION.to_owned());
    }
    joints_with_moments(session).is_empty().then(|| NO_JOINT.to_owned())
}

#[cfg(test)]
mod tests {
    #[test]
    fn a_decay_is_the_exponential_on_both_sides_of_its_series() {
        for x in [0.0, 1e-6, 0.01, 0.0299, 0.0301, 0.5, 3.0_f64] {
            assert!((super::decay(x) - (-x).exp()).abs() < 1e-14, "{x}");
        }
    }
}
