//! `wrenchctl dump`: frames as candump prints them, in words where a configuration is given.

use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

use can::candump::{MAX_LINE, StampDigits, format_line};
use can::frame::{CanId, Stamped};
use can::source::Event;

use crate::commands::check::RateArgs;
use crate::commands::stats::Stats;
use crate::decoded::Decoder;
use crate::input::Input;
use crate::{Error, Outcome, output};

/// Malformed lines that are told one by one; more are only counted.
const FAULTS_TOLD: u64 = 5;

/// What to print.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Interface (can0, or can0,can1), candump log (plain, gzip, zstd; - for standard input) or run directory
    #[arg(value_name = "IFACE|LOG")]
    pub input: String,
    /// Decode with this configuration's DBC
    #[arg(long, value_name = "CONFIG")]
    pub config: Option<PathBuf>,
    /// Only frames with this identifier, 3 (standard) or 8 (extended) hexadecimal digits; may be repeated
    #[arg(long = "id", value_name = "HEX", value_parser = parse_id)]
    pub ids: Vec<CanId>,
    /// Only frames of this message of the DBC; may be repeated
    #[arg(long = "message", value_name = "NAME", requires = "config")]
    pub messages: Vec<String>,
    /// End after this many frames [default: all]
    #[arg(long, value_name = "N")]
    pub count: Option<u64>,
    /// End after this time, s [default: when interrupted; logs are read to their end]
    #[arg(long, value_name = "N", value_parser = super::seconds)]
    pub seconds: Option<Duration>,
    /// After the frames print their rates, gaps, jitter and load as `wrenchctl stats` does, of those that were printed
    #[arg(long)]
    pub stats: bool,
    /// Bit rates of the buses, for their load
    #[command(flatten)]
    pub rates: RateArgs,
}

/// An identifier as candump writes it.
fn parse_id(text: &str) -> Result<CanId, String> {
    let number = u32::from_str_radix(text, 16).ok();
    let id = number.and_then(|number| match text.len() {
        1..=3 => CanId::standard(number),
        8 => CanId::extended(number),
        _ => None,
    });
    id.ok_or_else(|| "write 1 to 3 hexadecimal digits up to 7FF, or 8 digits up to 1FFFFFFF".into())
}

struct Dump {
    decoder: Option<Decoder>,
    stats: Option<Stats>,
    ids: Vec<CanId>,
    left: u64,
    frames: u64,
    faults: u64,
    drops: u64,
    line: String,
}

/// Prints until the end, the limit, or Ctrl-C.
pub fn run(args: Args) -> Result<Outcome, Error> {
    let decoder = args.config.as_deref().map(Decoder::load).transpose()?;
    let mut ids = args.ids;
    for name in &args.messages {
        ids.extend(decoder.as_ref().map(|decoder| decoder.id_of(name)).transpose()?);
    }
    let mut input = Input::open(&args.input)?;
    let left = args.count.unwrap_or(u64::MAX);
    let stats = args.stats.then(|| Stats::new(args.rates.rates()));
    let mut dump = Dump { decoder, stats, ids, left, frames: 0, faults: 0, drops: 0, line: String::new() };
    let mut out = output::stdout();
    input.follow(args.seconds, |input, batch| {
        for event in batch {
            dump.event(event, input, &mut out)?;
        }
        if input.is_live() {
            out.flush()?;
        }
        Ok(dump.left > 0)
    })?;
    if let Some(stats) = &dump.stats {
        write!(out, "\n{}", stats.table(&args.input, &input, dump.decoder.as_ref()))?;
    }
    out.flush()?;
    if dump.frames == 0 && dump.faults > 0 {
        return Err(super::no_log(&args.input, dump.faults));
    }
    if dump.faults > FAULTS_TOLD {
        output::note(format_args!("{}: {} lines are no candump lines", args.input, dump.faults));
    }
    Ok(Outcome::Done)
}

impl Dump {
    fn event(&mut self, event: &Event, input: &Input, out: &mut impl Write) -> Result<(), Error> {
        if self.left == 0 {
            return Ok(());
        }
        self.frames += u64::from(event.stamped().is_some());
        let printed = match event {
            Event::Frame(stamped) => self.wanted(stamped),
            Event::BusError { .. } => self.ids.is_empty(),
            _ => true,
        };
        if let Some(stats) = self.stats.as_mut().filter(|_| printed) {
            stats.event(event, self.decoder.as_ref());
        }
        match event {
            Event::Frame(stamped) if printed => self.frame(stamped, None, input, out),
            Event::BusError { stamped, error } if printed => {
                self.frame(stamped, Some(error.to_string()), input, out)
            }
            Event::Frame(_) | Event::BusError { .. } => Ok(()),
            Event::Dropped { interface, count } => {
                self.drops += u64::from(*count);
                let (name, plural) = (input.interface(*interface), if *count == 1 { "" } else { "s" });
                let total = self.drops;
                writeln!(
                    out,
                    "DROPCOUNT: dropped {count} CAN frame{plural} on '{name}' socket (total drops {total})"
                )?;
                Ok(())
            }
            Event::Down { interface } => {
                output::note(format_args!("{} is down; waiting for it", input.interface(*interface)));
                Ok(())
            }
            Event::Up { interface } => {
                output::note(format_args!("{} is up", input.interface(*interface)));
                Ok(())
            }
            Event::Malformed { line, fault } => {
                self.faults += 1;
                if self.faults <= FAULTS_TOLD {
                    output::note(format_args!("line {line} is no candump line: {fault}"));
                }
                Ok(())
            }
        }
    }

    fn wanted(&self, stamped: &Stamped) -> bool {
        self.ids.is_empty() || self.ids.contains(&stamped.frame.id())
    }

    fn frame(
        &mut self,
        stamped: &Stamped,
        words: Option<String>,
        input: &Input,
        out: &mut impl Write,
    ) -> Result<(), Error> {
        let name = input.interface(stamped.interface);
        let mut bytes = [0; MAX_LINE];
        let len = format_line(&mut bytes, stamped, name, StampDigits::Micros);
        out.write_all(bytes[..len].trim_ascii_end())?;
        self.line.clear();
        if let Some(words) = words {
            self.line.push_str(" error: ");
            self.line.push_str(&words);
        } else if let Some(decoder) = self.decoder.as_ref().filter(|_| stamped.frame.is_data()) {
            decoder.describe(name, &stamped.frame, &mut self.line);
        }
        writeln!(out, "{}", self.line)?;
        self.left -= 1;
        Ok(())
    }
}
