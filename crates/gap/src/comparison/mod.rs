//! A comparison directory: somebody else's simulation beside what was measured, as a [`Session`].

mod description;
mod repeats;
mod robot;
mod rows;
mod table;

use std::path::{Path, PathBuf};

use rig::document::Step::{Index, Key};
use rig::document::{self, Problem};
use rig::error::{read_text, suggest};

use crate::division::{self, Recording};
use crate::motion;
use crate::session::{Channel, Covariate, HoldOut, Joint, Quantity, Session};
use crate::{Error, session};
use description::Description;
use table::{Columns, Table};

/// Fewest rows from which anything can be concluded.
const FEWEST_ROWS: usize = 12;

/// Whether a directory holds a comparison.
#[must_use]
pub fn is_comparison(dir: &Path) -> bool {
    dir.join("comparison.toml").is_file()
}

/// The files of a comparison: its description, and what that names.
///
/// # Errors
/// A description that cannot be read, with its line and what to do.
pub fn files(dir: &Path) -> Result<Vec<PathBuf>, Error> {
    let (file, _, description) = describe(dir)?;
    let urdf = description.robot.map(|robot| dir.join(robot.urdf));
    Ok([file, dir.join(description.table)].into_iter().chain(urdf).collect())
}

/// The description's path, text and content.
fn describe(dir: &Path) -> Result<(PathBuf, String, Description), Error> {
    let file = dir.join("comparison.toml");
    let text = read_text(&file, "a comparison's description (TOML)")?;
    let description = document::parse(&file, &text)?;
    Ok((file, text, description))
}

/// Reads `comparison.toml` of a directory with its table.
///
/// # Errors
/// What cannot be used, with its line and what to do.
pub fn load(dir: &Path) -> Result<Session, Error> {
    let (file, text, description) = describe(dir)?;
    let located = |problem| Error::Rig(document::locate(&file, &text, problem));
    check(&description).map_err(located)?;
    let table = Table::load(&dir.join(&description.table))?;
    let mut wanted = Wanted::default();
    let plan = plan(&description, &table, &mut wanted).map_err(located)?;
    let columns = table.read(&wanted.numbers, plan.recording)?;
    if columns.lines.len() < FEWEST_ROWS {
        let problem = format!(
            "has {} complete rows ({} lack a value); nothing can be concluded from fewer than {FEWEST_ROWS}, record more",
            columns.lines.len(),
            columns.incomplete
        );
        return Err(table.problem(None, problem));
    }
    let mut session = assemble(&description, &table, &plan, columns)?;
    repeats::find(&mut session.session, &mut session.recordings);
    let held = hold_out(&description, &session, &plan.recordings(&session)).map_err(located)?;
    session.session.hold_out = held;
    if let Some(given) = &description.robot {
        let loaded = robot::load(dir, given, &session.session).map_err(|error| match error {
            robot::Failure::Rig(error) => Error::Rig(error),
            robot::Failure::Problem(problem) => located(problem),
        })?;
        session.session.notes.extend(loaded.1);
        session.session.kinematics = loaded.0;
    }
    Ok(session.session)
}

fn check(description: &Description) -> Result<(), Problem> {
    if description.purpose != "comparison" {
        let text = format!("purpose = \"{}\" must be \"comparison\" in this file", description.purpose);
        return Err(Problem::new(&[Key("purpose")], text));
    }
    if description.channel.is_empty() {
        return Err(Problem::new(&[], "has no [[channel]]; add one with name, measured, simulated and unit"));
    }
    if let Some(length_m) = description.characteristic_length_m.filter(|m| !(m.is_finite() && *m > 0.0)) {
        let text = format!("characteristic_length_m = {length_m} must be a length in m above 0");
        return Err(Problem::new(&[Key("characteristic_length_m")], text));
    }
    for (index, channel) in description.channel.iter().enumerate() {
        let at = |key| [Key("channel"), Index(index), Key(key)];
        if description.channel[..index].iter().any(|other| other.name == channel.name) {
            let text = format!("two channels are called \"{}\"; rename one", channel.name);
            return Err(Problem::new(&at("name"), text));
        }
        if let Some(noise) = channel.noise.filter(|noise| !(noise.is_finite() && *noise > 0.0)) {
            let text = format!("noise = {noise} must be a standard deviation above 0, in {}", channel.unit);
            return Err(Problem::new(&at("noise"), text));
        }
        let known = description.joint.iter().map(|joint| joint.name.as_str());
        if let Some(joint) = channel.joint.as_deref().filter(|name| known.clone().all(|known| known != *name))
        {
            let text = format!("joint = \"{joint}\" is no [[joint]] of this file; {}", suggest(joint, known));
            return Err(Problem::new(&at("joint"), text));
        }
    }
    if description.hold_out.is_some() && description.recording.is_none() {
        let text =
            "hold_out names values of the column `recording`, which is not given; add recording = \"COLUMN\"";
        return Err(Problem::new(&[Key("hold_out")], text));
    }
    Ok(())
}

