//! The reports as a person sees them: made by the program from the captures, laid out by a browser.

#![allow(clippy::unwrap_used, clippy::panic)]

use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;
use wrenchd_tests::browser::{View, look};
use wrenchd_tests::process::{self, Program};
use wrenchd_tests::programs::programs;

const LIMIT: Duration = Duration::from_secs(120);
const LIGHT: View = View { width: 1160, dark: false };
/// A page may be mailed: no larger than this, bytes.
const LARGEST: usize = 3_000_000;

fn captures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("captures")
}

fn place(name: &str) -> PathBuf {
    let place = Path::new(env!("CARGO_TARGET_TMPDIR")).join("reports").join(name);
    let _ = fs::remove_dir_all(&place);
    fs::create_dir_all(&place).unwrap();
    place
}

fn wrenchctl(arguments: &[&Path]) -> String {
    let mut command = Command::new(&programs().unwrap().wrenchctl);
    process::run(command.args(arguments), LIMIT).unwrap().stdout()
}

/// Calibrates a run; the page, and what `--json` says.
fn calibrate(run: &Path, place: &Path) -> (PathBuf, Value) {
    let (page, model) = (place.join("calibration.html"), place.join("model.toml"));
    let [calibrate, out, json, stdout, report] =
        ["calibrate", "--out", "--json", "-", "--report"].map(Path::new);
    let said = wrenchctl(&[calibrate, run, out, &model, json, stdout, report, &page]);
    (page, serde_json::from_str(&said).unwrap())
}

fn validate(run: &Path, place: &Path) -> (PathBuf, Value) {
    let (page, model) = (place.join("validation.html"), place.join("model.toml"));
    let [validate, with, json, stdout, report] =
        ["validate", "--model", "--json", "-", "--report"].map(Path::new);
    let said = wrenchctl(&[validate, run, with, &model, json, stdout, report, &page]);
    (page, serde_json::from_str(&said).unwrap())
}

fn seen(page: &Path, name: &str, view: View) -> Value {
    serde_json::from_str(&look(page, name, view).unwrap()).unwrap()
}

fn strings(value: &Value) -> Vec<&str> {
    value.as_array().unwrap().iter().map(|text| text.as_str().unwrap()).collect()
}

/// The figure with this title.
fn figure<'a>(seen: &'a Value, title: &str) -> &'a Value {
    let figures = seen["figures"].as_array().unwrap();
    figures.iter().find(|f| f["title"] == title).unwrap_or_else(|| panic!("no figure is called {title:?}"))
}

/// The table whose caption begins so, without its head.
fn rows<'a>(seen: &'a Value, caption: &str) -> Vec<Vec<&'a str>> {
    let tables = seen["tables"].as_array().unwrap();
    let table = tables.iter().find(|t| t["caption"].as_str().unwrap().starts_with(caption)).unwrap();
    table["rows"].as_array().unwrap()[1..].iter().map(strings).collect()
}

/// A number as the page shows it.
fn shown(text: &str) -> f64 {
    text.replace('\u{2212}', "-").parse().unwrap_or_else(|_| panic!("{text:?} is no number"))
}

fn close(shown: f64, value: &Value, share: f64) -> bool {
    (shown - value.as_f64().unwrap()).abs() <= share * value.as_f64().unwrap().abs()
}

/// What holds for every page in every view.
fn is_a_good_page(page: &Path, name: &str) {
    let html = fs::read_to_string(page).unwrap();
    assert!(html.len() < LARGEST, "{} bytes", html.len());
    for foreign in ["http:", "https:", "//cdn", "<script", "src=", "url(", "@import", "NaN", "inf"] {
        assert!(!html.replace("http-equiv", "").contains(foreign), "{name}: {foreign}");
    }
    for (width, dark) in [(1160, false), (1160, true), (700, false), (400, true)] {
        let seen = seen(page, &format!("{name}-{width}-{dark}"), View { width, dark });
        for nothing in ["overlaps", "outside", "foreign"] {
            assert_eq!(strings(&seen[nothing]), [""; 0], "{name}, {width} px: {nothing}");
        }
        assert_eq!(seen["sideways"], 0, "{name}: wider than a window of {width} px");
        let [paper, ink] = ["paper", "ink"].map(|part| seen["brightness"][part].as_f64().unwrap());
        assert!(
            if dark { paper < 150.0 && ink > 600.0 } else { paper > 700.0 && ink < 150.0 },
            "{paper} {ink}"
        );
        for figure in seen["figures"].as_array().unwrap() {
            assert!(figure["height"].as_f64().unwrap() > 50.0, "{name}: {} is empty", figure["title"]);
        }
    }
}

