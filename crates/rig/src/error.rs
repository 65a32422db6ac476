//! What can be wrong with a robot's files, each as one message: where, what, and what to do.

use std::io::Read as _;
use std::path::{Path, PathBuf};

/// Why a configuration, a run directory or a robot could not be used.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RigError {
    /// A file that cannot be read at all.
    #[error("{file}: cannot be read: {source}; {remedy}", file = .file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// What the operating system said.
        source: std::io::Error,
        /// What to do about it.
        remedy: String,
    },
    /// A value, key or line of a file that cannot be used.
    #[error("{file}{}: {problem}", line_suffix(*.line), file = .file.display())]
    Invalid {
        /// The file.
        file: PathBuf,
        /// Its line, counted from 1, where there is one to point at.
        line: Option<usize>,
        /// Fact, value and what to do.
        problem: String,
    },
    /// A URDF from which no chain can be made.
    #[error(transparent)]
    Urdf(#[from] model::urdf::UrdfError),
    /// A DBC, a log or signals that cannot be used.
    #[error(transparent)]
    Can(#[from] can::Error),
}

impl RigError {
    /// A problem of a whole file.
    pub fn of_file(file: &Path, problem: impl Into<String>) -> Self {
        Self::Invalid { file: file.to_owned(), line: None, problem: problem.into() }
    }

    /// A problem at one line (counted from 1) of a file.
    pub fn at_line(file: &Path, line: usize, problem: impl Into<String>) -> Self {
        Self::Invalid { file: file.to_owned(), line: Some(line), problem: problem.into() }
    }
}

fn line_suffix(line: Option<usize>) -> String {
    line.map(|line| format!(":{line}")).unwrap_or_default()
}

/// The text of a file; `what` says in two or three words what the file should be.
///
/// # Errors
/// The file cannot be read, with what to do about it.
pub fn read_text(file: &Path, what: &str) -> Result<String, RigError> {
    let bytes = read_bytes(file, what)?;
    String::from_utf8(bytes).map_err(|error| {
        let at = error.utf8_error().valid_up_to();
        let line = error.as_bytes().iter().take(at).filter(|byte| **byte == b'\n').count() + 1;
        RigError::at_line(file, line, format!("is not UTF-8 text; give {what}, saved as UTF-8"))
    })
}

/// No configuration, URDF, DBC or model is larger; a device such as /dev/zero never ends.
const MOST_BYTES: u64 = 64 << 20;

fn read_at_most(file: &Path, most: u64) -> std::io::Result<Vec<u8>> {
    let mut bytes = Vec::new();
    std::fs::File::open(file)?.take(most + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most {
        let text = format!("it is larger than {} MiB", most >> 20);
        return Err(std::io::Error::new(std::io::ErrorKind::FileTooLarge, text));
    }
    Ok(bytes)
}

/// The bytes of a file; `what` says in two or three words what the file should be.
///
/// # Errors
/// The file cannot be read, with what to do about it.
pub fn read_bytes(file: &Path, what: &str) -> Result<Vec<u8>, RigError> {
    read_at_most(file, MOST_BYTES).map_err(|source| {
        let remedy = match source.kind() {
            std::io::ErrorKind::NotFound => format!("give the path of {what}"),
            std::io::ErrorKind::FileTooLarge => format!("give {what}"),
            std::io::ErrorKind::IsADirectory => format!("give the path of {what}, not of its folder"),
            _ => format!("make {what} readable for this user"),
        };
        RigError::Read { file: file.to_owned(), source, remedy }
    })
}

/// The one of `known` that looks most like `wrong`, or nothing where none is near.
pub(crate) fn nearest<'a>(wrong: &str, known: impl IntoIterator<Item = &'a str>) -> Option<&'a str> {
    known
        .into_iter()
        .map(|name| (strsim::jaro_winkler(&wrong.to_lowercase(), &name.to_lowercase()), name))
        .filter(|(likeness, _)| *likeness > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, name)| name)
}

/// What to do about a name that is not among `known`: the nearest one, else the list of them.
pub fn suggest<'a>(wrong: &str, known: impl IntoIterator<Item = &'a str> + Clone) -> String {
    if let Some(name) = nearest(wrong, known.clone()) {
        return format!("did you mean \"{name}\"?");
    }
    let mut names: Vec<&str> = known.into_iter().collect();
    if names.is_empty() {
        return "there are none".to_owned();
    }
    let more = names.len().saturating_sub(12);
    names.truncate(12);
    let list = names.join(", ");
    if more > 0 { format!("known are {list} and {more} more") } else { format!("known are {list}") }
}
