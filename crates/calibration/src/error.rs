//! What keeps a calibration or validation from an answer.

/// Why there is no calibration or validation.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A configuration, run or log that cannot be used.
    #[error(transparent)]
    Rig(#[from] rig::RigError),
    /// A log that cannot be read.
    #[error(transparent)]
    Can(#[from] can::Error),
    /// Data that can be read but not used.
    #[error("{what}: {problem}")]
    Data {
        /// The run, file or gauge.
        what: String,
        /// Fact, value and what to do.
        problem: String,
    },
}

impl Error {
    /// A problem of a run, file or gauge.
    pub(crate) fn data(what: impl std::fmt::Display, problem: impl Into<String>) -> Self {
        Self::Data { what: what.to_string(), problem: problem.into() }
    }
}
