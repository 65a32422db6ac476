//! `wrenchctl record`: live interfaces into a run directory, whole or not at all.

use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

use can::candump::{LogWriter, StampDigits};
use can::source::{Batch, Event, Source};
use rig::Rig;

use crate::run_dir::{self, NewRun};
use crate::{Error, Outcome, live, output};

/// How long one poll waits, so that Ctrl-C and the time limit are noticed.
const PATIENCE: Duration = Duration::from_millis(100);

/// What to record.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Configuration of the robot: the interfaces of its bus are recorded, everything that they carry
    #[arg(long, value_name = "CONFIG")]
    pub config: PathBuf,
    /// Run directory to make; it must not exist yet
    #[arg(long, value_name = "RUN")]
    pub out: PathBuf,
    /// Record for this time, s [default: until interrupted]
    #[arg(long, value_name = "N", value_parser = super::seconds)]
    pub seconds: Option<Duration>,
    /// What the recording is for
    #[arg(long, value_enum, default_value_t = Purpose::Evaluation)]
    pub purpose: Purpose,
    /// Name that runs with the same gauge zeros share [default: a session of its own]
    #[arg(long, value_name = "NAME")]
    pub session: Option<String>,
}

/// What a recording is for.
#[derive(clap::ValueEnum, Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// To find the gauges' compliances
    Calibration,
    /// To see how good the wrench is
    Evaluation,
}

impl Purpose {
    /// As run.toml has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Calibration => "calibration",
            Self::Evaluation => "evaluation",
        }
    }
}

#[derive(Default)]
struct Tally {
    frames: u64,
    errors: u64,
    dropped: u64,
    first_ns: Option<i64>,
    last_ns: i64,
}

/// Records until the time is over or Ctrl-C.
pub fn run(args: Args) -> Result<Outcome, Error> {
    let rig = Rig::load_file(&args.config)?;
    let interfaces = &rig.config.bus.interfaces;
    let run = NewRun::begin(&args.out)?;
    let mut source = live::open(interfaces)?;
    run.copy_config(&rig.config)?;
    let mut log = LogWriter::create(&run.path("can.log.gz"), interfaces, StampDigits::Micros)?;
    let interrupted = live::interrupted();
    let tally =
        record(&mut source, &mut log, interfaces, args.seconds, || interrupted.load(Ordering::Relaxed))?;
    log.finish()?;
    let Some(first_ns) = tally.first_ns else {
        return Err(Error::usage(format!(
            "no frame came on {}; is it up, and do the boards send? nothing was recorded",
            interfaces.join(", ")
        )));
    };
    let duration_s = (tally.last_ns - first_ns) as f64 * 1e-9;
    can::atomic::write(&run.path("run.toml"), description(&args, duration_s).as_bytes())?;
    run.finish()?;
    let mut out = output::stdout();
    writeln!(
        out,
        "{}: {} frames in {duration_s:.3} s, {} error frames, {} dropped; note loads and exclusions in its run.toml",
        args.out.display(),
        tally.frames,
        tally.errors,
        tally.dropped
    )?;
    out.flush()?;
    Ok(Outcome::Done)
}

fn record(
    source: &mut dyn Source,
    log: &mut LogWriter,
    interfaces: &[String],
    limit: Option<Duration>,
    stop: impl Fn() -> bool,
) -> Result<Tally, Error> {
    let mut tally = Tally::default();
    let mut batch = Batch::new(512);
    let started = Instant::now();
    while !stop() && limit.is_none_or(|limit| started.elapsed() < limit) {
        source.poll(&mut batch, PATIENCE)?;
        for event in &batch {
            let name = |index: u8| interfaces.get(usize::from(index)).map_or("?", String::as_str);
            match event {
                Event::Frame(stamped) | Event::BusError { stamped, .. } => {
                    log.frame(stamped)?;
                    let error = matches!(event, Event::BusError { .. });
                    tally.errors += u64::from(error);
                    tally.frames += u64::from(!error);
                    tally.first_ns.get_or_insert(stamped.stamp_ns);
                    tally.last_ns = stamped.stamp_ns;
                }
                Event::Dropped { interface, count } => {
                    log.dropped(*interface, *count)?;
                    tally.dropped += u64::from(*count);
                }
                Event::Down { interface } => log.remark(&format!("{} went down", name(*interface)))?,
                Event::Up { interface } => log.remark(&format!("{} is up again", name(*interface)))?,
                Event::Malformed { .. } => {}
            }
        }
    }
    Ok(tally)
}

/// Text of run.toml.
fn description(args: &Args, duration_s: f64) -> String {
    let mut text = run_dir::description("can.log.gz", args.purpose.name(), args.session.as_deref());
    text.push_str(&format!(
        "\n# The log lasts {duration_s:.3} s. What hung on the tip, and what is not to be used:\n# [[load]]\n# from = 0.0\n# to = {duration_s:.3}\n# mass = 0.5                # kg\n# com = [0.0, 0.0, 0.05]    # m, tip frame\n# [[exclude]]\n# from = 0.0\n# to = 1.0\n# why = \"\"\n"
    ));
    text
}
