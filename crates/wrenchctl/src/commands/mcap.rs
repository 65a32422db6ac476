//! `wrenchctl mcap`: raw CAN and the wrench into one MCAP file, which Foxglove and PlotJuggler open.
//!
//! The frames go through the daemon's own cycle, live or from a recording, so the wrench is the one that the daemon publishes. Messages are
//! those of ROS 2 (CDR), with their definitions in the file: `can_msgs/Frame` for each interface, `geometry_msgs/WrenchStamped`,
//! `diagnostic_msgs/DiagnosticArray` whenever the status changes.

use std::collections::BTreeMap;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use ::mcap::records::MessageHeader;
use ::mcap::{McapError, WriteOptions, Writer};
use can::atomic::AtomicFile;
use can::frame::{Flags, Stamped};
use can::source::Event;
use rig::cycle::{Cycle, Estimate};
use rig::{ModelFile, Rig, Status};
use ros::{CanFrame, Diagnostic, DiagnosticArray, Level, Message, Stamp, WrenchStamped};

use crate::input::Input;
use crate::{Error, Outcome, output};

/// What to write.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Interface (can0, or can0,can1), candump log or run directory
    #[arg(value_name = "IFACE|LOG|RUN")]
    pub input: String,
    /// The robot's configuration
    #[arg(long, value_name = "CONFIG")]
    pub config: PathBuf,
    /// The calibrated model; overrides the configuration's
    #[arg(long, value_name = "MODEL")]
    pub model: Option<PathBuf>,
    /// The file to write; it appears when it is whole
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// End after this time, s [default: when interrupted; logs are read to their end]
    #[arg(long, value_name = "N", value_parser = super::seconds)]
    pub seconds: Option<Duration>,
}

/// A channel of the file and how many messages it has.
struct Channel {
    id: u16,
    messages: u32,
}

/// The file as it grows.
struct Recorder {
    file: Writer<BufWriter<AtomicFile>>,
    cans: BTreeMap<String, Channel>,
    wrench: Channel,
    diagnostics: Channel,
    frame_id: String,
    status: Option<Status>,
    /// Frames that no `can_msgs/Frame` holds: CAN FD.
    left_out: u64,
}

/// Writes until the end, the limit, or Ctrl-C.
pub fn run(args: Args) -> Result<Outcome, Error> {
    let rig = Rig::load_file(&args.config)?;
    let model = load_model(&args, &rig)?;
    let mut cycle = Cycle::new(&rig, &model)?;
    let mut input = Input::open(&args.input)?;
    let mut recorder = Recorder::new(AtomicFile::create(&args.out)?, rig.config.robot.tip.clone())
        .map_err(|error| broken(&args.out, &error))?;
    input.follow(args.seconds, |input, batch| {
        for event in batch {
            let (Event::Frame(stamped) | Event::BusError { stamped, .. }) = event else { continue };
            let mut written = recorder.frame(input.interface(stamped.interface), stamped);
            cycle.push(stamped, |estimate| {
                if written.is_ok() {
                    written = recorder.estimate(estimate);
                }
            });
            written.map_err(|error| broken(&args.out, &error))?;
        }
        Ok(true)
    })?;
    let said = recorder.finish(&args.out)?;
    let mut out = output::stdout();
    writeln!(out, "{}: {said}", args.out.display())?;
    out.flush()?;
    Ok(Outcome::Done)
}

fn load_model(args: &Args, rig: &Rig) -> Result<ModelFile, Error> {
    let configured = rig.config.model.as_ref().map(|model| &model.path);
    let file = args.model.as_ref().or(configured).ok_or_else(|| {
        Error::usage(format!(
            "{}: no model is configured; give --model, or calibrate first (`wrenchctl calibrate`)",
            args.config.display()
        ))
    })?;
    Ok(ModelFile::load(file, rig)?)
}

fn broken(file: &Path, error: &McapError) -> Error {
    Error::usage(format!("cannot write {}: {error}; nothing was left behind", file.display()))
}

/// What a message is called in a ROS 2 bag, with its definition.
fn channel<M: Message>(file: &mut Writer<BufWriter<AtomicFile>>, topic: &str) -> Result<Channel, McapError> {
    let schema = file.add_schema(M::NAME, "ros2msg", M::DEFINITION.as_bytes())?;
    let id = file.add_channel(schema, topic, "cdr", &BTreeMap::new())?;
    Ok(Channel { id, messages: 0 })
}

