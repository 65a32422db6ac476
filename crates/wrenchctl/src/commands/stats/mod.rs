//! `wrenchctl stats`: rates, gaps, jitter, errors and bus load, in one pass and bounded memory.

mod flow;
mod intervals;
mod report;

use std::collections::BTreeMap;
use std::fmt;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Duration;

use can::frame::{CanId, Flags, Stamped};
use can::source::Event;
use rig::binding::{BitRates, classical_bits, fd_bits};

use crate::commands::check::RateArgs;
use crate::decoded::Decoder;
use crate::input::{Input, log_of};
use crate::{Error, Outcome, output};
use flow::Flow;

/// Identifiers that are told apart; frames of more are counted together.
const MAX_FLOWS: usize = 2048;

/// Length of the stretches of which the busiest is told, ns.
const WINDOW_NS: i64 = 100_000_000;

/// What to measure.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Interface (can0, or can0,can1), candump log (plain, gzip, zstd; - for standard input) or run directory
    #[arg(value_name = "IFACE|LOG")]
    pub input: String,
    /// Name messages, follow their counters and check their lengths with this configuration
    #[arg(long, value_name = "CONFIG")]
    pub config: Option<PathBuf>,
    /// Listen for this time, s [default: until interrupted; logs are read to their end]
    #[arg(long, value_name = "N", value_parser = crate::commands::seconds)]
    pub seconds: Option<Duration>,
    /// Also write the figures as JSON; - is standard output, instead of the table
    #[arg(long, value_name = "FILE")]
    pub json: Option<PathBuf>,
    /// Bit rates of the buses, for their load
    #[command(flatten)]
    pub rates: RateArgs,
}

/// Measures and prints.
pub fn run(args: Args) -> Result<Outcome, Error> {
    let decoder = args.config.as_deref().map(Decoder::load).transpose()?;
    let mut input = Input::open(&args.input)?;
    let log = log_of(&args.input)?;
    let config = decoder.iter().flat_map(|decoder| decoder.config.files());
    output::refuse_to_overwrite([args.json.as_ref()], &log.into_iter().chain(config).collect::<Vec<_>>())?;
    let mut stats = Stats::new(args.rates.rates());
    input.follow(args.seconds, |_, batch| {
        for event in batch {
            stats.event(event, decoder.as_ref());
        }
        Ok(true)
    })?;
    if stats.buses.is_empty() && stats.malformed > 0 {
        return Err(crate::commands::no_log(&args.input, stats.malformed));
    }
    let report = report::Report::new(&args.input, &stats, &input, decoder.as_ref());
    if let Some(path) = &args.json {
        output::write_json(path, &report)?;
    }
    if args.json.as_deref() != Some(Path::new("-")) {
        let mut out = output::stdout();
        write!(out, "{report}")?;
        out.flush()?;
    }
    Ok(Outcome::Done)
}

/// Everything that was met so far.
pub(super) struct Stats {
    rates: BitRates,
    buses: BTreeMap<u8, Bus>,
    flows: BTreeMap<(u8, CanId), Flow>,
    /// Frames of identifiers beyond [`MAX_FLOWS`]
    untold: u64,
    fd: bool,
    malformed: u64,
    first_fault: Option<(u64, can::candump::LineFault)>,
    first_ns: Option<i64>,
    last_ns: i64,
}

/// One interface.
#[derive(Default)]
struct Bus {
    frames: u64,
    errors: u64,
    dropped: u64,
    downs: u64,
    first_ns: Option<i64>,
    last_ns: i64,
    /// Time on the wire of the first frame, s: stamps are frames' ends
    first_s: (f64, f64),
    /// Time on the wire with no and with most stuff bits, s
    busy_s: (f64, f64),
    window: i64,
    window_s: (f64, f64),
    busiest_s: (f64, f64),
    last_error: Option<String>,
}

