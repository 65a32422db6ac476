use std::net::IpAddr;
use std::path::Path;

use rig::Config;
use rig::config::{Inertia, PublishMode};

use super::{ARM, message, parse, with};

/// The smallest configuration: everything else is default.
fn minimal() -> String {
    let mut text =
        "format = 1\n[robot]\nurdf = \"a.urdf\"\nbase = \"b\"\ntip = \"t\"\n[bus]\ndbc = \"a.dbc\"\ninterfaces = [\"can0\"]\n"
            .to_owned();
    for i in 1..=6 {
        text += &format!("[[sensor]]\nname = \"s{i}\"\nsection = \"j{i}\"\nsignal = \"M.S{i}\"\n");
    }
    text
}

#[test]
fn defaults_are_those_of_the_contract() {
    let config = parse(&minimal()).unwrap();
    assert_eq!(config.robot.gravity_m_s2, [0.0, 0.0, -9.80665]);
    assert_eq!((config.bus.stale_after_s, config.bus.temperature_stale_after_s), (0.02, 5.0));
    assert_eq!((config.publish.rate_hz, config.publish.mode), (1000.0, PublishMode::Fixed));
    let publish = &config.publish;
    assert!(
        publish.can.is_none() && publish.rdt.is_none() && publish.ros2.is_none() && publish.metrics.is_none()
    );
    assert!(config.control.is_none() && config.tool.is_none() && config.model.is_none());
    assert_eq!((config.filter.cutoff_hz, config.filter.delay_s), (None, None));

    let tables =
        "[publish.can]\ninterface = \"can1\"\n[publish.rdt]\n[publish.ros2]\n[publish.metrics]\n[control]\n";
    let config = parse(&(minimal() + tables)).unwrap();
    let can = config.publish.can.unwrap();
    assert_eq!((can.force_id, can.torque_id, can.quality_id), (0x400, 0x401, 0x402));
    assert_eq!((can.force_n_per_bit, can.torque_nm_per_bit), (0.01, 0.001));
    let rdt = config.publish.rdt.unwrap();
    assert_eq!(
        (rdt.bind.to_string(), rdt.http.to_string()),
        ("127.0.0.1:49152".into(), "127.0.0.1:8049".into())
    );
    assert_eq!((rdt.counts_per_n, rdt.counts_per_nm), (1_000_000, 1_000_000));
    assert!(rdt.allow.len() == 1 && rdt.allow[0].contains(IpAddr::from([127, 9, 9, 9])));
    let ros2 = config.publish.ros2.unwrap();
    assert_eq!((ros2.topic.as_str(), ros2.frame_id, ros2.domain, ros2.endpoint), ("wrench", None, 0, None));
    assert_eq!(config.publish.metrics.unwrap().bind.to_string(), "127.0.0.1:9464");
    assert_eq!(config.control.unwrap().socket, Path::new("/run/wrenchd/control.sock"));
}

#[test]
fn paths_are_relative_to_the_file() {
    let text = minimal() + "[model]\npath = \"models/m.toml\"\n[control]\nsocket = \"c.sock\"\n";
    let config = Config::parse(Path::new("robots/one/arm.toml"), &text).unwrap();
    assert_eq!(config.robot.urdf, Path::new("robots/one/a.urdf"));
    assert_eq!(config.bus.dbc, Path::new("robots/one/a.dbc"));
    assert_eq!(config.model.unwrap().path, Path::new("robots/one/models/m.toml"));
    assert_eq!(config.control.unwrap().socket, Path::new("robots/one/c.sock"));
    let absolute = Config::parse(Path::new("x/arm.toml"), &with(&minimal(), "a.urdf", "/r/a.urdf")).unwrap();
    assert_eq!(absolute.robot.urdf, Path::new("/r/a.urdf"));
}

