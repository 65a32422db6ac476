//! Run directories in the making: all their files under another name first, so that nothing half-written remains.

use std::fs;
use std::path::{Path, PathBuf};

use rig::Config;
use toml_edit::{DocumentMut, value};

use crate::Error;

/// A run directory that appears under its name at [`NewRun::finish`]; dropped before that, nothing is left of it.
#[derive(Debug)]
pub struct NewRun {
    temporary: PathBuf,
    target: PathBuf,
    finished: bool,
}

impl NewRun {
    /// Begins a directory where there is none yet (or an empty one).
    pub fn begin(target: &Path) -> Result<Self, Error> {
        let occupied = match fs::read_dir(target) {
            Ok(mut entries) => entries.next().is_some(),
            Err(_) => target.exists(),
        };
        if occupied {
            return Err(Error::usage(format!(
                "{} exists already; give a new name, or remove it",
                target.display()
            )));
        }
        if target.file_name().is_none() {
            let text = format!("\"{}\" is no name of a folder; give one for the run", target.display());
            return Err(Error::usage(text));
        }
        let temporary = can::atomic::folder_beside(target)
            .map_err(|source| Error::Folder { path: target.to_owned(), source })?;
        Ok(Self { temporary, target: target.to_owned(), finished: false })
    }

    /// Where a file of the run is until it is finished.
    pub fn path(&self, name: &str) -> PathBuf {
        self.temporary.join(name)
    }

    /// Copies configuration, URDF and DBC, the configuration's paths changed to the copies.
    pub fn copy_config(&self, config: &Config) -> Result<(), Error> {
        let urdf = self.copy(&config.robot.urdf, "arm.urdf")?;
        let dbc = self.copy(&config.bus.dbc, "arm.dbc")?;
        let text = with_paths(config, &urdf, &dbc)?;
        Ok(can::atomic::write(&self.path(CONFIG), text.as_bytes())?)
    }

    fn copy(&self, from: &Path, otherwise: &str) -> Result<String, Error> {
        let name = from.file_name().and_then(|name| name.to_str()).unwrap_or(otherwise).to_owned();
        let bytes = fs::read(from).map_err(|source| can::Error::Open { path: from.to_owned(), source })?;
        can::atomic::write(&self.path(&name), &bytes)?;
        Ok(name)
    }

    /// Gives the directory its name.
    pub fn finish(mut self) -> Result<(), Error> {
        fs::rename(&self.temporary, &self.target)
            .map_err(|source| Error::Folder { path: self.target.clone(), source })?;
        self.finished = true;
        Ok(())
    }
}

impl Drop for NewRun {
    fn drop(&mut self) {
        if !self.finished {
            let _ = fs::remove_dir_all(&self.temporary);
        }
    }
}

/// Name of the configuration's copy.
const CONFIG: &str = "config.toml";

/// Text of run.toml up to what a person adds.
pub fn description(log: &str, purpose: &str, session: Option<&str>) -> String {
    let session = session.map_or_else(String::new, |name| format!("session = {}\n", value(name)));
    format!("format = 1\nconfig = \"{CONFIG}\"\nlog = \"{log}\"\npurpose = \"{purpose}\"\n{session}")
}

/// The configuration's text with other paths; the model stays behind, the run is judged with whichever is given.
fn with_paths(config: &Config, urdf: &str, dbc: &str) -> Result<String, Error> {
    let mut document: DocumentMut =
        config.text().parse().map_err(|error| Error::usage(format!("{}: {error}", config.file.display())))?;
    document["robot"]["urdf"] = value(urdf);
    document["bus"]["dbc"] = value(dbc);
    document.remove("model");
    Ok(document.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/arm.toml");

    #[test]
    fn a_run_is_whole_or_not_there() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("run");
        let config = Config::load(Path::new(CONFIG)).unwrap();
        let dropped = NewRun::begin(&target).unwrap();
        dropped.copy_config(&config).unwrap();
        drop(dropped);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
        let run = NewRun::begin(&target).unwrap();
        run.copy_config(&config).unwrap();
        assert!(!target.exists());
        run.finish().unwrap();
        let copied = rig::Rig::load_file(&target.join("config.toml")).unwrap();
        assert_eq!(copied.config.robot.urdf, target.join("arm.urdf"));
        let message = NewRun::begin(&target).unwrap_err().to_string();
        assert!(message.contains("exists already"), "{message}");
    }

    #[test]
    fn a_missing_folder_is_named() {
        let message = NewRun::begin(Path::new("/nowhere/at/all")).unwrap_err().to_string();
        assert!(message.contains("/nowhere/at/all"), "{message}");
    }

    #[test]
    fn session_names_are_quoted() {
        assert!(description("can.log", "evaluation", Some("a \"b\"")).contains("session = 'a \"b\"'"));
    }
}