impl Recorder {
    fn new(file: AtomicFile, frame_id: String) -> Result<Self, McapError> {
        let library = concat!("wrenchctl ", env!("CARGO_PKG_VERSION"));
        let options = WriteOptions::new().compression(None).profile("ros2").library(library);
        let mut file = options.create(BufWriter::new(file))?;
        Ok(Self {
            wrench: channel::<WrenchStamped>(&mut file, "/wrench")?,
            diagnostics: channel::<DiagnosticArray>(&mut file, "/diagnostics")?,
            cans: BTreeMap::new(),
            file,
            frame_id,
            status: None,
            left_out: 0,
        })
    }

    fn frame(&mut self, interface: &str, stamped: &Stamped) -> Result<(), McapError> {
        let (frame, flags) = (&stamped.frame, stamped.frame.flags());
        let mut data = [0; 8];
        if flags.has(Flags::FD) || frame.data().len() > data.len() {
            self.left_out += 1;
            return Ok(());
        }
        data[..frame.data().len()].copy_from_slice(frame.data());
        let message = CanFrame {
            stamp: Stamp(stamped.stamp_ns),
            frame_id: interface.to_owned(),
            id: frame.id().number(),
            is_remote: flags.has(Flags::REMOTE),
            is_extended: frame.id().is_extended(),
            is_error: flags.has(Flags::ERROR),
            length: frame.len() as u8,
            data,
        };
        if !self.cans.contains_key(interface) {
            let new = channel::<CanFrame>(&mut self.file, &format!("/can/{interface}"))?;
            self.cans.insert(interface.to_owned(), new);
        }
        match self.cans.get_mut(interface) {
            Some(channel) => channel.write(&mut self.file, &message, stamped.stamp_ns, stamped.stamp_ns),
            None => Ok(()),
        }
    }

    /// An instant with a wrench, and its status where that is another than before.
    fn estimate(&mut self, estimate: &Estimate) -> Result<(), McapError> {
        let (at_ns, stamp) = (estimate.last_stamp_ns, Stamp(estimate.instant_ns));
        if let Ok(solution) = &estimate.outcome {
            let wrench = solution.wrench.to_vector().into();
            let message = WrenchStamped { stamp, frame_id: self.frame_id.clone(), wrench };
            self.wrench.write(&mut self.file, &message, at_ns, estimate.instant_ns)?;
        }
        if self.status.replace(estimate.status) == Some(estimate.status) {
            return Ok(());
        }
        let level = match &estimate.outcome {
            Err(_) => Level::Error,
            Ok(_) if estimate.status == Status::GOOD => Level::Ok,
            Ok(_) => Level::Warn,
        };
        let reason = estimate.outcome.err().map_or_else(String::new, |why| format!(": {why}"));
        let status = Diagnostic {
            level,
            name: "wrenchd: wrench".into(),
            message: format!("{}{reason}", estimate.status),
            hardware_id: String::new(),
            values: Vec::new(),
        };
        self.diagnostics.write(&mut self.file, &DiagnosticArray { stamp, status: vec![status] }, at_ns, at_ns)
    }

    /// Ends the file; what is in it.
    fn finish(mut self, out: &Path) -> Result<String, Error> {
        self.file.finish().map_err(|error| broken(out, &error))?;
        let failed = |error: std::io::IntoInnerError<_>| broken(out, &McapError::Io(error.into_error()));
        self.file.into_inner().into_inner().map_err(failed)?.commit()?;
        let frames: u64 = self.cans.values().map(|channel| u64::from(channel.messages)).sum();
        let beside = match self.left_out {
            0 => String::new(),
            n => format!(", {n} CAN FD frames left out (can_msgs/Frame holds none)"),
        };
        Ok(format!("{} wrenches, {frames} frames{beside}", self.wrench.messages))
    }
}

impl Channel {
    /// Adds a message, logged and published at these times (ns since the Unix epoch).
    fn write(
        &mut self,
        file: &mut Writer<BufWriter<AtomicFile>>,
        message: &impl Message,
        logged_ns: i64,
        published_ns: i64,
    ) -> Result<(), McapError> {
        let time = |ns: i64| u64::try_from(ns).unwrap_or(0);
        let header = MessageHeader {
            channel_id: self.id,
            sequence: self.messages,
            log_time: time(logged_ns),
            publish_time: time(published_ns),
        };
        self.messages = self.messages.wrapping_add(1);
        file.write_to_known_channel(&header, &message.cdr())
    }
}
