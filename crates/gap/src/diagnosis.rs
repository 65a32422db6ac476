//! The answer, as typed values; its JSON is the public format.

use std::collections::BTreeMap;

use serde::Serialize;

/// What a diagnosis comes to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Nothing but noise.
    NoGap,
    /// What was found leaves hardly more than noise.
    Explained,
    /// What was found explains a part.
    PartlyExplained,
    /// No effect of the catalogue explains it.
    Unexplained,
}

/// The gap of a session.
#[derive(Debug, Clone, Serialize)]
pub struct Diagnosis {
    /// Version of this format.
    pub format: u32,
    /// What it comes to.
    pub verdict: Verdict,
    /// How large the gap is and how far it shrinks.
    pub gap: Gap,
    /// Effects that were established, the largest share first.
    pub findings: Vec<Finding>,
    /// Effects that this data cannot show.
    pub not_testable: Vec<NotTestable>,
    /// What to record next.
    pub next_experiment: String,
    /// Where the gap lies.
    #[serde(rename = "where")]
    pub location: Location,
    /// How rows were left out.
    pub hold_out: String,
    /// What the reader should know.
    pub notes: Vec<String>,
}

/// Size of the gap: RMS over channels on left-out units, each channel over its scale.
#[derive(Debug, Clone, Serialize)]
pub struct Gap {
    /// As simulated.
    pub before: f64,
    /// With what was found.
    pub after: f64,
    /// What noise leaves; 0 where nothing tells.
    pub floor: f64,
    /// Share of the reducible gap that goes away; none where there is none to reduce.
    pub shrink: Option<f64>,
    /// Interval of 95 % of the shrink.
    pub shrink_ci95: Option<[f64; 2]>,
    /// The same in the channels' own unit.
    pub raw: Raw,
}

/// RMS over channels in their own unit; none where units differ and no characteristic length makes them alike.
#[derive(Debug, Clone, Serialize)]
pub struct Raw {
    /// As simulated.
    pub before: Option<f64>,
    /// With what was found.
    pub after: Option<f64>,
    /// Their unit.
    pub unit: Option<String>,
}

/// An effect that was established.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Finding {
    /// Its name in the catalogue.
    pub effect: String,
    /// Channels where it sits.
    pub sensors: Vec<String>,
    /// Joints where it sits.
    pub joints: Vec<String>,
    /// Links where it sits.
    pub links: Vec<String>,
    /// Its share of the shrink (Shapley value).
    pub share: f64,
    /// Interval of 95 % of the share.
    pub share_ci95: [f64; 2],
    /// How often a finding so well supported is right.
    pub confidence: f64,
    /// Its parameters, by name.
    pub parameters: BTreeMap<String, Parameter>,
    /// Effects that explain the data as well.
    pub indistinguishable_from: Vec<String>,
    /// It all in a sentence.
    pub words: String,
    /// What the confidence was made of.
    #[serde(skip)]
    pub evidence: Evidence,
    /// What a calibrated model would have to be told; empty where the effect cannot be compensated by it.
    #[serde(skip)]
    pub compensations: Vec<crate::effects::Compensation>,
}

/// What speaks for a finding.
#[derive(Debug, Clone, Copy, Default)]
pub struct Evidence {
    /// Share of the draws in which it explains more than every rival (those said to be alike apart).
    pub wins: f64,
    /// How much more it explains than its best rival (those said to be alike apart), over what it explains, median of the draws.
    pub lead: f64,
    /// That lead over its spread.
    pub lead_sigmas: f64,
    /// What leaving it out would cost, over what all findings explain.
    pub marginal: f64,
    /// By how much a model that knows no physics is better on its channels, over what would refute the finding; 0 where it is not.
    pub generic: f64,
    /// Share of the reducible gap of its channels that all findings explain.
    pub explained: f64,
    /// Gap of its channels beyond the noise, RMS over it.
    pub excess: f64,
    /// Share of the parts of the data in which the effect was chosen by itself.
    pub chosen: f64,
    /// Share of what it explains that it would explain only with other parameters in every part of the recordings.
    pub unsteady: f64,
    /// Parameters that are searched or fitted at a place, the most of any.
    pub freedom: usize,
}

/// A parameter with its standard deviation.
#[derive(Debug, Clone, Serialize)]
pub struct Parameter {
    /// Its value.
    pub value: f64,
    /// Standard deviation; none where the data does not tell.
    pub sigma: Option<f64>,
    /// Its unit.
    pub unit: String,
}

/// An effect that the data cannot show.
#[derive(Debug, Clone, Serialize)]
pub struct NotTestable {
    /// Its name in the catalogue.
    pub effect: String,
    /// What is missing.
    pub missing: String,
}

/// Where the gap lies.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Location {
    /// By channel.
    pub sensors: Vec<SensorGap>,
    /// By channel and joint.
    pub sensor_by_joint: Vec<SensorByJoint>,
    /// Where a quantity rises beside where it falls, for findings that depend on it.
    pub loops: Vec<Loop>,
    /// By time, temperature, joint angle, speed and the like.
    #[serde(flatten)]
    pub profiles: BTreeMap<String, Vec<Bin>>,
}

/// The gap of one channel.
#[derive(Debug, Clone, Serialize)]
pub struct SensorGap {
    /// The channel.
    pub name: String,
    /// RMS over its scale, as simulated.
    pub before: f64,
    /// RMS over its scale, with what was found.
    pub after: f64,
    /// What noise leaves.
    pub floor: f64,
    /// RMS in its unit, as simulated.
    pub before_raw: f64,
    /// RMS in its unit, with what was found.
    pub after_raw: f64,
    /// Its unit.
    pub unit: String,
}

/// How much of a channel's gap goes with a joint's angle.
#[derive(Debug, Clone, Serialize)]
pub struct SensorByJoint {
    /// The channel.
    pub sensor: String,
    /// The joint.
    pub joint: String,
    /// Share of the mean square gap that lies in its means over intervals of the angle (the correlation ratio), as simulated.
    pub before: f64,
    /// The same of what is left with what was found.
    pub after: f64,
}

/// The gap where a quantity lies in an interval.
#[derive(Debug, Clone, Serialize)]
pub struct Bin {
    /// The quantity.
    pub name: String,
    /// From this value on.
    pub from: f64,
    /// Up to this value.
    pub to: f64,
    /// Unit of the quantity.
    pub unit: String,
    /// RMS over scales, as simulated.
    pub before: f64,
    /// RMS over scales, with what was found.
    pub after: f64,
}

/// What is left of a channel where a quantity rises, beside where it falls.
#[derive(Debug, Clone, Serialize)]
pub struct Loop {
    /// The channel.
    pub sensor: String,
    /// The quantity: the channel's own simulated signal, or a joint.
    pub over: String,
    /// Its unit.
    pub unit: String,
    /// Intervals of it, in ascending order.
    pub points: Vec<LoopPoint>,
}

/// Means over an interval, over the channel's scale; none where it hardly ever moved that way.
#[derive(Debug, Clone, Serialize)]
pub struct LoopPoint {
    /// Mean of the quantity.
    pub at: f64,
    /// As simulated, rising.
    pub rising_before: Option<f64>,
    /// As simulated, falling.
    pub falling_before: Option<f64>,
    /// With what was found, rising.
    pub rising_after: Option<f64>,
    /// With what was found, falling.
    pub falling_after: Option<f64>,
}