/// Columns to read, each once.
#[derive(Default)]
struct Wanted {
    numbers: Vec<usize>,
}

impl Wanted {
    /// Position among the columns that are read.
    fn add(&mut self, table: &Table, name: &str, at: &[document::Step]) -> Result<usize, Problem> {
        let column = table.column(name).map_err(|text| Problem::new(at, text))?;
        Ok(self.numbers.iter().position(|known| *known == column).unwrap_or_else(|| {
            self.numbers.push(column);
            self.numbers.len() - 1
        }))
    }
}

/// Where everything is among the columns that are read.
struct Plan {
    time: Option<usize>,
    recording: Option<usize>,
    temperature: Option<usize>,
    loads: Vec<usize>,
    /// Per joint position, velocity, acceleration.
    joints: Vec<[Option<usize>; 3]>,
    /// Per channel measured and simulated.
    channels: Vec<[usize; 2]>,
}

impl Plan {
    fn recordings<'a>(&self, assembled: &'a Assembled) -> Vec<&'a Recording> {
        if self.recording.is_some() { assembled.recordings.iter().collect() } else { Vec::new() }
    }
}

fn plan(description: &Description, table: &Table, wanted: &mut Wanted) -> Result<Plan, Problem> {
    let mut maybe = |name: &Option<String>, at: &[document::Step]| {
        name.as_ref().map(|name| wanted.add(table, name, at)).transpose()
    };
    let time = maybe(&description.time, &[Key("time")])?;
    let temperature = maybe(&description.covariates.temperature, &[Key("covariates"), Key("temperature")])?;
    let mut joints = Vec::new();
    for (index, joint) in description.joint.iter().enumerate() {
        let at = |key| [Key("joint"), Index(index), Key(key)];
        joints.push([
            maybe(&Some(joint.position.clone()), &at("position"))?,
            maybe(&joint.velocity, &at("velocity"))?,
            maybe(&joint.acceleration, &at("acceleration"))?,
        ]);
    }
    let mut loads = Vec::new();
    for name in &description.covariates.load {
        loads.push(wanted.add(table, name, &[Key("covariates"), Key("load")])?);
    }
    let mut channels = Vec::new();
    for (index, channel) in description.channel.iter().enumerate() {
        let at = |key| [Key("channel"), Index(index), Key(key)];
        channels.push([
            wanted.add(table, &channel.measured, &at("measured"))?,
            wanted.add(table, &channel.simulated, &at("simulated"))?,
        ]);
    }
    let recording = description.recording.as_ref();
    let recording = recording
        .map(|name| table.column(name).map_err(|text| Problem::new(&[Key("recording")], text)))
        .transpose()?;
    Ok(Plan { time, recording, temperature, loads, joints, channels })
}

struct Assembled {
    session: Session,
    recordings: Vec<Recording>,
}

