//! Recordings of the arm as a session: measured counts beside those that motion, loads and the model predict.

mod doubt;
mod predict;
mod repeats;

use std::path::Path;

use calibration::Recording;
use model::chain::Chain;
use model::motion::{JointMotion, smooth};
use rig::{ModelFile, Rig, Run};

use crate::Error;
use crate::division;
use crate::session::{Channel, Gauge, Joint, Kinematics, Quantity, Sensing, Session};
use predict::Prediction;

/// So close to a change of the load it is not known which of them hung there, s.
const CHANGE_S: f64 = 0.02;
/// Stretches further apart than this are no uninterrupted history, s.
const INTERRUPTION_S: f64 = 0.5;

/// Instants at which the motion's uncertainty adds more than this share of a gauge's noise variance are not used for it: where a
/// recording begins or ends in motion, or an acceleration jumps.
const MOST_OF_MOTION: f64 = 4.0;

/// The session of runs of one robot: what the model makes of motion and loads, beside what was read.
///
/// # Errors
/// Nothing of the runs can be compared, with what to record instead.
pub fn session(rig: &Rig, model: &ModelFile, runs: &[(&Run, &Recording)]) -> Result<Session, Error> {
    let mut table = Table::new(rig);
    let mut prediction = Prediction::new(rig, model);
    for (run, recording) in runs {
        table.append(run, recording, model, &mut prediction)?;
    }
    table.session(rig, model, runs, prediction)
}

/// The name by which other runs refer to a run.
pub(crate) fn name_of(run: &Run) -> String {
    let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
    let real = std::fs::canonicalize(&run.dir).ok();
    name(&run.dir).or_else(|| name(&real?)).unwrap_or_else(|| run.dir.display().to_string())
}

/// Columns over all instants of all runs.
pub(super) struct Table {
    pub(super) time_s: Vec<f64>,
    pub(super) motion: Vec<[Vec<f64>; 3]>,
    pub(super) channels: Vec<Readings>,
    rows_of_run: Vec<std::ops::Range<usize>>,
    /// First stamp of all, ns.
    origin_ns: Option<i64>,
}

/// One gauge over all instants.
#[derive(Default)]
pub(super) struct Readings {
    /// Counts; none where absent.
    pub(super) counts: Vec<Option<f64>>,
    pub(super) temperature_c: Vec<Option<f64>>,
}

impl Table {
    fn new(rig: &Rig) -> Self {
        Self {
            time_s: Vec::new(),
            motion: (0..rig.chain.coordinates()).map(|_| Default::default()).collect(),
            channels: rig.sections.iter().map(|_| Readings::default()).collect(),
            rows_of_run: Vec::new(),
            origin_ns: None,
        }
    }

    fn append(
        &mut self,
        run: &Run,
        recording: &Recording,
        model: &ModelFile,
        prediction: &mut Prediction,
    ) -> Result<(), Error> {
        let first = self.time_s.len();
        let origin_ns = *self.origin_ns.get_or_insert(recording.start_ns);
        if recording.start_ns < origin_ns {
            return Err(Error::run(
                run.dir.display(),
                "was recorded before the run named first; give the runs in the order in which they were recorded",
            ));
        }
        let smoothed = smoothed(recording, model);
        prediction.begin();
        for instant in 0..recording.len() {
            let t_s = recording.time_s(instant);
            let motion: Vec<JointMotion> = smoothed.iter().map(|column| column[instant]).collect();
            prediction.condition(recording, instant);
            let is_changing = recording.loads.at(t_s - CHANGE_S) != recording.loads.at(t_s + CHANGE_S);
            if recording.is_excluded(t_s) || (is_changing && instant > 0) {
                continue;
            }
            prediction.row(recording, t_s, &motion);
            self.time_s.push((recording.at_ns[instant] - origin_ns) as f64 * 1e-9);
            for (columns, joint) in self.motion.iter_mut().zip(&motion) {
                columns[0].push(joint.position_rad);
                columns[1].push(joint.velocity_rad_s);
                columns[2].push(joint.acceleration_rad_s2);
            }
            for (gauge, readings) in self.channels.iter_mut().enumerate() {
                readings.counts.push(recording.counts[gauge][instant]);
                readings.temperature_c.push(recording.temperatures_c[gauge][instant]);
            }
        }
        if self.time_s.len() == first {
            return Err(Error::run(
                run.dir.display(),
                "has no instant outside its [[exclude]] stretches; leave the run out, or correct them",
            ));
        }
        self.rows_of_run.push(first..self.time_s.len());
        Ok(())
    }

