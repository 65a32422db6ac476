//! The configuration with its URDF and DBC, copied into a run directory so that the run stands by itself.

use std::fs;
use std::path::Path;

use rig::Rig;
use toml::de::{DeTable, DeValue};

use super::OWN_FILES;
use crate::SimError;

/// Copies configuration, URDF and DBC into `folder`, side by side; the configuration's file name there.
pub(super) fn copy_beside(rig: &Rig, folder: &Path) -> Result<String, SimError> {
    let config = &rig.config;
    let mut taken: Vec<String> = OWN_FILES.map(str::to_owned).to_vec();
    let name = free_name(&config.file, "arm.toml", &mut taken);
    let urdf = free_name(&config.robot.urdf, "arm.urdf", &mut taken);
    let dbc = free_name(&config.bus.dbc, "arm.dbc", &mut taken);
    copy(&config.robot.urdf, &folder.join(&urdf), "the URDF of [robot] urdf")?;
    copy(&config.bus.dbc, &folder.join(&dbc), "the DBC of [bus] dbc")?;
    let mut changes = vec![("robot", "urdf", urdf), ("bus", "dbc", dbc)];
    if let Some(model) = &config.model {
        let whole = fs::canonicalize(&model.path).unwrap_or_else(|_| model.path.clone());
        changes.push(("model", "path", whole.display().to_string()));
    }
    let text = with_values(config.text(), &changes);
    can::atomic::write(&folder.join(&name), text.as_bytes())?;
    Ok(name)
}

/// The last part of a path, or another where that is taken.
fn free_name(path: &Path, default: &str, taken: &mut Vec<String>) -> String {
    let own = path.file_name().and_then(|name| name.to_str()).unwrap_or(default);
    let mut name = own.to_owned();
    while taken.contains(&name) {
        name.insert_str(0, "copy_of_");
    }
    taken.push(name.clone());
    name
}

fn copy(from: &Path, to: &Path, what: &'static str) -> Result<(), SimError> {
    let bytes = fs::read(from).map_err(|source| SimError::Read { file: from.to_owned(), source, what })?;
    Ok(can::atomic::write(to, &bytes)?)
}

/// A document with other strings at these places (table, key, value); all else, remarks too, stays as it is.
fn with_values(text: &str, changes: &[(&str, &str, String)]) -> String {
    let mut spans = Vec::new();
    if let Ok(root) = DeTable::parse(text) {
        for (table, key, value) in changes {
            if let Some(DeValue::Table(table)) = root.get_ref().get(*table).map(|table| table.get_ref())
                && let Some(old) = table.get(*key)
            {
                spans.push((old.span(), toml::Value::String(value.clone()).to_string()));
            }
        }
    }
    // From the end, so that earlier places stay where they are.
    spans.sort_by_key(|(span, _)| std::cmp::Reverse(span.start));
    let mut changed = text.to_owned();
    for (span, value) in spans {
        changed.replace_range(span, &value);
    }
    changed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_change_and_nothing_else() {
        let text = "format = 1 # one\n[robot]\nurdf = '../a/arm.urdf' # there\nbase = \"b\"\n[bus]\ndbc = \"x/y.dbc\"\n";
        let changes = [
            ("robot", "urdf", "arm.urdf".to_owned()),
            ("bus", "dbc", "y.dbc".to_owned()),
            ("no", "x", "".to_owned()),
        ];
        let expected =
            "format = 1 # one\n[robot]\nurdf = \"arm.urdf\" # there\nbase = \"b\"\n[bus]\ndbc = \"y.dbc\"\n";
        assert_eq!(with_values(text, &changes), expected);
    }

    #[test]
    fn files_of_one_name_do_not_collide() {
        let mut taken = vec!["run.toml".to_owned()];
        assert_eq!(free_name(Path::new("a/run.toml"), "arm.toml", &mut taken), "copy_of_run.toml");
        assert_eq!(free_name(Path::new("arm"), "x", &mut taken), "arm");
        assert_eq!(free_name(Path::new("b/arm"), "x", &mut taken), "copy_of_arm");
    }
}
