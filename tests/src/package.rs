//! The Debian packages, built by cargo-deb: the daemon's from the release programs, the bridge's from a program that the tests have built anyway.

use crate::programs::{build_bridge, programs, workspace};
use crate::scratch::target_dir;
use crate::{Check, Failure, IoContext, packages, process};
use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;
use std::time::Duration;

const INSTALL_LIMIT: Duration = Duration::from_secs(1200);
const PACK_LIMIT: Duration = Duration::from_secs(300);
const PACKAGE_VARIABLE: &str = "WRENCHD_TEST_PACKAGE";
const CARGO_DEB_VERSION: &str = "3.8.0";

/// The package, built once a process from the release programs. Inside the machine it is the one that was built outside.
pub fn package() -> Check<&'static Path> {
    static PACKAGE: OnceLock<Check<PathBuf>> = OnceLock::new();
    let given = || std::env::var_os(PACKAGE_VARIABLE).map(PathBuf::from);
    let outcome = PACKAGE.get_or_init(|| given().map_or_else(build, Ok));
    outcome.as_deref().map_err(|failure| Failure::new(failure.words()))
}

/// The bridge's package, built with the daemon's and beside it.
pub fn bridge() -> Check<PathBuf> {
    Ok(package()?.with_file_name("wrenchd-ros2.deb"))
}

/// The variable that hands the packages to the inside of the machine.
pub fn environment(package: &Path) -> (&'static str, &Path) {
    (PACKAGE_VARIABLE, package)
}

fn build() -> Check<PathBuf> {
    programs()?;
    let bridge = build_bridge()?;
    packages::require(&[&packages::SHLIBDEPS, &packages::XZ])?;
    let target = target_dir()?;
    // cargo-deb packs what lies where release programs do: in a build directory that nobody takes for one.
    let staged = target.join("debian/staged");
    let release = staged.join("release");
    fs::create_dir_all(&release).at("create", &release)?;
    fs::copy(&bridge, release.join("wrenchd-ros2")).at("copy", &bridge)?;
    pack("wrenchd-ros2", &staged, &target)?;
    pack("wrenchd", &target, &target)
}

/// Packs programs that were built into `built`.
fn pack(name: &str, built: &Path, target: &Path) -> Check<PathBuf> {
    let package = target.join("debian").join(name).with_extension("deb");
    let mut command = Command::new(cargo_deb(target)?);
    // Compressed less than what is given to people.
    command.args(["deb", "-p", name, "--strip", "--fast", "--compress-system", "--no-build", "--locked"]);
    command.arg("--output").arg(&package).current_dir(workspace()).env("CARGO_TARGET_DIR", built);
    let said = process::run(&mut command, PACK_LIMIT)?.stderr();
    // A file that is named but not there, or two in one place, is a warning only.
    match said.lines().find(|line| line.starts_with("warning")) {
        Some(warning) => Err(Failure::new(format!("cargo-deb finds fault with the package: {warning}"))),
        None => Ok(package),
    }
}

/// The packer, built once into the build directory. It is not optimised: that would take longer than all that it ever does here.
fn cargo_deb(target: &Path) -> Check<PathBuf> {
    let root = target.join("cargo-deb").join(CARGO_DEB_VERSION);
    fs::create_dir_all(&root).at("create", &root)?;
    let lock_path = root.join("lock");
    let lock = File::create(&lock_path).at("create", &lock_path)?;
    lock.lock().at("lock", &lock_path)?;
    let program = root.join("bin/cargo-deb");
    if program.is_file() {
        return Ok(program);
    }
    println!("building cargo-deb {CARGO_DEB_VERSION}, which makes the package");
    let building = root.join("building");
    let mut command = Command::new(std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    command.args(["install", "--locked", "--debug", "--no-default-features", "--version", CARGO_DEB_VERSION]);
    command.arg("cargo-deb").arg("--root").arg(&root).env("CARGO_TARGET_DIR", &building);
    // Outside the workspace, whose settings are not meant for it.
    process::run(command.current_dir(&root), INSTALL_LIMIT).map_err(|failure| {
        Failure::new(format!(
            "cargo-deb, which makes the package, cannot be built (cargo needs a network or a registry): {}",
            failure.words()
        ))
    })?;
    let _ = fs::remove_dir_all(&building);
    Ok(program)
}
