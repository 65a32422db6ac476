//! `wrenchctl check`: configuration, URDF, DBC and model against each other, and the planned bus load.

use std::io::Write;
use std::path::{Path, PathBuf};

use model::chain::JointKind;
use rig::binding::{BitRates, Direction};
use rig::config::SignalName;
use rig::model_file::Sensor;
use rig::{ModelFile, Rig, RigError};

use crate::output::{self, Side, Table};
use crate::{Error, Outcome};

/// What to check.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// Configuration file (TOML)
    #[arg(value_name = "CONFIG")]
    pub config: PathBuf,
    /// Model file, instead of the configuration's [model] path
    #[arg(long, value_name = "MODEL")]
    pub model: Option<PathBuf>,
    /// Bit rates of the buses, for the planned load
    #[command(flatten)]
    pub rates: RateArgs,
}

/// Bit rates of a bus.
#[derive(clap::Args, Debug, Clone, Copy)]
pub struct RateArgs {
    /// Bit rate of classical frames and of CAN FD arbitration, bit/s
    #[arg(long, value_name = "BPS", default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1..))]
    pub bitrate: u32,
    /// Bit rate of CAN FD data, bit/s
    #[arg(long, value_name = "BPS", default_value_t = 5_000_000, value_parser = clap::value_parser!(u32).range(1..))]
    pub data_bitrate: u32,
}

impl RateArgs {
    /// As the load estimate takes them.
    pub fn rates(self) -> BitRates {
        BitRates { nominal_bps: self.bitrate.into(), data_bps: self.data_bitrate.into() }
    }
}

/// Checks, and prints what was found.
pub fn run(args: Args) -> Result<Outcome, Error> {
    let rig = Rig::load_file(&args.config)?;
    // Printed once all files could be read: unusable input has its one message and nothing else.
    let mut out = Vec::new();
    writeln!(out, "{}", args.config.display())?;
    arm(&rig, &mut out)?;
    joints_and_sensors(&rig, &mut out)?;
    let fits = bus(&rig, args.rates.rates(), &mut out)?;
    for warning in &rig.warnings {
        writeln!(out, "warning: {warning}")?;
    }
    let model = args.model.or_else(|| rig.config.model.as_ref().map(|model| model.path.clone()));
    let refusal = match model {
        Some(path) => model_of(&rig, &path, &mut out)?,
        None => {
            writeln!(out, "model    none configured; `wrenchctl calibrate` makes one")?;
            None
        }
    };
    output::write_file(Path::new("-"), &out)?;
    if let Some(refusal) = &refusal {
        output::note(format_args!("{refusal}"));
    }
    Ok(if fits && refusal.is_none() { Outcome::Done } else { Outcome::No })
}

fn arm(rig: &Rig, out: &mut impl Write) -> Result<(), Error> {
    let chain = &rig.chain;
    let mass_kg: f64 = chain.joints.iter().map(|joint| joint.body.mass_kg).sum();
    let tool_kg = rig.config.tool.as_ref().map_or(0.0, |tool| tool.mass_kg);
    let g = chain.gravity_mps2;
    writeln!(
        out,
        "arm      {} to {}: {} joints, {} of them movable, {mass_kg:.3} kg (tool {tool_kg:.3} kg), gravity [{}, {}, {}] m/s^2",
        chain.base,
        chain.tip,
        chain.joints.len(),
        chain.coordinates(),
        g.x,
        g.y,
        g.z
    )?;
    writeln!(out, "urdf     {} (sha256 {})", rig.config.robot.urdf.display(), short(&rig.urdf_sha256))?;
    writeln!(out, "dbc      {} (sha256 {})", rig.config.bus.dbc.display(), short(&rig.dbc_sha256))?;
    Ok(())
}

fn short(hash: &str) -> &str {
    hash.get(..12).unwrap_or(hash)
}

fn joints_and_sensors(rig: &Rig, out: &mut impl Write) -> Result<(), Error> {
    let kind = |joint: usize| match rig.chain.joints[joint].kind {
        JointKind::Revolute => "revolute",
        JointKind::Continuous => "continuous",
        JointKind::Fixed => "fixed",
    };
    let mut joints = Table::new(&[Side::Left; 4], 2);
    for &entry in &rig.joint_entries {
        let joint = &rig.config.joints[entry];
        let at = rig.chain.joint_index(&joint.name).expect("a [[joint]] of a checked rig is on the chain");
        let velocity = joint.velocity.as_ref().map_or_else(String::new, |name| format!("velocity {name}"));
        joints.row([joint.name.clone(), kind(at).into(), joint.position.to_string(), velocity]);
    }
    let mut sensors = Table::new(&[Side::Left; 5], 2);
    for (sensor, section) in rig.config.sensors.iter().zip(&rig.sections) {
        let outboard_kg: f64 = rig.chain.joints[section.joint..].iter().map(|joint| joint.body.mass_kg).sum();
        let have = |what: &'static str, name: &Option<SignalName>| name.as_ref().map(|_| what);
        let extras = [
            have("saturated", &sensor.saturated),
            have("sequence", &sensor.sequence),
            have("temperature", &sensor.temperature),
        ];
        let extras: Vec<&str> = extras.into_iter().flatten().collect();
        let section_text = format!("{} ({})", sensor.section, kind(section.joint));
        let carries = format!("carries {outboard_kg:.3} kg");
        sensors.row([
            sensor.name.clone(),
            section_text,
            sensor.signal.to_string(),
            carries,
            extras.join(", "),
        ]);
    }
    write!(out, "joints   from base to tip\n{joints}sensors  with the section that each sits in\n{sensors}")?;
    Ok(())
}

