//! Outputs that publish from inside the cycle; each is one file here and one line in `OPENERS`.
//!
//! Outputs that need not be on time, or that cannot promise not to wait, read a [`crate::feed::Feed`] instead.

#[cfg(target_os = "linux")]
mod can;

use rig::Config;

use crate::published::Published;

/// What became of the records that an output was given.
#[derive(Clone, Copy, PartialEq, Eq, Debug, Default)]
pub struct OutputCounts {
    /// Messages handed on.
    pub sent: u64,
    /// Messages dropped: the queue was full, or the interface down.
    pub dropped: u64,
}

/// Publishes records from the real-time cycle.
///
/// `publish` must not allocate, lock, log, or make a system call that can wait. What cannot be sent now is dropped and
/// counted: the next record is better than an old one.
pub trait Output: Send {
    /// Takes the next record.
    fn publish(&mut self, record: &Published);

    /// What became of all records so far.
    fn counts(&self) -> OutputCounts;
}

/// Opens an output if it is configured.
type Opener = fn(&Config) -> ::can::Result<Option<Box<dyn Output>>>;

/// Every real-time output.
#[cfg(target_os = "linux")]
const OPENERS: [Opener; 1] = [can::open];
#[cfg(not(target_os = "linux"))]
const OPENERS: [Opener; 0] = [];

/// All real-time outputs that a configuration asks for.
pub fn open(config: &Config) -> ::can::Result<Vec<Box<dyn Output>>> {
    OPENERS.iter().filter_map(|opener| opener(config).transpose()).collect()
}

/// Configured tables that this version does not serve, one line each.
pub fn not_served(config: &Config) -> Vec<String> {
    let publish = &config.publish;
    let tables = [
        ("[publish.rdt]", publish.rdt.is_some()),
        ("[publish.ros2]", publish.ros2.is_some()),
        ("[publish.metrics]", publish.metrics.is_some()),
        ("[control]", config.control.is_some()),
        ("[filter]", config.filter != rig::config::Filter::default()),
    ];
    let asked = tables.into_iter().filter(|(_, asked)| *asked);
    asked.map(|(table, _)| format!("{table} is configured, but this version does not serve it")).collect()
}
