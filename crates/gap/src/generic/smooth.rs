//! Any smooth function of what a gauge's section bears and of the joints' angles: loads to the second power, their product with the other
//! gauges' signals, and zero and scale that change with each joint's angle.
//!
//! Of a cause that comes again with load and pose it needs to know nothing, so that a finding which foretells clearly less is another
//! cause's.

use nalgebra::{DMatrix, DVector};

use crate::session::Session;

/// Weight of a prior of no size, as a share of the rows: directions that the data does not show stay at zero.
const PRIOR: f64 = 1e-5;

/// Per row on odd seconds what is left of what is to be foretold, once the function is fitted on the even ones.
pub(super) fn of_channel(session: &Session, channel: usize, target: &[Option<f64>]) -> Vec<Option<f64>> {
    let is_even: &Vec<bool> =
        &session.hold_out.block_of_row.iter().map(|block| session.hold_out.is_even(*block)).collect();
    let features = features(session, channel);
    let rows = |even: bool| {
        let known = (0..session.rows()).filter(move |row| is_even[*row] == even);
        known.filter_map(|row| Some((row, target[row]?)))
    };
    let Some(parameters) = fitted(&features, rows(true)) else {
        return vec![None; session.rows()];
    };
    let mut left = vec![None; session.rows()];
    for (row, target) in rows(false) {
        let foretold: f64 = features.iter().zip(&parameters).map(|(values, p)| values[row] * p).sum();
        left[row] = Some(target - foretold);
    }
    left
}

/// Per feature its values, per row, each of mean square one.
fn features(session: &Session, channel: usize) -> Vec<Vec<f64>> {
    let own = &session.channels[channel];
    let ones = vec![1.0; session.rows()];
    let signal = normalised(own.simulated.clone());
    let mut bases: Vec<Vec<f64>> = Vec::new();
    for axis in 0..6 {
        bases.extend(
            own.gauge.as_ref().map(|gauge| normalised(gauge.loads.iter().map(|l| l[axis]).collect())),
        );
    }
    let mut all = vec![ones];
    for (k, base) in bases.iter().enumerate() {
        all.extend(bases[k..].iter().map(|other| product(base, other)));
    }
    all.append(&mut bases);
    let others = (0..session.channels.len()).filter(|other| *other != channel);
    all.extend(others.map(|other| product(&signal, &normalised(session.channels[other].simulated.clone()))));
    for joint in &session.joints {
        for turn in [f64::sin as fn(f64) -> f64, f64::cos] {
            let turned: Vec<f64> = joint.position_rad.iter().map(|q| turn(*q)).collect();
            all.push(product(&signal, &turned));
            all.push(turned);
        }
    }
    all.into_iter().map(normalised).collect()
}

fn product(a: &[f64], b: &[f64]) -> Vec<f64> {
    a.iter().zip(b).map(|(a, b)| a * b).collect()
}

/// Over its own size; what is nothing stays so.
fn normalised(mut values: Vec<f64>) -> Vec<f64> {
    let size = crate::session::rms(&values);
    let factor = if size > 0.0 { size.recip() } else { 0.0 };
    values.iter_mut().for_each(|value| *value *= factor);
    values
}

fn fitted(features: &[Vec<f64>], rows: impl Iterator<Item = (usize, f64)>) -> Option<DVector<f64>> {
    let mut normal = DMatrix::zeros(features.len(), features.len());
    let mut right = DVector::zeros(features.len());
    let mut here = DVector::zeros(features.len());
    let mut count = 0.0;
    for (row, target) in rows {
        here.iter_mut().zip(features).for_each(|(value, values)| *value = values[row]);
        normal.syger(1.0, &here, &here, 1.0);
        right.axpy(target, &here, 1.0);
        count += 1.0;
    }
    for k in 0..features.len() {
        normal[(k, k)] += PRIOR * f64::max(count, 1.0);
    }
    // Only the lower triangle was summed, and only that is read.
    normal.cholesky().map(|factor| factor.solve(&right))
}