#[test]
fn inertia_is_six_numbers_or_three_rows() {
    let tool = |inertia: &str| {
        parse(&format!("{}[tool]\nmass = 1\ncom = [0, 0, 0.1]\ninertia = {inertia}\n", minimal()))
    };
    let expected = Inertia { rows_kg_m2: [[2.0, 0.1, 0.2], [0.1, 3.0, 0.3], [0.2, 0.3, 4.0]] };
    for text in ["[2, 0.1, 0.2, 3, 0.3, 4]", "[[2, 0.1, 0.2], [0.1, 3, 0.3], [0.2, 0.3, 4]]"] {
        assert_eq!(tool(text).unwrap().tool.unwrap().inertia, Some(expected), "{text}");
    }
    for text in [
        "[1, 2]",
        "[[1, 2], [3, 4], [5, 6]]",
        "[1, 2, 3]",
        "[\"a\", 0, 0, 1, 0, 1]",
        "[[1,0,0],[0,1,0],[0,0,1],[0,0,0]]",
    ] {
        assert!(
            message(tool(text)).contains("inertia is [ixx, ixy, ixz, iyy, iyz, izz] or three rows"),
            "{text}"
        );
    }
    for (text, why) in [
        ("[1, 0, 0, 1, 0, 3]", "has one principal moment above the sum of the other two"),
        ("[1, 0, 0, 1, 0, -1]", "has a negative principal moment"),
        ("[nan, 0, 0, 1, 0, 1]", "is not finite"),
        ("[[1, 0.5, 0], [0, 1, 0], [0, 0, 1]]", "is not symmetric"),
    ] {
        assert!(message(tool(text)).contains(why), "{text}: {}", message(tool(text)));
    }
}

#[test]
fn a_missing_or_unreadable_file_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("arm.toml");
    let said = message(Config::load(&file));
    assert!(said.starts_with(&format!("{}: cannot be read: No such file", file.display())), "{said}");
    assert!(said.ends_with("give the path of a configuration (TOML)"), "{said}");
    assert!(message(Config::load(dir.path())).ends_with("not of its folder"));
    std::fs::write(&file, b"format = 1\n# caf\xe9\n").unwrap();
    assert!(message(Config::load(&file)).contains("arm.toml:2: is not UTF-8 text"));
}

#[test]
fn an_unknown_key_names_its_line_and_the_nearest() {
    assert_eq!(
        message(parse(&with(ARM, "gravity = ", "gravty = "))),
        "arm.toml:10: unknown key \"gravty\"; did you mean \"gravity\"?\n   |\n\
         10 | gravty = [0.0, 0.0, -9.80665]   # m/s^2, in the base frame: turn it for a wall-mounted or hanging arm\n   | ^^^^^^"
    );
    let line = |text: &str, key: &str| text.lines().position(|line| line.starts_with(key)).unwrap() + 1;
    for (from, to, nearest) in [
        ("[publish.can]", "[publish.cann]", "can"),
        ("force_n_per_bit", "force_per_bit", "force_n_per_bit"),
        ("saturated =", "saturate =", "saturated"),
        ("[tool]", "[tools]", "tool"),
        ("position =", "positions =", "position"),
    ] {
        let text = with(ARM, from, to);
        let said = message(parse(&text));
        let wrong =
            to.trim_end_matches([' ', '=', ']']).trim_start_matches("[publish.").trim_start_matches('[');
        let start =
            format!("arm.toml:{}: unknown key \"{wrong}\"; did you mean \"{nearest}\"?", line(&text, to));
        assert!(said.starts_with(&start), "{said}\n{start}");
    }
    let far = message(parse(&with(ARM, "rate_hz = 1000.0", "qqq = 1")));
    assert!(far.contains("unknown key \"qqq\"; known here: rate_hz, mode, can, rdt, ros2, metrics"), "{far}");
}

