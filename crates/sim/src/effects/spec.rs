//! What one types for an effect: `ID[@PLACE][,key=value]...`, with `size=` for a size in noise floors.

use std::str::FromStr;

use rand::RngExt;
use rig::Rig;

use super::Effect;
use crate::SimError;
use crate::random::{Purpose, stream};

/// Where an effect sits, as an index.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// A gauge, in the configuration's order.
    Gauge(usize),
    /// A joint, by its coordinate.
    Joint(usize),
    /// The child link of a joint of the chain.
    Link(usize),
    /// The whole arm: its base or its tip.
    Arm,
}

macro_rules! kinds {
    ($($kind:ident $id:literal $place:ident $strength:literal $usual:literal [$($name:literal $value:expr),*] $doc:literal;)*) => {
        /// The effects that can be simulated.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Kind { $(#[doc = $doc] $kind,)* }

        impl Kind {
            /// All of them.
            pub const ALL: &'static [Self] = &[$(Self::$kind,)*];

            /// Its name in files and on the command line.
            #[must_use]
            pub const fn id(self) -> &'static str { match self { $(Self::$kind => $id,)* } }

            /// The name of its strength among its parameters.
            #[must_use]
            pub const fn strength(self) -> &'static str { match self { $(Self::$kind => $strength,)* } }

            const fn usual(self) -> f64 { match self { $(Self::$kind => $usual,)* } }

            const fn numbers(self) -> &'static [(&'static str, f64)] { match self { $(Self::$kind => &[$(($name, $value)),*],)* } }

            const fn sits(self) -> Sits { match self { $(Self::$kind => Sits::$place,)* } }
        }
    };
}

/// What kind of place an effect takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sits {
    Gauge,
    Joint,
    Link,
    /// A link that at least two gauges feel through the links before.
    Beyond,
    Arm,
}

kinds! {
    ZeroOffset "zero_offset" Gauge "offset" 3000.0 [] "A constant, counts.";
    Gain "gain" Gauge "relative" 0.01 [] "A factor.";
    SensingAxis "sensing_axis" Gauge "d_ax" 0.02 [] "An axis turned (rad) and shifted a tenth of that (m).";
    AxialForce "axial_force" Gauge "pitch_m" 0.005 [] "Force along the axis, m.";
    TemperatureOffset "temperature_offset" Gauge "per_k" 1000.0 ["lag_s" 20.0] "A zero that follows temperature, counts/K.";
    TemperatureGain "temperature_gain" Gauge "per_k" 0.002 [] "A scale that follows temperature, 1/K.";
    Drift "drift" Gauge "amplitude" 3000.0 ["tau_s" 40.0] "A zero that creeps with the logarithm of time, counts.";
    Nonlinearity "nonlinearity" Gauge "relative" 0.01 ["order" 2.0] "A bent characteristic, share of half the range.";
    Hysteresis "hysteresis" Gauge "relative" 0.01 ["width" 0.15] "A loop (Bouc, Wen), share of half the range.";
    Creep "creep" Gauge "relative" 0.01 ["tau_s" 30.0] "A power of time that ends (mean retardation time tau_s), share of the load after five minutes.";
    Saturation "saturation" Gauge "limit" 1e6 [] "A limit, counts beyond the bias.";
    Spikes "spikes" Gauge "amplitude" 2e4 ["rate_hz" 0.3] "Single readings, counts.";
    FrameLoss "frame_loss" Gauge "held_s" 0.1 ["every_s" 2.0] "Readings that stand for the next ones, s at a time.";
    Quantisation "quantisation" Gauge "step" 3000.0 [] "Steps, counts: what is between is rounded.";
    MainsPickup "mains_pickup" Gauge "amplitude" 3000.0 ["hz" 49.99] "A sine, counts.";
    Delay "delay" Gauge "s" 0.01 [] "A late signal, s.";
    Lowpass "lowpass" Gauge "tau_s" 0.02 [] "A smoothed signal, s.";
    ChannelCoupling "channel_coupling" Gauge "relative" 0.01 ["source" -1.0] "A share of another gauge's signal.";
    TorqueRipple "torque_ripple" Joint "amplitude" 0.02 ["cycles_per_rev" 160.0, "by_load" 0.0] "A wave of the joint's angle, Nm; by_load: the share of it that grows with the load.";
    LinkMass "link_mass" Link "relative_mass" 0.05 [] "A heavier link.";
    Payload "payload" Arm "d_mass" 0.02 [] "Another weight than declared (kg), half a millimetre a gram elsewhere.";
    BaseTilt "base_tilt" Arm "rad" 0.005 [] "A base that leans.";
    EncoderOffset "encoder_offset" Joint "rad" 0.005 [] "A joint's zero.";
    JointFlexibility "joint_flexibility" Joint "rad_per_nm" 2e-4 [] "A joint that yields.";
    Backlash "backlash" Joint "rad" 0.002 [] "Play of a gear.";
    LinkOffset "link_offset" Beyond "m" 0.001 [] "A link that sits elsewhere on the one before.";
    Friction "friction" Joint "coulomb_nm" 0.02 ["viscous" 0.3, "stribeck_rad_s" 0.05] "Friction with a dip after the start (Stribeck).";
    CableDrag "cable_drag" Joint "nm_per_rad" 0.02 [] "A cable that stiffens.";
    ExternalContact "external_contact" Link "force_n" 2.0 ["from_s" -1.0, "to_s" -1.0] "A push on a link for a while, N.";
    RandomWalk "random_walk" Gauge "amplitude" 3000.0 [] "A zero that walks at random, counts; outside the catalogue of a diagnosis.";
    ZeroJumps "zero_jumps" Gauge "amplitude" 3000.0 ["every_s" 12.0] "A zero that jumps at random (a loose solder joint), counts; outside the catalogue of a diagnosis.";
    GainWalk "gain_walk" Gauge "relative" 0.01 ["time_s" 15.0] "A scale that wanders (a supply that does), share; outside the catalogue of a diagnosis.";
    Product "product" Gauge "relative" 0.01 ["source" -1.0] "A share of the product with another gauge's signal (over half its range); outside the catalogue of a diagnosis.";
}

