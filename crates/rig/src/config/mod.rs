//! The configuration of one robot: which arm, which signals, which outputs.
//!
//! One TOML file, `format = 1`; paths in it are relative to it. [`Config::load`] reads and checks all that can be
//! checked without the other files; [`crate::Rig::load`] checks it against the URDF and the DBC.

mod check;
mod outputs;
mod values;

use std::path::{Path, PathBuf};

use serde::Deserialize;

pub use outputs::{
    Control, Filter, Publish, PublishCan, PublishMetrics, PublishMode, PublishRdt, PublishRos2,
    STANDARD_ID_MAX,
};
pub use values::{Inertia, Network, SignalName};

pub(crate) use values::three;

use crate::document::{self, Problem, Step};
use crate::error::{RigError, read_text};

/// One robot as its configuration file describes it, checked by itself.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The file it came from, as it was given; messages name it.
    #[serde(skip)]
    pub file: PathBuf,
    #[serde(rename = "format")]
    _format: u32,
    /// The arm.
    pub robot: Robot,
    /// Where the signals come from.
    pub bus: Bus,
    /// Where each movable joint's position comes from, in the file's order.
    #[serde(rename = "joint", default)]
    pub joints: Vec<JointEntry>,
    /// The strain gauges, in the file's order.
    #[serde(rename = "sensor", default)]
    pub sensors: Vec<SensorEntry>,
    /// What is mounted on the tip for good.
    pub tool: Option<Tool>,
    /// The calibrated model.
    pub model: Option<ModelFile>,
    /// What is published, and when.
    #[serde(default)]
    pub publish: Publish,
    /// The motion filter.
    #[serde(default)]
    pub filter: Filter,
    /// The control socket; off where absent.
    pub control: Option<Control>,
    #[serde(skip)]
    text: String,
}

/// The arm: URDF, the two ends of the chain, gravity.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Robot {
    /// The URDF file.
    pub urdf: PathBuf,
    /// Link that W, the base frame, is fixed to.
    pub base: String,
    /// Link whose frame is E, the tip frame.
    pub tip: String,
    /// Acceleration of gravity in W (m/s^2).
    #[serde(rename = "gravity", default = "standard_gravity", deserialize_with = "values::three")]
    pub gravity_m_s2: [f64; 3],
}

fn standard_gravity() -> [f64; 3] {
    [0.0, 0.0, -9.80665]
}

/// The DBC and the interfaces that its messages come from.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bus {
    /// The DBC file.
    pub dbc: PathBuf,
    /// CAN interfaces to listen to.
    pub interfaces: Vec<String>,
    /// Age beyond which a reading is not used (s).
    #[serde(default = "stale_after")]
    pub stale_after_s: f64,
    /// Age beyond which a temperature is not used (s).
    #[serde(default = "temperature_stale_after")]
    pub temperature_stale_after_s: f64,
}

fn stale_after() -> f64 {
    0.02
}

fn temperature_stale_after() -> f64 {
    5.0
}

/// Where one movable joint's position comes from.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct JointEntry {
    /// Name of the URDF joint.
    pub name: String,
    /// Its position.
    pub position: SignalName,
    /// Its velocity, where the bus carries it.
    pub velocity: Option<SignalName>,
    /// The interface that it comes from, one of the bus's; the first of them where absent.
    pub interface: Option<String>,
    /// Stamp minus sampling instant (s); absent = sampled together with the gauges.
    pub delay_s: Option<f64>,
}

/// One strain-gauge bridge.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SensorEntry {
    /// Its name, in the model, in reports and in messages.
    pub name: String,
    /// URDF joint whose section it sits in: it feels everything outboard.
    pub section: String,
    /// Its reading (counts).
    pub signal: SignalName,
    /// Axis it was meant to sense, in the child link's frame, any length; absent = the joint's (z for fixed joints).
    #[serde(default, deserialize_with = "values::maybe_three")]
    pub axis: Option<[f64; 3]>,
    /// Signal that is other than 0 while the amplifier is saturated.
    pub saturated: Option<SignalName>,
    /// Counter of its message's frames.
    pub sequence: Option<SignalName>,
    /// Its temperature.
    pub temperature: Option<SignalName>,
    /// The interface that it comes from, one of the bus's; the first of them where absent.
    pub interface: Option<String>,
    /// Stamp minus sampling instant (s); absent = all gauges were sampled at one instant.
    pub delay_s: Option<f64>,
}

/// What is mounted on the tip for good: part of the arm, subtracted from the wrench.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Tool {
    /// Mass (kg).
    #[serde(rename = "mass")]
    pub mass_kg: f64,
    /// Centre of mass in E (m).
    #[serde(rename = "com", deserialize_with = "values::three")]
    pub com_m: [f64; 3],
    /// Rotational inertia about the centre of mass, in E's axes; zero where absent.
    pub inertia: Option<Inertia>,
}

/// The calibrated model's place.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    /// The model file.
    pub path: PathBuf,
}

impl Config {
    /// The configuration in a file, checked by itself, its paths made relative to the caller's working directory.
    pub fn load(file: &Path) -> Result<Self, RigError> {
        Self::parse(file, &read_text(file, "a configuration (TOML)")?)
    }

    /// The configuration in `text`; `file` is what messages call it and what paths in it are relative to.
    pub fn parse(file: &Path, text: &str) -> Result<Self, RigError> {
        let mut config: Self = document::parse(file, text)?;
        check::check(&config).map_err(|problem| document::locate(file, text, problem))?;
        file.clone_into(&mut config.file);
        text.clone_into(&mut config.text);
        config.resolve_paths();
        Ok(config)
    }

    /// The files that describe the robot: this one, the URDF, the DBC. The model is not one of them: `calibrate` may write it.
    #[must_use]
    pub fn files(&self) -> Vec<PathBuf> {
        vec![self.file.clone(), self.robot.urdf.clone(), self.bus.dbc.clone()]
    }

    /// The file's text, as it was read.
    #[must_use]
    pub fn text(&self) -> &str {
        &self.text
    }

    /// An error about the value at the end of a way through the file.
    pub(crate) fn problem(&self, at: &[Step], text: String) -> RigError {
        document::locate(&self.file, &self.text, Problem::new(at, text))
    }

    fn resolve_paths(&mut self) {
        let folder = self.file.parent().unwrap_or(Path::new("")).to_owned();
        let paths = [&mut self.robot.urdf, &mut self.bus.dbc];
        let optional = self.model.as_mut().map(|model| &mut model.path);
        let socket = self.control.as_mut().map(|control| &mut control.socket);
        for path in paths.into_iter().chain(optional).chain(socket) {
            *path = folder.join(&*path);
        }
    }
}