impl Stats {
    /// Nothing yet; the bit rates are for the load.
    pub(super) fn new(rates: BitRates) -> Self {
        Self {
            rates,
            buses: BTreeMap::new(),
            flows: BTreeMap::new(),
            untold: 0,
            fd: false,
            malformed: 0,
            first_fault: None,
            first_ns: None,
            last_ns: i64::MIN,
        }
    }

    /// The figures so far as `stats` prints them, of the input with this name.
    pub(super) fn table(
        &self,
        name: &str,
        input: &Input,
        decoder: Option<&Decoder>,
    ) -> impl fmt::Display + use<> {
        report::Report::new(name, self, input, decoder)
    }

    /// Takes in what comes next.
    pub(super) fn event(&mut self, event: &Event, decoder: Option<&Decoder>) {
        match event {
            Event::Frame(stamped) => self.frame(stamped, decoder),
            Event::BusError { stamped, error } => {
                let bus = self.buses.entry(stamped.interface).or_default();
                bus.errors += 1;
                bus.last_error = Some(error.to_string());
            }
            Event::Dropped { interface, count } => {
                self.buses.entry(*interface).or_default().dropped += u64::from(*count);
            }
            Event::Down { interface } => self.buses.entry(*interface).or_default().downs += 1,
            Event::Up { .. } => {}
            Event::Malformed { line, fault } => {
                self.malformed += 1;
                self.first_fault.get_or_insert((*line, *fault));
            }
        }
    }

    fn frame(&mut self, stamped: &Stamped, decoder: Option<&Decoder>) {
        self.first_ns.get_or_insert(stamped.stamp_ns);
        self.last_ns = self.last_ns.max(stamped.stamp_ns);
        self.fd |= stamped.frame.flags().has(Flags::FD);
        let wire_s = wire_time_s(stamped, self.rates);
        self.buses.entry(stamped.interface).or_default().frame(stamped.stamp_ns, wire_s);
        let key = (stamped.interface, stamped.frame.id());
        if self.flows.len() >= MAX_FLOWS && !self.flows.contains_key(&key) {
            self.untold += 1;
            return;
        }
        let flow = self.flows.entry(key).or_insert_with(|| Flow::new(decoder, stamped.frame.id()));
        flow.frame(stamped);
    }
}

impl Bus {
    fn frame(&mut self, stamp_ns: i64, wire_s: (f64, f64)) {
        self.frames += 1;
        if self.first_ns.is_none() {
            self.first_s = wire_s;
        }
        self.first_ns.get_or_insert(stamp_ns);
        self.last_ns = self.last_ns.max(stamp_ns);
        let window = stamp_ns.div_euclid(WINDOW_NS);
        if window != self.window {
            self.end_window();
            self.window = window;
        }
        for sum in [&mut self.busy_s, &mut self.window_s] {
            *sum = (sum.0 + wire_s.0, sum.1 + wire_s.1);
        }
    }

    fn end_window(&mut self) {
        if self.window_s.1 > self.busiest_s.1 {
            self.busiest_s = self.window_s;
        }
        self.window_s = (0.0, 0.0);
    }
}

/// Time that a frame takes on the wire with no and with most stuff bits, s.
fn wire_time_s(stamped: &Stamped, rates: BitRates) -> (f64, f64) {
    let frame = &stamped.frame;
    let flags = frame.flags();
    let extended = frame.id().is_extended();
    let bits = if flags.has(Flags::FD) {
        fd_bits(frame.len(), extended)
    } else {
        classical_bits(frame.data().len(), extended)
    };
    // Flags nibble bit 0: the data part is sent at the data rate.
    let switched = flags.has(Flags::FD) && flags.fd_nibble() & 1 != 0;
    let data_bps = if switched { rates.data_bps } else { rates.nominal_bps };
    let time = |nominal: u32, data: u32| f64::from(nominal) / rates.nominal_bps + f64::from(data) / data_bps;
    (time(bits.nominal.0, bits.data.0), time(bits.nominal.1, bits.data.1))
}
