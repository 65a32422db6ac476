//! A recording as columns: instants, joint positions, gauge counts.

use can::assembly::{Assembler, AssemblyCounts, Snapshot};
use can::candump::{Interfaces, LogEvent, LogReader, ReadAhead};
use can::frame::Stamped;
use model::motion::{RoundClock, Sampled};
use rig::run::{Exclude, Loads, Reference};
use rig::{Rig, Run};

use crate::error::Error;
use crate::keep::{Keep, Thinning};

/// All instants of one recording at which every joint is known, by column, with what acted on the tip.
#[derive(Clone, Debug)]
pub struct Recording {
    /// What to call it in messages.
    pub name: String,
    /// Recordings with the same session share the gauges' zeros.
    pub session: String,
    /// Stamp of the log's first frame, ns since the Unix epoch: the zero of the loads' clock.
    pub start_ns: i64,
    /// The last instant that was met, kept or not, ns since the Unix epoch.
    pub end_ns: i64,
    /// Instants, strictly rising, ns since the Unix epoch.
    pub at_ns: Vec<i64>,
    /// The same by the boards' own time, which does not follow the stamps' scatter.
    pub sampled: Vec<Sampled>,
    /// Position of each coordinate at each instant: `[coordinate][instant]`, rad.
    pub positions_rad: Vec<Vec<f64>>,
    /// Velocity of each coordinate where it is measured: `[coordinate][instant]`, rad/s; empty where it never is.
    pub velocities_rad_s: Vec<Vec<f64>>,
    /// Reading of each gauge at each instant: `[gauge][instant]`, counts; `None` where absent.
    pub counts: Vec<Vec<Option<f64>>>,
    /// Temperature of each gauge at each instant: `[gauge][instant]`, degC; `None` where absent.
    pub temperatures_c: Vec<Vec<Option<f64>>>,
    /// What hung on the tip.
    pub loads: Loads,
    /// What is not to be used.
    pub excludes: Vec<Exclude>,
    /// Wrench measured or known at the tip beside the loads.
    pub reference: Option<Reference>,
    /// What was met on the way.
    pub met: AssemblyCounts,
    /// That it is not the whole log, in words.
    pub thinned: Option<String>,
}

impl Recording {
    /// Reads a run's log, all of it. `progress` is told how many bytes of text were read so far.
    pub fn read(run: &Run, rig: &Rig, progress: impl FnMut(u64)) -> Result<Self, Error> {
        Self::read_some(run, rig, Keep::Everything, progress)
    }

    /// Reads a run's log and keeps as much of it as it should.
    pub fn read_some(run: &Run, rig: &Rig, keep: Keep, mut progress: impl FnMut(u64)) -> Result<Self, Error> {
        let name = run.dir.display().to_string();
        let session = run.session.clone().unwrap_or_else(|| name.clone());
        let mut builder = Builder::new(rig, name, session, keep)?;
        for_each_frame(run, |frame, bytes| {
            builder.push(frame);
            progress(bytes);
        })?;
        let mut recording = builder.finish()?;
        recording.loads = run.loads.clone();
        recording.excludes = run.excludes.clone();
        recording.reference = run.reference.clone();
        if recording.met.steps_back > 0 {
            let problem = format!(
                "its time steps back {} times: loads and reference cannot be placed; `wrenchctl stats` shows where, cut the log there",
                recording.met.steps_back
            );
            return Err(Error::data(run.log.display(), problem));
        }
        run.check_span((recording.end_ns - recording.start_ns) as f64 * 1e-9)?;
        Ok(recording)
    }

    /// Takes in frames from anywhere, e.g. a simulator; loads, excludes and reference are then set by the caller.
    pub fn from_frames(
        rig: &Rig,
        name: &str,
        frames: impl IntoIterator<Item = Stamped>,
    ) -> Result<Self, Error> {
        let mut builder = Builder::new(rig, name.to_owned(), name.to_owned(), Keep::Everything)?;
        for frame in frames {
            builder.push(&frame);
        }
        builder.finish()
    }

    /// Number of instants.
    pub fn len(&self) -> usize {
        self.at_ns.len()
    }

    /// Whether there are no instants.
    pub fn is_empty(&self) -> bool {
        self.at_ns.is_empty()
    }

    /// An instant on the loads' clock: s from the log's first frame.
    pub fn time_s(&self, instant: usize) -> f64 {
        (self.at_ns[instant] - self.start_ns) as f64 * 1e-9
    }

    /// What was odd about the frames, as one line for a person; `None` where nothing was.
    pub fn oddities(&self) -> Option<String> {
        let met = &self.met;
        let odd = [
            (met.wrong_length, "frames of wrong length"),
            (met.missed, "missed messages"),
            (met.repeated + met.duplicates, "repeated frames"),
            (met.late, "late frames"),
            (met.steps_back, "steps back of the clock"),
            (met.steps_forward, "steps forward of the clock"),
        ];
        let said: Vec<String> =
            odd.iter().filter(|(n, _)| *n > 0).map(|(n, what)| format!("{n} {what}")).collect();
        let silent: Vec<String> = self
            .counts
            .iter()
            .enumerate()
            .map(|(gauge, readings)| (gauge, readings.iter().flatten().count()))
            .filter(|(_, n)| *n * 20 < self.len() * 19)
            .map(|(gauge, n)| format!("gauge {} reads at {n} of {} instants", gauge + 1, self.len()))
            .collect();
        let all: Vec<String> = said.into_iter().chain(silent).collect();
        (!all.is_empty())
            .then(|| format!("{}: {}; the rest is used as far as it goes", self.name, all.join(", ")))
    }

