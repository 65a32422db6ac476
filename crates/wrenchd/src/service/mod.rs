//! The daemon as a service: started from files, supervised by signals and the service manager.

mod clients;
pub mod load;
pub mod log;
mod notify;
mod supervise;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use crate::desk::desk;
use crate::feed::feed;
use crate::health::Health;
use crate::realtime;
use crate::recorder::{QUEUE_EVENTS, Recorder};
use crate::runner::{BoxedSource, Runner};
use crate::station::{Sinks, Station};
use clients::Clients;
use load::{Loaded, StartError};
use supervise::Supervisor;

/// Records kept for readers outside the cycle: one second at the usual rate.
const FEED_RECORDS: usize = 1024;

/// What the command line gives.
#[derive(Clone, Debug)]
pub struct Options {
    /// The configuration file.
    pub config: PathBuf,
    /// The model, where it is not the configuration's.
    pub model: Option<PathBuf>,
    /// Where to record everything received.
    pub record: Option<PathBuf>,
}

/// Runs the daemon until it is told to stop: 0; 1 if it failed on the way. What keeps it from starting is an error.
pub fn run(options: &Options) -> Result<ExitCode, StartError> {
    let loaded = Loaded::load(options)?;
    for warning in &loaded.rig.warnings {
        tracing::warn!("{warning}");
    }
    if loaded.rig.config.publish.ros2.is_some() {
        tracing::info!(
            "[publish.ros2] is served by a program of its own: `wrenchd-ros2 --config FILE`, beside this one"
        );
    }
    // Held to the end.
    let awake = realtime::no_deep_sleep();
    if let Err(refused) = &awake {
        tracing::info!("{refused}");
    }
    if let Err(refused) = realtime::lock_memory() {
        tracing::warn!("{refused}");
    }
    start(options, loaded, open_bus)?.run()
}

/// Where frames come from, and the recording of them.
type Bus = (BoxedSource, Option<Recorder>);

/// Opens the interfaces, and the recording where one is asked for.
fn open_bus(options: &Options, loaded: &Loaded) -> Result<Bus, StartError> {
    let (source, receive_buffer) = loaded.open_source(options.record.is_some())?;
    let bus: Bus = match &options.record {
        Some(path) => {
            let (tapped, copies) = can::tap::tap(source, QUEUE_EVENTS);
            let interfaces = &loaded.rig.config.bus.interfaces;
            let recorder = Recorder::start(path, interfaces, copies, &loaded.remark())?;
            if recorder.path() != path {
                let (kept, new) = (path.display(), recorder.path().display());
                tracing::warn!("{kept} is there already and is kept; recording into {new}");
            }
            (Box::new(tapped), Some(recorder))
        }
        None => (Box::new(source), None),
    };
    loaded.announce(receive_buffer);
    Ok(bus)
}

/// Opens the outputs and what clients come to, then the bus, and starts the cycle.
fn start(
    options: &Options,
    loaded: Loaded,
    bus: impl FnOnce(&Options, &Loaded) -> Result<Bus, StartError>,
) -> Result<Supervisor, StartError> {
    let health = Arc::new(Health::default());
    let (writer, feed) = feed(FEED_RECORDS);
    let (desk, inbox) = desk();
    let engine = loaded.engine()?;
    let mut clients = Clients::new(loaded.robot(&engine), feed, health.clone(), desk);
    let outputs = clients.open(&loaded.rig.config)?;
    let (source, recorder) = bus(options, &loaded)?;
    let sinks = Sinks::new(outputs, writer, health.clone());
    let station = Station::new(source, engine, loaded.rig.config.publish.rate_hz, sinks);
    let (runner, refused) = Runner::start(station, inbox).map_err(StartError::Thread)?;
    if let Some(refused) = refused {
        tracing::warn!("{refused}");
    }
    Ok(Supervisor { options: options.clone(), loaded, runner, recorder, health, clients })
}
