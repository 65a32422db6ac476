//! Files that people write, or other programs.

use std::path::{Path, PathBuf};
use std::sync::LazyLock;

use can::candump::{Line, parse_line};
use can::frame::Stamped;
use model::chain::{Chain, Section};
use model::dynamics::Dynamics;
use nalgebra::Vector3;
use rig::{Config, Cycle, ModelFile, Rig, RigError, Run};

use super::bus::is_honest;

pub(crate) const URDF: &str = include_str!("../../../config/arm.urdf");
pub(crate) const DBC: &str = include_str!("../../../config/arm.dbc");
const ARM: &str = include_str!("../../../config/arm.toml");
/// A second of the example arm.
const RECORDED: &str = include_str!("../corpus/candump/arm.log");

/// The example arm.
pub(crate) static CONFIG: LazyLock<Config> =
    LazyLock::new(|| Config::parse(Path::new("arm.toml"), ARM).expect("the example"));
static RIG: LazyLock<Rig> =
    LazyLock::new(|| Rig::from_texts(CONFIG.clone(), URDF, DBC.as_bytes()).expect("the example"));
static FOLDER: LazyLock<PathBuf> = LazyLock::new(folder);

/// A folder with the example arm and a log. It stays behind: a fuzzer does not end, it is ended.
fn folder() -> PathBuf {
    let folder = std::env::temp_dir().join(format!("wrenchd-fuzz-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for files");
    for (name, text) in [("arm.toml", ARM), ("arm.urdf", URDF), ("arm.dbc", DBC), ("can.log", RECORDED)] {
        write(&folder.join(name), text.as_bytes());
    }
    folder
}

fn write(file: &Path, bytes: &[u8]) {
    std::fs::write(file, bytes).expect("a file in the folder for files");
}

/// Writes the parts of an input that a line `#---` divides into files of a folder of this thread; the folder.
fn spread(data: &[u8], names: [&str; 2]) -> PathBuf {
    const CUT: &[u8] = b"\n#---\n";
    let folder = FOLDER.join(format!("{:?}", std::thread::current().id()));
    std::fs::create_dir_all(&folder).expect("a folder for files");
    let at = data.windows(CUT.len()).position(|window| window == CUT);
    let (first, second) = at.map_or((data, &[][..]), |at| (&data[..at], &data[at + CUT.len()..]));
    write(&folder.join(names[0]), first);
    write(&folder.join(names[1]), second);
    folder
}

/// An error names the file that it is about.
fn refused(error: &RigError, files: &[&str]) -> bool {
    let words = error.to_string();
    assert!(files.iter().any(|file| words.contains(file)), "{words}");
    false
}

/// A URDF from which a chain can be made can be moved.
pub(crate) fn urdf(data: &[u8]) -> bool {
    let text = String::from_utf8_lossy(data);
    let gravity_mps2 = Vector3::new(0.0, 0.0, -9.80665);
    let chain = match Chain::from_urdf(&text, "fuzz.urdf", "base_link", "tool0", gravity_mps2) {
        Ok(chain) => chain,
        Err(error) => {
            assert!(error.to_string().contains("fuzz.urdf"), "{error}");
            return false;
        }
    };
    let sections: Vec<Section> =
        chain.joints.iter().filter_map(|joint| Section::new(&chain, &joint.name, None).ok()).collect();
    let coordinates = chain.coordinates();
    let mut dynamics = Dynamics::new(&chain, &sections);
    dynamics.update(&vec![0.3; coordinates], &vec![0.2; coordinates], &vec![-0.1; coordinates]);
    dynamics.differentiate();
    true
}

/// A configuration, and the example's arm by it.
pub(crate) fn config(data: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(data) else { return false };
    match Config::parse(Path::new("fuzz.toml"), text) {
        Err(error) => refused(&error, &["fuzz.toml"]),
        Ok(config) => {
            let files = [config.robot.urdf.display().to_string(), config.bus.dbc.display().to_string()];
            let files = [&files[0], &files[1], "fuzz.toml"];
            match Rig::from_texts(config.clone(), URDF, DBC.as_bytes()) {
                Ok(rig) => rig.sections.len() == config.sensors.len(),
                // What the layout is refused for is told by the names of the signals.
                Err(RigError::Can(error)) => error.to_string().is_empty(),
                Err(error) => refused(&error, &files),
            }
        }
    }
}

/// A model that is taken for the arm's own is written again as it was, and gives true wrenches or none.
pub(crate) fn model(data: &[u8]) -> bool {
    let file = FOLDER.join(format!("{:?}.toml", std::thread::current().id()));
    write(&file, data);
    let model = match ModelFile::load(&file, &RIG) {
        Ok(model) => model,
        Err(error) => return refused(&error, &[&file.display().to_string()]),
    };
    let again = ModelFile::parse(&file, &model.to_toml()).expect("what it writes can be read");
    assert_eq!(again.to_toml(), model.to_toml());
    let Ok(mut cycle) = Cycle::new(&RIG, &model) else { return false };
    for line in RECORDED.lines() {
        if let Ok(Line::Frame { stamp_ns, frame, .. }) = parse_line(line.as_bytes()) {
            cycle.push(&Stamped { stamp_ns, interface: 0, frame }, |estimate| {
                is_honest(estimate);
            });
        }
    }
    true
}

/// A run's description and its reference.
pub(crate) fn run(data: &[u8]) -> bool {
    let folder = spread(data, ["run.toml", "reference.csv"]);
    let run = match Run::load(&folder) {
        Ok(run) => run,
        Err(error) => return refused(&error, &[&folder.display().to_string()]),
    };
    let _ = run.check_span(10.0);
    for t_s in [-1.0, 0.0, 0.5, 1e9] {
        assert!(run.loads.at(t_s).mass_kg >= 0.0);
        let _ = (run.is_excluded(t_s), run.reference.as_ref().and_then(|reference| reference.at(t_s)));
    }
    true
}

/// A comparison's description and its table.
pub(crate) fn comparison(data: &[u8]) -> bool {
    let folder = spread(data, ["comparison.toml", "table.csv"]);
    let session = match gap::comparison::load(&folder) {
        Ok(session) => session,
        Err(error) => {
            let words = error.to_string();
            assert!(words.contains(&folder.display().to_string()), "{words}");
            return false;
        }
    };
    let rows = session.rows();
    assert!(session.channels.iter().all(|channel| channel.gap.len() == rows && channel.scale > 0.0));
    true
}
