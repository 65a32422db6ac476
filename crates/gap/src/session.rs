//! What is compared, as columns over instants: measured minus simulated per channel, with what is known beside it.

use std::ops::Range;
use std::sync::OnceLock;

use model::chain::{Chain, Section};
use model::spatial::{RigidBody, Tip, Wrench};
use nalgebra::Vector6;

use crate::effects::ArmColumns;

/// What a channel measures, as far as an effect cares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// A force, N.
    Force,
    /// A moment, Nm.
    Moment,
    /// An angle, rad.
    Angle,
    /// Anything else: counts, kg, V.
    Other,
}

impl Quantity {
    /// The quantity of a unit as it is written in a file.
    #[must_use]
    pub fn of_unit(unit: &str) -> Self {
        match unit {
            "N" => Self::Force,
            "Nm" | "N m" | "N*m" => Self::Moment,
            "rad" => Self::Angle,
            _ => Self::Other,
        }
    }
}

/// One measured signal beside its simulation.
#[derive(Debug, Clone)]
pub struct Channel {
    /// What the signal is called.
    pub name: String,
    /// Unit of its values.
    pub unit: String,
    /// What the unit stands for.
    pub quantity: Quantity,
    /// Index of the joint it belongs to, if it does.
    pub joint: Option<usize>,
    /// Simulated values (channel's unit), per row.
    pub simulated: Vec<f64>,
    /// Measured minus simulated (channel's unit), per row.
    pub gap: Vec<f64>,
    /// What the gap is divided by before channels are pooled (channel's unit): noise, or the RMS gap where none is known.
    pub scale: f64,
    /// What noise leaves of the gap, over the scale; 0 where nothing tells.
    pub floor: f64,
    /// Factor that makes the channel commensurate with the others in raw figures (1, or one over a length, 1/m).
    pub raw_factor: f64,
    /// Rows at which it was read; empty: all of them. Elsewhere `gap` is 0 and counts for nothing.
    pub read: Vec<bool>,
    /// What a torque about its joint's axis in parallel with the sensor adds (channel's unit per Nm); 0 where there is no joint.
    pub per_nm: f64,
    /// What is known of it as a strain gauge in a section of the arm.
    pub gauge: Option<Gauge>,
}

/// A strain gauge in a section of the arm, as its model has it.
#[derive(Debug, Clone)]
pub struct Gauge {
    /// Sensitivity to the load of its section, counts/N and counts/Nm, in S.
    pub compliance: Vector6<f64>,
    /// Reading without load, counts; `simulated` is without it.
    pub bias_counts: f64,
    /// Simulated load of its section (N, Nm about S, in S), per row.
    pub loads: Vec<Vector6<f64>>,
    /// Temperature (degC), per row, where it is measured.
    pub temperature_c: Option<Vec<f64>>,
}

impl Channel {
    /// Half the span of the simulated values, or the RMS gap where the simulation hardly moves (channel's unit).
    #[must_use]
    pub fn extent(&self) -> f64 {
        let (low, high) =
            self.simulated.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
        ((high - low) / 2.0).max(self.rms_gap())
    }

    /// RMS of measured minus simulated (channel's unit).
    #[must_use]
    pub fn rms_gap(&self) -> f64 {
        let share = self.count() as f64 / self.gap.len().max(1) as f64;
        if share > 0.0 { rms(&self.gap) / share.sqrt() } else { 0.0 }
    }

    /// Whether it was read at a row.
    #[must_use]
    pub fn is_read(&self, row: usize) -> bool {
        self.read.get(row).is_none_or(|read| *read)
    }

    /// Number of rows at which it was read.
    #[must_use]
    pub fn count(&self) -> usize {
        if self.read.is_empty() { self.gap.len() } else { self.read.iter().filter(|read| **read).count() }
    }
}

/// Root of the mean square; 0 for nothing.
pub(crate) fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|v| v * v).sum::<f64>() / values.len().max(1) as f64).sqrt()
}

/// A joint's motion, per row.
#[derive(Debug, Clone)]
pub struct Joint {
    /// The joint's name.
    pub name: String,
    /// Position, rad.
    pub position_rad: Vec<f64>,
    /// Velocity, rad/s; none for static points.
    pub velocity_rad_s: Option<Vec<f64>>,
    /// Acceleration, rad/s^2; none for static points.
    pub acceleration_rad_s2: Option<Vec<f64>>,
}

/// A known quantity beside the channels.
#[derive(Debug, Clone)]
pub struct Covariate {
    /// What it is called.
    pub name: String,
    /// Its values, per row.
    pub values: Vec<f64>,
}

/// Joint torques as functions of what moves: the chain, with the joints of the session on it.
#[derive(Debug, Clone)]
pub struct Kinematics {
    /// The arm; its links may have no masses.
    pub chain: Chain,
    /// Per coordinate of the chain the session's joint that gives its position.
    pub joints: Vec<usize>,
    /// Whether the links have masses (kg), so that predictions can be derived by pose and gravity.
    pub has_masses: bool,
    /// Channels that feel the arm's weight and motion.
    pub sensing: Vec<Sensing>,
    /// What hangs on the tip as declared (tip frame), by stretches of rows; elsewhere nothing.
    pub carried: Vec<(Range<usize>, RigidBody)>,
    /// What else acts on the tip (N, Nm about E, in E), per row; empty: nothing.
    pub wrench: Vec<Wrench<Tip>>,
}

