use std::path::Path;

use rig::Run;
use rig::run::{Purpose, Reference};
use tempfile::TempDir;

use super::{ARM, message, with};

const RUN: &str = "format = 1
config = \"arm.toml\"
log = \"can.log\"
purpose = \"evaluation\"
reference = \"reference.csv\"
session = \"monday\"
repeat_of = \"run_2\"

[[load]]
from = 0.0
to = 10.0
mass = 0.5
com = [0.0, 0.0, 0.05]

[[load]]
from = 10.0
to = 20
mass = 1
com = [0, 0.08, 0.03]

[[exclude]]
from = 3.0
to = 4.0
why = \"somebody touched it\"
";

const REFERENCE: &str =
    "t,fx,fy,fz,tx,ty,tz\n1.0,1,2,3,0.1,0.2,0.3\n1.04,3,2,1,0.3,0.2,0.1\n2.0,5,5,5,0.5,0.5,0.5\n";

fn directory(run: &str, reference: &str) -> TempDir {
    let dir = tempfile::tempdir().unwrap();
    for (name, text) in [("run.toml", run), ("arm.toml", ARM), ("can.log", ""), ("reference.csv", reference)]
    {
        std::fs::write(dir.path().join(name), text).unwrap();
    }
    dir
}

/// What a run directory with this run.toml is told, without the directory's own name.
fn told(run: &str) -> String {
    let dir = directory(run, REFERENCE);
    let said = message(Run::load(dir.path()));
    let start = format!("{}/", dir.path().display());
    said.strip_prefix(&start).map(str::to_owned).unwrap_or(said)
}

#[test]
fn a_run_is_read_whole() {
    let dir = directory(RUN, REFERENCE);
    let run = Run::load(dir.path()).unwrap();
    assert_eq!(run.log, dir.path().join("can.log"));
    assert_eq!(run.config.robot.urdf, dir.path().join("arm.urdf"));
    assert_eq!(
        (run.purpose, run.session.as_deref(), run.repeat_of.as_deref()),
        (Purpose::Evaluation, Some("monday"), Some("run_2"))
    );
    assert_eq!(
        (run.loads.at(9.9).mass_kg, run.loads.at(10.0).mass_kg, run.loads.at(20.0).mass_kg),
        (0.5, 1.0, 0.0)
    );
    assert!(run.is_excluded(3.0) && !run.is_excluded(4.0) && !run.is_excluded(2.9));
    assert_eq!(run.excludes[0].why, "somebody touched it");
    assert_eq!(run.reference.as_ref().unwrap().rows().len(), 3);
    assert!(run.check_span(20.0).is_ok() && run.check_span(19.99).is_ok());
}

#[test]
fn the_reference_holds_within_its_rows_only() {
    let reference = Reference::parse(Path::new("reference.csv"), REFERENCE).unwrap();
    let force_x = |t_s: f64| reference.at(t_s).map(|wrench| wrench.force_n.x);
    assert_eq!(force_x(1.0), Some(1.0));
    assert!((force_x(1.02).unwrap() - 2.0).abs() < 1e-12, "between two rows: interpolated");
    assert_eq!(force_x(0.96), Some(1.0), "before the first row: the row's own");
    assert_eq!(force_x(1.08), Some(3.0));
    assert_eq!((force_x(0.94), force_x(1.1), force_x(1.5), force_x(2.06)), (None, None, None, None));
    assert_eq!(force_x(2.0), Some(5.0));
    assert!((reference.at(1.02).unwrap().moment_nm.x - 0.2).abs() < 1e-12);
}

