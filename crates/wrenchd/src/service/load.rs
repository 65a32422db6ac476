//! From the command line to a robot with its model, each refusal one message.

use std::path::PathBuf;

use can::frame::CanId;
use can::socket::{SocketOptions, SocketSource};
use rig::binding::{Direction, sha256_hex};
use rig::config::PublishMode;
use rig::{ModelFile, Rig, RigError};

use super::Options;
use crate::engine::Engine;
use crate::merge::Merge;
use crate::network::Robot;
use crate::output::OpenError;
use crate::station::EVENTS_PER_TURN;

/// Why the daemon cannot start, or a reload not be done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum StartError {
    /// Configuration, URDF, DBC or model.
    #[error(transparent)]
    Rig(#[from] RigError),
    /// An interface, or the file to record into.
    #[error(transparent)]
    Can(#[from] can::Error),
    /// Neither the configuration nor the command line names a model.
    #[error(
        "{}: names no model, and --model is not given; make one with `wrenchctl calibrate RUN... --out model.toml`, then \
         give --model model.toml or set path in [model]",
        config.display()
    )]
    NoModel {
        /// The configuration file.
        config: PathBuf,
    },
    /// An output, or a socket that clients come to.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// A reload that would need another recording.
    #[error(
        "{}: [bus] interfaces changed while --record is writing a log of the old ones; restart the daemon instead",
        config.display()
    )]
    Recording {
        /// The configuration file.
        config: PathBuf,
    },
    /// The system refuses a thread.
    #[error("cannot start the cycle's thread: {0}; is the limit on threads or memory reached?")]
    Thread(#[source] std::io::Error),
    /// The system refuses signals or timers.
    #[error("cannot watch signals: {0}")]
    Signals(#[source] std::io::Error),
}

/// A robot and its model, checked against each other.
#[derive(Debug)]
pub struct Loaded {
    /// The robot.
    pub rig: Rig,
    /// Its model.
    pub model: ModelFile,
    /// Where the model came from.
    pub model_file: PathBuf,
    /// SHA-256 (hex) of the model's text.
    pub model_sha256: String,
}

impl Loaded {
    /// Reads and checks all files.
    pub fn load(options: &Options) -> Result<Self, StartError> {
        let rig = Rig::load_file(&options.config)?;
        let configured = rig.config.model.as_ref().map(|model| model.path.clone());
        let model_file = options
            .model
            .clone()
            .or(configured)
            .ok_or_else(|| StartError::NoModel { config: options.config.clone() })?;
        // Read once: the hash is of what runs, whoever writes the file meanwhile.
        let text = ModelFile::text(&model_file)?;
        let model = ModelFile::of_robot(&model_file, &text, &rig)?;
        let model_sha256 = sha256_hex(text.as_bytes());
        Ok(Self { rig, model, model_file, model_sha256 })
    }

    /// A new engine.
    pub fn engine(&self) -> Result<Engine, StartError> {
        Ok(Engine::new(&self.rig, &self.model)?)
    }

    /// What clients may know of it, with the engine that runs it.
    pub(super) fn robot(&self, engine: &Engine) -> Robot {
        let config = &self.rig.config;
        Robot {
            config: config.file.display().to_string(),
            model: self.model_file.display().to_string(),
            model_sha256: self.model_sha256.clone(),
            mode: mode_name(config.publish.mode),
            rate_hz: config.publish.rate_hz,
            gauges: config.sensors.iter().map(|sensor| sensor.name.clone()).collect(),
            board: engine.board().clone(),
        }
    }

    /// Opens the interfaces; with the smallest receive buffer that the kernel gave, in bytes. Unless everything is to be
    /// recorded, the kernel passes on only the messages that are read.
    pub fn open_source(&self, everything: bool) -> Result<(Merge<SocketSource>, usize), StartError> {
        let interfaces = &self.rig.config.bus.interfaces;
        let options: Vec<(&str, SocketOptions)> = interfaces
            .iter()
            .map(|name| {
                let filters = (!everything).then(|| self.messages_of(name));
                (name.as_str(), SocketOptions { filters, ..SocketOptions::default() })
            })
            .collect();
        let source = SocketSource::open(&options)?;
        let receive_buffer = source.receive_buffer();
        Ok((Merge::new(source, interfaces.len(), EVENTS_PER_TURN), receive_buffer))
    }

    fn messages_of(&self, interface: &str) -> Vec<CanId> {
        let read =
            |m: &&rig::binding::PlannedMessage| m.direction == Direction::In && m.interface == interface;
        self.rig.messages.iter().filter(read).map(|message| message.id).collect()
    }

    /// One line that says what a recording belongs to.
    pub fn remark(&self) -> String {
        format!(
            "wrenchd {}: {}, model {} (sha256 {})",
            env!("CARGO_PKG_VERSION"),
            self.rig.config.file.display(),
            self.model_file.display(),
            self.model_sha256
        )
    }

    /// Logs what runs.
    pub fn announce(&self, receive_buffer: usize) {
        let config = &self.rig.config;
        let output = config.publish.can.as_ref().map_or("none", |can| can.interface.as_str());
        tracing::info!(
            version = env!("CARGO_PKG_VERSION"),
            config = %config.file.display(),
            model = %self.model_file.display(),
            model_sha256 = self.model_sha256,
            calibrated = self.model.provenance.date,
            gauges = self.rig.sections.len(),
            joints = self.rig.joint_entries.len(),
            interfaces = config.bus.interfaces.join(","),
            receive_buffer,
            output,
            mode = mode_name(config.publish.mode),
            rate_hz = config.publish.rate_hz,
            "running"
        );
        let asked = SocketOptions::default().receive_buffer;
        if receive_buffer < asked {
            let frames = receive_buffer / BYTES_PER_FRAME;
            tracing::warn!(
                "the kernel gave a receive buffer of {receive_buffer} bytes (some {frames} frames), not {asked}: a burst \
                 may be lost; raise net.core.rmem_max (systemd/60-wrenchd.conf does)"
            );
        }
    }
}

/// Kernel memory of one waiting classical frame.
const BYTES_PER_FRAME: usize = 770;

/// A mode as the configuration writes it.
pub(super) fn mode_name(mode: PublishMode) -> &'static str {
    match mode {
        PublishMode::Fixed => "fixed",
        PublishMode::Event => "event",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;
    use std::sync::mpsc::channel;
    use std::time::Duration;

    /// A pipe gives its text once.
    #[test]
    fn the_model_is_read_once_and_its_hash_is_of_what_was_read() {
        let folder = tempfile::tempdir().unwrap();
        let mut options = super::super::tests::files(folder.path(), "");
        let (file, pipe) = (folder.path().join("model.toml"), folder.path().join("pipe.toml"));
        assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        options.model = Some(pipe.clone());
        let (tell, told) = channel();
        std::thread::spawn(move || tell.send(Loaded::load(&options).unwrap().model_sha256));
        let text = std::fs::read(file).unwrap();
        std::fs::write(pipe, &text).unwrap();
        let hash = told.recv_timeout(Duration::from_secs(20)).expect("it waits for a second text");
        assert_eq!(hash, sha256_hex(&text));
    }
}