/// An effect as it was asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Spec {
    kind: Kind,
    place: Option<String>,
    values: Vec<(String, f64)>,
    source: Option<String>,
    pub(super) size: Option<f64>,
}

impl FromStr for Spec {
    type Err = SimError;

    fn from_str(text: &str) -> Result<Self, SimError> {
        let wrong = |problem: String| SimError::Option(format!("--effect {text}: {problem}"));
        let mut parts = text.split(',');
        let head = parts.next().unwrap_or_default();
        let (id, place) = head.split_once('@').map_or((head, None), |(id, place)| (id, Some(place)));
        let kind = Kind::ALL.iter().copied().find(|kind| kind.id() == id.trim()).ok_or_else(|| {
            let known: Vec<&str> = Kind::ALL.iter().map(|kind| kind.id()).collect();
            wrong(format!("\"{id}\" is no effect; give one of {}", known.join(", ")))
        })?;
        let mut spec = Self {
            kind,
            place: place.map(|place| place.trim().to_owned()),
            values: Vec::new(),
            source: None,
            size: None,
        };
        for part in parts {
            let Some((key, value)) = part.split_once('=').map(|(key, value)| (key.trim(), value.trim()))
            else {
                return Err(wrong(format!("\"{part}\" is no key=value; write for example size=3")));
            };
            if key == "source" && matches!(kind, Kind::ChannelCoupling | Kind::Product) {
                spec.source = Some(value.to_owned());
                continue;
            }
            let number = value.parse::<f64>().ok().filter(|number| number.is_finite());
            let number = number.ok_or_else(|| wrong(format!("{key} = \"{value}\" is not a number")))?;
            match key {
                "size" if number > 0.0 => spec.size = Some(number),
                "size" => return Err(wrong(format!("size = {number} must be above 0"))),
                _ if key == kind.strength() || kind.numbers().iter().any(|(name, _)| *name == key) => {
                    spec.values.push((key.to_owned(), number));
                }
                _ => {
                    let known: Vec<&str> = std::iter::once(kind.strength())
                        .chain(kind.numbers().iter().map(|(name, _)| *name))
                        .collect();
                    return Err(wrong(format!(
                        "{key} is no parameter of it; it has {} and size",
                        known.join(", ")
                    )));
                }
            }
        }
        if spec.size.is_some() && spec.values.iter().any(|(key, _)| key == kind.strength()) {
            return Err(wrong(format!(
                "{} and size are two ways to say the same; give one",
                kind.strength()
            )));
        }
        Ok(spec)
    }
}

