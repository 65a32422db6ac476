//! `wrenchctl replay`: a recording onto a CAN interface, with its own timing.

use std::io::Write;
use std::sync::atomic::Ordering;
use std::thread;
use std::time::{Duration, Instant};

use crate::input::{log_of, open_log};
use crate::live::Sender;
use crate::{Error, Outcome, live, output};
use can::candump::{Interfaces, LogReader};
use can::frame::Frame;
use can::replay::{Clock, Pace, Replay};
use can::source::{Batch, Event, Poll, Source};

/// A frame that is sent so long after it was due counts as late, ns.
const LATE_NS: i64 = 1_000_000;

/// Most frames that are sent at a time.
const BATCH: usize = 256;

/// What to play, where.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Run directory or candump log (plain, gzip, zstd; - for standard input)
    #[arg(value_name = "RUN|LOG")]
    pub input: String,
    /// Interface to send on; it gets the frames of all interfaces of the log, unless --from names one
    #[arg(long, value_name = "IFACE")]
    pub onto: String,
    /// Only frames of this interface of the log; may be repeated [default: all]
    #[arg(long = "from", value_name = "IFACE")]
    pub from: Vec<String>,
    /// Recorded seconds per second, or max: as fast as the interface takes it
    #[arg(long, value_name = "X|max", default_value = "1", value_parser = pace)]
    pub speed: Pace,
    /// Frames due within this time of each other are sent together, none early, s
    #[arg(long, value_name = "S", default_value_t = 0.0002, value_parser = gather)]
    pub gather: f64,
}

fn pace(text: &str) -> Result<Pace, String> {
    if text == "max" {
        return Ok(Pace::Max);
    }
    let speed = text.parse::<f64>().ok().filter(|speed| *speed > 0.0 && speed.is_finite());
    speed.map(Pace::Speed).ok_or_else(|| "give a number above 0, such as 1 or 0.5, or max".into())
}

fn gather(text: &str) -> Result<f64, String> {
    let seconds = text.parse::<f64>().ok().filter(|seconds| (0.0..=1.0).contains(seconds));
    seconds.ok_or_else(|| "give seconds from 0 to 1, such as 0.0002".into())
}

/// The system's monotonic clock, which wakes up late on purpose so that neighbours go out together.
struct SystemClock {
    origin: Instant,
    gather: Duration,
}

impl SystemClock {
    fn elapsed_ns(&self) -> i64 {
        i64::try_from(self.origin.elapsed().as_nanos()).unwrap_or(i64::MAX)
    }
}

impl Clock for SystemClock {
    fn now_ns(&mut self) -> i64 {
        self.elapsed_ns()
    }

    fn sleep_until_ns(&mut self, until_ns: i64) {
        let until = Duration::from_nanos(until_ns.max(0).unsigned_abs()) + self.gather;
        thread::sleep(until.saturating_sub(self.origin.elapsed()));
    }
}

/// What was sent, and how well it kept its time.
#[derive(Default)]
struct Summary {
    sent: u64,
    error_frames: u64,
    other_interfaces: u64,
    malformed: u64,
    late: u64,
    latest_ns: i64,
    /// Time and stamp of the first frame, ns
    origin_ns: Option<(i64, i64)>,
    due_ns: i64,
}

/// Plays to the end, or until interrupted.
pub fn run(args: Args) -> Result<Outcome, Error> {
    let log = log_of(&args.input)?.ok_or_else(|| {
        Error::usage(format!("\"{}\" is no run directory and no log; give the path of one", args.input))
    })?;
    let (reader, bar) = open_log(&log, Interfaces::learned())?;
    let mut sender = Sender::open(&args.onto)?;
    let interrupted = live::interrupted();
    let gather = Duration::from_secs_f64(args.gather);
    let started = Instant::now();
    let mut replay = Replay::new(reader, args.speed, SystemClock { origin: started, gather });
    let mut summary = Summary::default();
    let mut batch = Batch::new(BATCH);
    let mut frames = Vec::with_capacity(BATCH);
    while !interrupted.load(Ordering::Relaxed) {
        match replay.poll(&mut batch, Duration::from_millis(200))? {
            Poll::End => break,
            Poll::Idle => continue,
            Poll::Ready => {}
        }
        frames.clear();
        let now_ns = i64::try_from(started.elapsed().as_nanos()).unwrap_or(i64::MAX);
        for event in &batch {
            if let Some(frame) = summary.take(event, replay.reader(), &args, now_ns) {
                frames.push(frame);
            }
        }
        sender.send(&frames)?;
        summary.sent += frames.len() as u64;
    }
    bar.finish_and_clear();
    summary.check(&args, replay.reader())?;
    summary.tell(&args, sender.waits, started.elapsed())
}

impl Summary {
    /// The frame to send for an event, if any.
    fn take(&mut self, event: &Event, reader: &LogReader, args: &Args, now_ns: i64) -> Option<Frame> {
        let stamped = match event {
            Event::Frame(stamped) => stamped,
            Event::BusError { .. } => {
                self.error_frames += 1;
                return None;
            }
            Event::Malformed { .. } => {
                self.malformed += 1;
                return None;
            }
            Event::Dropped { .. } | Event::Down { .. } | Event::Up { .. } => return None,
        };
        if let Pace::Speed(speed) = args.speed {
            let (clock_ns, stamp_ns) = *self.origin_ns.get_or_insert((now_ns, stamped.stamp_ns));
            let recorded_ns = stamped.stamp_ns.saturating_sub(stamp_ns) as f64;
            self.due_ns = self.due_ns.max(clock_ns.saturating_add((recorded_ns / speed) as i64));
            let late_ns = now_ns - self.due_ns;
            self.late += u64::from(late_ns > LATE_NS + (args.gather * 1e9) as i64);
            self.latest_ns = self.latest_ns.max(late_ns);
        }
        let name = reader.interfaces().name(stamped.interface);
        if !args.from.is_empty() && !args.from.iter().any(|from| from == name) {
            self.other_interfaces += 1;
            return None;
        }
        Some(stamped.frame)
    }

    /// Refuses a log from which nothing could be sent.
    fn check(&self, args: &Args, reader: &LogReader) -> Result<(), Error> {
        for from in &args.from {
            if reader.interfaces().find(from.as_bytes()).is_none() {
                let names = reader.interfaces().names().join(", ");
                return Err(Error::usage(format!(
                    "--from {from}: {} has no such interface; it has {names}",
                    args.input
                )));
            }
        }
        if self.sent == 0 && self.malformed > 0 {
            return Err(super::no_log(&args.input, self.malformed));
        }
        Ok(())
    }

    fn tell(&self, args: &Args, waits: u64, took: Duration) -> Result<Outcome, Error> {
        let mut out = output::stdout();
        write!(out, "{} frames sent onto {} in {:.3} s", self.sent, args.onto, took.as_secs_f64())?;
        if args.speed != Pace::Max {
            write!(
                out,
                ", {} late by more than 1 ms, the latest by {:.3} ms",
                self.late,
                self.latest_ns as f64 * 1e-6
            )?;
        }
        let others = [
            (waits, "waits for a full queue"),
            (self.error_frames, "error frames not sent"),
            (self.other_interfaces, "frames of other interfaces not sent"),
            (self.malformed, "malformed lines"),
        ];
        for (count, what) in others.into_iter().filter(|(count, _)| *count > 0) {
            write!(out, ", {count} {what}")?;
        }
        writeln!(out)?;
        out.flush()?;
        Ok(Outcome::Done)
    }
}
