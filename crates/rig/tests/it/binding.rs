use rig::binding::sha256_hex;
use rig::{Rig, RigError};

use super::{ARM, DBC, URDF, message, parse, with};

fn bind(config: &str, urdf: &str, dbc: &str) -> Result<Rig, RigError> {
    Rig::from_texts(parse(config)?, urdf, dbc.as_bytes())
}

#[test]
fn the_reference_arm_binds() {
    let rig = bind(ARM, URDF, DBC).unwrap();
    assert_eq!(
        rig.chain.coordinate_names(),
        ["joint_1", "joint_2", "joint_3", "joint_4", "joint_5", "joint_6"]
    );
    assert_eq!(rig.joint_entries, [0, 1, 2, 3, 4, 5]);
    assert_eq!(rig.layout.gauges[7].name, "s8");
    assert_eq!(
        (rig.layout.stale_after_ns, rig.layout.temperature_stale_after_ns),
        (20_000_000, 5_000_000_000)
    );
    assert_eq!((rig.urdf_sha256.clone(), rig.dbc_sha256.len()), (sha256_hex(URDF.as_bytes()), 64));
    assert_eq!(rig.messages.len(), 4 + 1 + 3 + 3);
}

#[test]
fn joints_follow_the_chain_not_the_file() {
    let (first, second) = (
        "name = \"joint_1\"\nposition = \"Joints12.Position1\"",
        "name = \"joint_2\"\nposition = \"Joints12.Position2\"",
    );
    let swapped = with(&with(&with(ARM, first, "@"), second, first), "@", second);
    let rig = bind(&swapped, URDF, DBC).unwrap();
    assert_eq!(rig.joint_entries, [1, 0, 2, 3, 4, 5]);
    let position = |index: usize| rig.layout.joints[index].position.spec.name.clone();
    assert_eq!(
        (rig.layout.joints[0].name.as_str(), position(0).as_str(), position(1).as_str()),
        ("joint_1", "Position1", "Position2")
    );
}