    fn session(
        self,
        rig: &Rig,
        model: &ModelFile,
        runs: &[(&Run, &Recording)],
        prediction: Prediction,
    ) -> Result<Session, Error> {
        let (segments, began_s) = self.segments(runs);
        let doubts = doubt::doubts(rig, &self, &prediction);
        let channels = self.gauges(rig, model, &prediction)?;
        let notes = notes(runs, &channels);
        let recordings: Vec<division::Recording> = self.recordings(runs);
        let hold_out = division::by_second(&recordings, &self.time_s);
        let repeats = repeats::repeats(&recordings, &self.motion);
        let kinematics = kinematics(prediction.chain.clone(), &channels, rig, &prediction);
        let names = rig.chain.coordinate_names();
        let joint = |(name, [position, velocity, acceleration]): (&&str, [Vec<f64>; 3])| Joint {
            name: (*name).to_owned(),
            position_rad: position,
            velocity_rad_s: Some(velocity),
            acceleration_rad_s2: Some(acceleration),
        };
        Ok(Session {
            channels,
            time_s: Some(self.time_s),
            segments,
            joints: names.iter().zip(self.motion).map(joint).collect(),
            temperature: None,
            began_s,
            doubts,
            loads: Vec::new(),
            kinematics: Some(kinematics),
            hold_out,
            repeats,
            notes,
            arm_columns: std::sync::OnceLock::new(),
        })
    }

    /// Rows without an interruption, over the borders of runs of one session, each with the beginning of its session (s).
    fn segments(&self, runs: &[(&Run, &Recording)]) -> (Vec<std::ops::Range<usize>>, Vec<f64>) {
        let (mut segments, mut began_s): (Vec<std::ops::Range<usize>>, Vec<f64>) = (Vec::new(), Vec::new());
        for (index, rows) in self.rows_of_run.iter().enumerate() {
            let session = &runs[index].1.session;
            let begins = (0..index)
                .find(|other| &runs[*other].1.session == session)
                .map_or(self.time_s[rows.start], |other| self.time_s[self.rows_of_run[other].start]);
            let continues = index > 0 && &runs[index - 1].1.session == session;
            for row in rows.clone() {
                let is_next = row > 0 && {
                    let step_s = self.time_s[row] - self.time_s[row - 1];
                    step_s > 0.0 && step_s <= INTERRUPTION_S
                };
                match segments.last_mut() {
                    Some(last) if is_next && (row > rows.start || continues) => last.end = row + 1,
                    _ => {
                        segments.push(row..row + 1);
                        began_s.push(begins);
                    }
                }
            }
        }
        (segments, began_s)
    }

    fn recordings(&self, runs: &[(&Run, &Recording)]) -> Vec<division::Recording> {
        let names: Vec<String> = runs.iter().map(|(run, _)| name_of(run)).collect();
        let repeats = |a: usize, b: usize| runs[a].0.repeat_of.as_ref() == Some(&names[b]);
        let earlier = |index: usize| {
            (0..index).find(|other| {
                let same =
                    runs[index].0.repeat_of.is_some() && runs[index].0.repeat_of == runs[*other].0.repeat_of;
                repeats(index, *other) || repeats(*other, index) || same
            })
        };
        let recording = |(index, rows): (usize, &std::ops::Range<usize>)| division::Recording {
            name: names[index].clone(),
            rows: rows.clone(),
            repeats: earlier(index),
        };
        self.rows_of_run.iter().enumerate().map(recording).collect()
    }

    fn gauges(&self, rig: &Rig, model: &ModelFile, prediction: &Prediction) -> Result<Vec<Channel>, Error> {
        let mut channels = Vec::with_capacity(self.channels.len());
        for (index, readings) in self.channels.iter().enumerate() {
            let gauge = &prediction.gauges[index];
            let simulated = &prediction.signals[index];
            let motion_counts2 = &prediction.motion_counts2[index];
            let most_counts2 = (MOST_OF_MOTION * gauge.noise_counts2) as f32;
            let is_sure = |row: usize| motion_counts2[row] <= most_counts2;
            let read: Vec<bool> =
                (0..simulated.len()).map(|row| readings.counts[row].is_some() && is_sure(row)).collect();
            let gap = |(row, counts): (usize, &Option<f64>)| {
                counts.filter(|_| read[row]).map_or(0.0, |z| z - simulated[row] - gauge.bias_counts)
            };
            let gap = readings.counts.iter().enumerate().map(gap).collect();
            let motion_mean = mean_of(motion_counts2, &read) / gauge.noise_counts2;
            let section = &rig.sections[index];
            let joint = &rig.chain.joints[section.joint];
            let moment = gauge.compliance.fixed_rows::<3>(3).into_owned();
            let per_nm = joint.coordinate.map_or(0.0, |_| moment.dot(&section.r_cs.tr_mul(&joint.axis)));
            channels.push(Channel {
                name: model.sensors[index].name.clone(),
                unit: "counts".to_owned(),
                quantity: Quantity::Other,
                joint: joint.coordinate,
                simulated: simulated.clone(),
                gap,
                scale: model.sensors[index].noise_floor_counts,
                floor: (1.0 + motion_mean).sqrt(),
                raw_factor: 1.0,
                read: if read.iter().all(|read| *read) { Vec::new() } else { read },
                per_nm,
                gauge: Some(Gauge {
                    compliance: gauge.compliance,
                    bias_counts: gauge.bias_counts,
                    loads: prediction.loads[index].clone(),
                    temperature_c: filled(&readings.temperature_c),
                }),
            });
        }
        if channels.iter().all(|channel| channel.count() == 0) {
            let text = "no gauge has a single usable reading: all are saturated or absent, so nothing can be concluded of any \
                        effect; lower the amplifiers' gain or the load, look with `wrenchctl stats --config`, and record again";
            return Err(Error::run("the runs", text));
        }
        Ok(channels)
    }
}

