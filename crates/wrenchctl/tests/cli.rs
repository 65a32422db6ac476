//! The program as a person runs it: golden output, exit statuses, one message for each bad input.

#![allow(clippy::unwrap_used, clippy::panic)]

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const ARM: &str = "../../config/arm.toml";
const LOG: &str = "tests/data/small.log";

fn wrenchctl(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_wrenchctl"))
        .args(args)
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .stdin(Stdio::null())
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// Compares with a golden file; `UPDATE_GOLDEN=1` writes it.
fn golden(name: &str, args: &[&str]) {
    let output = wrenchctl(args);
    assert_eq!(output.status.code(), Some(0), "{args:?}: {}", text(&output.stderr));
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name);
    if std::env::var_os("UPDATE_GOLDEN").is_some() {
        std::fs::write(&file, &output.stdout).unwrap();
    }
    let expected = std::fs::read_to_string(&file).unwrap();
    assert_eq!(text(&output.stdout), expected, "{name}; UPDATE_GOLDEN=1 accepts what it is now");
}

/// Exit status 2, nothing on standard output, one message on standard error that says all of `parts`.
fn refused(args: &[&str], parts: &[&str]) {
    let output = wrenchctl(args);
    let message = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{args:?}: {message}");
    assert_eq!(text(&output.stdout), "", "{args:?}");
    // A message about a place in a file shows the place below.
    assert!(message.starts_with("wrenchctl: "), "{args:?}: {message}");
    assert_eq!(message.matches("wrenchctl: ").count(), 1, "{args:?}: {message}");
    for part in parts {
        assert!(message.contains(part), "{args:?}: {part:?} is not in {message}");
    }
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    fn write(&self, name: &str, bytes: impl AsRef<[u8]>) -> String {
        std::fs::write(self.path(name), bytes).unwrap();
        self.path(name)
    }

    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.0.path()).unwrap();
        let mut names: Vec<String> =
            entries.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
        names.sort();
        names
    }
}

#[test]
fn check_prints_the_arm_and_the_planned_load() {
    golden("check.txt", &["check", ARM]);
}

#[test]
fn check_knows_the_model_and_refuses_that_of_another_arm() {
    let folder = Folder::new();
    let model = folder.path("model.toml");
    let run = simulate(&folder, "run", &["--motion", "calibration"]);
    let made = wrenchctl(&["calibrate", run.to_str().unwrap(), "--out", &model]);
    assert_eq!(made.status.code(), Some(0), "{}", text(&made.stderr));
    let own = wrenchctl(&["check", ARM, "--model", &model]);
    let said = text(&own.stdout);
    assert_eq!(own.status.code(), Some(0), "{said}{}", text(&own.stderr));
    assert!(said.contains("full axes") && said.contains("crosstalk"), "{said}");
    // Another arm: one link is heavier.
    let urdf = std::fs::read_to_string(run.join("arm.urdf")).unwrap();
    std::fs::write(run.join("arm.urdf"), urdf.replacen("<mass value=\"", "<mass value=\"9", 2)).unwrap();
    let other = wrenchctl(&["check", run.join("arm.toml").to_str().unwrap(), "--model", &model]);
    let why = text(&other.stderr);
    assert_eq!(other.status.code(), Some(1), "{why}");
    assert!(why.contains("is the model of another arm"), "{why}");
}

#[test]
fn dump_prints_lines_as_candump_does() {
    golden("dump.txt", &["dump", LOG]);
    golden("dump_decoded.txt", &["dump", LOG, "--config", ARM]);
    golden("dump_one_message.txt", &["dump", LOG, "--config", ARM, "--message", "Strain12", "--count", "2"]);
    golden("dump_one_id.txt", &["dump", LOG, "--id", "201"]);
}

#[test]
fn what_dump_prints_can_be_read_again() {
    let first = wrenchctl(&["dump", LOG]);
    let folder = Folder::new();
    let again = wrenchctl(&["dump", &folder.write("again.log", &first.stdout)]);
    let frames = |output: &Output| text(&output.stdout).lines().filter(|line| line.starts_with('(')).count();
    assert_eq!(frames(&first) - frames(&again), 1, "only the error frame's words are no candump line");
}

