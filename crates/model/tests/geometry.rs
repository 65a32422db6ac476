//! Geometry against derivations of another kind: homogeneous matrices, powers, points instead of bodies, differences.
#![allow(clippy::unwrap_used)] // a test may

use nalgebra::{Isometry3, Matrix3, Matrix4, Rotation3, Unit, UnitQuaternion, Vector3, Vector6};
use proptest::prelude::*;

use wrenchd_model::chain::{Chain, Section, rotation_from_z};
use wrenchd_model::dynamics::Dynamics;
use wrenchd_model::spatial::{Pose, RigidBody, Wrench, rotation_about};

const ARM_B: &str = include_str!("data/arm_b.urdf");
const CUTS: [&str; 8] = ["a1", "a2", "cut_1", "a3", "a5", "a6", "a7", "cut_2"];

fn arm() -> (Chain, Vec<Section>) {
    let gravity_mps2 = Vector3::new(1.0, -2.0, -9.0);
    let chain = Chain::from_urdf(ARM_B, "arm_b.urdf", "pedestal", "point", gravity_mps2).unwrap();
    let sections = CUTS.iter().map(|name| Section::new(&chain, name, None).unwrap()).collect();
    (chain, sections)
}

fn vectors(most: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-most..most).prop_map(Vector3::from)
}

/// Directions of any kind, straight down and nearly so included.
fn directions() -> impl Strategy<Value = Vector3<f64>> {
    let any = vectors(1.0).prop_filter("has a direction", |v| v.norm() > 0.1);
    let near_down = vectors(1e-9).prop_map(|v| v - Vector3::z());
    prop_oneof![4 => any, 1 => near_down, 1 => Just(-Vector3::z())].prop_map(|v| v.normalize())
}

fn poses() -> impl Strategy<Value = Pose> {
    (prop::array::uniform3(-2.0..2.0f64), prop::array::uniform3(-4.0..4.0f64))
        .prop_map(|(xyz_m, rpy_rad)| Pose::from_xyz_rpy(xyz_m, rpy_rad))
}

fn wrenches() -> impl Strategy<Value = Vector6<f64>> {
    prop::array::uniform6(-10.0..10.0f64).prop_map(Vector6::from)
}

fn positions() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-3.1..3.1f64, 7)
}

fn homogeneous(pose: &Pose) -> Matrix4<f64> {
    let mut matrix = pose.rotation.to_homogeneous();
    matrix.fixed_view_mut::<3, 1>(0, 3).copy_from(&pose.translation_m);
    matrix
}

/// The tip in the base by nalgebra's own rigid motions.
fn tip_in_base(chain: &Chain, positions_rad: &[f64]) -> Matrix4<f64> {
    let mut placed = Isometry3::identity();
    for joint in &chain.joints {
        let turned = Rotation3::from_matrix_unchecked(joint.origin.rotation);
        placed *= Isometry3::from_parts(joint.origin.translation_m.into(), UnitQuaternion::from(turned));
        if let Some(coordinate) = joint.coordinate {
            placed *=
                UnitQuaternion::from_axis_angle(&Unit::new_normalize(joint.axis), positions_rad[coordinate]);
        }
    }
    placed.to_homogeneous()
}

/// Velocity (m per rad, in the base) of a frame's origin and its rate of turning (rad per rad), by differences.
fn twist(chain: &Chain, positions_rad: &[f64], coordinate: usize) -> (Vector3<f64>, Vector3<f64>) {
    const STEP_RAD: f64 = 1e-5;
    let at = |step_rad: f64| {
        let mut moved = positions_rad.to_vec();
        moved[coordinate] += step_rad;
        tip_in_base(chain, &moved)
    };
    let rate = (at(STEP_RAD) - at(-STEP_RAD)) / (2.0 * STEP_RAD);
    let turning = rate.fixed_view::<3, 3>(0, 0) * at(0.0).fixed_view::<3, 3>(0, 0).transpose();
    let velocity = rate.fixed_view::<3, 1>(0, 3).into_owned();
    (velocity, Vector3::new(turning[(2, 1)], turning[(0, 2)], turning[(1, 0)]))
}