#[test]
fn the_calibration_is_shown_as_it_was_found() {
    let place = place("calibration");
    let (page, json) = calibrate(&captures().join("calibration"), &place);
    is_a_good_page(&page, "calibration");
    let seen = seen(&page, "calibration", LIGHT);
    let headings = strings(&seen["headings"]);
    for heading in [
        "Sensing axes",
        "Crosstalk",
        "What is left of the readings",
        "Over load",
        "Over time",
        "Over temperature",
        "Over pose",
        "What the recordings could show",
    ] {
        assert!(headings.contains(&heading), "{heading} is not among {headings:?}");
    }
    let gauges = json["sensors"].as_array().unwrap();
    let (arm, table) = (figure(&seen, "Sensing axes on the arm"), rows(&seen, "Actual sensing frames"));
    let (before, left) = (
        figure(&seen, "Crosstalk before and after correction"),
        figure(&seen, "Residuals of held poses, RMS"),
    );
    assert_eq!(strings(&left["legend"]), ["nominal axes", "five parameters", "this model"]);
    // Arm, cross, and for each gauge the nominal axis, the actual one and its distance.
    assert_eq!(arm["lines"].as_u64().unwrap() as usize, 3 + 3 * gauges.len());
    for (gauge, row) in gauges.iter().zip(&table) {
        let name = gauge["name"].as_str().unwrap();
        assert_eq!(row[0], name);
        assert!(close(shown(row[2]), &gauge["crosstalk_percent"], 0.006), "{row:?}");
        let r: Vec<&str> = row[3].split(" \u{b1} ").collect();
        assert!(
            close(shown(r[0]), &gauge["r"], 1e-3) && close(shown(r[1]), &gauge["sigma"]["r"], 0.5),
            "{row:?}"
        );
        assert!(strings(&arm["texts"]).contains(&name), "{name} is not on the arm");
        assert!(figure(&seen, name)["lines"].as_u64().unwrap() >= 5, "{name} from near");
        // Twenty poses were held, some of them within a dot's width of another.
        for over in ["load", "time", "pose"] {
            let dots = figure(&seen, &format!("{name} over {over}"))["dots"].as_u64().unwrap();
            assert!((15..=20).contains(&dots), "{name} over {over}: {dots} dots");
        }
        let said = strings(&before["bars"]);
        assert_eq!(said.iter().filter(|words| words.starts_with(&format!("{name}, "))).count(), 2);
        let rms = |method: &str| {
            let words = strings(&left["bars"]);
            let start = format!("{name}, {method}: ");
            let found = words.iter().find_map(|w| w.strip_prefix(&start)).unwrap();
            shown(found.trim_end_matches(" noise floors"))
        };
        assert!(
            rms("this model") < 0.7 && rms("this model") <= rms("nominal axes"),
            "{name}: {}",
            rms("this model")
        );
    }
    assert_eq!(table.len(), gauges.len());
}

#[test]
fn the_validation_is_shown_as_it_was_scored() {
    let place = place("validation");
    calibrate(&captures().join("calibration"), &place);
    let (page, json) = validate(&captures().join("accuracy"), &place);
    is_a_good_page(&page, "validation");
    let seen = seen(&page, "validation", LIGHT);
    for name in ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"] {
        let chart = figure(&seen, name);
        assert_eq!((&chart["lines"], &chart["bands"]), (&2.into(), &1.into()), "{name}");
        assert_eq!(strings(&chart["legend"])[1..], ["estimate", "reference"]);
        assert!(strings(&chart["texts"]).contains(&"time, s"), "{name}");
    }
    let table = rows(&seen, "Root mean square");
    let methods = [
        ("nominal axes", &json["nominal_axes"]),
        ("five parameters", &json["five_parameter"]),
        ("this model", &json),
    ];
    let mut compared = 0;
    for (method, scores) in methods {
        for which in ["still", "moving", "all"] {
            let row = table.iter().find(|row| row[0] == method && row[1] == which).unwrap();
            let score = &scores[which];
            assert_eq!(row[2], score["n"].to_string());
            assert!(close(shown(row[3]), &score["force_rms_all_n"], 0.006), "{row:?}");
            assert!(close(shown(row[5]), &score["force_rms_n"][1], 0.006), "{row:?}");
            assert!(close(1e-3 * shown(row[7]), &score["torque_rms_all_nm"], 0.006), "{row:?}");
            compared += 1;
        }
    }
    assert_eq!(compared, table.len());
    for title in ["Over load", "Over time", "Over joint_1", "Over joint_6"] {
        assert!(figure(&seen, title)["dots"].as_u64().unwrap() >= 9, "{title}");
    }
    assert!(
        strings(&seen["text"]).iter().any(|text| text.contains("N with five parameters")),
        "{}",
        seen["text"]
    );
}

/// Names come from files of others: they are shown, and do nothing.
#[test]
fn names_from_files_are_text() {
    let place = place("hostile");
    let run = place.join("run");
    fs::create_dir_all(&run).unwrap();
    for entry in fs::read_dir(captures().join("calibration")).unwrap() {
        let entry = entry.unwrap();
        fs::copy(entry.path(), run.join(entry.file_name())).unwrap();
    }
    let bad = "<img src=x onerror=document.title='taken'>";
    let config = fs::read_to_string(run.join("arm.toml")).unwrap();
    assert!(config.contains("name = \"s2\""));
    fs::write(run.join("arm.toml"), config.replace("name = \"s2\"", &format!("name = \"{bad}\""))).unwrap();
    let (page, json) = calibrate(&run, &place);
    assert_eq!(json["sensors"][1]["name"], bad);
    let seen = seen(&page, "hostile", LIGHT);
    assert_eq!((&seen["title"], strings(&seen["foreign"]).len()), (&"Calibration".into(), 0));
    assert_eq!(rows(&seen, "Actual sensing frames")[1][0], bad);
}

#[test]
fn a_report_that_cannot_be_written_is_refused_and_leaves_nothing() {
    let place = place("refused");
    let mut command = Command::new(&programs().unwrap().wrenchctl);
    command.arg("calibrate").arg(captures().join("calibration")).arg("--out").arg(place.join("model.toml"));
    let finished = Program::start(command.arg("--report").arg(place.join("none/page.html"))).unwrap();
    let finished = finished.finish(LIMIT).unwrap().expect_code(2).unwrap();
    assert!(finished.stderr().contains("none/page.html"), "{}", finished.stderr());
    assert!(!place.join("none").exists());
}
