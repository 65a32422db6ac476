//! Kinematics, loads and their derivatives against Pinocchio's (`data/make_pinocchio_table.py`).

#![allow(clippy::unwrap_used)]

use nalgebra::{Matrix3, Vector3, Vector6};
use serde_json::Value;
use wrenchd_model::chain::{Chain, Section};
use wrenchd_model::dynamics::Dynamics;
use wrenchd_model::spatial::{RigidBody, Wrench};

/// The table has twelve digits; loads are up to some 300 N and Nm.
const TOLERANCE: f64 = 1e-8;

struct Arm {
    chain: Chain,
    sections: Vec<Section>,
    rows: Vec<Value>,
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

fn names(value: &Value) -> Vec<&str> {
    value.as_array().unwrap().iter().map(|name| name.as_str().unwrap()).collect()
}

fn arms() -> Vec<Arm> {
    let table: Value = serde_json::from_str(include_str!("data/pinocchio.json")).unwrap();
    let arms: Vec<Arm> = table
        .as_array()
        .unwrap()
        .iter()
        .map(|arm| {
            let text = match arm["urdf"].as_str().unwrap() {
                "arm_a.urdf" => include_str!("data/arm_a.urdf"),
                _ => include_str!("data/arm_b.urdf"),
            };
            let (base, tip) = (arm["base"].as_str().unwrap(), arm["tip"].as_str().unwrap());
            let chain = Chain::from_urdf(text, "arm.urdf", base, tip, Vector3::zeros()).unwrap();
            assert_eq!(chain.coordinate_names(), names(&arm["moving"]));
            let sections =
                names(&arm["sections"]).into_iter().map(|name| Section::new(&chain, name, None).unwrap());
            Arm { sections: sections.collect(), rows: arm["rows"].as_array().unwrap().clone(), chain }
        })
        .collect();
    assert_eq!(arms.iter().map(|arm| arm.rows.len()).collect::<Vec<_>>(), [8, 8]);
    arms
}

/// Runs `check` on every row of both arms, updated to the row's state.
fn each(check: impl Fn(&Arm, &Value, &mut Dynamics)) {
    for mut arm in arms() {
        for row in arm.rows.clone() {
            arm.chain.gravity_mps2 = Vector3::from_vec(numbers(&row["gravity_mps2"]));
            let mut dynamics = Dynamics::new(&arm.chain, &arm.sections);
            dynamics.update(&numbers(&row["q"]), &numbers(&row["qd"]), &numbers(&row["qdd"]));
            check(&arm, &row, &mut dynamics);
        }
    }
}

/// A six-vector in S in the axes of the child link.
fn in_child(section: &Section, vector: &Vector6<f64>) -> Vec<f64> {
    let wrench = Wrench::<wrenchd_model::spatial::Section>::from_vector(vector);
    let (force, moment) = (section.r_cs * wrench.force_n, section.r_cs * wrench.moment_nm);
    force.iter().chain(moment.iter()).copied().collect()
}

fn assert_near(got: &[f64], expected: &[f64], what: &str) {
    assert_eq!(got.len(), expected.len(), "{what}");
    for (a, b) in got.iter().zip(expected) {
        assert!((a - b).abs() < TOLERANCE * (1.0 + b.abs()), "{what}: {got:?} is not {expected:?}");
    }
}

#[test]
fn loads() {
    each(|arm, row, dynamics| {
        for (index, section) in arm.sections.iter().enumerate() {
            let expected = numbers(&row["loads"][index]);
            assert_near(
                &in_child(section, &dynamics.load(index)),
                &expected,
                &arm.chain.joints[section.joint].name,
            );
        }
    });
}

#[test]
fn loads_at_rest_by_the_short_way() {
    let mut still = 0;
    for mut arm in arms() {
        for row in arm.rows.iter().filter(|row| numbers(&row["qd"]).iter().all(|rate| *rate == 0.0)) {
            arm.chain.gravity_mps2 = Vector3::from_vec(numbers(&row["gravity_mps2"]));
            let mut dynamics = Dynamics::new(&arm.chain, &arm.sections);
            dynamics.update_static(&numbers(&row["q"]));
            for (index, section) in arm.sections.iter().enumerate() {
                let load = in_child(section, &dynamics.load(index));
                assert_near(&load, &numbers(&row["loads"][index]), "load at rest");
            }
            still += 1;
        }
    }
    assert_eq!(still, 4);
}

#[test]
fn sections_one_at_a_time_feel_the_same_as_together() {
    for arm in arms() {
        let row = &arm.rows[5];
        let state = (numbers(&row["q"]), numbers(&row["qd"]), numbers(&row["qdd"]));
        let mut chain = arm.chain.clone();
        chain.gravity_mps2 = Vector3::from_vec(numbers(&row["gravity_mps2"]));
        for (index, section) in arm.sections.iter().enumerate() {
            // A second section of another axis at the same joint, and the order of the list, change nothing.
            let name = &chain.joints[section.joint].name;
            let tilted = Section::new(&chain, name, Some([0.2, -3.0, 1.0])).unwrap();
            let mut dynamics = Dynamics::new(&chain, &[tilted, *section]);
            dynamics.update(&state.0, &state.1, &state.2);
            for (place, section) in [tilted, *section].iter().enumerate() {
                let load = in_child(section, &dynamics.load(place));
                assert_near(&load, &numbers(&row["loads"][index]), name);
            }
        }
    }
}

#[test]
fn tip_wrench_at_every_section() {
    each(|arm, row, dynamics| {
        let wrench = Wrench::from_vector(&Vector6::from_vec(numbers(&row["tip_wrench"])));
        for (index, section) in arm.sections.iter().enumerate() {
            let load = dynamics.load_of_tip_wrench(index, &wrench).to_vector();
            assert_near(
                &in_child(section, &load),
                &numbers(&row["tip_wrench_loads"][index]),
                "load of tip wrench",
            );
            let compliance = Vector6::new(0.3, -1.2, 0.7, 2.0, -0.4, 1.1);
            let by_matrix = compliance.dot(&(dynamics.tip_adjoint(index) * wrench.to_vector()));
            let by_row = dynamics.row_to_tip(index, &compliance).dot(&wrench.to_vector());
            assert_near(&[by_row, by_matrix], &[compliance.dot(&load); 2], "row to tip");
        }
    });
}

#[test]
fn tip_placement_and_motion() {
    each(|arm, row, dynamics| {
        let tip = dynamics.tip_in_base();
        let rotation = Matrix3::from_row_slice(&numbers(&row["tip_rotation"]));
        assert_near(tip.rotation.as_slice(), rotation.as_slice(), "tip rotation");
        assert_near(tip.translation_m.as_slice(), &numbers(&row["tip_position"]), "tip position");
        let placed = arm.chain.placements(&numbers(&row["q"])).pop().unwrap();
        assert_near(placed.rotation.as_slice(), rotation.as_slice(), "tip rotation by placements");
        assert_near(
            placed.translation_m.as_slice(),
            &numbers(&row["tip_position"]),
            "tip position by placements",
        );
        let motion = dynamics.tip_motion();
        assert_near(motion.velocity_rad_s.as_slice(), &numbers(&row["tip_velocity_rad_s"]), "tip velocity");
        assert_near(
            motion.acceleration_rad_s2.as_slice(),
            &numbers(&row["tip_acceleration_rad_s2"]),
            "tip turning",
        );
        let gravity = rotation.tr_mul(&arm.chain.gravity_mps2);
        let acceleration = motion.proper_mps2 + gravity;
        assert_near(acceleration.as_slice(), &numbers(&row["tip_acceleration_mps2"]), "tip acceleration");
        let point_mass = RigidBody::from_com(2.0, Vector3::zeros(), Matrix3::zeros());
        let expected = (gravity - acceleration) * 2.0;
        assert_near(dynamics.payload_wrench(&point_mass).force_n.as_slice(), expected.as_slice(), "payload");
    });
}

/// The torque about the child's z (fixed) or axis (moving) is minus the load's component.
#[test]
fn derivatives_of_torques() {
    each(|arm, row, dynamics| {
        dynamics.differentiate();
        for (index, section) in arm.sections.iter().enumerate() {
            for coordinate in 0..arm.chain.coordinates() {
                for (key, derivative) in [
                    ("torque_by_q", dynamics.by_position(index, coordinate)),
                    ("torque_by_qd", dynamics.by_velocity(index, coordinate)),
                    ("torque_by_qdd", dynamics.by_acceleration(index, coordinate)),
                ] {
                    let expected = numbers(&row[key][index])[coordinate];
                    let name = &arm.chain.joints[section.joint].name;
                    assert_near(&[-derivative[5]], &[expected], &format!("{key} of {name} for {coordinate}"));
                }
            }
        }
    });
}
