//! The gap by order: cycles per turn of a joint, at which gears ripple.

use crate::diagnosis::Bin;
use crate::location::Residuals;
use crate::session::Session;
use crate::spectrum::power_by_order;

/// Lower orders are what weight makes of the angle, and nobody's gear has higher ones.
const LOWEST: usize = 4;
const HIGHEST: usize = 400;
/// Bands an octave.
const BANDS: f64 = 3.0;
/// Rows that are looked at, at most: orders show in any of them.
const MOST_ROWS: usize = 4000;

/// Per joint with channels of its own the strongest wave of each band, RMS over scales.
pub(crate) fn bands(session: &Session, before: &Residuals, after: &Residuals) -> Vec<Bin> {
    let mut out = Vec::new();
    if session.joints.iter().all(|joint| joint.velocity_rad_s.is_none()) {
        return out;
    }
    let edges = edges();
    for (index, joint) in session.joints.iter().enumerate() {
        let own: Vec<usize> =
            (0..session.channels.len()).filter(|k| session.channels[*k].joint == Some(index)).collect();
        if own.is_empty() {
            continue;
        }
        let strongest = |of: &Residuals| {
            let all = own.iter().map(|channel| rms_by_order(&joint.position_rad, &of[*channel]));
            let all: Vec<Vec<f64>> = all.collect();
            let band = |from: usize, to: usize| {
                let waves = (from..to).map(|order| all.iter().map(|own| own[order]).fold(0.0, f64::max));
                waves.fold(0.0, f64::max)
            };
            edges.windows(2).map(|edge| band(edge[0], edge[1])).collect::<Vec<f64>>()
        };
        let (before, after) = (strongest(before), strongest(after));
        out.extend(edges.windows(2).zip(before.into_iter().zip(after)).map(|(edge, (before, after))| Bin {
            name: joint.name.clone(),
            from: edge[0] as f64,
            to: edge[1] as f64,
            unit: "cycles/rev".to_owned(),
            before,
            after,
        }));
    }
    out
}

fn edges() -> Vec<usize> {
    let octaves = (HIGHEST as f64 / LOWEST as f64).log2();
    let count = (octaves * BANDS).round() as usize;
    let edge = |k: usize| LOWEST as f64 * (octaves * k as f64 / count as f64).exp2();
    let mut edges: Vec<usize> = (0..=count).map(|k| edge(k).round() as usize).collect();
    edges.dedup();
    edges
}

/// RMS of the wave of every order.
fn rms_by_order(angle_rad: &[f64], left: &[Option<f64>]) -> Vec<f64> {
    let step = angle_rad.len().div_ceil(MOST_ROWS).max(1);
    let known: Vec<(f64, f64)> =
        angle_rad.iter().zip(left).step_by(step).filter_map(|(q, v)| Some((*q, (*v)?))).collect();
    let count = known.len().max(1) as f64;
    let mean = known.iter().map(|(_, v)| v).sum::<f64>() / count;
    let (angles, values): (Vec<f64>, Vec<f64>) = known.into_iter().map(|(q, v)| (q, v - mean)).unzip();
    // A wave `a sin(n q)` has the power `(a count / 2)^2`.
    let rms = |power: f64| (2.0 * power).sqrt() / count;
    power_by_order(&angles, &values, HIGHEST).into_iter().map(rms).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wave_shows_with_its_rms_in_its_order() {
        let angle: Vec<f64> = (0..9000).map(|k| f64::from(k) * 0.0007).collect();
        let left: Vec<Option<f64>> = angle.iter().map(|q| Some(2.0 * (100.0 * q).sin() + 5.0)).collect();
        let rms = rms_by_order(&angle, &left);
        assert!((rms[100] - 2.0_f64.sqrt()).abs() < 0.02, "{}", rms[100]);
        assert!(rms[50] < 0.05);
    }

    #[test]
    fn bands_cover_all_orders_once() {
        let edges = edges();
        assert_eq!((edges[0], edges[edges.len() - 1]), (LOWEST, HIGHEST));
        assert!(edges.windows(2).all(|edge| edge[0] < edge[1]));
    }
}
