//! Everything that publishes; each output is one file here and one line in `OPENERS`.
//!
//! An output has a part inside the cycle, a part outside it, or both. What need not be on time, or cannot promise not to wait,
//! is a [`crate::network::Server`] that reads the feed; only what must leave at once is an [`Output`].

#[cfg(target_os = "linux")]
mod can;
#[cfg(target_os = "linux")]
mod metrics;
#[cfg(target_os = "linux")]
pub mod rdt;

use crate::published::Dispatch;

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
    /// Sends the next record.
    fn publish(&mut self, record: &Dispatch);

    /// Goes through all but the sending, so that this is in the processor's caches when the next record comes.
    fn rehearse(&mut self, _record: &Dispatch) {}

    /// What became of all records so far.
    fn counts(&self) -> OutputCounts;
}

#[cfg(target_os = "linux")]
pub use opening::OpenError;
#[cfg(target_os = "linux")]
pub(crate) use opening::{Opened, open};

#[cfg(target_os = "linux")]
mod opening {
    use rig::Config;

    use super::{Output, can, metrics, rdt};
    use crate::control::server as control;
    use crate::network::ports::{PortError, Ports};
    use crate::network::{Server, Shared};

    /// Why an output cannot be opened.
    #[derive(Debug, thiserror::Error)]
    #[non_exhaustive]
    pub enum OpenError {
        /// An interface.
        #[error(transparent)]
        Can(#[from] ::can::Error),
        /// An address.
        #[error(transparent)]
        Port(#[from] PortError),
    }

    /// What was opened for one table of the configuration; nothing where that is absent.
    #[derive(Default)]
    pub(crate) struct Opened {
        /// The part inside the cycle.
        pub(crate) output: Option<Box<dyn Output>>,
        /// The parts outside it.
        pub(crate) servers: Vec<Server>,
    }

    type Opener = fn(&Config, &Shared, &mut Ports) -> Result<Opened, OpenError>;

    /// Everything that a configuration can ask for.
    const OPENERS: [Opener; 4] = [
        |config, _, _| Ok(Opened { output: can::open(config)?, servers: Vec::new() }),
        |config, shared, ports| Ok(rdt::open(config, shared, ports)?),
        |config, shared, ports| Ok(metrics::open(config, shared, ports)?),
        |config, shared, ports| Ok(control::open(config, shared, ports)?),
    ];

    /// All that a configuration asks for: what runs inside the cycle, and what outside.
    pub(crate) type Parts = (Vec<Box<dyn Output>>, Vec<Server>);

    /// Opens all that a configuration asks for. On an error `ports` still has what was opened before it.
    pub(crate) fn open(config: &Config, shared: &Shared, ports: &mut Ports) -> Result<Parts, OpenError> {
        ports.begin();
        let (mut outputs, mut servers) = Parts::default();
        for opener in OPENERS {
            let opened = opener(config, shared, ports)?;
            outputs.extend(opened.output);
            servers.extend(opened.servers);
        }
        Ok((outputs, servers))
    }
}
