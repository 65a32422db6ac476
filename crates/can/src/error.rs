//! What can be wrong with files, bindings and interfaces, said with what to do

use std::path::PathBuf;

/// Anything unusable that this crate was given
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Text that is no DBC
    #[error("{file}:{line}: not a DBC: {why}; correct this line or export the file again")]
    DbcSyntax {
        /// The file as named by the caller
        file: String,
        /// Line number from 1
        line: usize,
        /// What was found
        why: String,
    },
    /// A message or signal in a DBC that cannot exist on a CAN bus
    #[error("{file}: {what}: {why}")]
    DbcContent {
        /// The file as named by the caller
        file: String,
        /// Message or signal
        what: String,
        /// What is wrong, and what to do
        why: String,
    },
    /// A signal that the DBC lacks
    #[error("{file}: no signal {name:?}; {hint}")]
    UnknownSignal {
        /// The file as named by the caller
        file: String,
        /// What was asked for
        name: String,
        /// The nearest name, or how names are written
        hint: String,
    },
    /// Bindings that contradict each other
    #[error("{what}: {why}")]
    Binding {
        /// The signal or gauge
        what: String,
        /// What is wrong, and what to do
        why: String,
    },
    /// A file that cannot be opened
    #[error("cannot open {}: {source}; check the path and its permissions", path.display())]
    Open {
        /// The file
        path: PathBuf,
        /// The system's reason
        source: std::io::Error,
    },
    /// A file that could be opened but not read to its end
    #[error("cannot read {} beyond line {line}: {source}", path.display())]
    Read {
        /// The file
        path: PathBuf,
        /// Last whole line
        line: u64,
        /// The system's or decompressor's reason
        source: std::io::Error,
    },
    /// A compressed log that ends early or is damaged
    #[error("{}: the {kind} data is cut off or damaged after {bytes} bytes of text (line {line}): {why}; copy the file again, or unpack what is whole and use that", path.display())]
    Truncated {
        /// The file
        path: PathBuf,
        /// gzip or zstd
        kind: &'static str,
        /// Uncompressed bytes that were read
        bytes: u64,
        /// Last whole line
        line: u64,
        /// The decompressor's reason
        why: String,
    },
    /// A file that could not be written; nothing is left of it
    #[error("cannot write {}: {source}; nothing was left behind, what was there before is unchanged", path.display())]
    Write {
        /// The file that was to be
        path: PathBuf,
        /// The system's reason
        source: std::io::Error,
    },
    /// A CAN interface that this machine has not
    #[error(
        "no CAN interface {interface:?} on this machine; `ip link show type can` lists those there are; for a virtual one: `ip link add dev {interface} type vcan && ip link set up {interface}`"
    )]
    NoInterface {
        /// Its configured name
        interface: String,
    },
    /// A socket operation that the system refused
    #[error("{interface}: {what}: {source}{}", hint.map(|hint| format!("; {hint}")).unwrap_or_default())]
    Socket {
        /// Interface name
        interface: String,
        /// What was tried
        what: &'static str,
        /// The system's reason
        source: std::io::Error,
        /// What to do, where it is known
        hint: Option<&'static str>,
    },
}

/// Result with this crate's [`Error`]
pub type Result<T> = std::result::Result<T, Error>;