/// Mean over the rows that count.
fn mean_of(values: &[f32], counts: &[bool]) -> f64 {
    let used =
        || values.iter().zip(counts).filter(|(_, counts)| **counts).map(|(value, _)| f64::from(*value));
    used().sum::<f64>() / used().count().max(1) as f64
}

/// Motion of every coordinate at every instant, without lag. Coordinates are independent and take a thread each.
fn smoothed(recording: &Recording, model: &ModelFile) -> Vec<Vec<JointMotion>> {
    let positions = &recording.positions_rad;
    std::thread::scope(|scope| {
        let workers: Vec<_> = positions
            .iter()
            .enumerate()
            .map(|(k, q)| {
                let sigma_rad = model.encoder(k).position_sigma_rad;
                scope.spawn(move || smooth(&recording.sampled, q, sigma_rad))
            })
            .collect();
        let joined = workers.into_iter().map(std::thread::ScopedJoinHandle::join);
        joined.map(|motion| motion.unwrap_or_else(|panic| std::panic::resume_unwind(panic))).collect()
    })
}

/// A temperature that was read somewhere, held where it was not.
fn filled(readings: &[Option<f64>]) -> Option<Vec<f64>> {
    let mut last = *readings.iter().flatten().next()?;
    let held = readings.iter().map(|reading| {
        last = reading.unwrap_or(last);
        last
    });
    Some(held.collect())
}

fn kinematics(chain: Chain, channels: &[Channel], rig: &Rig, prediction: &Prediction) -> Kinematics {
    let has_masses = chain.joints.iter().any(|joint| joint.body.mass_kg > 0.0);
    let sensing = |(channel, section): (usize, &model::chain::Section)| Sensing {
        channel,
        section: *section,
        row: prediction.gauges[channel].compliance,
    };
    Kinematics {
        joints: (0..chain.coordinates()).collect(),
        chain,
        has_masses,
        sensing: rig.sections.iter().enumerate().take(channels.len()).map(sensing).collect(),
        carried: prediction.carried.clone(),
        wrench: prediction.wrenches.clone(),
    }
}

/// What the runs leave open, and what to record for it.
fn notes(runs: &[(&Run, &Recording)], channels: &[Channel]) -> Vec<String> {
    let mut notes: Vec<String> = runs.iter().filter_map(|(_, recording)| recording.thinned.clone()).collect();
    notes.extend(runs.iter().filter_map(|(_, recording)| recording.oddities()));
    let loads = || runs.iter().flat_map(|(run, _)| run.loads.intervals());
    if loads().all(|load| load.mass_kg == 0.0) && runs.iter().all(|(run, _)| run.reference.is_none()) {
        notes.push(
            "no run says what hung on the tip ([[load]]) or pushed it (reference): mass, scale and encoder zeros are hard to tell apart, \
             and what pushes the tip counts as a gap; record one run with a known weight"
                .to_owned(),
        );
    }
    if runs.len() > 1 && runs.iter().all(|(run, _)| run.repeat_of.is_none()) {
        notes.push(
            "no run repeats another (repeat_of): that noise is what the model says of it is taken for granted; record one motion twice"
                .to_owned(),
        );
    }
    for channel in channels {
        let (read, rows) = (channel.count(), channel.gap.len());
        if read * 20 < rows * 19 {
            notes.push(format!(
                "{} has a usable reading at {read} of {rows} instants (elsewhere saturated, absent, or in a motion too uncertain): nothing is concluded from the others",
                channel.name
            ));
        }
    }
    notes
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests;