    /// Whether a time (s from the log's first frame) is excluded.
    pub fn is_excluded(&self, t_s: f64) -> bool {
        self.excludes.iter().any(|e| e.from_s <= t_s && t_s < e.to_s)
    }
}

/// Hands every frame of a run's log to `take`, with the number of bytes read so far. Another thread reads ahead.
pub fn for_each_frame(run: &Run, mut take: impl FnMut(&Stamped, u64)) -> Result<(), Error> {
    let reader = LogReader::open(&run.log, Interfaces::fixed(&run.config.bus.interfaces))?;
    let mut reader = ReadAhead::new(reader);
    while let Some(event) = reader.next_event()? {
        if let LogEvent::Frame(frame) = event {
            take(&frame, reader.bytes());
        }
    }
    let counts = reader.counts();
    if counts.frames == 0 {
        let interfaces = run.config.bus.interfaces.join(", ");
        let problem = format!(
            "has no frame of {interfaces} in {} lines ({} malformed, {} of other interfaces); give the log that belongs to this configuration",
            counts.lines, counts.malformed, counts.foreign
        );
        return Err(Error::data(run.log.display(), problem));
    }
    Ok(())
}

struct Builder {
    assembler: Assembler,
    recording: Recording,
    clock: RoundClock,
    thinning: Thinning,
    started: bool,
}

impl Builder {
    fn new(rig: &Rig, name: String, session: String, keep: Keep) -> Result<Self, Error> {
        let (coordinates, gauges) = (rig.chain.coordinates(), rig.sections.len());
        let recording = Recording {
            name,
            session,
            start_ns: 0,
            end_ns: 0,
            at_ns: Vec::new(),
            sampled: Vec::new(),
            positions_rad: vec![Vec::new(); coordinates],
            velocities_rad_s: vec![Vec::new(); coordinates],
            counts: vec![Vec::new(); gauges],
            temperatures_c: vec![Vec::new(); gauges],
            loads: Loads::default(),
            excludes: Vec::new(),
            reference: None,
            met: AssemblyCounts::default(),
            thinned: None,
        };
        Ok(Self {
            assembler: Assembler::new(&rig.layout)?,
            recording,
            clock: RoundClock::default(),
            thinning: Thinning::new(keep),
            started: false,
        })
    }

    fn push(&mut self, frame: &Stamped) {
        if !self.started {
            self.recording.start_ns = frame.stamp_ns;
            self.started = true;
        }
        for snapshot in self.assembler.push(frame) {
            let sampled = self.clock.observe(snapshot.instant_ns, snapshot.cycles);
            if !is_usable(&self.recording, snapshot) {
                continue;
            }
            self.recording.end_ns = snapshot.instant_ns;
            if self.thinning.admits(&mut self.recording, snapshot.instant_ns) {
                append(&mut self.recording, snapshot, sampled);
            }
        }
    }

    fn finish(mut self) -> Result<Recording, Error> {
        self.recording.met = self.assembler.counts();
        self.recording.thinned = self.thinning.words(&self.recording);
        if self.recording.is_empty() {
            let met = &self.recording.met;
            let problem = format!(
                "no instant has a position of every joint ({} frames, {} of no configured message, {} of wrong length); check interface names, the DBC and the [[joint]] signals",
                met.frames, met.unbound, met.wrong_length
            );
            return Err(Error::data(&self.recording.name, problem));
        }
        let n = self.recording.len();
        for velocities in &mut self.recording.velocities_rad_s {
            if velocities.len() < n {
                velocities.clear();
            }
        }
        Ok(self.recording)
    }
}

/// Whether every joint was read at its own instant; other snapshots are no use for calibration.
fn is_usable(recording: &Recording, snapshot: &Snapshot) -> bool {
    let rising = recording.is_empty() || snapshot.instant_ns > recording.end_ns;
    rising && snapshot.joints.iter().all(|joint| joint.position.is_ok())
}

fn append(recording: &mut Recording, snapshot: &Snapshot, sampled: Sampled) {
    recording.at_ns.push(snapshot.instant_ns);
    recording.sampled.push(sampled);
    for (joint, column) in snapshot.joints.iter().zip(&mut recording.positions_rad) {
        column.extend(joint.position.iter().map(|reading| reading.value));
    }
    for (joint, column) in snapshot.joints.iter().zip(&mut recording.velocities_rad_s) {
        column.extend(joint.velocity.iter().map(|reading| reading.value));
    }
    for (gauge, column) in snapshot.gauges.iter().zip(&mut recording.counts) {
        column.push(gauge.ok().map(|reading| reading.value));
    }
    for (temperature, column) in snapshot.temperatures.iter().zip(&mut recording.temperatures_c) {
        column.push(temperature.ok().map(|reading| reading.value));
    }
}
