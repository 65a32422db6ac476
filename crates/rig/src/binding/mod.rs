//! A configuration bound to its URDF and DBC: the arm's chain, the gauges' sections, the signals' places on the bus.

mod busload;
mod fingerprint;
mod signals;
mod units;

use std::path::Path;

use can::assembly::{Assembler, Layout};
use can::dbc::Dbc;
use model::chain::{Chain, Section};
use nalgebra::{Matrix3, Vector3};

pub use busload::{
    BitRates, Direction, FrameBits, PlannedLoad, PlannedMessage, classical_bits, fd_bits, planned_load,
};
pub use fingerprint::{Fingerprint, JointPrint, SensorPrint, sha256_hex, sha256_of};

use crate::config::Config;
use crate::document::Step::{Index, Key};
use crate::error::{RigError, read_bytes, read_text, suggest};

/// A robot as configured, checked against its URDF and DBC.
#[derive(Debug, Clone)]
pub struct Rig {
    /// The configuration.
    pub config: Config,
    /// The arm from base to tip, the tool part of its last body (SI; W and E as configured).
    pub chain: Chain,
    /// Where each gauge sits, in the configuration's order.
    pub sections: Vec<Section>,
    /// Which entry of `config.joints` belongs to each coordinate of the chain.
    pub joint_entries: Vec<usize>,
    /// The signals: gauges in the configuration's order, joints in the order of the chain's coordinates.
    pub layout: Layout,
    /// Every message that is read or written, with its expected rate.
    pub messages: Vec<PlannedMessage>,
    /// What can be used but should be known, one line each.
    pub warnings: Vec<String>,
    /// SHA-256 (hex) of the URDF file.
    pub urdf_sha256: String,
    /// SHA-256 (hex) of the DBC file.
    pub dbc_sha256: String,
    fingerprint: Fingerprint,
}

impl Rig {
    /// The robot of a configuration, its URDF and DBC read and checked.
    pub fn load(config: Config) -> Result<Self, RigError> {
        let urdf = read_text(&config.robot.urdf, "a URDF ([robot] urdf)")?;
        let dbc = read_bytes(&config.bus.dbc, "a DBC ([bus] dbc)")?;
        Self::from_texts(config, &urdf, &dbc)
    }

    /// The robot of a configuration file, its URDF and DBC read and checked.
    pub fn load_file(file: &Path) -> Result<Self, RigError> {
        Self::load(Config::load(file)?)
    }

    /// The robot of a configuration, a URDF's text and a DBC's bytes; the configured paths only name them in messages.
    ///
    /// A DBC that is not UTF-8 is taken as Latin-1, as older editors write it.
    pub fn from_texts(config: Config, urdf: &str, dbc: &[u8]) -> Result<Self, RigError> {
        let robot = &config.robot;
        let urdf_name = robot.urdf.display().to_string();
        let gravity = Vector3::from(robot.gravity_m_s2);
        let bare = Chain::from_urdf(urdf, &urdf_name, &robot.base, &robot.tip, gravity)?;
        let joint_entries = match_joints(&config, &bare)?;
        let sections = find_sections(&config, &bare)?;
        let parsed = Dbc::parse(&latin1_or_utf8(dbc), &config.bus.dbc.display().to_string())?;
        let (layout, messages) = signals::bind(&config, &parsed, &joint_entries)?;
        Assembler::new(&layout)?;
        let fingerprint = Fingerprint::new(&config, &bare, &sections, &layout);
        let chain = match &config.tool {
            Some(tool) => {
                let inertia = tool.inertia.unwrap_or_default().rows_kg_m2;
                let inertia = Matrix3::from_fn(|row, column| inertia[row][column]);
                bare.with_tool(tool.mass_kg, Vector3::from(tool.com_m), inertia)
            }
            None => bare,
        };
        Ok(Self {
            warnings: chain.warnings.clone(),
            urdf_sha256: sha256_hex(urdf.as_bytes()),
            dbc_sha256: sha256_hex(dbc),
            config,
            chain,
            sections,
            joint_entries,
            layout,
            messages,
            fingerprint,
        })
    }

    /// What a calibrated model depends on.
    #[must_use]
    pub fn fingerprint(&self) -> &Fingerprint {
        &self.fingerprint
    }

    /// Refuses the model in `file` if it was made for another arm, naming the first difference.
    pub fn check_model(&self, file: &Path, calibrated: &Fingerprint) -> Result<(), RigError> {
        let Some(difference) = self.fingerprint.difference(calibrated) else { return Ok(()) };
        let config = self.config.file.display();
        let problem = format!(
            "is the model of another arm than {config} describes: {difference}; calibrate this arm, or give its own model"
        );
        Err(RigError::of_file(file, problem))
    }

    /// How full the configured messages make each bus at these bit rates.
    #[must_use]
    pub fn planned_load(&self, rates: BitRates) -> Vec<PlannedLoad> {
        planned_load(&self.messages, rates)
    }
}

fn latin1_or_utf8(bytes: &[u8]) -> String {
    match std::str::from_utf8(bytes) {
        Ok(text) => text.to_owned(),
        Err(_) => bytes.iter().map(|byte| char::from(*byte)).collect(),
    }
}

/// Which [[joint]] belongs to each coordinate.
fn match_joints(config: &Config, chain: &Chain) -> Result<Vec<usize>, RigError> {
    let movable = chain.coordinate_names();
    for (index, entry) in config.joints.iter().enumerate() {
        if movable.contains(&entry.name.as_str()) {
            continue;
        }
        let at = [Key("joint"), Index(index), Key("name")];
        let name = &entry.name;
        let between = format!("between \"{}\" and \"{}\"", chain.base, chain.tip);
        let text = if chain.joint_index(name).is_some() {
            format!(
                "[[joint]] \"{name}\" is a fixed joint of {}; remove the table: only movable joints have a position",
                chain.file_name
            )
        } else if chain.other_joints.contains(name) {
            format!(
                "[[joint]] \"{name}\" is a joint of {} but not {between}; remove the table",
                chain.file_name
            )
        } else {
            let hint = suggest(name, movable.iter().copied());
            format!("[[joint]] \"{name}\" is no movable joint {between} in {}; {hint}", chain.file_name)
        };
        return Err(config.problem(&at, text));
    }
    let entry_of = |name: &str| {
        config.joints.iter().position(|entry| entry.name == name).ok_or_else(|| {
            let text = format!(
                "the movable joint \"{name}\" of {} has no [[joint]] table; add one with its position signal",
                chain.file_name
            );
            config.problem(&[Key("joint")], text)
        })
    };
    movable.into_iter().map(entry_of).collect()
}

fn find_sections(config: &Config, chain: &Chain) -> Result<Vec<Section>, RigError> {
    let find = |(index, sensor): (usize, &crate::config::SensorEntry)| {
        Section::new(chain, &sensor.section, sensor.axis).map_err(|error| {
            let at = [Key("sensor"), Index(index), Key("section")];
            config.problem(&at, format!("[[sensor]] \"{}\": {error}", sensor.name))
        })
    };
    config.sensors.iter().enumerate().map(find).collect()
}
