//! What several tests of the simulator need.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used)]

use std::path::{Path, PathBuf};

use can::assembly::{Assembler, Snapshot};
use can::frame::Stamped;
use rig::Rig;

pub fn config_file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config").join(name)
}

pub fn rig(name: &str) -> Rig {
    Rig::load_file(&config_file(name)).unwrap()
}

/// A robot of the repository's URDF with another configuration and DBC.
pub fn rig_of(config: &str, dbc: &str) -> Rig {
    let config = rig::Config::parse(Path::new("test.toml"), config).unwrap();
    let urdf = std::fs::read_to_string(config_file("arm.urdf")).unwrap();
    Rig::from_texts(config, &urdf, dbc.as_bytes()).unwrap()
}

/// The text of a file in config/ with replacements, each of which must apply.
pub fn edited(name: &str, changes: &[(&str, &str)]) -> String {
    let mut text = std::fs::read_to_string(config_file(name)).unwrap();
    for (old, new) in changes {
        assert!(text.contains(old), "{old}");
        text = text.replace(old, new);
    }
    text
}

pub fn snapshots(rig: &Rig, frames: impl Iterator<Item = Stamped>) -> (Vec<Snapshot>, Assembler) {
    let mut assembler = Assembler::new(&rig.layout).unwrap();
    let mut all = Vec::new();
    for frame in frames {
        all.extend_from_slice(assembler.push(&frame));
    }
    (all, assembler)
}