fn assemble(
    description: &Description,
    table: &Table,
    plan: &Plan,
    mut columns: Columns,
) -> Result<Assembled, Error> {
    let recordings = rows::gather(&mut columns);
    let time_s = plan.time.map(|column| columns.numbers[column].clone());
    if let Some(time_s) = &time_s {
        rows::check_time(description, table, time_s, &recordings, &columns.lines)?;
    }
    let segments = rows::segments(time_s.as_deref(), &recordings);
    let numbers = |column: usize| columns.numbers[column].clone();
    let joints =
        description.joint.iter().zip(&plan.joints).map(|(joint, [position, velocity, acceleration])| {
            let position_rad = position.map(numbers).unwrap_or_default();
            let differentiated =
                time_s.as_deref().map(|time_s| motion::differentiate(time_s, &position_rad, &segments));
            let (first, second) = differentiated.unzip();
            Joint {
                name: joint.name.clone(),
                position_rad,
                velocity_rad_s: velocity.map(numbers).or(first),
                acceleration_rad_s2: acceleration.map(numbers).or(second),
            }
        });
    let joints: Vec<Joint> = joints.collect();
    let channels = description.channel.iter().zip(&plan.channels);
    let channels = channels
        .map(|(channel, [measured, simulated])| {
            compare(description, channel, &columns.numbers[*measured], &columns.numbers[*simulated])
        })
        .collect();
    let covariate = |name: &String, column: usize| Covariate { name: name.clone(), values: numbers(column) };
    let mut notes = Vec::new();
    if columns.incomplete > 0 {
        notes.push(format!("{} rows lack a value and were left out", columns.incomplete));
    }
    let session = Session {
        channels,
        joints,
        temperature: description
            .covariates
            .temperature
            .as_ref()
            .zip(plan.temperature)
            .map(|(n, c)| covariate(n, c)),
        loads: description.covariates.load.iter().zip(&plan.loads).map(|(n, c)| covariate(n, *c)).collect(),
        kinematics: None,
        hold_out: division::by_point(columns.lines.len()),
        began_s: vec![began_s(time_s.as_deref()); segments.len()],
        doubts: Vec::new(),
        repeats: Vec::new(),
        segments,
        time_s,
        notes,
        arm_columns: std::sync::OnceLock::new(),
    };
    Ok(Assembled { session, recordings })
}

/// The earliest instant (s).
fn began_s(time_s: Option<&[f64]>) -> f64 {
    time_s.map_or(0.0, |time_s| time_s.iter().copied().fold(f64::MAX, f64::min))
}

fn compare(
    description: &Description,
    channel: &description::Channel,
    measured: &[f64],
    simulated: &[f64],
) -> Channel {
    let gap: Vec<f64> = measured.iter().zip(simulated).map(|(m, s)| m - s).collect();
    let quantity = Quantity::of_unit(&channel.unit);
    let rms_gap = session::rms(&gap);
    let length_m = description.characteristic_length_m.filter(|_| quantity == Quantity::Moment);
    Channel {
        name: channel.name.clone(),
        unit: channel.unit.clone(),
        quantity,
        joint: channel.joint.as_ref().and_then(|name| description.joint.iter().position(|j| &j.name == name)),
        simulated: simulated.to_vec(),
        gap,
        // A channel without any gap keeps a scale that can be divided by.
        scale: channel.noise.unwrap_or(if rms_gap > 0.0 { rms_gap } else { 1.0 }),
        floor: if channel.noise.is_some() { 1.0 } else { 0.0 },
        raw_factor: length_m.map_or(1.0, |m| 1.0 / m),
        read: Vec::new(),
        per_nm: f64::from(u8::from(quantity == Quantity::Moment)),
        gauge: None,
    }
}

fn hold_out(
    description: &Description,
    assembled: &Assembled,
    recordings: &[&Recording],
) -> Result<HoldOut, Problem> {
    let rows = assembled.session.rows();
    let reserved = description.hold_out.clone().unwrap_or_default();
    for (index, value) in reserved.iter().enumerate() {
        if recordings.iter().all(|recording| &recording.name != value) {
            let known = recordings.iter().map(|recording| recording.name.as_str());
            let text =
                format!("\"{value}\" is no value of the column `recording`; {}", suggest(value, known));
            return Err(Problem::new(&[Key("hold_out"), Index(index)], text));
        }
    }
    if !recordings.is_empty() && recordings.iter().all(|recording| reserved.contains(&recording.name)) {
        let text = "hold_out keeps every recording from being fitted; leave at least one out of it";
        return Err(Problem::new(&[Key("hold_out")], text));
    }
    Ok(if recordings.len() > 1 {
        division::by_recording(&assembled.recordings, &reserved)
    } else if assembled.session.time_s.is_some() {
        division::by_time(rows)
    } else {
        division::by_point(rows)
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
