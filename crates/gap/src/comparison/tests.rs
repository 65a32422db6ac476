//! Comparisons written by the tests, with effects in other forms than the fitter's where it matters.

use std::path::Path;

use super::*;
use crate::diagnosis::{Diagnosis, Verdict};

const HEAD: &str = "format = 1\npurpose = \"comparison\"\ntable = \"table.csv\"\n";
const CHANNEL: &str = "[[channel]]\nname = \"c\"\nmeasured = \"z\"\nsimulated = \"s\"\nunit = \"N\"\n";

fn write(dir: &Path, description: &str, table: &str) {
    std::fs::write(dir.join("comparison.toml"), description).unwrap();
    std::fs::write(dir.join("table.csv"), table).unwrap();
}

fn refusal(description: &str, table: &str) -> String {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path(), description, table);
    load(dir.path()).unwrap_err().to_string().replace(&dir.path().display().to_string(), "DIR")
}

/// Noise with a memory of some samples, the same for a seed.
struct Noise {
    state: u64,
    last: f64,
}

impl Noise {
    fn new(seed: u64) -> Self {
        Self { state: seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1, last: 0.0 }
    }

    fn next(&mut self, memory: f64) -> f64 {
        let mut sum = 0.0;
        for _ in 0..12 {
            self.state ^= self.state << 13;
            self.state ^= self.state >> 7;
            self.state ^= self.state << 17;
            sum += (self.state >> 11) as f64 / (1_u64 << 53) as f64;
        }
        self.last = memory * self.last + (1.0 - memory * memory).sqrt() * (sum - 6.0);
        self.last
    }
}

/// A signal of several frequencies (N), its temperature (degC), and what is measured of both, in four recordings.
fn table(seed: u64, measure: impl Fn(f64, f64, f64) -> f64) -> String {
    let mut noise = Noise::new(seed);
    let mut text = String::from("run,t,s,z,temp\n");
    for run in 0..4 {
        for k in 0..400 {
            let t_s = f64::from(k) * 0.05;
            let phase = f64::from(run) * 1.3 + f64::from(u32::try_from(seed % 100).unwrap());
            let force = |t_s: f64| 5.0 * (0.7 * t_s + phase).sin() + 3.0 * (1.9 * t_s + 2.0 * phase).sin();
            let temperature = 22.0 + 2.0 * (0.2 * t_s + 3.0 * phase).sin() + f64::from(run);
            let measured = measure(force(t_s), force(t_s - 0.13), temperature) + 0.1 * noise.next(0.8);
            text.push_str(&format!("r{run},{t_s},{:.6},{measured:.6},{temperature:.4}\n", force(t_s)));
        }
    }
    text
}

fn diagnosed(text: &str, noise: &str) -> Diagnosis {
    let dir = tempfile::tempdir().unwrap();
    let description = format!(
        "{HEAD}time = \"t\"\nrecording = \"run\"\n[covariates]\ntemperature = \"temp\"\n{CHANNEL}{noise}"
    );
    write(dir.path(), &description, text);
    crate::diagnose(&load(dir.path()).unwrap(), |_, _| {})
}

#[test]
fn single_effects_are_named_with_their_parameters() {
    let first = |text: &str| {
        let diagnosis = diagnosed(text, "");
        assert_eq!(diagnosis.verdict, Verdict::Explained, "{diagnosis:?}");
        let shares: f64 = diagnosis.findings.iter().map(|finding| finding.share).sum();
        assert!((shares - diagnosis.gap.shrink.unwrap()).abs() < 1e-9, "{diagnosis:?}");
        diagnosis.findings[0].clone()
    };
    let near = |finding: &crate::diagnosis::Finding, name: &str, value: f64, within: f64| {
        let found = &finding.parameters[name];
        assert!((found.value - value).abs() < within, "{name}: {found:?}");
    };
    let offset = first(&table(1, |s, _, _| s + 0.8));
    assert_eq!(offset.effect, "zero_offset");
    near(&offset, "offset", 0.8, 0.05);
    let gain = first(&table(2, |s, _, _| s * 1.12));
    assert_eq!(gain.effect, "gain");
    near(&gain, "relative", 0.12, 0.01);
    let warm = first(&table(3, |s, _, t| s + 0.6 * (t - 20.0)));
    assert_eq!(warm.effect, "temperature_offset");
    near(&warm, "per_k", 0.6, 0.05);
    let late = first(&table(4, |_, late, _| late));
    assert_eq!(late.effect, "delay");
    near(&late, "s", 0.13, 0.01);
}

/// Force of four recordings whose first alone goes far up and whose last alone far down, as a channel with rails shows it.
fn between_rails([low, high]: [f64; 2]) -> String {
    let mut noise = Noise::new(6);
    let mut text = String::from("run,t,s,z,temp\n");
    for (run, middle) in [3.0, 0.5, -0.5, -3.0].into_iter().enumerate() {
        for k in 0..400 {
            let t_s = f64::from(k) * 0.05;
            let force = middle + 4.0 * (0.7 * t_s + run as f64).sin() + 1.5 * (1.9 * t_s).sin();
            let read = force.clamp(low, high) + 0.02 * noise.next(0.0);
            text.push_str(&format!("r{run},{t_s},{force:.6},{read:.6},22\n"));
        }
    }
    text
}