#[test]
fn a_wrong_type_is_underlined() {
    assert_eq!(
        message(parse(&with(ARM, "rate_hz = 1000.0", "rate_hz = \"fast\""))),
        "arm.toml:124: invalid type: string \"fast\", expected a number\n    |\n\
         124 | rate_hz = \"fast\"\n    |           ^^^^^^"
    );
    let bad = |from, to| message(parse(&with(ARM, from, to)));
    assert!(
        bad("mode = \"fixed\"", "mode = \"often\"")
            .contains("unknown variant `often`, expected `fixed` or `event`")
    );
    assert!(bad("force_id = 0x400", "force_id = -1").contains("invalid value: integer `-1`, expected u32"));
    assert!(
        bad("tip = \"tool0\"", "").contains("arm.toml:6: the key \"tip\" is missing; add it to this table")
    );
    assert!(
        bad("com = [0.0, 0.0, 0.0]", "com = [0.0, 0.0]")
            .contains("expected three numbers [x, y, z], found 2")
    );
    assert!(
        bad("com = [0.0, 0.0, 0.0]", "com = [0, 0, 0, 0]")
            .contains("expected three numbers [x, y, z], found 4")
    );
    let signal = bad("\"Joints12.Position1\"", "\"Position1\"");
    assert!(signal.contains("\"Position1\" does not name a signal; write \"Message.Signal\""), "{signal}");
    let socket = parse(&(minimal() + "[publish.rdt]\nbind = \"localhost\"\n"));
    assert!(message(socket).contains("invalid socket address syntax"));
    let network = parse(&(minimal() + "[publish.rdt]\nallow = [\"10.0.0.0/40\"]\n"));
    assert!(message(network).contains("\"10.0.0.0/40\" is not a network; write an address with a prefix"));
    let syntax = bad("[bus]", "[bus");
    assert!(syntax.starts_with("arm.toml:12: "), "{syntax}");
}

#[test]
fn another_format_is_refused_before_its_keys() {
    let text = with(ARM, "format = 1", "format = 2\nnovelty = true");
    let said = message(parse(&text));
    assert!(
        said.starts_with("arm.toml:4: format = 2 is not one that this version reads; it reads format = 1"),
        "{said}"
    );
    assert!(message(parse(&with(ARM, "format = 1", ""))).contains("write format = 1 at the top"));
    assert!(message(parse(&with(ARM, "format = 1", "format = \"1\""))).contains("format = \"1\" is not one"));
    assert!(message(parse("")).contains("write format = 1 at the top"));
}

#[test]
fn values_that_cannot_be_are_refused_where_they_stand() {
    let cases: &[(&str, &str, &str)] = &[
        ("tip = \"tool0\"", "tip = \"base_link\"", ":9: [robot] base and tip are both \"base_link\""),
        ("tip = \"tool0\"", "tip = \"\"", ":9: [robot] tip is empty; fill it in or remove it"),
        ("-9.80665]", "nan]", ":10: [robot] gravity = [0.0, 0.0, NaN] is not finite"),
        ("[\"can0\"]", "[]", ":14: [bus] interfaces is empty; name at least one"),
        ("[\"can0\"]", "[\"can0\", \"can0\"]", ":14: [bus] interfaces names \"can0\" twice"),
        (
            "[\"can0\"]",
            "[\"a name too long for it\"]",
            ":14: [bus] interfaces: \"a name too long for it\" is no interface",
        ),
        (
            "# stale_after_s = 0.02",
            "stale_after_s = 0 ",
            ":15: [bus] stale_after_s = 0 must be a finite number above 0",
        ),
        (
            "# temperature_stale_after_s = 5.0",
            "temperature_stale_after_s = inf",
            "temperature_stale_after_s = inf must",
        ),
        ("name = \"joint_2\"", "name = \"joint_1\"", ":27: [[joint]] name = \"joint_1\" stands twice"),
        (
            "Joints12.Position2",
            "Joints12.Position1",
            ":28: [[joint]] \"joint_2\": position = \"Joints12.Position1\" is also that of \"joint_1\"",
        ),
        (
            "# interface = \"can0\"",
            "interface = \"can9\"",
            "[[joint]] \"joint_1\": interface = \"can9\" is not in [bus] interfaces; add it there, or: did you mean \"can0\"?",
        ),
        ("# delay_s = 0.0005", "delay_s = -1.0", "[[joint]] \"joint_1\": delay_s = -1 is outside 0 .. 1 s"),
        (
            "# velocity = \"Joints12.Velocity1\"",
            "velocity = \"Joints12.Position1\"",
            "velocity is the same signal as its position",
        ),
        ("name = \"s2\"", "name = \"s1\"", "[[sensor]] name = \"s1\" stands twice; give each its own"),
        (
            "Strain12.Counts2",
            "Strain12.Counts1",
            "[[sensor]] \"s2\": signal = \"Strain12.Counts1\" is also that of \"s1\"",
        ),
        (
            "# axis = [0.0, 0.0, 1.0]",
            "axis = [0.0, 0.0, 0.0]",
            "[[sensor]] \"s1\": axis = [0.0, 0.0, 0.0] has no direction",
        ),
        (
            "# axis = [0.0, 0.0, 1.0]",
            "axis = [0.0, inf, 1.0]",
            "[[sensor]] \"s1\": axis = [0.0, inf, 1.0] is not finite",
        ),
        (
            "\"Strain12.Saturated1\"",
            "\"Strain12.Counts1\"",
            "[[sensor]] \"s1\": saturated is the same signal as its reading",
        ),
        (
            "\"Strain12.Sequence12\"",
            "\"Strain34.Sequence34\"",
            "[[sensor]] \"s1\": sequence = \"Strain34.Sequence34\" counts another message than the reading's; name a signal of \"Strain12\"",
        ),
        ("mass = 0.0", "mass = -0.1", "[tool] mass = -0.1 must be a finite number, 0 or more"),
        ("rate_hz = 1000.0", "rate_hz = 0.0", ":124: [publish] rate_hz = 0 must be a finite number above 0"),
        ("rate_hz = 1000.0", "rate_hz = nan", ":124: [publish] rate_hz = NaN must be"),
        ("rate_hz = 1000.0", "rate_hz = 1e6", ":124: [publish] rate_hz = 1000000 is beyond 10000; lower it"),
        (
            "force_n_per_bit = 0.01",
            "force_n_per_bit = 0",
            "[publish.can] force_n_per_bit = 0 must be a finite number above 0",
        ),
        (
            "torque_id = 0x401",
            "torque_id = 0x400",
            "[publish.can] torque_id = 0x400 is also force_id; give each frame its own",
        ),
        (
            "quality_id = 0x402",
            "quality_id = 0x2000_0000",
            "[publish.can] quality_id = 0x20000000 is no CAN identifier",
        ),
        ("interface = \"can1\"", "interface = \"\"", "[publish.can] interface: \"\" is no interface name"),
    ];
    for (from, to, expected) in cases {
        let said = message(parse(&with(ARM, from, to)));
        assert!(said.starts_with("arm.toml:") && said.contains(expected), "{to}: {said}");
        assert!(!said.contains('\n'), "one line: {said}");
    }
}