#[test]
fn units_are_converted() {
    let dbc = with(DBC, "(1E-006,0) [-6.4|6.4] \"rad\"", "(0.001,0) [-360|360] \"deg\"");
    let dbc = with(&dbc, "(0.25,0) [0|63.75] \"degC\"", "(0.5,250) [250|377.5] \"K\"");
    let rig = bind(ARM, URDF, &dbc).unwrap();
    let position = &rig.layout.joints[0].position;
    assert!((position.spec.physical(90_000) * position.to_si - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
    let temperature = rig.layout.gauges[0].temperature.as_ref().unwrap();
    assert!((temperature.spec.physical(100) * temperature.to_si - 26.85).abs() < 1e-9);
    assert!((temperature.spec.raw(26.85 / temperature.to_si).unwrap() as i64 - 100).abs() < 1);
    let said = message(bind(ARM, URDF, &with(DBC, "\"rad\"", "\"furlong\"")));
    assert_eq!(
        said,
        "arm.toml:21: [[joint]] \"joint_1\": position: Joints12.Position1 has the unit \"furlong\" in arm.dbc; it must be an \
         angle: rad, mrad, deg"
    );
    let said = message(bind(ARM, URDF, &with(DBC, "\"counts\"", "\"kg\"")));
    assert!(said.contains(
        "signal: Strain12.Counts1 has the unit \"kg\" in arm.dbc; it must be a gauge's reading: counts"
    ));
    let said = message(bind(ARM, URDF, &with(DBC, "\"rad\"", "\"\"")));
    assert!(said.contains("Joints12.Position1 has no unit in arm.dbc; it must be an angle"), "{said}");
}

#[test]
fn a_signal_that_the_dbc_lacks_is_named_with_the_nearest() {
    let said = message(bind(&with(ARM, "\"Strain12.Counts2\"", "\"Strain12.Count2\""), URDF, DBC));
    assert!(
        said.starts_with("arm.toml:")
            && said.contains("[[sensor]] \"s2\": signal: arm.dbc: no signal \"Strain12.Count2\""),
        "{said}"
    );
    assert!(said.ends_with("did you mean \"Strain12.Counts2\"?"), "{said}");
    let said = message(bind(&with(ARM, "Joints56.Position6", "Joints78.Position6"), URDF, DBC));
    assert!(
        said.contains("[[joint]] \"joint_6\": position: arm.dbc: no signal \"Joints78.Position6\""),
        "{said}"
    );
}

#[test]
fn a_counter_must_be_an_integer() {
    let dbc = with(DBC, "Sequence12 : 48|8@1+ (1,0)", "Sequence12 : 48|8@1+ (0.5,0)");
    let said = message(bind(ARM, URDF, &dbc));
    assert!(
        said.contains("[[sensor]] \"s1\": sequence: Strain12.Sequence12 is no integer counter in arm.dbc"),
        "{said}"
    );
}

#[test]
fn a_section_that_the_urdf_lacks_is_named_with_the_nearest() {
    let said = message(bind(&with(ARM, "section = \"section_7\"", "section = \"section_77\""), URDF, DBC));
    assert!(said.starts_with("arm.toml:") && said.contains("[[sensor]] \"s7\": "), "{said}");
    assert!(
        said.contains("section \"section_77\" is no joint of the URDF (nearest: \"section_7\")"),
        "{said}"
    );
}

#[test]
fn joints_and_tables_must_match() {
    let said = message(bind(&with(ARM, "name = \"joint_3\"", "name = \"joint_33\""), URDF, DBC));
    assert!(said.contains("[[joint]] \"joint_33\" is no movable joint between \"base_link\" and \"tool0\" in arm.urdf; did you mean \"joint_3\"?"), "{said}");
    let said = message(bind(&with(ARM, "name = \"joint_3\"", "name = \"section_7\""), URDF, DBC));
    assert!(
        said.contains("[[joint]] \"section_7\" is a fixed joint of arm.urdf; remove the table"),
        "{said}"
    );
    let without = with(ARM, "[[joint]]\nname = \"joint_3\"\nposition = \"Joints34.Position3\"\n", "");
    let said = message(bind(&without, URDF, DBC));
    assert!(
        said.contains("the movable joint \"joint_3\" of arm.urdf has no [[joint]] table; add one"),
        "{said}"
    );
}

#[test]
fn bad_files_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| std::fs::write(dir.path().join(name), text).unwrap();
    let load = || message(Rig::load_file(&dir.path().join("arm.toml")));
    write("arm.toml", ARM);
    assert!(
        load().contains("arm.urdf: cannot be read: No such file")
            && load().ends_with("give the path of a URDF ([robot] urdf)")
    );
    write("arm.urdf", "<robot name=\"x\"><link name=\"base_link\"></robot>");
    write("arm.dbc", "BO_ nonsense");
    assert!(load().contains("arm.urdf:1: not a readable URDF"), "{}", load());
    write("arm.urdf", URDF);
    assert!(load().contains("arm.dbc:1: not a DBC"), "{}", load());
    std::fs::remove_file(dir.path().join("arm.dbc")).unwrap();
    assert!(load().ends_with("give the path of a DBC ([bus] dbc)"), "{}", load());
    let said = message(bind(&with(ARM, "tip = \"tool0\"", "tip = \"tool1\""), URDF, DBC));
    assert!(said.contains("arm.urdf: the tip link \"tool1\" does not exist (nearest: \"tool0\")"), "{said}");
}

#[test]
fn an_output_must_not_look_like_an_input() {
    let text = with(
        &with(ARM, "interface = \"can1\"", "interface = \"can0\""),
        "force_id = 0x400",
        "force_id = 0x101",
    );
    let said = message(bind(&text, URDF, DBC));
    assert!(
        said.contains("[publish.can] force_id = 0x101 is the identifier of Strain12 on can0, which is read"),
        "{said}"
    );
    assert!(bind(&with(ARM, "force_id = 0x400", "force_id = 0x101"), URDF, DBC).is_ok(), "another bus");
}

#[test]
fn the_tool_hangs_on_the_tip() {
    let text = with(ARM, "mass = 0.0 ", "mass = 0.75 ");
    let heavy = bind(&text, URDF, DBC).unwrap();
    let bare = bind(ARM, URDF, DBC).unwrap();
    let tip_mass = |rig: &Rig| rig.chain.joints.last().unwrap().body.mass_kg;
    assert!((tip_mass(&heavy) - tip_mass(&bare) - 0.75).abs() < 1e-12);
    assert_eq!(heavy.fingerprint(), bare.fingerprint(), "a tool may change after the calibration");
}

#[test]
fn the_model_of_another_arm_is_refused_with_the_difference() {
    let here = bind(ARM, URDF, DBC).unwrap();
    let told = |config: &str, urdf: &str| {
        let other = bind(config, urdf, DBC).unwrap();
        assert_ne!(other.fingerprint().sha256(), here.fingerprint().sha256());
        message(here.check_model("model.toml".as_ref(), other.fingerprint()))
    };
    let swapped = with(&with(&with(ARM, "\"s1\"", "\"@\""), "\"s2\"", "\"s1\""), "\"@\"", "\"s2\"");
    let cases = [
        (told(&swapped, URDF), "its gauges are s2, s1, s3, s4, s5, s6, s7, s8, in this order"),
        (
            told(&with(ARM, "section = \"section_7\"", "section = \"section_8\""), URDF),
            "its gauge \"s7\" sits at \"section_8\", the configuration's at \"section_7\"",
        ),
        (
            told(&with(ARM, "# axis = [0.0, 0.0, 1.0]", "axis = [0.0, 0.1, 1.0]"), URDF),
            "its gauge \"s1\" has another sensing axis",
        ),
        (
            told(ARM, &with(URDF, "mass value=\"1.9\"", "mass value=\"1.8\"")),
            "its link after joint \"joint_1\" has another mass, centre of mass or inertia",
        ),
        (
            told(ARM, &with(URDF, "xyz=\"0 0 0.15\"", "xyz=\"0 0 0.16\"")),
            "its joint \"joint_1\" has another kind, origin or axis",
        ),
    ];
    for (said, expected) in cases {
        assert!(
            said.starts_with("model.toml: is the model of another arm than arm.toml describes: "),
            "{said}"
        );
        assert!(
            said.contains(expected) && said.ends_with("calibrate this arm, or give its own model"),
            "{said}"
        );
    }
    assert!(here.check_model("model.toml".as_ref(), here.fingerprint()).is_ok());
}

#[test]
fn formatting_does_not_make_another_arm() {
    let here = bind(ARM, URDF, DBC).unwrap();
    let urdf =
        with(URDF, "mass value=\"1.9\"", "mass   value=\"1.900\"").replace("upper=\"2.9\"", "upper=\"2.8\"");
    let same = bind(&with(ARM, "# axis = [0.0, 0.0, 1.0]", "axis = [0.0, 0.0, 2.0]"), &urdf, DBC).unwrap();
    assert_eq!(same.fingerprint().sha256(), here.fingerprint().sha256());
    assert_ne!(same.urdf_sha256, here.urdf_sha256);
}
