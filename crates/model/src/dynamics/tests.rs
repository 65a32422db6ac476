use nalgebra::{Matrix3, Rotation3, Vector3, Vector6};

use super::Dynamics;
use crate::chain::{Chain, Section};
use crate::spatial::{Pose, RigidBody, Wrench};

const G: f64 = 9.80665;
const ARM_B: &str = include_str!("../../tests/data/arm_b.urdf");

/// Numbers in -1..1, the same in every run.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    fn list(&mut self, scale: f64) -> Vec<f64> {
        (0..7).map(|_| scale * self.next()).collect()
    }
}

fn arm_b() -> (Chain, Vec<Section>) {
    let gravity = Vector3::new(1.0, -2.0, -9.0);
    let chain = Chain::from_urdf(ARM_B, "arm_b.urdf", "pedestal", "point", gravity).unwrap();
    let sections = ["a1", "a2", "cut_1", "a3", "a5", "a6", "a7", "cut_2"];
    let sections = sections.iter().map(|name| Section::new(&chain, name, None).unwrap()).collect();
    (chain, sections)
}

/// A rod of mass 2 kg, centre of mass 0.3 m along x, turning about a horizontal y axis; tip at 0.5 m.
fn pendulum() -> (Chain, Dynamics) {
    let text = r#"<robot name="p"><link name="w"/><link name="rod"><inertial><origin xyz="0.3 0 0"/><mass value="2"/>
        <inertia ixx="0" ixy="0" ixz="0" iyy="0.05" iyz="0" izz="0.05"/></inertial></link><link name="e"/>
        <joint name="j" type="continuous"><parent link="w"/><child link="rod"/><axis xyz="0 1 0"/></joint>
        <joint name="t" type="fixed"><parent link="rod"/><child link="e"/><origin xyz="0.5 0 0"/></joint></robot>"#;
    let chain = Chain::from_urdf(text, "p.urdf", "w", "e", Vector3::new(0.0, 0.0, -G)).unwrap();
    // Sensing along the child's own z: S is the child link's frame.
    let section = Section::new(&chain, "j", Some([0.0, 0.0, 1.0])).unwrap();
    let dynamics = Dynamics::new(&chain, &[section]);
    (chain, dynamics)
}

#[test]
fn a_pendulum_pulls_and_turns_as_the_textbook_says() {
    let (_, mut dynamics) = pendulum();
    let (q, qd, qdd): (f64, f64, f64) = (0.7, 1.9, -3.1);
    dynamics.update(&[q], &[qd], &[qdd]);
    // Turned by q about y, the rod's x points q below the horizontal. In rod axes gravity is G (sin q, 0, -cos q);
    // the centre of mass moves tangentially with -0.3 q'' along z, and centripetally with -0.3 q'^2 along x.
    let force = Vector3::new(2.0 * (G * q.sin() + 0.3 * qd * qd), 0.0, 2.0 * (-G * q.cos() + 0.3 * qdd));
    let moment_y = 2.0 * 0.3 * G * q.cos() - (0.05 + 2.0 * 0.09) * qdd;
    let expected = Vector6::new(force.x, 0.0, force.z, 0.0, moment_y, 0.0);
    assert!((dynamics.load(0) - expected).amax() < 1e-12, "{} {expected}", dynamics.load(0));
    dynamics.update_static(&[q]);
    let weight = Vector6::new(2.0 * G * q.sin(), 0.0, -2.0 * G * q.cos(), 0.0, 0.6 * G * q.cos(), 0.0);
    assert!((dynamics.load(0) - weight).amax() < 1e-12);
}

#[test]
fn a_payload_is_a_body_of_the_arm() {
    let (chain, _) = pendulum();
    let (com, inertia) =
        (Vector3::new(0.02, 0.03, -0.1), Matrix3::from_diagonal(&Vector3::new(0.01, 0.02, 0.015)));
    let section = Section::new(&chain, "j", None).unwrap();
    let mut loaded = Dynamics::new(&chain.clone().with_tool(1.3, com, inertia), &[section]);
    let mut bare = Dynamics::new(&chain, &[section]);
    loaded.update(&[0.7], &[1.9], &[-3.1]);
    bare.update(&[0.7], &[1.9], &[-3.1]);
    let wrench = bare.payload_wrench(&RigidBody::from_com(1.3, com, inertia));
    let sum = bare.load(0) + bare.load_of_tip_wrench(0, &wrench).to_vector();
    assert!((loaded.load(0) - sum).amax() < 1e-12);
    assert!((loaded.load(0) - bare.load(0)).amax() > 1.0);
}