#[test]
fn two_rails_are_one_limit_though_each_is_reached_in_a_recording_of_its_own() {
    let diagnosis = diagnosed(&between_rails([-6.2, 6.5]), "noise = 0.02\n");
    let first = &diagnosis.findings[0];
    assert_eq!((first.effect.as_str(), diagnosis.findings.len()), ("saturation", 1), "{diagnosis:?}");
    // The recording that is left out reaches a rail that none of the others does.
    assert!(diagnosis.gap.shrink.unwrap() > 0.95, "{:?}", diagnosis.gap);
}

/// The table with what is measured changed, line by line of each recording.
fn transferred(text: &str, mut of: impl FnMut(usize, f64) -> f64) -> String {
    let mut lines = text.lines();
    let mut out = format!("{}\n", lines.next().unwrap_or_default());
    for (row, line) in lines.enumerate() {
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        cells[3] = format!("{:.6}", of(row % 400, cells[3].parse().unwrap()));
        out.push_str(&format!("{}\n", cells.join(",")));
    }
    out
}

#[test]
fn coarse_steps_and_readings_that_are_the_last_again_are_told_by_the_readings_themselves() {
    let whole = table(8, |s, _, _| s);
    let steps = diagnosed(&transferred(&whole, |_, z| (z / 1.5).round() * 1.5), "noise = 0.1\n");
    assert_eq!(steps.findings[0].effect, "quantisation", "{steps:?}");
    assert!((steps.findings[0].parameters["step"].value - 1.5).abs() < 1e-3, "{steps:?}");
    let mut last = 0.0;
    let held = transferred(&whole, |row, z| {
        // Every second second six readings are lost.
        if row % 40 < 34 {
            last = z;
        }
        last
    });
    let held = diagnosed(&held, "noise = 0.1\n");
    assert_eq!(held.findings[0].effect, "frame_loss", "{held:?}");
    assert!((held.findings[0].parameters["share"].value - 0.15).abs() < 1e-3, "{held:?}");
    assert!(held.gap.shrink.unwrap() > 0.9, "{:?}", held.gap);
}

#[test]
fn noise_with_a_memory_is_no_cause() {
    let mut named = Vec::new();
    for seed in 10..40 {
        let diagnosis = diagnosed(&table(seed, |s, _, _| s), "");
        named.extend(diagnosis.findings.iter().map(|finding| (seed, finding.effect.clone())));
        if diagnosis.findings.is_empty() {
            assert_eq!(diagnosis.verdict, Verdict::Unexplained, "nobody stated how much is noise");
        }
    }
    assert!(named.is_empty(), "{named:?}");
    let stated = diagnosed(&table(40, |s, _, _| s), "noise = 0.1\n");
    assert_eq!((stated.verdict, stated.gap.shrink), (Verdict::NoGap, None), "{:?}", stated.gap);
}

#[test]
fn what_cannot_be_tested_is_said_with_the_column_that_is_missing() {
    let dir = tempfile::tempdir().unwrap();
    let mut text = String::from("s,z\n");
    (0..40).for_each(|k| text.push_str(&format!("{k},{}\n", f64::from(k) * 1.1)));
    write(dir.path(), &format!("{HEAD}{CHANNEL}"), &text);
    let diagnosis = crate::diagnose(&load(dir.path()).unwrap(), |_, _| {});
    let missing = |id: &str| {
        let entry = diagnosis.not_testable.iter().find(|entry| entry.effect == id);
        entry.map(|entry| entry.missing.clone()).unwrap_or_default()
    };
    assert!(missing("delay").contains("time = "), "{:?}", diagnosis.not_testable);
    assert!(missing("temperature_offset").contains("temperature = "));
    assert!(missing("link_mass").contains("urdf"));
    assert_eq!(diagnosis.findings[0].effect, "gain");
    assert!(diagnosis.hold_out.contains("interleaved"));
}

