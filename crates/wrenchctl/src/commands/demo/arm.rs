//! The robot of the demo: the example arm of config/, built in, or a configuration of the user's.

use std::path::Path;

use rig::{Config, Rig};

use crate::Error;

const CONFIG: &str = include_str!("../../../../../config/arm.toml");
const URDF: &str = include_str!("../../../../../config/arm.urdf");
const DBC: &str = include_str!("../../../../../config/arm.dbc");

/// The robot of a configuration file, or the example arm where none is given.
pub(super) fn rig(config: Option<&Path>) -> Result<Rig, Error> {
    Ok(match config {
        Some(file) => Rig::load_file(file)?,
        None => {
            Rig::from_texts(Config::parse(Path::new("built-in arm.toml"), CONFIG)?, URDF, DBC.as_bytes())?
        }
    })
}

#[cfg(test)]
mod tests {
    #[test]
    fn the_built_in_arm_is_whole() {
        let rig = super::rig(None).unwrap();
        assert_eq!((rig.sections.len(), rig.chain.coordinates()), (8, 6));
    }
}