proptest! {
    #[test]
    fn placements_multiply_as_homogeneous_matrices(a in poses(), b in poses(), point in vectors(3.0)) {
        let product = homogeneous(&a) * homogeneous(&b);
        prop_assert!((homogeneous(&a.compose(&b)) - product).amax() < 1e-13);
        prop_assert!((homogeneous(&a.inverse()) * homogeneous(&a) - Matrix4::identity()).amax() < 1e-13);
        let moved = homogeneous(&a) * point.push(1.0);
        prop_assert!((a.point(&point) - moved.xyz()).amax() < 1e-13);
    }

    #[test]
    fn turns_are_nalgebra_s(axis in directions(), angle_rad in -7.0..7.0f64) {
        let expected = Rotation3::from_axis_angle(&Unit::new_unchecked(axis), angle_rad);
        prop_assert!((rotation_about(&axis, angle_rad) - expected.matrix()).amax() < 1e-13);
    }

    #[test]
    fn the_smallest_turn_takes_z_to_the_axis(axis in directions()) {
        let turn = rotation_from_z(&axis);
        prop_assert!((turn * Vector3::z() - axis).amax() < 1e-12, "{turn}");
        prop_assert!((turn * turn.transpose() - Matrix3::identity()).amax() < 1e-12, "{turn}");
        prop_assert!((turn.determinant() - 1.0).abs() < 1e-12);
        // The smallest: it turns by the angle between z and the axis, 1 + 2 cos being the trace.
        prop_assert!((turn.trace() - (1.0 + 2.0 * axis.z)).abs() < 1e-12);
    }

    #[test]
    fn a_body_is_its_points(points in prop::collection::vec((0.1..5.0f64, vectors(1.0)), 1..6), pose in poses()) {
        let body = |place: &dyn Fn(&Vector3<f64>) -> Vector3<f64>| {
            let of = |(mass_kg, at): &(f64, Vector3<f64>)| RigidBody::from_com(*mass_kg, place(at), Matrix3::zeros());
            points.iter().map(of).fold(RigidBody::zero(), |sum, part| sum + part)
        };
        let moved = body(&|at| *at).transformed(&pose).parameters();
        let expected = body(&|at| pose.point(at)).parameters();
        prop_assert!(moved.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-10), "{moved:?} {expected:?}");
        let again = RigidBody::from_parameters(&expected).parameters();
        prop_assert_eq!(again, expected);
    }

    #[test]
    fn the_arm_stands_where_its_joints_put_it(q in positions()) {
        let (chain, sections) = arm();
        let mut dynamics = Dynamics::new(&chain, &sections);
        dynamics.update_static(&q);
        let expected = tip_in_base(&chain, &q);
        prop_assert!((homogeneous(&dynamics.tip_in_base()) - expected).amax() < 1e-12);
        prop_assert!((homogeneous(chain.placements(&q).last().unwrap()) - expected).amax() < 1e-12);
        for section in 0..sections.len() {
            let tip = dynamics.section_in_base(section).compose(dynamics.tip_in_section(section));
            prop_assert!((homogeneous(&tip) - expected).amax() < 1e-12);
        }
    }

    /// Seen from anywhere, a wrench on a rigid body has the same power: with the twist carried by velocities of points.
    #[test]
    fn adjoints_keep_the_power(q in positions(), wrench in wrenches(), speed in vectors(2.0), turning in vectors(2.0)) {
        let (chain, sections) = arm();
        let mut dynamics = Dynamics::new(&chain, &sections);
        dynamics.update_static(&q);
        let power = wrench.fixed_rows::<3>(0).dot(&speed) + wrench.fixed_rows::<3>(3).dot(&turning);
        for section in 0..sections.len() {
            // The velocity of the body's point that is at the section's origin, and both in its axes.
            let seen = dynamics.tip_in_section(section);
            let there = seen.inverse().translation_m;
            let (speed_s, turning_s) = (seen.rotation * (speed + turning.cross(&there)), seen.rotation * turning);
            let load = dynamics.tip_adjoint(section) * wrench;
            let again = load.fixed_rows::<3>(0).dot(&speed_s) + load.fixed_rows::<3>(3).dot(&turning_s);
            prop_assert!((power - again).abs() < 1e-10 * (1.0 + power.abs()), "{power} {again}");
            let other = dynamics.load_of_tip_wrench(section, &Wrench::from_vector(&wrench)).to_vector();
            prop_assert!((other - load).amax() < 1e-12);
        }
    }

    /// A gauge's row is what its compliance makes of the carried wrench.
    #[test]
    fn rows_are_compliances_carried_to_the_tip(q in positions(), wrench in wrenches(), compliance in wrenches()) {
        let (chain, sections) = arm();
        let mut dynamics = Dynamics::new(&chain, &sections);
        dynamics.update_static(&q);
        for section in 0..sections.len() {
            let direct = compliance.dot(&(dynamics.tip_adjoint(section) * wrench));
            let row = dynamics.row_to_tip(section, &compliance).dot(&wrench);
            prop_assert!((row - direct).abs() < 1e-10 * (1.0 + direct.abs()), "{row} {direct}");
        }
    }

    /// Virtual work: what a tip wrench adds to a joint's torque is its power along the motion of the tip that the joint makes.
    #[test]
    fn joint_torques_are_the_jacobian_s(q in positions(), wrench in wrenches()) {
        let (chain, sections) = arm();
        let mut dynamics = Dynamics::new(&chain, &sections);
        dynamics.update_static(&q);
        let turned = dynamics.tip_in_base().rotation;
        let (force_n, moment_nm) = (wrench.fixed_rows::<3>(0).into_owned(), wrench.fixed_rows::<3>(3).into_owned());
        for coordinate in 0..dynamics.coordinates() {
            let (velocity, turning) = twist(&chain, &q, coordinate);
            let power = (turned * force_n).dot(&velocity) + (turned * moment_nm).dot(&turning);
            let torque_nm = |w| dynamics.joint_torque_nm(coordinate, &w);
            let added_nm = torque_nm(Wrench::from_vector(&wrench)) - torque_nm(Wrench::zero());
            prop_assert!((added_nm - power).abs() < 1e-7, "{coordinate}: {added_nm} {power}");
        }
    }
}
