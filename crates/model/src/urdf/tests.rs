use nalgebra::{Matrix3, Vector3};

use super::UrdfError;
use crate::chain::{Chain, JointKind};
use crate::spatial::{Pose, RigidBody};

const ARM_A: &str = include_str!("../../tests/data/arm_a.urdf");
const ARM_B: &str = include_str!("../../tests/data/arm_b.urdf");
const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.80665);

fn arm_a(text: &str) -> Result<Chain, UrdfError> {
    Chain::from_urdf(text, "arm.urdf", "base_link", "tool0", GRAVITY)
}

/// The message for arm A with one piece of text replaced.
fn message(from: &str, to: &str) -> String {
    assert!(ARM_A.contains(from), "{from}");
    arm_a(&ARM_A.replacen(from, to, 1)).unwrap_err().to_string()
}

#[track_caller]
fn assert_says(message: &str, parts: &[&str]) {
    for part in parts {
        assert!(message.contains(part), "\"{message}\" does not say \"{part}\"");
    }
}

#[test]
fn arm_a_is_read() {
    let chain = arm_a(ARM_A).unwrap();
    assert_eq!(chain.coordinates(), 6);
    assert_eq!(chain.coordinate_names()[5], "joint_6");
    let names: Vec<_> = chain.joints.iter().map(|joint| joint.name.as_str()).collect();
    assert_eq!(names[..4], ["joint_1", "joint_2", "section_7", "joint_3"]);
    assert_eq!(chain.joints[2].kind, JointKind::Fixed);
    assert_eq!(chain.joints[2].coordinate, None);
    assert_eq!(chain.joints[3].coordinate, Some(2));
    assert_eq!(chain.joints[0].body.com_m().unwrap(), Vector3::new(0.0, -0.01, -0.02));
    let limits = chain.joints[0].limits.unwrap();
    assert_eq!(
        (limits.lower_rad, limits.upper_rad, limits.velocity_rad_s, limits.effort_nm),
        (-2.9, 2.9, 3.0, 60.0)
    );
    assert_eq!((chain.joints.len(), chain.warnings.len(), chain.other_joints.len()), (9, 0, 0));
}

#[test]
fn branches_are_lumped_into_their_parents() {
    let chain = Chain::from_urdf(ARM_B, "b", "pedestal", "point", GRAVITY).unwrap();
    let upper = &chain.joints[chain.joint_index("a2").unwrap()];
    let turned = |xyz, rpy| Pose::from_xyz_rpy(xyz, rpy);
    let mount = turned([-0.06, 0.09, 0.02], [0.2, 0.1, -0.9]);
    let hinge = mount.compose(&turned([0.03, 0.0, 0.05], [1.2, 0.0, 0.0]));
    // Point by point: masses and their places add up whatever the frames.
    let parts = [
        (3.1, Vector3::new(0.02, 0.11, -0.03)),
        (0.9, mount.point(&Vector3::new(0.0, 0.01, 0.02))),
        (0.2, hinge.point(&Vector3::new(0.004, 0.003, 0.01))),
    ];
    let first = parts.iter().fold(Vector3::zeros(), |sum, (mass, at)| sum + at * *mass);
    assert!((upper.body.mass_kg - 4.2).abs() < 1e-12);
    assert!((upper.body.first_moment_kgm - first).amax() < 1e-14);
    let words: Vec<_> = chain.warnings.iter().map(String::as_str).collect();
    assert_eq!(words.len(), 2, "{words:?}");
    assert_says(words[0], &["\"fan_hinge\"", "position zero"]);
    assert_says(words[1], &["\"grip\"", "\"finger\""]);
    let mut others = chain.other_joints.clone();
    others.sort();
    assert_eq!(others, ["battery_mount", "camera_mount", "fan_hinge", "grip", "lamp_hinge", "mount"]);
    assert_eq!(chain.joints[0].limits, None);
    assert_eq!(chain.joints[0].kind, JointKind::Continuous);
    let down = chain.joints.iter().find(|joint| joint.name == "a1").unwrap();
    assert_eq!(down.axis, -Vector3::z());
}