/// Kinetic minus potential energy of the whole arm, from placements alone, velocities by differences.
fn lagrangian(chain: &Chain, q: &[f64], qd: &[f64]) -> f64 {
    let step = 1e-5;
    let moved = |sign: f64| -> Vec<f64> { q.iter().zip(qd).map(|(q, qd)| q + sign * step * qd).collect() };
    let (now, before, after) =
        (chain.placements(q), chain.placements(&moved(-1.0)), chain.placements(&moved(1.0)));
    let mut energy = 0.0;
    for (index, joint) in chain.joints.iter().enumerate() {
        let body = joint.body.transformed(&Pose { rotation: now[index].rotation, ..Pose::identity() });
        let turn =
            (after[index].rotation - before[index].rotation) / (2.0 * step) * now[index].rotation.transpose();
        let rate = Vector3::new(turn[(2, 1)], turn[(0, 2)], turn[(1, 0)]);
        let velocity = (after[index].translation_m - before[index].translation_m) / (2.0 * step);
        energy += 0.5 * body.mass_kg * velocity.norm_squared()
            + velocity.dot(&rate.cross(&body.first_moment_kgm))
            + 0.5 * rate.dot(&(body.inertia_kgm2 * rate));
        energy += chain.gravity_mps2.dot(&(now[index].translation_m * body.mass_kg + body.first_moment_kgm));
    }
    energy
}

/// Torque of one joint by Lagrange's equation, differentiated numerically.
fn lagrange_torque(chain: &Chain, q: &[f64], qd: &[f64], qdd: &[f64], joint: usize) -> f64 {
    let step = 1e-3;
    let shifted = |list: &[f64], by: &[f64], factor: f64| -> Vec<f64> {
        list.iter().zip(by).map(|(value, by)| value + factor * by).collect()
    };
    let unit: Vec<f64> = (0..q.len()).map(|index| f64::from(u8::from(index == joint))).collect();
    let momentum = |t: f64| {
        let (q, qd) = (shifted(&shifted(q, qd, t), qdd, 0.5 * t * t), shifted(qd, qdd, t));
        let energy = |factor: f64| lagrangian(chain, &q, &shifted(&qd, &unit, factor));
        (energy(1.0) - energy(-1.0)) / 2.0
    };
    let by_position = |h: f64| {
        let energy = |factor: f64| lagrangian(chain, &shifted(q, &unit, factor), qd);
        (energy(h) - energy(-h)) / (2.0 * h)
    };
    (momentum(step) - momentum(-step)) / (2.0 * step) - by_position(step)
}

#[test]
fn joint_torques_are_lagrange_s() {
    let (chain, _) = arm_b();
    let joints: Vec<_> = chain.joints.iter().filter(|joint| joint.coordinate.is_some()).collect();
    let sections: Vec<_> =
        joints.iter().map(|joint| Section::new(&chain, &joint.name, None).unwrap()).collect();
    let mut dynamics = Dynamics::new(&chain, &sections);
    let mut random = Random(1);
    for _ in 0..5 {
        let (q, qd, qdd) = (random.list(3.0), random.list(1.5), random.list(4.0));
        dynamics.update(&q, &qd, &qdd);
        for joint in 0..joints.len() {
            // The section's z is the joint's axis; the arm's own load is minus the torque that drives it.
            let (torque, expected) =
                (-dynamics.load(joint)[5], lagrange_torque(&chain, &q, &qd, &qdd, joint));
            assert!(
                (torque - expected).abs() < 2e-4 * (1.0 + expected.abs()),
                "{joint}: {torque} {expected}"
            );
        }
    }
}

