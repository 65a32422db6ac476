use rig::Rig;
use rig::binding::BitRates;

use super::examples;

#[test]
fn every_example_configuration_binds() {
    let mut found = 0;
    for entry in std::fs::read_dir(examples()).unwrap() {
        let file = entry.unwrap().path();
        if file.extension().is_some_and(|extension| extension == "toml") {
            let rig = Rig::load_file(&file).unwrap_or_else(|error| panic!("{error}"));
            assert_eq!((rig.sections.len(), rig.joint_entries.len()), (8, 6), "{}", file.display());
            assert_eq!(rig.warnings, Vec::<String>::new());
            found += 1;
        }
    }
    assert_eq!(found, 2);
}

#[test]
fn what_the_example_comments_out_is_valid() {
    let mut text = String::new();
    for line in super::ARM.lines() {
        // Velocity1 is the one thing that the reference DBC does not have.
        let key_or_table = line.strip_prefix("# ").filter(|rest| {
            rest.starts_with('[') || rest.split_once(" = ").is_some_and(|(key, _)| !key.contains([' ', ':']))
        });
        text.push_str(key_or_table.unwrap_or(line));
        text.push('\n');
    }
    let config = super::parse(&text).unwrap_or_else(|error| panic!("{error}"));
    assert!(
        config.publish.rdt.is_some() && config.publish.ros2.is_some() && config.publish.metrics.is_some()
    );
    assert_eq!(config.filter.cutoff_hz, Some(20.0));
    assert_eq!(config.sensors[0].delay_s, Some(0.0003));
    assert_eq!(config.tool.unwrap().inertia.unwrap().rows_kg_m2, [[0.0; 3]; 3]);
}

#[test]
fn the_examples_fit_their_buses() {
    let load = |name: &str| Rig::load_file(&examples().join(name)).unwrap().planned_load(BitRates::default());
    let arm = load("arm.toml");
    // Four gauge and three joint messages at 1 kHz, one of temperatures at 10 Hz; three wrench frames at 1 kHz out.
    assert_eq!(arm.iter().map(|bus| bus.interface.as_str()).collect::<Vec<_>>(), ["can0", "can1"]);
    assert!((arm[0].least - 7.01 * 0.111).abs() < 1e-9 && (arm[0].most - 7.01 * 0.135).abs() < 1e-9);
    assert!((arm[1].least - 0.333).abs() < 1e-9);
    let fd = load("arm_fd.toml");
    assert!(fd.len() == 1 && fd[0].most < 0.8, "{fd:?}");
}
