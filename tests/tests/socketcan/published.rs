//! Wrenches as they were published, live or offline, and how the two are paired.

use wrenchd_tests::candump::{Line, ROUND, ROUND_ID};
use wrenchd_tests::guest::Captured;
use wrenchd_tests::programs::workspace;
use wrenchd_tests::python::{self, Decoded};
use wrenchd_tests::{Check, Failure, ensure};

/// Status bits: do not use; a gauge is left out; an input is stale; a direction is not known well.
pub(crate) const INVALID: u8 = 1;
pub(crate) const DEGRADED: u8 = 1 << 1;
pub(crate) const STALE: u8 = 1 << 3;
pub(crate) const UNCERTAIN: u8 = 1 << 4;
/// The status of a record that says that no snapshot came.
pub(crate) const SILENCE: u8 = INVALID | STALE;
/// Without a snapshot for so long the bus counts as silent: the default of `stale_after_s`, ns.
pub(crate) const STALE_AFTER_NS: i64 = 20_000_000;
/// How often a silence is told once it has begun, ns.
pub(crate) const SILENCE_PERIOD_NS: i64 = 50_000_000;

/// N and Nm per count of the wrench frames.
const COUNTS: [f64; 6] = [0.01, 0.01, 0.01, 0.001, 0.001, 0.001];
/// The largest number that a wrench frame says.
const MOST_COUNTS: f64 = 32767.0;

/// One wrench, live or offline.
pub(crate) struct Published {
    /// Live: the kernel's stamp of the force frame, since the Unix epoch. Offline: the instant, since the log's first frame. ns.
    pub(crate) time_ns: i64,
    /// N and Nm, force first, in the tip frame; whatever stands there when invalid.
    pub(crate) wrench: [f64; 6],
    /// Standard deviations of the same, where they are known.
    pub(crate) sigma: Option<[f64; 6]>,
    /// Whether force and moment are within what their frames can say.
    pub(crate) in_range: [bool; 2],
    pub(crate) status: u8,
}

/// What the daemon published, as the independent decoder reads it with the shipped DBC: every record's three frames, in order, none
/// left out, the sequence without a gap.
pub(crate) fn decode(captured: &Captured) -> Check<Vec<Published>> {
    let frames = decoded(captured)?;
    ensure!(frames.len().is_multiple_of(3), "{} frames are no whole number of records", frames.len());
    records(&captured.lines, &frames)
}

/// The same of a capture that began and ended while records were on their way: the whole ones among them.
pub(crate) fn decode_cut(captured: &Captured) -> Check<Vec<Published>> {
    let frames = decoded(captured)?;
    let begin = frames.iter().position(|frame| frame.message == "WrenchForce").unwrap_or(frames.len());
    let end = frames.len() - (frames.len() - begin) % 3;
    ensure!(begin < 3, "the first {begin} frames begin no record");
    records(&captured.lines[begin..end], &frames[begin..end])
}

fn decoded(captured: &Captured) -> Check<Vec<Decoded>> {
    let frames = python::decode(&workspace().join("config/wrench.dbc"), &captured.path)?;
    ensure!(frames.len() == captured.lines.len(), "{} lines, {} frames", captured.lines.len(), frames.len());
    Ok(frames)
}

fn records(lines: &[Line], frames: &[Decoded]) -> Check<Vec<Published>> {
    let mut expected: Option<u8> = None;
    let mut published = Vec::with_capacity(frames.len() / 3);
    for (at, (lines, frames)) in lines.chunks(3).zip(frames.chunks(3)).enumerate() {
        let names: Vec<&str> = frames.iter().map(|frame| frame.message.as_str()).collect();
        ensure!(names == ["WrenchForce", "WrenchTorque", "WrenchQuality"], "record {at} is {names:?}");
        let sequence = value(&frames[0], "Sequence")? as u8;
        ensure!(
            expected.is_none_or(|next| next == sequence),
            "record {at}: sequence {sequence}, {expected:?} was due"
        );
        expected = Some(sequence.wrapping_add(1));
        published.push(Published::from_frames(&lines[0], frames)?);
    }
    Ok(published)
}

fn value(frame: &Decoded, signal: &str) -> Check<f64> {
    let found = frame.signals.get(signal).copied();
    found.ok_or_else(|| Failure::new(format!("{} has no {signal}", frame.message)))
}

impl Published {
    fn from_frames(line: &Line, frames: &[Decoded]) -> Check<Self> {
        let (force, torque, quality) = (&frames[0], &frames[1], &frames[2]);
        let all = |signal| -> Check<[u8; 3]> {
            Ok([value(force, signal)? as u8, value(torque, signal)? as u8, value(quality, signal)? as u8])
        };
        let sequences = all("Sequence")?;
        ensure!(sequences == [sequences[0]; 3], "the frames of one record differ in sequence: {sequences:?}");
        // A force or moment beyond its frame's range makes that frame invalid, and that one only.
        let statuses = all("Status")?;
        let [force_status, torque_status, status] = statuses;
        for own in [force_status, torque_status] {
            ensure!(
                own == status || own == status | INVALID,
                "the frames of one record differ in status: {statuses:?}"
            );
        }
        let in_range = [force_status == status, torque_status == status];
        let mut wrench = [0.0; 6];
        let signals =
            [(force, "Fx"), (force, "Fy"), (force, "Fz"), (torque, "Tx"), (torque, "Ty"), (torque, "Tz")];
        for (place, (frame, signal)) in wrench.iter_mut().zip(signals) {
            *place = value(frame, signal)?;
        }
        Ok(Self { time_ns: line.stamp_ns, wrench, sigma: None, in_range, status })
    }