#[test]
fn bad_descriptions_are_told_what_is_wrong() {
    let cases: &[(&str, &str, &str)] = &[
        ("to = 10.0", "to = 0.0", "run.toml:11: [[load]] from = 0, to = 0: `from` must be before `to`"),
        ("to = 10.0", "to = inf", "run.toml:11: [[load]] from = 0, to = inf: `from` must be before `to`"),
        (
            "mass = 0.5",
            "mass = -0.5",
            "run.toml:12: [[load]] mass = -0.5 must be a finite number of kg, 0 or more",
        ),
        (
            "com = [0.0, 0.0, 0.05]",
            "com = [0.0, nan, 0.05]",
            "run.toml:13: [[load]] com = [0.0, NaN, 0.05] is not finite",
        ),
        ("com = [0.0, 0.0, 0.05]", "", "run.toml:9: the key \"com\" is missing; add it to this table"),
        ("com = [0.0, 0.0, 0.05]", "centre = [0.0, 0.0, 0.05]", "run.toml:13: unknown key \"centre\""),
        ("mass = 0.5", "mas = 0.5", "run.toml:12: unknown key \"mas\"; did you mean \"mass\"?"),
        ("to = 4.0", "to = 2.0", "run.toml:23: [[exclude]] from = 3, to = 2: `from` must be before `to`"),
        (
            "\"evaluation\"",
            "\"fun\"",
            "run.toml:4: unknown variant `fun`, expected `calibration` or `evaluation`",
        ),
        ("\"monday\"", "\"\"", "run.toml:6: session is empty; fill it in or remove it"),
        ("format = 1", "format = 3", "run.toml:1: format = 3 is not one that this version reads"),
        (
            "\"can.log\"",
            "\"lost.log\"",
            "run.toml:3: log = \"lost.log\" is not there; give the candump log's path",
        ),
        (
            "\"arm.toml\"",
            "\"lost.toml\"",
            "run.toml:2: config = \"lost.toml\" is not there; give the path of",
        ),
        (
            "\"reference.csv\"",
            "\"lost.csv\"",
            "run.toml:5: reference = \"lost.csv\" is not there; give the path of",
        ),
    ];
    for (from, to, expected) in cases {
        let said = told(&with(RUN, from, to));
        assert!(said.starts_with(expected), "{said}\n{expected}");
    }
}

#[test]
fn a_folder_that_is_no_run_is_told_so() {
    let dir = tempfile::tempdir().unwrap();
    assert!(
        message(Run::load(dir.path()))
            .ends_with("has no run.toml; give a run directory (run.toml with its log beside it)")
    );
    std::fs::write(dir.path().join("comparison.toml"), "").unwrap();
    assert!(message(Run::load(dir.path())).contains("holds a comparison, not a run"));
    assert!(
        message(Run::load(&dir.path().join("nowhere")))
            .contains("nowhere: does not exist; give a run directory")
    );
    assert!(
        message(Run::load(&dir.path().join("comparison.toml")))
            .contains("is not a run directory; give the folder")
    );
}

#[test]
fn intervals_outside_the_log_are_refused() {
    let told = |run: &str, reference: &str, duration_s: f64| {
        let dir = directory(run, reference);
        let run = Run::load(dir.path()).unwrap();
        message(run.check_span(duration_s)).replace(&format!("{}/", dir.path().display()), "")
    };
    assert_eq!(
        told(RUN, REFERENCE, 15.0),
        "run.toml:15: [[load]] from 10 to 20 s is outside the log: the log lasts 15.000 s; correct the interval or give \
         the log that belongs to it"
    );
    assert!(
        told(&with(RUN, "from = 0.0", "from = -1.0"), REFERENCE, 20.0)
            .starts_with("run.toml:9: [[load]] from -1 to 10")
    );
    let far = with(&with(RUN, "from = 3.0", "from = 30.0"), "to = 4.0", "to = 40.0");
    assert!(
        told(&far, REFERENCE, 20.0)
            .starts_with("run.toml:21: [[exclude]] from 30 to 40 s is outside the log")
    );
    let late = "t,fx,fy,fz,tx,ty,tz\n1790000000.0,0,0,0,0,0,0\n";
    let said = told(RUN, late, 20.0);
    assert!(
        said.starts_with("reference.csv: covers 1790000000 .. 1790000000 s, but the log lasts 20.000 s"),
        "{said}"
    );
}

#[test]
fn bad_references_are_told_their_line() {
    let told = |text: &str| message(Reference::parse(Path::new("reference.csv"), text));
    let header = "t,fx,fy,fz,tx,ty,tz";
    assert_eq!(told(""), format!("reference.csv:1: begins with \"\"; the first line must be {header}"));
    assert!(told("0,1,2,3,4,5,6\n").starts_with("reference.csv:1: begins with \"0,1,2,3,4,5,6\""));
    assert!(told(&format!("{header}\n")).contains("has no rows"));
    let second = |row: &str| told(&format!("{header}\n1,0,0,0,0,0,0\n\n{row}\n"));
    assert!(second("2,0,0").starts_with("reference.csv:4: has 3 columns instead of 7"));
    assert!(second("2,0,x,0,0,0,0").starts_with("reference.csv:4: fy = \"x\" is not a finite number"));
    assert!(second("2,0,0,0,0,0,inf").starts_with("reference.csv:4: tz = \"inf\" is not a finite number"));
    assert!(
        second("1,0,0,0,0,0,0").starts_with("reference.csv:4: t = 1 is not after t = 1 of the row before")
    );
    let spaced =
        Reference::parse(Path::new("r.csv"), "t, fx, fy, fz, tx, ty, tz\r\n 1, 2, 3, 4, 5, 6, 7\r\n")
            .unwrap();
    assert_eq!(spaced.rows()[0].wrench.moment_nm.z, 7.0);
}
