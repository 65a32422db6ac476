//! `wrenchctl mcap`: raw CAN and the wrench into one MCAP file, which Foxglove and PlotJuggler open.
//!
//! The frames go through the daemon's own cycle, live or from a recording, so the wrench is the one that the daemon publishes. Messages are
//! those of ROS 2 (CDR), with their definitions in the file: `can_msgs/Frame` and, where there are CAN FD frames,
//! `ros2_socketcan_msgs/FdFrame` for each interface, `geometry_msgs/WrenchStamped`, `diagnostic_msgs/DiagnosticArray` whenever the status changes.

use std::collections::BTreeMap;
use std::io::{self, BufWriter, StdoutLock, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use ::mcap::records::MessageHeader;
use ::mcap::write::NoSeek;
use ::mcap::{McapError, WriteOptions, Writer};
use can::atomic::AtomicFile;
use can::frame::{Flags, Stamped};
use can::source::Event;
use rig::cycle::{Cycle, Estimate};
use rig::{ModelFile, Rig, Status};
use ros::{CanFrame, Diagnostic, DiagnosticArray, FdFrame, Level, Message, Stamp, WrenchStamped};

use crate::input::{Input, log_of};
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
    /// The file to write, which appears when it is whole; - is standard output
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

/// Where the bytes go.
enum Sink {
    File(BufWriter<AtomicFile>),
    Stdout(BufWriter<StdoutLock<'static>>),
}

/// Written from its beginning to its end, as a pipe must be: what the format wants known ahead waits in memory, some 0.8 MB.
type File = Writer<NoSeek<Sink>>;

/// The file as it grows.
struct Recorder {
    file: File,
    /// By interface.
    cans: BTreeMap<String, Channel>,
    /// Those of CAN FD: no `can_msgs/Frame` holds them.
    fds: BTreeMap<String, Channel>,
    wrench: Channel,
    diagnostics: Channel,
    frame_id: String,
    status: Option<Status>,
}

/// Writes until the end, the limit, or Ctrl-C.
pub fn run(args: Args) -> Result<Outcome, Error> {
    let rig = Rig::load_file(&args.config)?;
    let model_file = model_file(&args, &rig)?;
    let mut read_from = rig.config.files();
    read_from.extend(log_of(&args.input)?.into_iter().chain([model_file.clone()]));
    output::refuse_to_overwrite([Some(&args.out)], &read_from)?;
    let model = ModelFile::load(&model_file, &rig)?;
    let mut cycle = Cycle::new(&rig, &model)?;
    let mut input = Input::open(&args.input)?;
    let to_stdout = args.out == Path::new("-");
    let sink = match to_stdout {
        true => Sink::Stdout(output::stdout()),
        false => Sink::File(BufWriter::new(AtomicFile::create(&args.out)?)),
    };
    let mut recorder =
        Recorder::new(sink, rig.config.robot.tip.clone()).map_err(|error| broken(&args.out, error))?;
    input.follow(args.seconds, |input, batch| {
        for event in batch {
            let (Event::Frame(stamped) | Event::BusError { stamped, .. }) = event else { continue };
            let mut written = recorder.frame(input.interface(stamped.interface), stamped);
            cycle.push(stamped, |estimate| {
                if written.is_ok() {
                    written = recorder.estimate(estimate);
                }
            });
            written.map_err(|error| broken(&args.out, error))?;
        }
        Ok(true)
    })?;
    let said = recorder.finish(&args.out)?;
    if to_stdout {
        output::note(format_args!("{said}"));
        return Ok(Outcome::Done);
    }
    let mut out = output::stdout();
    writeln!(out, "{}: {said}", args.out.display())?;
    out.flush()?;
    Ok(Outcome::Done)
}

fn model_file(args: &Args, rig: &Rig) -> Result<PathBuf, Error> {
    let configured = rig.config.model.as_ref().map(|model| &model.path);
    args.model.as_ref().or(configured).cloned().ok_or_else(|| {
        Error::usage(format!(
            "{}: no model is configured; give --model, or calibrate first (`wrenchctl calibrate`)",
            args.config.display()
        ))
    })
}

/// The system's reason, which the library's own words leave out.
fn broken(file: &Path, error: McapError) -> Error {
    let source = match error {
        McapError::Io(source) => source,
        other => io::Error::other(other),
    };
    match file == Path::new("-") {
        true => Error::Output(source),
        false => can::Error::Write { path: file.to_owned(), source }.into(),
    }
}

/// What a message is called in a ROS 2 bag, with its definition.
fn channel<M: Message>(file: &mut File, topic: &str) -> Result<Channel, McapError> {
    let schema = file.add_schema(M::NAME, "ros2msg", M::DEFINITION.as_bytes())?;
    let id = file.add_channel(schema, topic, "cdr", &BTreeMap::new())?;
    Ok(Channel { id, messages: 0 })
}

impl Recorder {
    fn new(sink: Sink, frame_id: String) -> Result<Self, McapError> {
        let library = concat!("wrenchctl ", env!("CARGO_PKG_VERSION"));
        let options = WriteOptions::new().compression(None).profile("ros2").library(library);
        let mut file = options.disable_seeking(true).create(NoSeek::new(sink))?;
        Ok(Self {
            wrench: channel::<WrenchStamped>(&mut file, "/wrench")?,
            diagnostics: channel::<DiagnosticArray>(&mut file, "/diagnostics")?,
            cans: BTreeMap::new(),
            fds: BTreeMap::new(),
            file,
            frame_id,
            status: None,
        })
    }

    fn frame(&mut self, interface: &str, stamped: &Stamped) -> Result<(), McapError> {
        let (frame, flags) = (&stamped.frame, stamped.frame.flags());
        let (stamp, frame_id) = (Stamp(stamped.stamp_ns), interface.to_owned());
        let (id, is_extended) = (frame.id().number(), frame.id().is_extended());
        let (is_error, length) = (flags.has(Flags::ERROR), frame.len() as u8);
        if flags.has(Flags::FD) {
            let data = frame.data().to_vec();
            let message = FdFrame { stamp, frame_id, id, is_extended, is_error, data };
            let topic = format!("/can/{interface}/fd");
            return raw(&mut self.file, &mut self.fds, (interface, &topic), &message, stamped.stamp_ns);
        }
        let mut data = [0; 8];
        for (to, from) in data.iter_mut().zip(frame.data()) {
            *to = *from;
        }
        let is_remote = flags.has(Flags::REMOTE);
        let message = CanFrame { stamp, frame_id, id, is_remote, is_extended, is_error, length, data };
        let topic = format!("/can/{interface}");
        raw(&mut self.file, &mut self.cans, (interface, &topic), &message, stamped.stamp_ns)
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
        self.file.finish().map_err(|error| broken(out, error))?;
        match self.file.into_inner().into_inner() {
            Sink::Stdout(mut stdout) => stdout.flush()?,
            Sink::File(file) => {
                let failed = |error: io::IntoInnerError<_>| broken(out, McapError::Io(error.into_error()));
                file.into_inner().map_err(failed)?.commit()?;
            }
        }
        let frames = [&self.cans, &self.fds]
            .map(|channels| channels.values().map(|channel| u64::from(channel.messages)).sum::<u64>());
        let beside = match frames[1] {
            0 => String::new(),
            n => format!(", {n} of them CAN FD"),
        };
        Ok(format!("{} wrenches, {} frames{beside}", self.wrench.messages, frames[0] + frames[1]))
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        match self {
            Self::File(file) => file.write(bytes),
            Self::Stdout(stdout) => stdout.write(bytes),
        }
    }

    fn flush(&mut self) -> io::Result<()> {
        match self {
            Self::File(file) => file.flush(),
            Self::Stdout(stdout) => stdout.flush(),
        }
    }
}

/// Adds a frame to its interface's channel, which begins with the first one.
fn raw<M: Message>(
    file: &mut File,
    channels: &mut BTreeMap<String, Channel>,
    (interface, topic): (&str, &str),
    message: &M,
    stamp_ns: i64,
) -> Result<(), McapError> {
    if !channels.contains_key(interface) {
        channels.insert(interface.to_owned(), channel::<M>(file, topic)?);
    }
    match channels.get_mut(interface) {
        Some(channel) => channel.write(file, message, stamp_ns, stamp_ns),
        None => Ok(()),
    }
}

impl Channel {
    /// Adds a message, logged and published at these times (ns since the Unix epoch).
    fn write(
        &mut self,
        file: &mut File,
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
