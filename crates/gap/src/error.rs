//! What can be wrong with what is to be diagnosed, each as one message: where, what, and what to do.

use std::path::PathBuf;

/// Why there is nothing to diagnose.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A description, a URDF or a model that cannot be used.
    #[error(transparent)]
    Rig(#[from] rig::RigError),
    /// A table, or a line of it (counted from 1), that cannot be used.
    #[error("{}{}: {problem}", file.display(), line.map(|line| format!(":{line}")).unwrap_or_default())]
    Table {
        /// The table's file.
        file: PathBuf,
        /// Its line after decompression, counted from 1, where there is one to point at.
        line: Option<usize>,
        /// Fact, value and what to do.
        problem: String,
    },
    /// Runs that can be read but not diagnosed.
    #[error("{what}: {problem}")]
    Run {
        /// The run.
        what: String,
        /// Fact, value and what to do.
        problem: String,
    },
}

impl Error {
    /// A problem of a run.
    pub(crate) fn run(what: impl std::fmt::Display, problem: &str) -> Self {
        Self::Run { what: what.to_string(), problem: problem.to_owned() }
    }
}