#[test]
fn stats_are_those_of_the_frames() {
    golden("stats.txt", &["stats", LOG]);
    golden("stats_config.txt", &["stats", LOG, "--config", ARM]);
    golden("stats.json", &["stats", LOG, "--config", ARM, "--json", "-"]);
}

#[test]
fn dump_tells_the_figures_of_what_it_printed() {
    let said = |args: &[&str]| text(&wrenchctl(args).stdout);
    let with_config = ["dump", LOG, "--config", ARM];
    let expected = format!("{}\n{}", said(&with_config), said(&["stats", LOG, "--config", ARM]));
    assert_eq!(said(&[&with_config[..], &["--stats"]].concat()), expected);
    let one = said(&[&with_config[..], &["--stats", "--message", "Strain12", "--count", "3"]].concat());
    assert_eq!(one.lines().filter(|line| line.starts_with('(')).count(), 3);
    let (_, figures) = one.split_once("\n\n").unwrap();
    assert!(figures.contains(": 0.001 s, 3 frames") && figures.contains("Strain12"), "{figures}");
    assert!(!figures.contains("201"), "only what was printed: {figures}");
}

#[test]
fn a_reader_that_has_seen_enough_is_no_error() {
    let folder = Folder::new();
    let line = "(1790000000.000000) can0 201#3E9507008979E2FF\n";
    let log = folder.write("long.log", line.repeat(20_000));
    let mut child = Command::new(env!("CARGO_BIN_EXE_wrenchctl"))
        .args(["dump", &log])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!((output.status.code(), text(&output.stderr).as_str()), (Some(0), ""));
}

#[test]
fn compressed_logs_are_read_and_cut_ones_refused() {
    let folder = Folder::new();
    let whole = std::fs::read("../../tests/captures/accuracy/can.log.gz").unwrap();
    let log = folder.write("whole.log.gz", &whole);
    assert_eq!(text(&wrenchctl(&["dump", &log, "--count", "3"]).stdout).lines().count(), 3);
    let cut = folder.write("cut.log.gz", &whole[..whole.len() / 2]);
    let output = wrenchctl(&["stats", &cut]);
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("cut off or damaged"), "{}", text(&output.stderr));
}

#[test]
fn bad_inputs_are_refused_with_what_to_do() {
    let folder = Folder::new();
    refused(&["check", "none.toml"], &["none.toml", "give the path of"]);
    let config = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(ARM)).unwrap();
    let wrong = folder.write("wrong.toml", config.replace("rate_hz", "rate_hertz"));
    refused(&["check", &wrong], &["wrong.toml:", "rate_hertz", "rate_hz"]);
    refused(&["check", ARM, "--model", "none.toml"], &["none.toml"]);
    let model = folder.write("model.toml", "format = 1\n");
    refused(&["check", ARM, "--model", &model], &["model.toml"]);
    refused(&["dump", "nocan7"], &["nocan7", "neither a log file nor a CAN interface"]);
    refused(&["dump", "none.log"], &["cannot open none.log"]);
    refused(&["stats", &folder.path("")], &["has no run.toml"]);
    refused(&["stats", ARM], &["none of its", "candump"]);
    refused(&["dump", LOG, "--config", ARM, "--message", "Strain99"], &["Strain99", "Strain12"]);
    refused(&["dump", LOG, "--config", "none.toml"], &["none.toml"]);
    refused(&["replay", LOG, "--onto", "nocan7"], &["no CAN interface \"nocan7\""]);
    refused(&["replay", "nothing", "--onto", "nocan7"], &["\"nothing\" is no run directory and no log"]);
    refused(&["stats", LOG, "--json", &folder.path("none/x.json")], &["cannot write", "none/x.json"]);
}

