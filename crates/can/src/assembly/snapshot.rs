//! What the assembler hands on: every gauge and joint at one instant, each a reading or a named absence

/// One value with the instant it was sampled at
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct Reading {
    /// Physical value: counts, rad, rad/s or degC
    pub value: f64,
    /// Sampling instant in ns since the Unix epoch
    pub at_ns: i64,
    /// The snapshot's instant minus the sampling instant, ns
    pub age_ns: i64,
    /// What it may be older by than that, ns: its frame came where another of its message had been lost, and nothing says whether it was that one
    pub unsure_ns: i64,
}

/// Why there is no reading
#[derive(Clone, Copy, PartialEq, Eq, Debug, Hash)]
pub enum Absence {
    /// No such signal is configured
    NotConfigured,
    /// Its message never arrived
    NeverSeen,
    /// Its message did not arrive in this round although it was due
    Missed,
    /// The last reading is older than the configured limit
    Stale,
    /// The board says that the gauge was beyond its range
    Saturated,
    /// Its message came, but its counter did not advance: a duplicate, or a board that stands still; or it came twice with different readings
    Repeated,
    /// Its message came with another length than the DBC says
    WrongLength,
    /// Its bits are a float that is no finite number
    NotFinite,
}

impl std::fmt::Display for Absence {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::NotConfigured => "not configured",
            Self::NeverSeen => "never seen",
            Self::Missed => "missed",
            Self::Stale => "stale",
            Self::Saturated => "saturated",
            Self::Repeated => "repeated",
            Self::WrongLength => "wrong length",
            Self::NotFinite => "not finite",
        })
    }
}

/// A reading or the reason that there is none
pub type Signal = Result<Reading, Absence>;

/// Position and velocity of one joint
#[derive(Clone, Copy, PartialEq, Debug)]
pub struct JointReading {
    /// rad
    pub position: Signal,
    /// rad/s
    pub velocity: Signal,
}

/// All gauges and joints of one round; [`Clone::clone_from`] into one of the same robot takes no memory
#[derive(PartialEq, Debug)]
pub struct Snapshot {
    /// The instant it refers to: earliest (stamp - delay) of the round's gauge frames, ns since the Unix epoch
    pub instant_ns: i64,
    /// Stamp of the last frame in it, ns since the Unix epoch
    pub last_stamp_ns: i64,
    /// Number of the round since the start
    pub round: u64,
    /// Cycles of the boards since the round before, where their counters say so
    pub cycles: Option<u32>,
    /// Every configured gauge's counts, in the layout's order
    pub gauges: Vec<Signal>,
    /// Every configured gauge's temperature in degC, in the layout's order
    pub temperatures: Vec<Signal>,
    /// Every configured joint, in the layout's order
    pub joints: Vec<JointReading>,
    /// Whether no gauge and no joint position is absent
    pub complete: bool,
}

impl Clone for Snapshot {
    fn clone(&self) -> Self {
        let mut copy = Self::empty(self.gauges.len(), self.joints.len());
        copy.clone_from(self);
        copy
    }

    fn clone_from(&mut self, source: &Self) {
        let Self { instant_ns, last_stamp_ns, round, cycles, gauges, temperatures, joints, complete } =
            source;
        (self.instant_ns, self.last_stamp_ns, self.round) = (*instant_ns, *last_stamp_ns, *round);
        (self.cycles, self.complete) = (*cycles, *complete);
        self.gauges.clone_from(gauges);
        self.temperatures.clone_from(temperatures);
        self.joints.clone_from(joints);
    }
}

impl Snapshot {
    /// A snapshot in which nothing was ever seen, sized for so many gauges and joints
    pub fn empty(gauges: usize, joints: usize) -> Self {
        let absent = Err(Absence::NeverSeen);
        Self {
            instant_ns: 0,
            last_stamp_ns: 0,
            round: 0,
            cycles: None,
            gauges: vec![absent; gauges],
            temperatures: vec![Err(Absence::NotConfigured); gauges],
            joints: vec![JointReading { position: absent, velocity: Err(Absence::NotConfigured) }; joints],
            complete: false,
        }
    }
}