/// The messages and what they make of each bus; whether they can fit.
fn bus(rig: &Rig, rates: BitRates, out: &mut impl Write) -> Result<bool, Error> {
    let mut table = Table::new(
        &[Side::Left, Side::Left, Side::Left, Side::Left, Side::Right, Side::Right, Side::Left],
        2,
    );
    for message in &rig.messages {
        let bits = message.bits();
        let (least, most) = (bits.nominal.0 + bits.data.0, bits.nominal.1 + bits.data.1);
        table.row([
            message.interface.clone(),
            if message.direction == Direction::In { "in" } else { "out" }.into(),
            message.id.to_string(),
            message.name.clone(),
            format!("{} bytes, {least}..{most} bits", message.len),
            format!("{:.1} Hz", message.rate_hz),
            if message.rate_known { "" } else { "assumed" }.into(),
        ]);
    }
    write!(out, "messages\n{table}")?;
    let mut fits = true;
    let nominal = rates.nominal_bps / 1e6;
    let fd = rig.messages.iter().any(|message| message.len > 8);
    let at =
        if fd { format!("{nominal}/{} Mbit/s", rates.data_bps / 1e6) } else { format!("{nominal} Mbit/s") };
    for load in rig.planned_load(rates) {
        let (least, most) = (100.0 * load.least, 100.0 * load.most);
        let verdict = if load.least > 1.0 {
            fits = false;
            ": does not fit; lower the rates, use CAN FD, or spread the messages over more interfaces"
        } else if load.most > 0.9 {
            ": nearly full; expect late frames"
        } else {
            ""
        };
        writeln!(out, "bus load {} {least:.1} to {most:.1} % at {at}{verdict}", load.interface)?;
    }
    Ok(fits)
}

/// The model, or why it is not this arm's. One that cannot be read at all is an error.
fn model_of(rig: &Rig, path: &Path, out: &mut impl Write) -> Result<Option<RigError>, Error> {
    let text = std::fs::read_to_string(path).unwrap_or_default();
    let readable = ModelFile::parse(path, &text);
    let model = match ModelFile::load(path, rig) {
        Ok(model) => model,
        Err(refusal) if readable.is_ok() => return Ok(Some(refusal)),
        Err(unusable) => return Err(unusable.into()),
    };
    let from = &model.provenance;
    writeln!(
        out,
        "model    {}: {} axes, {} samples, {} by {}",
        path.display(),
        from.axes,
        from.samples,
        from.date,
        from.tool
    )?;
    for input in &from.inputs {
        writeln!(out, "  from {} (sha256 {})", input.file, short(&input.sha256))?;
    }
    write!(out, "{}", crosstalk(&model))?;
    for sensor in &model.sensors {
        for unseen in &sensor.unobservable {
            writeln!(out, "warning: {} does not know {}; {}", sensor.name, unseen.words, unseen.remedy)?;
        }
    }
    Ok(None)
}

/// The gauges' actual sensing frames and crosstalk, one row a gauge.
fn crosstalk(model: &ModelFile) -> Table {
    let sides: Vec<Side> = [Side::Left].into_iter().chain([Side::Right; 8]).collect();
    let mut table = Table::new(&sides, 2);
    table.row([
        "gauge",
        "crosstalk",
        "counts/Nm",
        "a_x deg",
        "a_y deg",
        "l_x mm",
        "l_y mm",
        "pitch mm",
        "noise counts",
    ]);
    for sensor in &model.sensors {
        table.row(crosstalk_row(sensor));
    }
    table
}

fn crosstalk_row(sensor: &Sensor) -> [String; 9] {
    let shown = |value: Option<f64>, factor: f64, digits: usize| {
        value.map_or_else(|| "unknown".into(), |value| format!("{:.digits$}", value * factor))
    };
    let degrees = 180.0 / std::f64::consts::PI;
    let frame = &sensor.frame;
    [
        sensor.name.clone(),
        sensor.crosstalk_percent.map_or_else(|| "unknown".into(), |percent| format!("{percent:.1} %")),
        shown(frame.r_counts_per_nm, 1.0, 1),
        shown(frame.a_x_rad, degrees, 3),
        shown(frame.a_y_rad, degrees, 3),
        shown(frame.l_x_m, 1e3, 3),
        shown(frame.l_y_m, 1e3, 3),
        shown(frame.pitch_m, 1e3, 3),
        format!("{:.1}", sensor.noise_floor_counts),
    ]
}
