//! Directories of the tests' own beneath the build directory.

use crate::{Check, Failure, IoContext};
use std::fs;
use std::path::{Path, PathBuf};

/// The build directory that this executable was built into (wherever the user put it).
pub fn target_dir() -> Check<PathBuf> {
    let executable = std::env::current_exe()?;
    executable.ancestors().find(|dir| dir.join("CACHEDIR.TAG").is_file()).map(Path::to_owned).ok_or_else(
        || Failure::new(format!("{} does not lie in a cargo build directory", executable.display())),
    )
}

/// A directory for one run of the machine. It goes when the run ends well, and stays to be looked at when it does not.
pub(crate) struct Scratch {
    path: PathBuf,
    keep: bool,
}

impl Scratch {
    /// Creates the directory of this process, and removes those whose process is gone.
    pub(crate) fn new() -> Check<Self> {
        let parent = target_dir()?.join("can-machine");
        fs::create_dir_all(&parent).at("create", &parent)?;
        for entry in fs::read_dir(&parent).at("read", &parent)?.flatten() {
            let gone =
                entry.file_name().to_str().and_then(|name| name.parse::<u32>().ok()).is_some_and(|pid| {
                    pid == std::process::id() || !Path::new("/proc").join(pid.to_string()).exists()
                });
            if gone {
                let _ = fs::remove_dir_all(entry.path());
            }
        }
        let path = parent.join(std::process::id().to_string());
        fs::create_dir_all(&path).at("create", &path)?;
        Ok(Self { path, keep: false })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Leaves the directory where it is, until a later run finds this process gone.
    pub(crate) fn keep(&mut self) {
        self.keep = true;
    }
}

impl Drop for Scratch {
    fn drop(&mut self) {
        if !self.keep {
            let _ = fs::remove_dir_all(&self.path);
        }
    }
}