#[test]
fn what_would_count_twice_overwrite_or_mix_is_refused() {
    let folder = Folder::new();
    let run = simulate(&folder, "run", &["--motion", "calibration"]);
    let (run, model) = (run.to_str().unwrap(), folder.path("model.toml"));
    refused(&["calibrate", run, run, "--out", &model], &["run", "given twice"]);
    let config = format!("{run}/arm.toml");
    let before = std::fs::read(&config).unwrap();
    refused(&["calibrate", run, "--out", &config], &["arm.toml", "one of the inputs"]);
    assert_eq!(std::fs::read(&config).unwrap(), before);
    let (config, model_there) = (config.as_str(), folder.write("known.toml", "a model"));
    let (log, reference) = (format!("{run}/can.log.gz"), format!("{run}/reference.csv"));
    let whole = |dir: &str| -> Vec<Vec<u8>> {
        let names = ["arm.toml", "arm.urdf", "arm.dbc", "run.toml", "can.log.gz", "reference.csv"];
        names.iter().filter_map(|name| std::fs::read(format!("{dir}/{name}")).ok()).collect()
    };
    let before = whole(run);
    assert_eq!(before.len(), 6, "the run has them all");
    for input in [run, &log] {
        refused(
            &["mcap", input, "--config", config, "--model", &model, "--out", &log],
            &["can.log.gz", "one of"],
        );
        refused(&["stats", input, "--json", &log], &["can.log.gz", "one of the inputs"]);
    }
    refused(&["stats", &log, "--config", config, "--json", config], &["arm.toml", "one of the inputs"]);
    let mcap = ["mcap", run, "--config", config, "--model", &model_there, "--out"];
    for out in [config, &model_there] {
        refused(&[&mcap[..], &[out]].concat(), &[out, "one of the inputs"]);
    }
    let run_file = format!("{run}/run.toml");
    for (option, out) in [("--csv", &run_file), ("--json", &log), ("--report", &model_there)] {
        refused(&["validate", run, "--model", &model_there, option, out], &[out, "one of the inputs"]);
    }
    for (option, out) in [("--json", &run_file), ("--report", &log), ("--apply", &model_there)] {
        refused(&["diagnose", run, "--model", &model_there, option, out], &[out, "one of the inputs"]);
    }
    refused(&["plan", "--config", config, "--json", config], &["arm.toml", "one of the inputs"]);
    refused(&["plan", "--config", config, run, "--json", &run_file], &["run.toml", "one of the inputs"]);
    refused(&["status", "--config", config, "--json", config], &["arm.toml", "one of the inputs"]);
    assert_eq!((whole(run), std::fs::read(&model_there).unwrap()), (before, b"a model".to_vec()));
    refused(
        &["calibrate", run, "--out", &model, "--json", &reference],
        &["reference.csv", "one of the inputs"],
    );
    let (comparison, table) = (folder.path("comparison"), folder.path("comparison/table.csv"));
    std::fs::create_dir(&comparison).unwrap();
    folder
        .write("comparison/comparison.toml", "format = 1\npurpose = \"comparison\"\ntable = \"table.csv\"\n");
    folder.write("comparison/table.csv", "a,b\n");
    refused(&["diagnose", &comparison, "--json", &table], &["table.csv", "one of the inputs"]);
    refused(&["calibrate", run, "--out", "-", "--json", "-"], &["2 results", "standard output"]);
    refused(&["validate", run, "--model", &model, "--csv", "-", "--json", "-"], &["2 results"]);
    assert!(!Path::new(&model).exists());
    refused(&["check", "/dev/zero"], &["/dev/zero", "larger than 64 MiB"]);
}

#[test]
fn validate_scores_the_baselines_beside_each_score() {
    let folder = Folder::new();
    let model = folder.path("model.toml");
    let run = simulate(&folder, "run", &["--motion", "calibration"]);
    let run = run.to_str().unwrap();
    assert_eq!(wrenchctl(&["calibrate", run, "--out", &model]).status.code(), Some(0));
    let output = wrenchctl(&["validate", run, "--model", &model, "--json", "-"]);
    let scores: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    for part in ["still", "moving", "all"] {
        let own = scores[part]["force_rms_all_n"].as_f64().unwrap();
        for baseline in ["five_parameter", "nominal_axes"] {
            let beside = scores[part][baseline]["force_rms_all_n"].as_f64().unwrap();
            assert!(beside > own, "{part} {baseline}: {beside} {own}");
            assert_eq!(scores[baseline][part]["force_rms_all_n"].as_f64(), Some(beside));
        }
    }
    assert_eq!(scores["still"]["nees"].as_array().unwrap().len(), 6);
}

