//! What the program says to unusable input: exit status 2, one clear message.

use std::fs;
use std::path::Path;
use std::process::Command;

use rig::config::PublishMode;

use crate::common::{examples, model, rig, truth};

/// Status and standard error of a run with these arguments.
fn wrenchd(arguments: &[&Path]) -> (Option<i32>, String) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_wrenchd"));
    let options = ["--config", "--model"];
    for (option, value) in options.iter().zip(arguments) {
        command.arg(option).arg(value);
    }
    let output = command.output().unwrap();
    assert!(output.stdout.is_empty(), "data goes to standard output, and the daemon has none");
    (output.status.code(), String::from_utf8(output.stderr).unwrap())
}

fn refused(arguments: &[&Path], words: &[&str]) {
    let (code, said) = wrenchd(arguments);
    assert_eq!(code, Some(2), "{said}");
    // What is read may point at a line with a few more lines of text.
    let (before, message) =
        said.split_once("wrenchd: error: ").unwrap_or_else(|| panic!("no message: {said}"));
    assert!(before.is_empty() || before.ends_with('\n'), "{said}");
    assert!(!message.contains("wrenchd: error: "), "one message: {said}");
    for word in words {
        assert!(message.contains(word), "{word:?} is missing in: {said}");
    }
}

/// The example configuration with a change, beside copies of what it names; and a model that fits it.
struct Files {
    folder: tempfile::TempDir,
}

impl Files {
    fn new(from: &str, to: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        for name in ["arm.urdf", "arm.dbc"] {
            fs::copy(examples().join(name), folder.path().join(name)).unwrap();
        }
        let text = fs::read_to_string(examples().join("arm.toml")).unwrap();
        assert!(text.contains(from), "{from}");
        fs::write(folder.path().join("arm.toml"), text.replace(from, to)).unwrap();
        let rig = rig(PublishMode::Fixed);
        fs::write(folder.path().join("model.toml"), model(&rig, &truth(&rig)).to_toml()).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> std::path::PathBuf {
        self.folder.path().join(name)
    }

    fn refused(&self, words: &[&str]) {
        refused(&[&self.path("arm.toml"), &self.path("model.toml")], words);
    }
}

#[test]
fn files_that_are_not_there() {
    refused(&[Path::new("/nowhere/arm.toml")], &["/nowhere/arm.toml", "cannot be read"]);
    let files = Files::new("", "");
    refused(&[&files.path("arm.toml")], &["arm.toml", "--model", "wrenchctl calibrate"]);
    refused(&[&files.path("arm.toml"), &files.path("other.toml")], &["other.toml", "cannot be read"]);
    Files::new("\"arm.urdf\"", "\"gone.urdf\"").refused(&["gone.urdf"]);
    Files::new("\"arm.dbc\"", "\"gone.dbc\"").refused(&["gone.dbc"]);
}

#[test]
fn configurations_that_contradict() {
    Files::new("rate_hz = 1000.0", "rate_herz = 1000.0").refused(&["arm.toml", "rate_herz", "rate_hz"]);
    Files::new("\"Strain12.Counts1\"", "\"Strain12.Count1\"").refused(&["Strain12.Count1", "Counts1"]);
    Files::new("section = \"joint_1\"", "section = \"joint_9\"").refused(&["joint_9"]);
    let files = Files::new("", "");
    let text = fs::read_to_string(files.path("arm.toml")).unwrap();
    let (start, end) =
        (text.find("[[sensor]]\nname = \"s6\"").unwrap(), text.find("# What is mounted").unwrap());
    fs::write(files.path("arm.toml"), format!("{}{}", &text[..start], &text[end..])).unwrap();
    files.refused(&["arm.toml", "5 [[sensor]]", "6"]);
}

#[test]
fn models_that_do_not_fit() {
    let files = Files::new("section = \"section_8\"", "section = \"section_7\"");
    files.refused(&["model.toml", "another arm", "s8", "section_8"]);
    let files = Files::new("", "");
    let urdf = fs::read_to_string(files.path("arm.urdf")).unwrap();
    let heavier = urdf.replacen("<mass value=\"", "<mass value=\"1", 1);
    assert_ne!(urdf, heavier);
    fs::write(files.path("arm.urdf"), heavier).unwrap();
    let last = wrenchd(&[&files.path("arm.toml"), &files.path("model.toml")]).1;
    // A body that is fixed to the base carries no gauge: then nothing but the interface is missing.
    assert!(last.contains("another arm") || last.contains("can1"), "{last}");
    let files = Files::new("", "");
    let model = fs::read_to_string(files.path("model.toml")).unwrap();
    fs::write(files.path("model.toml"), &model[..model.len() / 2]).unwrap();
    files.refused(&["model.toml"]);
}

#[test]
fn interfaces_that_do_not_exist() {
    Files::new("\"can1\"", "\"nocan1\"").refused(&["nocan1", "ip link add dev nocan1"]);
    let files = Files::new("[publish.can]\ninterface = \"can1\"", "[publish.can]\ninterface = \"nocan1\"");
    files.refused(&["nocan1"]);
}

#[test]
fn arguments_are_explained() {
    let (code, said) = wrenchd(&[]);
    assert_eq!(code, Some(2));
    assert!(said.contains("--config") && said.contains("Usage"), "{said}");
}

/// With the disk of its log full: neither a log line nor the last message ends the program by a panic (status 101).
#[test]
fn a_log_that_takes_nothing_changes_no_exit_status() {
    let files = Files::new(
        "[publish.can]\ninterface = \"can1\"",
        "[publish.ros2]\n[publish.can]\ninterface = \"nocan1\"",
    );
    let full = fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_wrenchd"));
    command.arg("--config").arg(files.path("arm.toml")).arg("--model").arg(files.path("model.toml"));
    assert_eq!(command.stderr(full).status().unwrap().code(), Some(2));
}