#[test]
fn where_the_base_frame_lies_does_not_matter() {
    let (chain, sections) = arm_b();
    let mut random = Random(2);
    let (q, qd, qdd) = (random.list(3.0), random.list(1.5), random.list(4.0));
    let placed = Pose {
        rotation: Rotation3::from_euler_angles(0.5, -1.0, 2.0).into_inner(),
        translation_m: Vector3::new(0.4, 2.0, -1.0),
    };
    let mut other = chain.clone();
    other.gravity_mps2 = placed.rotation * chain.gravity_mps2;
    other.joints[0].origin = placed.compose(&chain.joints[0].origin);
    let (mut here, mut there) = (Dynamics::new(&chain, &sections), Dynamics::new(&other, &sections));
    here.update(&q, &qd, &qdd);
    there.update(&q, &qd, &qdd);
    for section in 0..sections.len() {
        assert!((here.load(section) - there.load(section)).amax() < 1e-11);
        let (row, other_row) = (
            here.row_to_tip(section, &Vector6::repeat(1.0)),
            there.row_to_tip(section, &Vector6::repeat(1.0)),
        );
        assert!((row - other_row).amax() < 1e-13);
    }
    let moved = placed.compose(&here.tip_in_base());
    assert!((moved.rotation - there.tip_in_base().rotation).amax() < 1e-13);
    assert!((moved.translation_m - there.tip_in_base().translation_m).amax() < 1e-13);
    let placements = chain.placements(&q);
    for (index, section) in sections.iter().enumerate() {
        let origin = placements[section.joint].translation_m;
        assert!((here.section_in_base(index).translation_m - origin).amax() < 1e-13);
        let axes = placements[section.joint].rotation * section.r_cs;
        assert!((here.section_in_base(index).rotation - axes).amax() < 1e-13);
    }
}

#[test]
fn derivatives_are_the_differences() {
    let (chain, sections) = arm_b();
    let mut dynamics = Dynamics::new(&chain, &sections);
    let mut random = Random(3);
    let wrench = Wrench::new(Vector3::new(3.0, -5.0, 7.0), Vector3::new(0.4, 0.9, -0.3));
    for _ in 0..4 {
        let state = [random.list(3.0), random.list(2.0), random.list(5.0)];
        dynamics.update(&state[0], &state[1], &state[2]);
        dynamics.differentiate();
        let step = 1e-4;
        let loads = |of: usize, coordinate: usize, by: f64| {
            let mut state = state.clone();
            state[of][coordinate] += by;
            let mut moved = Dynamics::new(&chain, &sections);
            moved.update(&state[0], &state[1], &state[2]);
            let all: Vec<_> = (0..sections.len())
                .map(|section| (moved.load(section), moved.load_of_tip_wrench(section, &wrench).to_vector()))
                .collect();
            all
        };
        for coordinate in 0..7 {
            for of in 0..3 {
                let (more, less) = (loads(of, coordinate, step), loads(of, coordinate, -step));
                for section in 0..sections.len() {
                    let difference = (more[section].0 - less[section].0) / (2.0 * step);
                    let exact = [
                        dynamics.by_position(section, coordinate),
                        dynamics.by_velocity(section, coordinate),
                        dynamics.by_acceleration(section, coordinate),
                    ][of];
                    assert!(
                        (exact - difference).amax() < 1e-5,
                        "{of} {section} {coordinate}: {exact} {difference}"
                    );
                    if of == 0 {
                        let difference = (more[section].1 - less[section].1) / (2.0 * step);
                        let exact = dynamics.tip_wrench_by_position(section, coordinate, &wrench);
                        assert!((exact - difference).amax() < 1e-6, "{section} {coordinate}");
                    }
                }
            }
        }
    }
}

#[test]
fn at_rest_the_short_way_gives_the_same_derivatives() {
    let (chain, sections) = arm_b();
    let (mut long, mut short) = (Dynamics::new(&chain, &sections), Dynamics::new(&chain, &sections));
    let q = Random(4).list(3.0);
    short.update(&q, &[9.0; 7], &[9.0; 7]);
    short.update_static(&q);
    short.differentiate();
    long.update(&q, &[0.0; 7], &[0.0; 7]);
    long.differentiate();
    for section in 0..sections.len() {
        assert!((long.load(section) - short.load(section)).amax() < 1e-11);
        for coordinate in 0..7 {
            assert!(
                (long.by_position(section, coordinate) - short.by_position(section, coordinate)).amax()
                    < 1e-11
            );
            assert!(
                (long.by_acceleration(section, coordinate) - short.by_acceleration(section, coordinate))
                    .amax()
                    < 1e-13
            );
            assert!(long.by_velocity(section, coordinate).amax() < 1e-13);
            assert!(short.by_velocity(section, coordinate).amax() < 1e-13);
        }
    }
}