#[cfg(unix)]
#[test]
fn an_interrupted_simulation_leaves_nothing() {
    let folder = Folder::new();
    let mut child = Command::new(env!("CARGO_BIN_EXE_wrenchctl"))
        .args(["simulate", "--config", ARM, "--motion", "calibration", "--rate", "1000"])
        .args(["--out", &folder.path("run")])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    while folder.names().is_empty() {
        assert!(child.try_wait().unwrap().is_none(), "it was done before it could be interrupted");
        std::thread::sleep(std::time::Duration::from_millis(5));
    }
    // The shell's own kill: a bare system has no other.
    let killed = Command::new("sh").args(["-c", &format!("kill -INT {}", child.id())]).status().unwrap();
    assert!(killed.success());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(2), "{}", text(&output.stderr));
    assert!(text(&output.stderr).contains("interrupted; nothing was left behind"));
    assert_eq!(folder.names(), Vec::<String>::new());
}

#[test]
fn bad_arguments_are_refused_by_name() {
    for (args, part) in [
        (vec!["dump", LOG, "--seconds", "0"], "above 0"),
        (vec!["dump", LOG, "--id", "800"], "up to 7FF"),
        (vec!["replay", LOG, "--onto", "can0", "--speed", "0"], "--speed"),
        (vec!["simulate", "--config", ARM, "--out", "x", "--load", "1,2"], "M,X,Y,Z"),
        (vec!["dump", LOG, "--message", "Strain12"], "--config"),
        (vec!["nothing"], "nothing"),
    ] {
        let output = wrenchctl(&args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(text(&output.stderr).contains(part), "{args:?}: {}", text(&output.stderr));
    }
}

#[test]
fn a_refused_recording_leaves_nothing() {
    let folder = Folder::new();
    let run = folder.path("run");
    let config = std::fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join(ARM)).unwrap();
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    let config = config.replace("\"can0\"", "\"nocan7\"");
    let config = config.replace("\"arm.", &format!("\"{}/arm.", data.display()));
    let config = folder.write("arm.toml", config);
    refused(&["record", "--config", &config, "--out", &run], &["no CAN interface \"nocan7\""]);
    assert_eq!(folder.names(), ["arm.toml"]);
}

fn simulate(folder: &Folder, name: &str, args: &[&str]) -> PathBuf {
    let run = folder.path(name);
    let all = [&["simulate", "--config", ARM, "--out", &run], args].concat();
    let output = wrenchctl(&all);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    run.into()
}

#[test]
fn a_simulated_run_is_a_run_and_repeats_with_its_seed() {
    let folder = Folder::new();
    let motion = folder.write(
        "motion.csv",
        "t,joint_1,joint_2,joint_3,joint_4,joint_5,joint_6\n0,0,0,0,0,0,0\n1,0.1,0.2,0.1,0,0,0\n2,0,0,0,0,0,0\n",
    );
    let same = ["--motion", &motion, "--load", "0.5,0,0,0.05", "--seed", "7"];
    let (a, b) = (simulate(&folder, "a", &same), simulate(&folder, "b", &same));
    let log = |run: &Path| text(&wrenchctl(&["dump", run.to_str().unwrap()]).stdout);
    assert_eq!(log(&a), log(&b));
    let run = rig::Run::load(&a).unwrap();
    assert_eq!(run.loads.at(1.0).mass_kg, 0.5);
    let stats = wrenchctl(&["stats", a.to_str().unwrap(), "--config", ARM, "--json", "-"]);
    let stats: serde_json::Value = serde_json::from_slice(&stats.stdout).unwrap();
    let strain = stats["messages"].as_array().unwrap().iter().find(|m| m["name"] == "Strain12").unwrap();
    assert_eq!((&strain["frames"], &strain["missing"]), (&251.into(), &0.into()), "2 s at 125 Hz");
    assert!(folder.names().contains(&"labels.json".to_owned()));
}

#[test]
fn what_cannot_be_simulated_is_refused() {
    let folder = Folder::new();
    let run = folder.path("run");
    let simulate = |args: &[&str], parts: &[&str]| {
        refused(&[&["simulate", "--config", ARM, "--out", &run], args].concat(), parts);
        assert!(folder.names().is_empty(), "{:?}", folder.names());
    };
    simulate(&["--effect", "drfit@s1"], &["--effect drfit@s1", "is no effect", "drift"]);
    simulate(&["--motion", "dance"], &["dance", "calibration, accuracy, sweep, holds"]);
    simulate(&["--motion", "none.csv"], &["none.csv"]);
    simulate(&["--rate", "1e9"], &["rate"]);
    simulate(&["--model", "none.toml"], &["none.toml"]);
}

