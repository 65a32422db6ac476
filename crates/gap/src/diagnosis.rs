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
#[derive(Debug, Clone, Serialize)]
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
    /// What a calibrated model would have to be told; empty where the effect cannot be compensated by it.
    #[serde(skip)]
    pub compensations: Vec<crate::effects::Compensation>,
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