/// A channel that feels the arm: a section, and what the channel makes of its load.
#[derive(Debug, Clone)]
pub struct Sensing {
    /// Index of the channel.
    pub channel: usize,
    /// Where it sits.
    pub section: Section,
    /// Channel's unit per N and Nm of load (about S, in S).
    pub row: Vector6<f64>,
}

/// A direction in which the simulation is uncertain: what one standard deviation of it adds to each channel.
#[derive(Debug, Clone)]
pub struct Doubt {
    /// Per touched channel the change (channel's unit), per row.
    pub parts: Vec<(usize, Vec<f64>)>,
}

/// How rows are divided for being left out.
#[derive(Debug, Clone)]
pub struct HoldOut {
    /// Names of the units that leave together.
    pub units: Vec<String>,
    /// Units used for nothing but the final figures; empty: every unit is left out in turn.
    pub reserved: Vec<usize>,
    /// Per block its unit. A block is what the bootstrap draws.
    pub unit_of_block: Vec<usize>,
    /// Per row its block.
    pub block_of_row: Vec<usize>,
    /// Per block whether it lies in an even second of its recording; empty where seconds do not count. What belongs to one unit
    /// alone (a contact, the phase of a hum) is fitted on the even seconds of that unit and judged on the odd.
    pub is_even: Vec<bool>,
    /// The division in words.
    pub words: String,
}

impl HoldOut {
    /// Whether a block may be fitted on although its unit is left out.
    #[must_use]
    pub fn is_even(&self, block: usize) -> bool {
        self.is_even.get(block).is_some_and(|even| *even)
    }
}

/// Everything that a diagnosis looks at.
#[derive(Debug, Clone)]
pub struct Session {
    /// What is compared.
    pub channels: Vec<Channel>,
    /// Instants (s), increasing within a segment; none for static points.
    pub time_s: Option<Vec<f64>>,
    /// Stretches of rows without an interruption; all rows are in one.
    pub segments: Vec<std::ops::Range<usize>>,
    /// The joints' motion.
    pub joints: Vec<Joint>,
    /// Temperature (degC) of what has no thermometer of its own.
    pub temperature: Option<Covariate>,
    /// Per segment the instant (s) at which its session began.
    pub began_s: Vec<f64>,
    /// Rows of recordings that repeat each other, instant by instant.
    pub repeats: Vec<(Range<usize>, Range<usize>)>,
    /// Directions in which the simulation is uncertain, independent of each other.
    pub doubts: Vec<Doubt>,
    /// Known loads.
    pub loads: Vec<Covariate>,
    /// The arm, where it is known.
    pub kinematics: Option<Kinematics>,
    /// How rows are divided for being left out.
    pub hold_out: HoldOut,
    /// What the reader should know about the data, one line each.
    pub notes: Vec<String>,
    /// What changes of the arm would change, computed when first asked for.
    pub(crate) arm_columns: OnceLock<ArmColumns>,
}

impl Session {
    /// Temperature (degC) of a channel, per row.
    #[must_use]
    pub fn temperature_of(&self, channel: usize) -> Option<&[f64]> {
        let own = self.channels[channel].gauge.as_ref().and_then(|gauge| gauge.temperature_c.as_deref());
        own.or_else(|| self.temperature.as_ref().map(|covariate| covariate.values.as_slice()))
    }

    /// Whether any channel has a temperature.
    #[must_use]
    pub fn has_temperature(&self) -> bool {
        (0..self.channels.len()).any(|channel| self.temperature_of(channel).is_some())
    }

    /// Number of instants.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.channels.first().map_or(0, |channel| channel.gap.len())
    }

    /// Number of blocks.
    #[must_use]
    pub fn blocks(&self) -> usize {
        self.hold_out.unit_of_block.len()
    }

    /// Median time between instants (s), if there is time.
    #[must_use]
    pub fn step_s(&self) -> Option<f64> {
        let time_s = self.time_s.as_ref()?;
        let mut steps: Vec<f64> = self
            .segments
            .iter()
            .flat_map(|rows| time_s[rows.clone()].windows(2).map(|pair| pair[1] - pair[0]))
            .collect();
        if steps.is_empty() {
            return None;
        }
        let middle = steps.len() / 2;
        Some(*steps.select_nth_unstable_by(middle, f64::total_cmp).1)
    }

    /// Length (s) of the longest segment, if there is time.
    #[must_use]
    pub fn longest_s(&self) -> Option<f64> {
        let time_s = self.time_s.as_ref()?;
        self.segments
            .iter()
            .filter(|rows| !rows.is_empty())
            .map(|rows| time_s[rows.end - 1] - time_s[rows.start])
            .reduce(f64::max)
    }
}
