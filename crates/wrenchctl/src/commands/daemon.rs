//! `wrenchctl status | tare | untare | payload | reload`: a running daemon asked and told.

use std::io::Write;
use std::path::PathBuf;

use wrenchd::control::{Reply, Request};
use wrenchd::view::{DaemonStatus, Live};

use crate::control::Target;
use crate::output::{self, Side, Table};
use crate::{Error, Outcome};

/// What to show.
#[derive(clap::Args, Debug)]
pub struct StatusArgs {
    /// Which daemon.
    #[command(flatten)]
    pub target: Target,
    /// Write the status as JSON ('-': standard output)
    #[arg(long, value_name = "F")]
    pub json: Option<PathBuf>,
}

/// Which daemon to tell.
#[derive(clap::Args, Debug)]
pub struct OrderArgs {
    /// Which daemon.
    #[command(flatten)]
    pub target: Target,
}

/// What hangs at the tip.
#[derive(clap::Args, Debug)]
pub struct PayloadArgs {
    /// Mass of a point that is rigidly fixed to the tip, kg; 0 takes it off
    #[arg(value_name = "MASS", allow_negative_numbers = true)]
    pub mass: f64,
    /// Where it is, tip frame, m
    #[arg(value_names = ["X", "Y", "Z"], num_args = 3, allow_negative_numbers = true)]
    pub com: Vec<f64>,
    /// Which daemon.
    #[command(flatten)]
    pub target: Target,
}

/// Shows the daemon's state: 1 if it publishes no valid wrench.
pub fn status(args: StatusArgs) -> Result<Outcome, Error> {
    let read_from: Vec<_> = args.target.config.iter().cloned().collect();
    output::refuse_to_overwrite([args.json.as_ref()], &read_from)?;
    let reply = args.target.ask(&Request::Status {})?;
    let Some(status) = reply.status else { return answered(&reply) };
    let valid = status.live.as_ref().is_some_and(|live| live.wrench.is_some());
    match &args.json {
        Some(file) => output::write_json(file, &status)?,
        None => {
            let mut out = output::stdout();
            write!(out, "{}", words(&status))?;
            out.flush()?;
        }
    }
    Ok(if valid { Outcome::Done } else { Outcome::No })
}

/// Tares: 1 if it is refused.
pub fn tare(args: OrderArgs) -> Result<Outcome, Error> {
    answered(&args.target.ask(&Request::Tare {})?)
}

/// Takes the tare back.
pub fn untare(args: OrderArgs) -> Result<Outcome, Error> {
    answered(&args.target.ask(&Request::Untare {})?)
}

/// Declares what hangs at the tip.
pub fn payload(args: PayloadArgs) -> Result<Outcome, Error> {
    let com = match args.com.as_slice() {
        [x, y, z] => [*x, *y, *z],
        _ if args.mass == 0.0 => [0.0; 3],
        _ => {
            return Err(Error::usage(
                "give the place of the mass too: MASS X Y Z, in kg and m in the tip frame",
            ));
        }
    };
    let request = Request::Payload { mass: args.mass, com }.check().map_err(Error::usage)?;
    answered(&args.target.ask(&request)?)
}

/// Makes the daemon read configuration and model again: 1 if it keeps the old ones.
pub fn reload(args: OrderArgs) -> Result<Outcome, Error> {
    answered(&args.target.ask(&Request::Reload {})?)
}

/// Says what the daemon did, or why not.
fn answered(reply: &Reply) -> Result<Outcome, Error> {
    if let Some(error) = &reply.error {
        output::note(format_args!("{error}"));
        return Ok(Outcome::No);
    }
    let mut out = output::stdout();
    writeln!(out, "{}", reply.done.as_deref().unwrap_or("done"))?;
    out.flush()?;
    Ok(if reply.ok { Outcome::Done } else { Outcome::No })
}

/// The status for a person.
fn words(status: &DaemonStatus) -> String {
    let mut table = Table::new(&[Side::Left, Side::Left], 0);
    let mut row = |name: &str, value: String| table.row([name.to_owned(), value]);
    row("daemon", format!("wrenchd {}, up {:.0} s", status.version, status.uptime_s));
    row("config", status.config.clone());
    row("model", format!("{} (sha256 {})", status.model, status.model_sha256));
    row("published", format!("{:.0} Hz, {} mode", status.published_hz, status.mode));
    let total = |name: &str| status.totals.get(name).copied().unwrap_or(0);
    row(
        "frames",
        format!(
            "{:.0} Hz, {} lost, {} bus errors",
            status.frames_hz,
            total("lost_frames"),
            total("bus_errors")
        ),
    );
    row("overruns", total("overruns").to_string());
    if let Some(latency_s) = status.latency_p99_s {
        row("latency", format!("99 % below {:.2} ms", latency_s * 1e3));
    }
    match &status.live {
        None => row("wrench", "nothing published yet".to_owned()),
        Some(live) => live_rows(live, &mut row),
    }
    let mut text = table.to_string();
    if let Some(live) = &status.live {
        text += &gauges(live);
    }
    text
}

fn live_rows(live: &Live, row: &mut impl FnMut(&str, String)) {
    row("status", live.status_names.join("+"));
    match (&live.wrench, &live.sigma) {
        (Some(wrench), Some(sigma)) => {
            let part = |from: usize, unit: &str| {
                let axis = |k: usize| format!("{:.3} \u{b1} {:.3}", wrench[k], sigma[k]);
                format!("{}, {}, {} {unit}", axis(from), axis(from + 1), axis(from + 2))
            };
            row("force", part(0, "N"));
            row("moment", part(3, "Nm"));
        }
        _ => row("wrench", format!("none: {}", live.reason.as_deref().unwrap_or("no reason given"))),
    }
    if let Some(protection) = &live.protection {
        // The largest error that one faulty gauge can hide.
        let level = |k: usize| protection[k].map_or("anything".to_owned(), |level| format!("{level:.3}"));
        let part = |from: usize, unit: &str| {
            format!("{}, {}, {} {unit}", level(from), level(from + 1), level(from + 2))
        };
        row("protection", format!("{}; {}", part(0, "N"), part(3, "Nm")));
    }
    if let Some(parity) = &live.parity {
        row("parity", format!("{:.1} of {:.0}, {} spare gauges", parity.chi2, parity.limit, parity.dof));
    }
    let tare = live.tare.map_or("none".to_owned(), |tare| format!("{:.0} s ago", tare.age_s));
    row("tare", tare);
    let payload = live.payload.map_or("none".to_owned(), |p| {
        let [x, y, z] = p.com_m;
        format!("{:.4} kg at {x:.4} {y:.4} {z:.4} m", p.mass_kg)
    });
    row("payload", payload);
}

fn gauges(live: &Live) -> String {
    let mut table = Table::new(&[Side::Left, Side::Left, Side::Right, Side::Right, Side::Right], 2);
    table.row(["gauge", "state", "counts", "residual, sigma", "zero shift"]);
    for gauge in &live.gauges {
        table.row([
            gauge.name.clone(),
            if gauge.suspect { format!("{}, suspect", gauge.state) } else { gauge.state.clone() },
            format!("{:.0}", gauge.counts),
            format!("{:.2}", gauge.residual_sigma),
            format!("{:.0}", gauge.zero_shift_counts),
        ]);
    }
    table.to_string()
}
