//! Derivatives of the predictions by every kind of number, against other ways to take them.

use std::collections::BTreeSet;
use std::path::Path;

use model::dynamics::Dynamics;
use model::spatial::{BODY_PARAMETERS, RigidBody};
use nalgebra::{Matrix3, SMatrix, Vector3, Vector6};
use rig::{Config, Rig};

use super::loads::{by_parameters, loads};
use super::parameters::{Group, Parameters};
use super::rows::Row;
use crate::solve::scaled;

fn arm() -> Rig {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/arm.toml");
    Rig::load(Config::load(&file).unwrap()).unwrap()
}

/// Poses bare, under two weights, and pushed.
fn rows() -> Vec<Row> {
    let body = |x: f64| RigidBody::from_com(0.5, Vector3::new(x, 0.01, 0.05), Matrix3::zeros());
    (0..12)
        .map(|k| {
            let turn = |j: usize| (0.7 * f64::from(k) + 1.3 * j as f64 + 0.4).sin();
            Row {
                session: 0,
                recording: 0,
                pose: k as usize,
                instants: (0, 1),
                positions_rad: (0..6).map(turn).collect(),
                positions: 1,
                body: match k % 4 {
                    1 => body(0.0),
                    2 => body(0.08),
                    _ => RigidBody::zero(),
                },
                reference: (k % 4 == 3).then(|| Vector6::from_fn(|j, _| turn(j + 3) * 4.0)),
                readings: vec![None; 8],
                shared: 1.0,
            }
        })
        .collect()
}

fn compliances() -> Vec<Vector6<f64>> {
    (0..8).map(|g| Vector6::from_fn(|k, _| 1e5 * (1.0 + f64::from(g) * 2.1 + 0.9 * k as f64).sin())).collect()
}

/// Somewhere away from the URDF: half a prior's width for all, signs mixed.
fn point(parameters: &Parameters) -> Vec<f64> {
    let list = parameters.list.iter().enumerate();
    list.map(|(k, p)| if k % 3 == 0 { -0.5 } else { 0.4 } * p.width).collect()
}

/// Fourth-order differences over a hundredth of the width: error and step have nothing in common with the estimator's.
fn reference_derivative(
    rig: &Rig,
    parameters: &Parameters,
    rows: &[Row],
    at: &[f64],
    index: usize,
) -> Vec<Vec<Vector6<f64>>> {
    let step = 0.01 * parameters.list[index].width;
    let moved = |by: f64| {
        let mut values = at.to_vec();
        values[index] += by * step;
        loads(rig, parameters, rows, &values)
    };
    let (a, b, c, d) = (moved(-2.0), moved(-1.0), moved(1.0), moved(2.0));
    let one = |r: usize, g: usize| (a[r][g] - d[r][g] + 8.0 * (c[r][g] - b[r][g])) / (12.0 * step);
    (0..rows.len()).map(|r| (0..a[r].len()).map(|g| one(r, g)).collect()).collect()
}

#[test]
fn derivatives_by_every_kind_of_number_are_those_of_fine_differences() {
    let (rig, rows) = (arm(), rows());
    let parameters = Parameters::new(&rig.chain, &rows);
    let kinds: BTreeSet<Group> = parameters.list.iter().map(|p| p.group).collect();
    assert_eq!(kinds.len(), Group::ALL.len(), "every kind is there");
    let (at, compliances) = (point(&parameters), compliances());
    let found = by_parameters(&rig, &parameters, &rows, &at, &compliances);
    for (index, parameter) in parameters.list.iter().enumerate() {
        let expected = reference_derivative(&rig, &parameters, &rows, &at, index);
        let counts: Vec<f64> = expected
            .iter()
            .flat_map(|row| row.iter().zip(&compliances).map(|(load, c)| c.dot(load)))
            .collect();
        let largest = counts.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        for (found, expected) in found[index].iter().zip(&counts) {
            // A width of a few mrad bends a sine by millionths; the differences round at 1e-9 of the load.
            let error = (f64::from(*found) - expected).abs();
            assert!(error <= 2e-4 * largest + 1e-3, "{}: {found} for {expected}", parameter.name);
        }
    }
}

#[test]
fn derivatives_by_masses_and_zeros_are_the_model_s_own() {
    let (rig, rows) = (arm(), rows());
    let parameters = Parameters::new(&rig.chain, &rows);
    let (at, compliances) = (vec![0.0; parameters.list.len()], compliances());
    let found = by_parameters(&rig, &parameters, &rows, &at, &compliances);
    let place = |name: &str| parameters.list.iter().position(|p| p.name == name).unwrap();
    let mut dynamics = Dynamics::new(&rig.chain, &rig.sections);
    let mut compared = 0;
    for (r, row) in rows.iter().enumerate().filter(|(_, row)| row.reference.is_none()) {
        dynamics.update_static(&row.positions_rad);
        dynamics.differentiate();
        for gauge in 0..rig.sections.len() {
            let counts = |load: Vector6<f64>| compliances[gauge].dot(&scaled(&load));
            let mut same = |name: String, expected: f64| {
                let found = f64::from(found[place(&name)][r * rig.sections.len() + gauge]);
                assert!(
                    (found - expected).abs() <= 2e-4 * expected.abs() + 2.0,
                    "{name}: {found} for {expected}"
                );
                compared += 1;
            };
            for (joint, entry) in rig.chain.joints.iter().enumerate().filter(|(_, j)| j.body.mass_kg > 0.0) {
                let regressor: SMatrix<f64, 6, BODY_PARAMETERS> = dynamics.regressor(gauge, joint);
                for (k, number) in
                    ["mass_kg", "first_moment_x_kgm", "first_moment_y_kgm", "first_moment_z_kgm"]
                        .iter()
                        .enumerate()
                {
                    same(format!("{}.{number}", entry.child_link), counts(regressor.column(k).into_owned()));
                }
            }
            // A weight hangs down wherever the arm is: the wrench that it makes turns with the tip, as the model's does not.
            if row.body.mass_kg == 0.0 {
                for (k, name) in rig.chain.coordinate_names().iter().enumerate() {
                    let by_position = dynamics.by_position(gauge, k);
                    same(format!("{name}.zero_rad"), counts(by_position));
                }
            }
        }
    }
    assert!(compared > 1000, "{compared}");
}