    /// A row of `validate --csv`; where there is no wrench its numbers say nan.
    pub(crate) fn from_row(row: &str) -> Check<Self> {
        let fields: Vec<&str> = row.split(',').collect();
        ensure!(fields.len() == 14, "a row of {} fields: {row}", fields.len());
        let mut numbers = [0.0_f64; 13];
        for (number, field) in numbers.iter_mut().zip(&fields) {
            *number = field.parse()?;
        }
        let status: u8 = fields[13].parse()?;
        let six = |from: usize| std::array::from_fn(|k| numbers[from + k]);
        let wrench: [f64; 6] = six(1);
        let fits = |axis: usize, value: &f64| value.abs() <= MOST_COUNTS * COUNTS[axis];
        let published = Self {
            time_ns: (numbers[0] * 1e9).round() as i64,
            wrench,
            sigma: Some(six(7)),
            in_range: [0, 3].map(|from| (from..from + 3).all(|axis| fits(axis, &wrench[axis]))),
            status,
        };
        let finite = numbers.iter().all(|number| number.is_finite());
        ensure!(finite == published.is_valid(), "status {status} does not fit the row {row}");
        Ok(published)
    }

    pub(crate) fn is_valid(&self) -> bool {
        self.status & INVALID == 0
    }

    /// The force's magnitude.
    pub(crate) fn force_n(&self) -> f64 {
        self.wrench[..3].iter().map(|force| force * force).sum::<f64>().sqrt()
    }
}

/// Pairs what was published live, in event mode, with what was computed offline from what the daemon `recorded`: one to one, in order. What is left over must be records of silence: invalid and stale, and only before the first instant, after the last,
/// or where no round was complete for longer than [`STALE_AFTER_NS`].
pub(crate) fn pair<'a>(
    live: &'a [Published],
    offline: &'a [Published],
    recorded: &[Line],
) -> Check<Vec<(&'a Published, &'a Published)>> {
    let first_ns = recorded.first().map_or(0, |line| line.stamp_ns);
    let last = [ROUND_ID, ROUND[ROUND.len() - 1]];
    let complete_ns: Vec<i64> =
        recorded.iter().filter(|line| last.contains(&line.id.as_str())).map(|line| line.stamp_ns).collect();
    let silent = |records: &[Published]| records.iter().take_while(|record| record.status == SILENCE).count();
    let mut pairs = Vec::with_capacity(offline.len());
    let mut at = 0;
    loop {
        // An instant may look like silence (a joint not known yet); which of a row of them is which makes no difference.
        let next = pairs.len();
        let (told, meant) = (silent(&live[at..]), silent(&offline[next..]));
        ensure!(told >= meant, "records {at}..: {told} silent ones live, {meant} offline");
        let before = at.checked_sub(1).map(|before| live[before].time_ns);
        at += told;
        pairs.extend(live[at - meant..at].iter().zip(&offline[next..]));
        let may = silences(&complete_ns, before, live.get(at).map(|after| after.time_ns));
        let told = told - meant;
        ensure!(told <= may, "before record {at} silence is told {told} times, not up to {may}");
        match (live.get(at), offline.get(next + meant)) {
            (Some(live), Some(offline)) => {
                let after_ns = live.time_ns - first_ns - offline.time_ns;
                ensure!(after_ns > 0, "record {at} was published {after_ns} ns after its instant");
                pairs.push((live, offline));
                at += 1;
            }
            (None, None) => return Ok(pairs),
            (live, _) => {
                let which = if live.is_some() { "live" } else { "offline" };
                let count = pairs.len();
                return Err(Failure::new(format!("{count} wrenches pair, then there are more {which} only")));
            }
        }
    }
}

/// How often silence may be told between a wrench and the next, by when rounds were complete: what the daemon takes for the instants that
/// they tell of may lie closer together. Stamps are from when a frame was sent; where a flood of datagrams kept the kernel from handing it on,
/// the daemon, too, heard nothing until then (seen: 1.5 ms on top of 19), and had published nothing for so long.
fn silences(complete_ns: &[i64], from_ns: Option<i64>, to_ns: Option<i64>) -> usize {
    let (Some(from_ns), Some(to_ns)) = (from_ns, to_ns) else { return usize::MAX };
    let until = |at_ns: i64| complete_ns.partition_point(|complete_ns| *complete_ns <= at_ns);
    let rounds = complete_ns.get(until(from_ns).saturating_sub(1)..until(to_ns)).unwrap_or_default();
    let tellings =
        |wait_ns: i64| if wait_ns < STALE_AFTER_NS { 0 } else { 1 + (wait_ns / SILENCE_PERIOD_NS) as usize };
    let on_the_bus: usize = rounds.windows(2).map(|pair| tellings(pair[1] - pair[0])).sum();
    on_the_bus.max(tellings(to_ns - from_ns))
}

/// In event mode every wrench equals the offline one: the same status, and each axis within one count of the frame's scaling.
pub(crate) fn ensure_equal(pairs: &[(&Published, &Published)]) -> Check {
    for (at, (live, offline)) in pairs.iter().enumerate() {
        let (a, b) = (live.status, offline.status);
        ensure!(a == b, "wrench {at}: status {a:#04x} live, {b:#04x} offline");
        if !live.is_valid() {
            continue;
        }
        ensure!(
            live.in_range == offline.in_range,
            "wrench {at}: in range {:?} live, {:?} offline",
            live.in_range,
            offline.in_range
        );
        for (axis, (a, b)) in live.wrench.iter().zip(offline.wrench).enumerate() {
            let close = (a - b).abs() <= COUNTS[axis] || !live.in_range[axis / 3];
            ensure!(close, "wrench {at}, axis {axis}: {a} live, {b} offline");
        }
    }
    Ok(())
}
