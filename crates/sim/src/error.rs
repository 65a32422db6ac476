//! What cannot be simulated or written, each as one message: where, what, and what to do.

use std::path::{Path, PathBuf};

/// Why there is no simulation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SimError {
    /// A file that cannot be read.
    #[error("{file}: cannot be read: {source}; give {what}", file = .file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
        /// What the file should be.
        what: &'static str,
    },
    /// A line of a motion file that cannot be used.
    #[error("{file}:{line}: {problem}", file = .file.display())]
    Row {
        /// The file.
        file: PathBuf,
        /// Its line, counted from 1.
        line: usize,
        /// Fact, value and what to do.
        problem: String,
    },
    /// A motion that the arm cannot make.
    #[error("joint \"{joint}\": {problem}")]
    Motion {
        /// The joint.
        joint: String,
        /// Fact, value and what to do.
        problem: String,
    },
    /// A gauge or a joint whose signal or truth cannot be simulated.
    #[error("{what}: {problem}")]
    Signal {
        /// The sensor, joint or interface.
        what: String,
        /// Fact, value and what to do.
        problem: String,
    },
    /// An option without meaning.
    #[error("{0}")]
    Option(String),
    /// Stopped before it was done.
    #[error("interrupted; nothing was left behind")]
    Interrupted,
    /// A directory that is there already.
    #[error("{dir} exists already; remove it, or give another name", dir = .dir.display())]
    Exists {
        /// The directory.
        dir: PathBuf,
    },
    /// A file or directory that cannot be written.
    #[error("{file}: cannot be written: {source}; nothing was left behind", file = .file.display())]
    Write {
        /// The file or directory.
        file: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
    },
    /// A configuration, URDF, DBC or run that cannot be used.
    #[error(transparent)]
    Rig(#[from] rig::RigError),
    /// A log that cannot be written.
    #[error(transparent)]
    Can(#[from] can::Error),
}

impl SimError {
    pub(crate) fn row(file: &Path, line: usize, problem: impl Into<String>) -> Self {
        Self::Row { file: file.to_owned(), line, problem: problem.into() }
    }

    pub(crate) fn motion(joint: &str, problem: impl Into<String>) -> Self {
        Self::Motion { joint: joint.to_owned(), problem: problem.into() }
    }

    pub(crate) fn signal(what: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Signal { what: what.into(), problem: problem.into() }
    }

    pub(crate) fn write(file: &Path, source: std::io::Error) -> Self {
        Self::Write { file: file.to_owned(), source }
    }
}