#[test]
fn unreadable_text_names_file_and_line() {
    let sixth = ARM_A.lines().position(|line| line.contains("<joint name=\"joint_1\"")).unwrap() + 1;
    for (from, to, reason) in [
        ("lower=\"-2.9\"", "lower=\"low\"", "invalid float"),
        ("<origin xyz=\"0 0 0.15\"", "<origin xyz=\"0 0\"", "expected 3 found 2"),
        ("type=\"revolute\"", "type=\"rotary\"", "rotary"),
        ("<child link=\"link_1\"/>", "", "child"),
    ] {
        assert_says(&message(from, to), &[&format!("arm.urdf:{sixth}: "), reason, "joint_1", "correct"]);
    }
    assert_says(&message("<mass value=\"1.9\"/>", ""), &["arm.urdf:4: ", "link_1", "mass"]);
    assert_says(&message("</link>", "</lnk>"), &["arm.urdf:"]);
    assert_says(&arm_a("").unwrap_err().to_string(), &["arm.urdf", "not a readable URDF"]);
    assert_says(&arm_a("base: arm").unwrap_err().to_string(), &["arm.urdf", "not a readable URDF"]);
    assert_says(&arm_a("<a>\n<!-- \n").unwrap_err().to_string(), &["arm.urdf:2", "never ends"]);
    let deep = format!("<robot>{}</robot>", "<a>".repeat(200_000) + &"</a>".repeat(200_000));
    assert_says(&arm_a(&deep).unwrap_err().to_string(), &["arm.urdf:1", "deeper than"]);
}

#[test]
fn the_tree_must_hold_the_chain() {
    let chain = |base, tip| Chain::from_urdf(ARM_A, "arm.urdf", base, tip, GRAVITY).unwrap_err().to_string();
    assert_says(
        &chain("base_lnk", "tool0"),
        &["base link \"base_lnk\"", "nearest: \"base_link\"", "[robot] base"],
    );
    assert_says(&chain("base_link", "tol0"), &["tip link \"tol0\"", "nearest: \"tool0\""]);
    assert_says(&chain("link_4", "link_2"), &["\"link_4\" is not an ancestor", "\"link_1\", \"base_link\""]);
    assert_says(&chain("link_1", "base_link"), &["ancestors are none"]);
    assert_says(&chain("tool0", "tool0"), &["both \"tool0\""]);
    assert_says(
        &message("<child link=\"link_2\"/>", "<child link=\"lnk_2\"/>"),
        &["\"joint_2\"", "\"lnk_2\"", "nearest: \"link_2\""],
    );
    assert_says(
        &message("<child link=\"link_2\"/>", "<child link=\"link_3\"/>"),
        &["\"link_3\" is the child of two joints"],
    );
    assert_says(
        &message("<link name=\"link_2\">", "<link name=\"link_1\">"),
        &["two links are called \"link_1\""],
    );
    assert_says(
        &message("<joint name=\"joint_2\"", "<joint name=\"joint_1\""),
        &["two joints are called \"joint_1\""],
    );
    // A ring of the links below joint_2, with nothing above it.
    assert_says(&message("<parent link=\"link_1\"/>", "<parent link=\"tool0\"/>"), &["form a loop"]);
    let nan =
        Chain::from_urdf(ARM_A, "a", "base_link", "tool0", Vector3::new(0.0, f64::NAN, 1.0)).unwrap_err();
    assert_says(&nan.to_string(), &["gravity is [0, NaN, 1]"]);
}

#[test]
fn joints_that_the_arm_cannot_have_are_refused() {
    for kind in ["prismatic", "floating", "planar", "spherical"] {
        let words =
            message("name=\"joint_3\" type=\"revolute\"", &format!("name=\"joint_3\" type=\"{kind}\""));
        assert_says(&words, &["\"joint_3\" between base and tip", kind, "only revolute"]);
    }
    let mimic = "<child link=\"link_1\"/><mimic joint=\"joint_2\" multiplier=\"2\"/>";
    assert_says(&message("<child link=\"link_1\"/>", mimic), &["\"joint_1\"", "mimic of \"joint_2\""]);
}

