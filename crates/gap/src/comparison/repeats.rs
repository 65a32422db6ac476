//! Recordings with the same motion and load as an earlier one: what differs between them is noise, and neither is news to
//! the other.

use crate::division::Recording;
use crate::session::{Session, rms};

/// Largest difference of repeated motion, as a share of how much the signal moves.
const TOLERANCE: f64 = 0.03;

/// Marks repeats, and takes the channels' floor from them where no noise is given: half the variance of the difference.
pub(super) fn find(session: &mut Session, recordings: &mut [Recording]) {
    let mut pairs = Vec::new();
    for later in 1..recordings.len() {
        let first = (0..later).find(|first| {
            recordings[*first].repeats.is_none()
                && is_repeat(session, &recordings[*first], &recordings[later])
        });
        recordings[later].repeats = first;
        pairs.extend(first.map(|first| (recordings[first].rows.start, recordings[later].rows.clone())));
    }
    for channel in session.channels.iter_mut().filter(|channel| channel.floor == 0.0) {
        let mut differences = Vec::new();
        for (start, rows) in &pairs {
            differences
                .extend(rows.clone().map(|row| channel.gap[row] - channel.gap[start + row - rows.start]));
        }
        channel.floor = rms(&differences) / std::f64::consts::SQRT_2 / channel.scale;
    }
    for recording in recordings.iter() {
        if let Some(first) = recording.repeats {
            let (name, first) = (&recording.name, &recordings[first].name);
            session.notes.push(format!("recording {name} repeats {first}: they are left out together"));
        }
    }
}

/// Whether all that was commanded is the same, instant by instant: the joints where they are known, else the simulation.
fn is_repeat(session: &Session, first: &Recording, later: &Recording) -> bool {
    if first.rows.len() != later.rows.len() || first.rows.len() < 3 {
        return false;
    }
    let commanded: Vec<&[f64]> = if session.joints.is_empty() {
        session.channels.iter().map(|channel| channel.simulated.as_slice()).collect()
    } else {
        session.joints.iter().map(|joint| joint.position_rad.as_slice()).collect()
    };
    let loads = session.loads.iter().map(|load| load.values.as_slice());
    let moves = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        rms(&values.iter().map(|v| v - mean).collect::<Vec<f64>>())
    };
    let mut some_moves = false;
    for values in commanded.into_iter().chain(loads) {
        let (a, b) = (&values[first.rows.clone()], &values[later.rows.clone()]);
        let difference = rms(&a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<f64>>());
        let size = moves(a);
        some_moves |= size > 0.0;
        if difference > TOLERANCE * size && difference > 1e-9 * a[0].abs() {
            return false;
        }
    }
    some_moves
}
