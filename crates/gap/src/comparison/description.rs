//! `comparison.toml` as it is written.

use std::path::PathBuf;

use serde::Deserialize;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Description {
    #[serde(rename = "format")]
    _format: u32,
    pub(super) purpose: String,
    pub(super) table: PathBuf,
    pub(super) time: Option<String>,
    pub(super) recording: Option<String>,
    pub(super) hold_out: Option<Vec<String>>,
    pub(super) characteristic_length_m: Option<f64>,
    pub(super) robot: Option<Robot>,
    #[serde(default)]
    pub(super) covariates: Covariates,
    #[serde(default)]
    pub(super) joint: Vec<Joint>,
    #[serde(default)]
    pub(super) channel: Vec<Channel>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Robot {
    pub(super) urdf: PathBuf,
    pub(super) base: Option<String>,
    pub(super) tip: Option<String>,
    #[serde(default = "standard_gravity")]
    pub(super) gravity: [f64; 3],
}

fn standard_gravity() -> [f64; 3] {
    [0.0, 0.0, -9.80665]
}

#[derive(Deserialize, Default)]
#[serde(deny_unknown_fields)]
pub(super) struct Covariates {
    pub(super) temperature: Option<String>,
    #[serde(default)]
    pub(super) load: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Joint {
    pub(super) name: String,
    pub(super) position: String,
    pub(super) velocity: Option<String>,
    pub(super) acceleration: Option<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Channel {
    pub(super) name: String,
    pub(super) measured: String,
    pub(super) simulated: String,
    pub(super) unit: String,
    pub(super) joint: Option<String>,
    pub(super) noise: Option<f64>,
}
