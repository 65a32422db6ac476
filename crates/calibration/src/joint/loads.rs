//! Loads of every gauge's section in every row, and how they follow the arm's numbers.

use model::dynamics::Dynamics;
use model::spatial::Wrench;
use nalgebra::Vector6;
use rig::Rig;

use super::parameters::Parameters;
use super::rows::Row;
use crate::gauges::in_parallel;
use crate::solve::scaled;

/// Scaled loads (N, moments over the characteristic length) about S, in S: `[row][gauge]`.
pub type Loads = Vec<Vec<Vector6<f64>>>;

/// Loads for one choice of the numbers.
///
/// Joints yield under the load that they carry at the encoders' positions, as in the cycle; what a second step would add is
/// of the order of the square of the yield.
pub fn loads(rig: &Rig, parameters: &Parameters, rows: &[Row], values: &[f64]) -> Loads {
    let setup = parameters.setup(values);
    let mut dynamics = Dynamics::new(&setup.arm.apply(&rig.chain), &rig.sections);
    let flexibility = setup.arm.flexibility_rad_per_nm(&rig.chain);
    let yields = flexibility.iter().any(|f| *f != 0.0);
    let mut positions = vec![0.0; flexibility.len()];
    let mut out = Vec::with_capacity(rows.len());
    for row in rows {
        let reference = row.reference.map_or_else(Vector6::zeros, |said| setup.reference(&said));
        let tip = |dynamics: &Dynamics| {
            let hanging = parameters.weight(&setup, &row.body);
            let weight = hanging.map_or_else(Wrench::zero, |body| dynamics.payload_wrench(body));
            weight + Wrench::from_vector(&reference)
        };
        dynamics.update_static(&row.positions_rad);
        let mut wrench = tip(&dynamics);
        if yields {
            for (k, position) in positions.iter_mut().enumerate() {
                *position = row.positions_rad[k] + flexibility[k] * dynamics.joint_torque_nm(k, &wrench);
            }
            dynamics.update_static(&positions);
            wrench = tip(&dynamics);
        }
        out.push(
            (0..rig.sections.len())
                .map(|g| scaled(&(dynamics.load(g) + dynamics.load_of_tip_wrench(g, &wrench).to_vector())))
                .collect(),
        );
    }
    out
}

/// Derivative of each gauge's prediction (counts) by each number: `[parameter][row][gauge]`, for scaled compliances (counts/N).
///
/// Central differences over the prior's width: the loads are polynomials of sines, so the error is of the order of the
/// width's square.
pub fn by_parameters(
    rig: &Rig,
    parameters: &Parameters,
    rows: &[Row],
    values: &[f64],
    compliances: &[Vector6<f64>],
) -> Vec<Vec<f32>> {
    in_parallel(parameters.list.len(), |index| {
        let step = 0.5 * parameters.list[index].width;
        let at = |sign: f64| {
            let mut moved = values.to_vec();
            moved[index] += sign * step;
            loads(rig, parameters, rows, &moved)
        };
        let (up, down) = (at(1.0), at(-1.0));
        let pairs = up.iter().flatten().zip(down.iter().flatten());
        pairs
            .enumerate()
            .map(|(k, (up, down))| {
                (compliances[k % compliances.len()].dot(&(up - down)) / (2.0 * step)) as f32
            })
            .collect()
    })
}