#[test]
fn numbers_that_make_no_sense_are_refused() {
    assert_says(&message("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 0 0\"/>"), &["\"joint_1\"", "no direction"]);
    assert_says(
        &message("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 nan 1\"/>"),
        &["\"joint_1\"", "no direction"],
    );
    assert_says(&message("<mass value=\"1.9\"/>", "<mass value=\"-1\"/>"), &["\"link_1\"", "-1 kg"]);
    assert_says(&message("<mass value=\"1.9\"/>", "<mass value=\"inf\"/>"), &["\"link_1\"", "inf kg"]);
    assert_says(&message("izz=\"0.002\"", "izz=\"-0.002\""), &["\"link_1\"", "negative principal moment"]);
    assert_says(&message("ixy=\"0\"", "ixy=\"0.1\""), &["\"link_1\"", "negative principal moment"]);
    assert_says(&message("ixy=\"0\"", "ixy=\"nan\""), &["\"link_1\"", "not finite"]);
    assert_says(&message("rpy=\"-1.57079632679 0 0\"", "rpy=\"inf 0 0\""), &["\"joint_2\"", "not finite"]);
}

#[test]
fn numbers_that_are_odd_are_used_with_a_warning() {
    let warned = |from: &str, to: &str| arm_a(&ARM_A.replacen(from, to, 1)).unwrap();
    let chain = warned("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0 3 4\"/>");
    assert_says(&chain.warnings[0], &["\"joint_1\"", "not a unit vector"]);
    assert!((chain.joints[0].axis - Vector3::new(0.0, 0.6, 0.8)).amax() < 1e-15);
    assert_eq!(warned("<axis xyz=\"0 0 1\"/>", "<axis xyz=\"0.577 0.577 0.577\"/>").warnings.len(), 0);
    assert_says(&warned("izz=\"0.002\"", "izz=\"0.1\"").warnings[0], &["\"link_1\"", "no body"]);
    let chain = warned("lower=\"-2.9\" upper=\"2.9\"", "lower=\"2.9\" upper=\"-2.9\"");
    assert_says(&chain.warnings[0], &["\"joint_1\"", "contradict"]);
    assert_eq!(chain.joints[0].limits, None);
    // Without an inertial element a link weighs nothing, and says nothing.
    assert_eq!(
        chain.joints.last().unwrap().body,
        RigidBody::from_com(0.0, Vector3::zeros(), Matrix3::zeros())
    );
}

/// Cut, doubled and garbled texts give a chain or an error with a message, in bounded time.
#[test]
fn no_text_makes_it_panic() {
    let mut seed = 7_u64;
    let mut random = |below: usize| {
        seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (seed >> 33) as usize % below
    };
    let pieces = [
        "<",
        ">",
        "\"",
        "/>",
        "<!--",
        "]]>",
        "&",
        "&#x0;",
        "\u{0}",
        "é",
        "1e999",
        "-",
        "</robot>",
        "<link/>",
        "<?",
        "name=\"link_3\"",
    ];
    let mut read = 0;
    for _ in 0..1500 {
        let mut text = if random(2) == 0 { ARM_A.to_owned() } else { ARM_B.to_owned() };
        for _ in 0..=random(3) {
            let at = (random(text.len())..=text.len()).find(|at| text.is_char_boundary(*at)).unwrap();
            match random(4) {
                0 => text.truncate(at),
                1 => text.insert_str(at, pieces[random(pieces.len())]),
                2 => {
                    let end = (at + random(30)).min(text.len());
                    let end = (end..=text.len()).find(|end| text.is_char_boundary(*end)).unwrap();
                    text.replace_range(at..end, pieces[random(pieces.len())]);
                }
                _ => text.insert_str(at, &ARM_B[100..100 + random(400)].replace('é', "")),
            }
            if text.is_empty() {
                break;
            }
        }
        match arm_a(&text) {
            Ok(chain) => read += chain.joints.len().min(1),
            Err(error) => assert!(error.to_string().contains("arm.urdf"), "{error}"),
        }
    }
    assert!(read > 10, "{read}");
}
