//! What a command comes to: done, "no", or one message that says what to do.

use std::io;
use std::path::PathBuf;

/// How a command ended.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
pub enum Outcome {
    /// Done (exit status 0).
    Done,
    /// The answer is "no": a check failed, a result is out of tolerance (exit status 1).
    No,
}

/// Unusable input or arguments (exit status 2).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A configuration, URDF, DBC, model or run directory.
    #[error(transparent)]
    Rig(#[from] rig::RigError),
    /// A log, an interface or a file that cannot be written.
    #[error(transparent)]
    Can(#[from] can::Error),
    /// A calibration or validation without an answer.
    #[error(transparent)]
    Calibration(#[from] calibration::Error),
    /// A comparison that cannot be diagnosed.
    #[error(transparent)]
    Gap(#[from] gap::Error),
    /// A simulation that cannot be made.
    #[error(transparent)]
    Sim(#[from] sim::SimError),
    /// Arguments that do not go together, or ask for what there is not: fact, value, what to do.
    #[error("{0}")]
    Usage(String),
    /// A folder that could not be made.
    #[error("cannot write {}: {source}; nothing was left behind", path.display())]
    Folder {
        /// The folder that was to be.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// Standard output that takes no more.
    #[error("cannot write to standard output: {0}; is the disk behind it full?")]
    Output(#[from] io::Error),
}

impl Error {
    /// A message of the program's own: fact, value, what to do.
    pub fn usage(text: impl Into<String>) -> Self {
        Self::Usage(text.into())
    }

    /// Whether the reader of standard output has gone, as `head` does.
    pub fn is_closed_output(&self) -> bool {
        matches!(self, Self::Output(source) if source.kind() == io::ErrorKind::BrokenPipe)
    }
}