impl Spec {
    /// An effect somewhere, at a size in noise floors.
    #[must_use]
    pub fn sized(kind: Kind, place: Option<String>, size: f64) -> Self {
        Self { kind, place, values: Vec::new(), source: None, size: Some(size) }
    }

    /// The effect on this arm; what was not said is the usual, and a place is drawn.
    pub(super) fn resolve(&self, rig: &Rig, seed: u64) -> Result<Effect, SimError> {
        let mut rng = stream(seed, Purpose::Effects);
        let names = names(rig, self.kind.sits());
        let index = match &self.place {
            Some(name) => find(&names, name, self.kind)?,
            None => rng.random_range(0..names.len().max(1)),
        };
        let given = |name: &str| self.values.iter().find(|(key, _)| key == name).map(|(_, value)| *value);
        let mut numbers: Vec<(&'static str, f64)> =
            self.kind.numbers().iter().map(|(name, usual)| (*name, given(name).unwrap_or(*usual))).collect();
        if matches!(self.kind, Kind::ChannelCoupling | Kind::Product) {
            let gauges = rig.sections.len();
            let drawn = (index + rng.random_range(1..gauges.max(2))) % gauges.max(1);
            let source = self.source.as_ref().map(|name| find(&names, name, self.kind)).transpose()?;
            numbers = vec![("source", source.unwrap_or(drawn) as f64)];
        }
        let sign = if rng.random_bool(0.5) || self.kind.is_one_sided() { 1.0 } else { -1.0 };
        Ok(Effect {
            kind: self.kind,
            place: match self.kind.sits() {
                Sits::Gauge => Place::Gauge(index),
                Sits::Joint => Place::Joint(index),
                Sits::Link => Place::Link(heavy(rig).get(index).copied().unwrap_or(0)),
                Sits::Beyond => Place::Link(beyond(rig).get(index).copied().unwrap_or(0)),
                Sits::Arm => Place::Arm,
            },
            strength: given(self.kind.strength()).unwrap_or(sign * self.kind.usual()),
            numbers,
            seed,
            size: self.size,
        })
    }
}

impl Kind {
    /// Whether physics gives it one sign only.
    fn is_one_sided(self) -> bool {
        use Kind::{
            Backlash, CableDrag, Delay, FrameLoss, Friction, JointFlexibility, Lowpass, Quantisation,
            Saturation,
        };
        matches!(
            self,
            Backlash
                | CableDrag
                | Delay
                | FrameLoss
                | Friction
                | JointFlexibility
                | Lowpass
                | Quantisation
                | Saturation
        )
    }
}

/// Joints of the chain whose child link has a mass.
fn heavy(rig: &Rig) -> Vec<usize> {
    (0..rig.chain.joints.len()).filter(|k| rig.chain.joints[*k].body.mass_kg > 0.0).collect()
}

/// Those of them that at least two gauges feel through the links before.
fn beyond(rig: &Rig) -> Vec<usize> {
    let felt = |k: usize| rig.sections.iter().filter(|section| section.joint < k).count();
    heavy(rig).into_iter().filter(|k| felt(*k) >= 2).collect()
}

fn names(rig: &Rig, sits: Sits) -> Vec<String> {
    match sits {
        Sits::Gauge => rig.layout.gauges.iter().map(|gauge| gauge.name.clone()).collect(),
        Sits::Joint => rig.chain.coordinate_names().into_iter().map(str::to_owned).collect(),
        Sits::Link => child_links(rig, &heavy(rig)),
        Sits::Beyond => child_links(rig, &beyond(rig)),
        Sits::Arm => vec!["arm".to_owned(), "base".to_owned(), "tip".to_owned()],
    }
}

fn child_links(rig: &Rig, joints: &[usize]) -> Vec<String> {
    joints.iter().map(|k| rig.chain.joints[*k].child_link.clone()).collect()
}

fn find(names: &[String], name: &str, kind: Kind) -> Result<usize, SimError> {
    names.iter().position(|known| known == name).ok_or_else(|| {
        let known = names.join(", ");
        SimError::Option(format!("--effect {}@{name}: is no place for it; give one of {known}", kind.id()))
    })
}
