//! The machine with a booted systemd: user-mode Linux on a disk image with a small Debian, made once and never written to again. Each
//! machine writes to a file of its own, which lasts over its boots.

use super::init::SERVICE_VARIABLE;
use super::text;
use crate::process::Program;
use crate::programs::workspace;
use crate::scratch::target_dir;
use crate::{Check, Failure, IoContext, packages};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// A mirror may be slow, and so may a loaded computer.
const MAKE_LIMIT: Duration = Duration::from_secs(1200);
/// What it is made with, and made of: with any other content it is made again.
const PARTS: [(&str, &str); 3] = [
    ("make.sh", include_str!("../../debian/make.sh")),
    ("start.sh", include_str!("../../debian/start.sh")),
    ("wrenchd-tests.service", include_str!("../../debian/wrenchd-tests.service")),
];
/// Where the image lies in the build directory.
const PLACE: &str = "debian";

/// The image, made anew unless it is there as it would be made.
pub(super) fn image(modules: &Path) -> Check<PathBuf> {
    packages::require(&[&packages::MMDEBSTRAP, &packages::MKE2FS])?;
    let release = release()?;
    let dir = target_dir()?.join(PLACE);
    fs::create_dir_all(&dir).at("create", &dir)?;
    let lock_path = dir.join("lock");
    let lock = File::create(&lock_path).at("create", &lock_path)?;
    lock.lock().at("lock", &lock_path)?;

    let mut recipe = format!("{release}\n{}\n", modules.display());
    for (name, content) in PARTS {
        let path = dir.join(name);
        fs::write(&path, content).at("write", &path)?;
        recipe.push_str(content);
    }
    let (image, done) = (dir.join("image.ext4"), dir.join("recipe"));
    if image.is_file() && fs::read_to_string(&done).is_ok_and(|text| text == recipe) {
        return Ok(image);
    }
    println!("making a Debian {release} with systemd in {} (mmdebstrap)", image.display());
    let _ = fs::remove_file(&done);
    let mut make = packages::as_root("sh").map_err(|why| {
        Failure::new(format!("a disk image of Debian is made by root: {why}; run the tests again as root"))
    })?;
    make.arg(dir.join("make.sh")).arg(&release).arg(modules).arg(&image);
    Program::start(&mut make)?.finish(MAKE_LIMIT)?.expect_code(0).map_err(|failure| {
        Failure::new(format!(
            "no Debian could be made (mmdebstrap needs root and a mirror that answers): {}",
            failure.words()
        ))
    })?;
    // Last, so that an image half made is made again.
    fs::write(&done, recipe).at("write", &done)?;
    Ok(image)
}

/// The release that this computer runs: programs that were linked here run there.
fn release() -> Check<String> {
    let path = Path::new("/etc/os-release");
    let text = fs::read_to_string(path).at("read", path)?;
    let value = |name: &str| {
        text.lines().find_map(|line| Some(line.strip_prefix(name)?.trim_matches('"').to_owned()))
    };
    match (value("ID="), value("VERSION_CODENAME=")) {
        (Some(id), Some(release)) if id == "debian" => Ok(release),
        (id, _) => Err(Failure::new(format!(
            "the package is for Debian and is tried on the release that it is built on; this is {}: run these tests on \
             Debian, in a container for instance",
            id.unwrap_or_else(|| "unknown".into())
        ))),
    }
}

/// What the machine does when it has booted: makes the workspace and the build directory appear where they are here, and goes on with the
/// tests' executable.
pub(super) fn write_start(scratch: &Path) -> Check {
    let mut script = String::new();
    let target = target_dir()?;
    for dir in [workspace(), target.as_path()] {
        let dir = quoted(dir)?;
        script.push_str(&format!("mkdir -p {dir} && mount --bind /host{dir} {dir}\n"));
    }
    let program = std::env::current_exe()?;
    script.push_str(&format!("export {SERVICE_VARIABLE}={}\nexec {}\n", quoted(scratch)?, quoted(&program)?));
    let path = scratch.join("start");
    fs::write(&path, script).at("write", &path)
}

/// A path as a word of the shell.
fn quoted(path: &Path) -> Check<String> {
    Ok(format!("'{}'", text(path)?.replace('\'', "'\\''")))
}
