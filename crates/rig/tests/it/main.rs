//! Configuration, binding and run directories: what is read, and what each bad input is told.

#![allow(clippy::unwrap_used)]

mod binding;
mod config;
mod examples;
mod model_file;
mod run;
mod wire;

extern crate wrenchd_rig as rig;

use std::path::{Path, PathBuf};

use rig::{Config, RigError};

/// The reference arm's configuration.
const ARM: &str = include_str!("../../../../config/arm.toml");
/// Its URDF.
const URDF: &str = include_str!("../../../../config/arm.urdf");
/// Its DBC.
const DBC: &str = include_str!("../../../../config/arm.dbc");

/// The folder of the example configurations.
fn examples() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config")
}

/// `text` with the one place where `from` stands replaced.
fn with(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "the text to change is gone: {from}");
    text.replacen(from, to, 1)
}

fn parse(text: &str) -> Result<Config, RigError> {
    Config::parse(Path::new("arm.toml"), text)
}

fn message<T: std::fmt::Debug>(result: Result<T, RigError>) -> String {
    result.unwrap_err().to_string()
}