#[test]
fn unusable_descriptions_are_refused_with_their_line() {
    let rows: String = (0..20).map(|k| format!("{k},{k},{k}\n")).collect();
    let table = format!("t,s,z\n{rows}");
    let words = |description: &str| refusal(description, &table);
    assert!(words(&CHANNEL.replace("[[", "format = 1\n[[")).contains("purpose"));
    assert!(words(HEAD).contains("has no [[channel]]"));
    let typo = words(&format!("{HEAD}{}", CHANNEL.replace("\"z\"", "\"zz\"")));
    assert!(typo.starts_with("DIR/comparison.toml:6: \"zz\" is no column"), "{typo}");
    let key = words(&format!("{HEAD}{CHANNEL}nois = 1\n"));
    assert!(key.contains("unknown key \"nois\"; did you mean \"noise\"?"), "{key}");
    assert!(words(&format!("{HEAD}hold_out = [\"a\"]\n{CHANNEL}")).contains("add recording"));
    assert!(words(&format!("{HEAD}{CHANNEL}joint = \"j\"\n")).contains("is no [[joint]]"));
    assert!(words(&format!("{HEAD}{CHANNEL}noise = -1\n")).contains("must be a standard deviation above 0"));
    assert!(words(&format!("{HEAD}{CHANNEL}{CHANNEL}")).contains("two channels are called \"c\""));
    assert!(words(&HEAD.replace("comparison\"", "evaluation\"")).contains("must be \"comparison\""));
    let timed = format!("{HEAD}time = \"t\"\n{CHANNEL}");
    assert!(refusal(&timed, "t,s,z\n1,1,1\n").contains("nothing can be concluded"));
    let back = refusal(&timed, &table.replace("\n9,9,9\n", "\n1,9,9\n"));
    assert!(back.contains("table.csv:11: t = 1 is not after 8"), "{back}");
    let held = format!("{HEAD}recording = \"t\"\nhold_out = [\"nine\"]\n{CHANNEL}");
    assert!(words(&held).contains("\"nine\" is no value of the column"));
}

/// One joint about a level axis with 2 kg at (0.3, 0, 0) m: the torque that holds it is -m g x cos q.
const PENDULUM: &str = r#"<robot name="p"><link name="base"/>
<link name="arm"><inertial><origin xyz="0.3 0 0"/><mass value="2"/>
<inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
<joint name="j" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"#;

#[test]
fn columns_of_an_arm_are_those_of_a_pendulum() {
    use crate::effects::{CATALOGUE, Place, by_id};
    const WEIGHT_N: f64 = 2.0 * 9.80665;
    let dir = tempfile::tempdir().unwrap();
    let robot = "[robot]\nurdf = \"p.urdf\"\n[[joint]]\nname = \"j\"\nposition = \"q\"\nvelocity = \"v\"\nacceleration = \"v\"\n";
    let channel = CHANNEL.replace("\"N\"", "\"Nm\"");
    let mut text = String::from("t,q,v,s,z\n");
    for k in 0..50 {
        let q = f64::from(k) * 0.05 - 1.0;
        let torque = -WEIGHT_N * 0.3 * q.cos();
        text.push_str(&format!("{k},{q},0,{torque},{}\n", torque * 1.1));
    }
    write(dir.path(), &format!("{HEAD}time = \"t\"\n{robot}{channel}joint = \"j\"\n"), &text);
    std::fs::write(dir.path().join("p.urdf"), PENDULUM).unwrap();
    let session = load(dir.path()).unwrap();
    let columns = |id: &str, place| {
        let effect = CATALOGUE[by_id(id).unwrap()];
        effect.columns(&session, place, &effect.shapes(&session, place)[0])
    };
    let check = |id: &str, place, parameter: &str, truth: &dyn Fn(f64) -> f64| {
        let columns = columns(id, place);
        let column = columns.iter().find(|column| column.parameter == parameter).unwrap();
        for (value, q) in column.parts[0].1.iter().zip(&session.joints[0].position_rad) {
            assert!(
                (value - truth(*q)).abs() < 1e-3,
                "{id} {parameter} at {q}: {value} is not {}",
                truth(*q)
            );
        }
    };
    check("link_mass", Place::Link(0), "relative_mass", &|q| -WEIGHT_N * 0.3 * q.cos());
    check("link_mass", Place::Link(0), "d_mc_x", &|q| -WEIGHT_N / 2.0 * q.cos());
    check("link_mass", Place::Link(0), "d_mc_z", &|q| -WEIGHT_N / 2.0 * q.sin());
    check("payload", Place::Tip, "d_mc_x", &|q| -WEIGHT_N / 2.0 * q.cos());
    check("encoder_offset", Place::Joint(0), "rad", &|q| WEIGHT_N * 0.3 * q.sin());
    // It yields towards its load by torque over stiffness.
    let yielding = |q: f64| WEIGHT_N * 0.3 * q.cos() * WEIGHT_N * 0.3 * q.sin();
    check("joint_flexibility", Place::Joint(0), "nm_per_rad", &yielding);
    let ripple = CATALOGUE[by_id("torque_ripple").unwrap()].columns(&session, Place::Joint(0), &[7.0, 1.0]);
    for (row, q) in session.joints[0].position_rad.iter().enumerate() {
        // It grows with the load, which is largest where the arm is level: nearest in row 20.
        assert!((ripple[0].parts[0].1[row] - (7.0 * q).sin() * q.cos()).abs() < 1e-6, "{row}");
    }
    let tilt = columns("base_tilt", Place::Base);
    for (row, q) in session.joints[0].position_rad.iter().enumerate() {
        // What gravity loses along itself comes beside the two turns.
        let turns = tilt.iter().filter(|column| column.parameter == "rad");
        let square: f64 = turns.map(|column| column.parts[0].1[row].powi(2)).sum();
        assert!((square - (WEIGHT_N * 0.3 * q.sin()).powi(2)).abs() < 1e-2, "{row}");
    }
}
