//! The linear stage on a table of dead-weight points that may not be shipped
//!
//! `DEAD_WEIGHTS=table.csv cargo test -p wrenchd-calibration --test dead_weights -- --ignored --nocapture`: columns `z_*` are six
//! readings, `L_*` the six loads; the residual of points that were left out, moments over 0.15 m.

#![expect(clippy::unwrap_used, reason = "a table that is not as expected fails the test")]

use nalgebra::{SMatrix, SVector};
use wrenchd_calibration::triangle::Triangle;

const LENGTH_M: f64 = 0.15;
const AXES: [&str; 6] = ["fx", "fy", "fz", "mx", "my", "mz"];
const BOUND_N: f64 = 0.09;

/// Readings and loads of each point, moments over the length.
fn points(text: &str) -> Vec<([f64; 6], [f64; 6])> {
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = |name: String| header.iter().position(|c| *c == name).unwrap();
    let of = |kind: &str, fields: &[&str]| -> [f64; 6] {
        std::array::from_fn(|k| {
            let value: f64 = fields[column(format!("{kind}_{}", AXES[k]))].parse().unwrap();
            if k < 3 { value } else { value / LENGTH_M }
        })
    };
    let rows = lines.map(|line| line.split(',').collect::<Vec<_>>());
    rows.map(|fields| (of("z", &fields), of("L", &fields))).collect()
}

/// Sensitivities and offset of one channel from points.
fn fit<'a>(channel: usize, points: impl Iterator<Item = &'a ([f64; 6], [f64; 6])>) -> SVector<f64, 7> {
    let mut triangle = Triangle::<8>::default();
    for (z, load) in points {
        triangle.add(&[load[0], load[1], load[2], load[3], load[4], load[5], 1.0, z[channel]]);
    }
    let r = triangle.finish();
    let a = SMatrix::<f64, 7, 7>::from_fn(|i, k| r[i][k]);
    a.solve_upper_triangular(&SVector::from_fn(|i, _| r[i][7])).unwrap()
}

#[test]
#[ignore = "needs a table that may not be shipped"]
fn points_left_out_are_predicted_as_well_as_the_full_compliance_can() {
    let path = std::env::var("DEAD_WEIGHTS").expect("DEAD_WEIGHTS names the table");
    let points = points(&std::fs::read_to_string(path).unwrap());
    let mut squares = 0.0;
    for left_out in 0..points.len() {
        let others = || points.iter().enumerate().filter(|(k, _)| *k != left_out).map(|(_, point)| point);
        let (z, load) = points[left_out];
        for channel in 0..6 {
            let found = fit(channel, others());
            let predicted = (0..6).map(|k| found[k] * load[k]).sum::<f64>() + found[6];
            squares += (z[channel] - predicted).powi(2);
        }
    }
    let rms_n = (squares / (6 * points.len()) as f64).sqrt();
    println!("{} points: {rms_n:.4} N-equivalent left, points left out", points.len());
    assert!(rms_n <= BOUND_N);
}