#[test]
fn a_plan_is_poses_within_the_limits_and_repeats_with_its_seed() {
    let plan = |args: &[&str]| {
        let all = [&["plan", "--config", ARM, "--json", "-"], args].concat();
        let output = wrenchctl(&all);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    let found = plan(&["--count", "9", "--weights", "0.5@0,0,0.05; 1.25@0.08,0,-0.03"]);
    assert_eq!(found, plan(&["--count", "9", "--weights", "0.5@0,0,0.05; 1.25@0.08,0,-0.03"]));
    let poses = found["poses"].as_array().unwrap();
    assert_eq!((poses.len(), found["joints"].as_array().unwrap().len()), (9, 6));
    let mut ranks: Vec<u64> = poses.iter().map(|pose| pose["rank"].as_u64().unwrap()).collect();
    ranks.sort_unstable();
    assert_eq!(ranks, (1..=9).collect::<Vec<_>>());
    assert!(poses.iter().all(|pose| pose["joints_rad"].as_array().unwrap().len() == 6));
    let masses: Vec<Option<f64>> = poses.iter().map(|pose| pose["load"]["mass_kg"].as_f64()).collect();
    assert!(
        masses.contains(&Some(1.25)) && masses.iter().flatten().all(|m| [0.5, 1.25].contains(m)),
        "{masses:?}"
    );
    let changes = masses.windows(2).filter(|pair| pair[0] != pair[1]).count();
    assert!(changes <= 2, "weights are changed as seldom as possible: {masses:?}");
    let sigma = |part: &str| found[part]["force_sigma_n"].as_f64().unwrap();
    assert!(sigma("before") > sigma("after") && sigma("after") > sigma("noise_alone"), "{found}");
    // Weights do not show everything of an upright first joint, and the plan says so.
    let unseen = found["not_helped"].as_array().unwrap();
    assert!(
        unseen.iter().any(|u| u["sensor"] == "s1" && u["remedy"].as_str().unwrap().contains("tilt the base"))
    );
    let said = text(&wrenchctl(&["plan", "--config", ARM, "--count", "9"]).stdout);
    assert!(said.contains("worst deviation in the workspace") && said.contains("after all 9"), "{said}");
}

#[test]
fn what_cannot_be_planned_is_refused() {
    refused(&["plan", "--config", "none.toml"], &["none.toml"]);
    refused(&["plan", "--config", ARM, "none"], &["none"]);
    refused(&["plan", "--config", ARM, "--model", "none.toml"], &["none.toml"]);
    refused(&["plan", "--config", ARM, "--force-sigma-n", "0.0001"], &["noise alone leaves", "ask for more"]);
    for (args, part) in [
        (["--weights", "0.5@0,0"], "MASS@X,Y,Z"),
        (["--weights", "-1@0,0,0"], "MASS@X,Y,Z"),
        (["--count", "0"], "1..=400"),
        (["--count", "401"], "1..=400"),
        (["--force-sigma-n", "nan"], "positive number"),
    ] {
        let output = wrenchctl(&[&["plan", "--config", ARM], &args[..]].concat());
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(text(&output.stderr).contains(part), "{args:?}: {}", text(&output.stderr));
    }
}

#[test]
fn the_demo_agrees_with_the_truth() {
    let output = wrenchctl(&["demo", "--seconds", "12"]);
    let said = text(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{said}{}", text(&output.stderr));
    assert!(said.contains("the published wrench agrees with the truth"), "{said}");
    assert!(said.lines().filter(|line| line.starts_with("t=")).count() >= 8, "a line a second: {said}");
    assert!(!said.contains('\x1b'), "no terminal, no control characters");
}

#[test]
fn without_a_daemon_its_commands_say_what_to_check() {
    let folder = Folder::new();
    let socket = folder.path("control.sock");
    for command in
        [&["status"][..], &["tare"], &["untare"], &["reload"], &["payload", "0.5", "0", "0", "0.05"]]
    {
        let args = [command, &["--socket", &socket]].concat();
        refused(&args, &[&socket, "is wrenchd running"]);
    }
    refused(&["payload", "-1", "0", "0", "0", "--socket", &socket], &["-1", "1000 kg"]);
    refused(&["monitor", "--socket", &socket], &["terminal", "wrenchctl status"]);
}
