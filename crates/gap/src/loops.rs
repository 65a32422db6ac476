//! Loops: what is left on average where a quantity rises, beside where it falls. They open where something remembers (a gauge's
//! hysteresis, a lag) or brakes (friction), and stay closed where the gap is a function of the quantity alone.

use crate::diagnosis::{Finding, Loop, LoopPoint};
use crate::location::Residuals;
use crate::session::{Channel, Session};

/// Intervals of the quantity, with equally many rows each.
const POINTS: usize = 16;
/// Rows over which a quantity rises or falls.
const REACH: usize = 4;
/// Rows of one direction in an interval from which a mean is worth showing.
const FEWEST: usize = 8;
/// Loops at most.
const MOST: usize = 8;

/// Effects that depend on where a gauge's signal comes from, and on where its joint does.
const OF_SIGNAL: [&str; 4] = ["hysteresis", "creep", "delay", "lowpass"];
const OF_ANGLE: [&str; 2] = ["friction", "cable_drag"];

/// The loops that tell something: of the channels with such findings.
pub(crate) fn of(session: &Session, findings: &[Finding], left: &Residuals) -> Vec<Loop> {
    let mut out: Vec<Loop> = Vec::new();
    for finding in findings {
        let id = finding.effect.as_str();
        let sits = |channel: &&Channel| finding.sensors.contains(&channel.name);
        for (index, channel) in session.channels.iter().enumerate().filter(|(_, channel)| sits(channel)) {
            let quantity = if OF_SIGNAL.contains(&id) {
                Some((channel.name.as_str(), channel.unit.as_str(), &channel.simulated))
            } else if OF_ANGLE.contains(&id) {
                let joint = channel.joint.map(|joint| &session.joints[joint]);
                joint.map(|joint| (joint.name.as_str(), "rad", &joint.position_rad))
            } else {
                None
            };
            let Some((over, unit, values)) = quantity else { continue };
            let is_known = |known: &Loop| known.sensor == channel.name && known.over == over;
            if out.len() < MOST && !out.iter().any(is_known) {
                let points = points(session, channel, values, &left[index]);
                out.push(Loop {
                    sensor: channel.name.clone(),
                    over: over.to_owned(),
                    unit: unit.to_owned(),
                    points,
                });
            }
        }
    }
    out
}

fn points(session: &Session, channel: &Channel, values: &[f64], left: &[Option<f64>]) -> Vec<LoopPoint> {
    let mut rows: Vec<(usize, bool)> = Vec::with_capacity(values.len());
    for segment in session.segments.iter().filter(|segment| segment.len() > REACH) {
        let inside = segment.start..segment.end - REACH;
        let steps = inside.map(|row| (row + REACH / 2, values[row + REACH] - values[row]));
        rows.extend(
            steps.filter(|(row, step)| *step != 0.0 && left[*row].is_some()).map(|(r, s)| (r, s > 0.0)),
        );
    }
    rows.sort_by(|a, b| values[a.0].total_cmp(&values[b.0]));
    let parts = rows.chunks(rows.len().div_ceil(POINTS).max(1));
    let point = |part: &[(usize, bool)]| {
        let at = part.iter().map(|(row, _)| values[*row]).sum::<f64>() / part.len() as f64;
        let mean = |rising: bool, of: &dyn Fn(usize) -> f64| {
            let own = || part.iter().filter(|(_, is)| *is == rising).map(|(row, _)| of(*row));
            let count = own().count();
            (count >= FEWEST).then(|| own().sum::<f64>() / count as f64)
        };
        let before = |row: usize| channel.gap[row] / channel.scale;
        let after = |row: usize| left[row].unwrap_or(0.0);
        LoopPoint {
            at,
            rising_before: mean(true, &before),
            falling_before: mean(false, &before),
            rising_after: mean(true, &after),
            falling_after: mean(false, &after),
        }
    };
    parts.map(point).collect()
}