#[test]
fn a_row_feels_what_its_compliance_makes_of_the_derivatives() {
    let (chain, sections) = arm_b();
    let mut dynamics = Dynamics::new(&chain, &sections);
    let mut random = Random(9);
    dynamics.update(&random.list(3.0), &random.list(2.0), &random.list(5.0));
    dynamics.differentiate();
    let wrench = Wrench::from_vector(&Vector6::new(3.0, -2.0, 5.0, 0.4, 0.1, -0.3));
    for section in 0..sections.len() {
        let compliance = Vector6::from_column_slice(&random.list(1.0)[..6]);
        let row = dynamics.row_to_tip(section, &compliance);
        for (coordinate, felt) in dynamics.row_by_motion(section, &row).enumerate() {
            let exact = [
                dynamics.by_position(section, coordinate),
                dynamics.by_velocity(section, coordinate),
                dynamics.by_acceleration(section, coordinate),
            ];
            for (felt, exact) in felt.iter().zip(exact) {
                assert!((felt - compliance.dot(&exact)).abs() < 1e-11, "{section} {coordinate}");
            }
            let turned = compliance.dot(&dynamics.tip_wrench_by_position(section, coordinate, &wrench));
            let felt = match dynamics.turns_tip(coordinate, section) {
                true => row.dot(&dynamics.turned_wrench(coordinate, &wrench)),
                false => 0.0,
            };
            assert!((felt - turned).abs() < 1e-12, "{section} {coordinate}");
        }
    }
}

#[test]
fn regressors_times_parameters_are_the_loads() {
    let (chain, sections) = arm_b();
    let mut dynamics = Dynamics::new(&chain, &sections);
    let mut random = Random(5);
    dynamics.update(&random.list(3.0), &random.list(2.0), &random.list(5.0));
    for (index, section) in sections.iter().enumerate() {
        let mut sum = Vector6::zeros();
        for (joint, link) in chain.joints.iter().enumerate() {
            let regressor = dynamics.regressor(index, joint);
            assert_eq!(regressor.amax() == 0.0, joint < section.joint, "{} {}", section.joint, joint);
            sum += regressor * nalgebra::SVector::from(link.body.parameters());
        }
        assert!((sum - dynamics.load(index)).amax() < 1e-11);
    }
}

#[test]
fn lists_of_another_length_are_taken_as_far_as_they_go() {
    let (chain, sections) = arm_b();
    let mut dynamics = Dynamics::new(&chain, &sections);
    dynamics.update(&[0.1; 9], &[], &[0.2]);
    dynamics.update_static(&[]);
    assert!(dynamics.load(0).iter().all(|value| value.is_finite()));
    assert_eq!((dynamics.coordinates(), dynamics.sections()), (7, 8));
}

#[test]
fn a_payload_is_as_good_as_a_tool_and_leaves_no_trace() {
    let (chain, sections) = arm_b();
    let (com_m, inertia) = (Vector3::new(0.02, -0.01, 0.07), Matrix3::from_diagonal_element(0.003));
    let tooled = chain.clone().with_tool(0.8, com_m, inertia);
    let [mut with, mut bare, mut loaded] =
        [&tooled, &chain, &chain].map(|chain| Dynamics::new(chain, &sections));
    let (q, qd, qdd) = ([0.3; 7], [1.1, -0.4, 0.2, 0.9, -1.0, 0.5, 2.0], [3.0; 7]);
    let differ = |a: &Dynamics, b: &Dynamics| {
        let load = (0..8).map(|k| (a.load(k) - b.load(k)).amax()).fold(0.0, f64::max);
        let change = (0..8).map(|k| (a.by_position(k, 2) - b.by_position(k, 2)).amax()).fold(0.0, f64::max);
        (load, change)
    };
    loaded.set_payload(&RigidBody::from_com(5.0, Vector3::x(), inertia));
    loaded.set_payload(&RigidBody::from_com(0.8, com_m, inertia));
    for dynamics in [&mut with, &mut bare, &mut loaded] {
        dynamics.update(&q, &qd, &qdd);
        dynamics.differentiate();
    }
    let (load, change) = differ(&with, &loaded);
    assert!(load < 1e-12 && change < 1e-12, "{load} {change}");
    assert!(differ(&bare, &loaded).0 > 1.0);
    loaded.set_payload(&RigidBody::zero());
    loaded.update(&q, &qd, &qdd);
    loaded.differentiate();
    assert_eq!(differ(&bare, &loaded), (0.0, 0.0));
}