#[test]
fn network_outputs_are_checked() {
    let cases = [
        (
            "[publish.rdt]\ncounts_per_n = 0\n",
            "arm.toml:34: [publish.rdt] counts_per_n = 0 leaves nothing to send",
        ),
        ("[publish.rdt]\nallow = []\n", "arm.toml:34: [publish.rdt] allow is empty, so nobody is answered"),
        (
            "[publish.rdt]\n[publish.metrics]\nbind = \"127.0.0.1:8049\"\n",
            "arm.toml:35: [publish.metrics] bind = \"127.0.0.1:8049\" is also",
        ),
        ("[publish.ros2]\ntopic = \"\"\n", "arm.toml:34: [publish.ros2] topic is empty"),
        (
            "[publish.ros2]\ndomain = 233\n",
            "arm.toml:34: [publish.ros2] domain = 233 is beyond 232; lower it",
        ),
        ("[filter]\ncutoff_hz = 0\n", "arm.toml:34: [filter] cutoff_hz = 0 must be"),
        ("[filter]\ndelay_s = 2\n", "arm.toml:34: [filter] delay_s = 2 is outside 0 .. 1 s"),
    ];
    for (tables, expected) in cases {
        let said = message(parse(&(minimal() + tables)));
        assert!(said.starts_with(expected), "{said}");
    }
}

#[test]
fn fewer_than_six_gauges_are_refused() {
    let text = minimal();
    let five = &text[..text.rfind("[[sensor]]").unwrap()];
    assert_eq!(
        message(parse(five)),
        "arm.toml:9: 5 [[sensor]] tables: six components of a wrench need at least 6 gauges; add the others"
    );
    let none = &text[..text.find("[[sensor]]").unwrap()];
    assert!(message(parse(none)).starts_with("arm.toml: 0 [[sensor]] tables"));
}
