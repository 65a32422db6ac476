//! What is compared, as columns over instants: measured minus simulated per channel, with what is known beside it.

use model::chain::Chain;

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
        rms(&self.gap)
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
    /// The division in words.
    pub words: String,
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
    /// Temperature (degC).
    pub temperature: Option<Covariate>,
    /// Known loads.
    pub loads: Vec<Covariate>,
    /// The arm, where it is known.
    pub kinematics: Option<Kinematics>,
    /// How rows are divided for being left out.
    pub hold_out: HoldOut,
    /// What the reader should know about the data, one line each.
    pub notes: Vec<String>,
}

impl Session {
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
