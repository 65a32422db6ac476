//! Programs that the tests need from the system, and their installation on Debian.

use crate::process::{self, Program};
use crate::{Check, Failure, IoContext};
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

const INSTALL_LIMIT: Duration = Duration::from_secs(900);

/// A program and the Debian package that holds it.
pub(crate) struct Tool {
    pub(crate) program: &'static str,
    pub(crate) package: &'static str,
}

pub(crate) const IP: Tool = Tool { program: "ip", package: "iproute2" };
pub(crate) const CANDUMP: Tool = Tool { program: "candump", package: "can-utils" };
pub(crate) const UNSHARE: Tool = Tool { program: "unshare", package: "util-linux" };
pub(crate) const MODPROBE: Tool = Tool { program: "modprobe", package: "kmod" };
pub(crate) const UML: Tool = Tool { program: "linux.uml", package: "user-mode-linux" };
pub(crate) const CC: Tool = Tool { program: "cc", package: "gcc libc6-dev" };
pub(crate) const MMDEBSTRAP: Tool = Tool { program: "mmdebstrap", package: "mmdebstrap" };
pub(crate) const MKE2FS: Tool = Tool { program: "mke2fs", package: "e2fsprogs" };
pub(crate) const XZ: Tool = Tool { program: "xz", package: "xz-utils" };
pub(crate) const SHLIBDEPS: Tool = Tool { program: "dpkg-shlibdeps", package: "dpkg-dev" };
pub(crate) const PYTHON: Tool = Tool { program: "python3", package: "python3" };

/// Where programs are looked for: `PATH`, and where Debian keeps those of the administrator.
pub(crate) fn search_path() -> Vec<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    let mut dirs: Vec<PathBuf> = std::env::split_paths(&path).collect();
    for dir in ["/usr/local/sbin", "/usr/sbin", "/sbin", "/usr/local/bin", "/usr/bin", "/bin"] {
        if !dirs.iter().any(|known| known == Path::new(dir)) {
            dirs.push(dir.into());
        }
    }
    dirs
}

/// A program's file, if it is there.
pub(crate) fn find(program: &str) -> Option<PathBuf> {
    search_path().into_iter().map(|dir| dir.join(program)).find(|file| file.is_file())
}

/// The files of these programs, in the same order; packages of missing ones are installed first.
pub(crate) fn require(tools: &[&Tool]) -> Check<Vec<PathBuf>> {
    let missing = |tools: &[&Tool]| -> Vec<&'static str> {
        let absent = tools.iter().filter(|tool| find(tool.program).is_none());
        absent.flat_map(|tool| tool.package.split(' ')).collect()
    };
    if !missing(tools).is_empty() {
        let lock_path = std::env::temp_dir().join(format!("wrenchd-tests-install-{}", nix::unistd::getuid()));
        let lock = File::create(&lock_path).at("create", &lock_path)?;
        lock.lock().at("lock", &lock_path)?;
        // Another run may have installed them while this one waited for the lock.
        let packages = missing(tools);
        if !packages.is_empty() {
            install(&packages)?;
        }
    }
    tools
        .iter()
        .map(|tool| {
            find(tool.program).ok_or_else(|| {
                Failure::new(format!(
                    "the package {} is installed but holds no {} for this architecture",
                    tool.package, tool.program
                ))
            })
        })
        .collect()
}

/// The file of a program that is in this Debian package, which is installed first where it is missing.
pub fn require_program(program: &'static str, package: &'static str) -> Check<PathBuf> {
    let files = require(&[&Tool { program, package }])?;
    files.into_iter().next().ok_or_else(|| Failure::new(format!("{program} is required and found")))
}

/// Installs Debian packages, or says what the user must install.
pub fn install(packages: &[&str]) -> Check {
    let by_hand = |why: String| {
        let list = packages.join(" ");
        Failure::new(format!(
            "these tests need the Debian packages {list}, which are not installed here and cannot be: {why}. \
             Install them (sudo apt-get install {list}) or their equivalents, and run the tests again"
        ))
    };
    let apt = find("apt-get").ok_or_else(|| by_hand("this system has no apt-get".into()))?;
    let apt_get = |arguments: &[&str]| -> Check {
        let mut command = as_root("env").map_err(|why| by_hand(why.into()))?;
        command.arg("DEBIAN_FRONTEND=noninteractive").arg(&apt);
        command.args(["-q", "-y", "-o", "DPkg::Lock::Timeout=300"]);
        Program::start(command.args(arguments))?.finish(INSTALL_LIMIT)?.expect_code(0).map(drop)
    };
    as_root("true").map_err(|why| by_hand(why.into()))?;
    println!("installing {} (apt-get)", packages.join(" "));
    let arguments = [&["install", "--no-install-recommends"], packages].concat();
    // The package lists may be missing or old: fetch them only where the first attempt fails.
    apt_get(&arguments)
        .or_else(|_| apt_get(&["update"]).and_then(|()| apt_get(&arguments)))
        .map_err(|failure| by_hand(failure.words().trim_end().to_owned()))
}

/// A program run by root; why not, where this user cannot.
pub(crate) fn as_root(program: &str) -> Result<Command, &'static str> {
    if nix::unistd::geteuid().is_root() {
        return Ok(Command::new(program));
    }
    let sudo = find("sudo").ok_or("not root, and there is no sudo")?;
    process::run(Command::new(&sudo).args(["-n", "true"]), Duration::from_secs(30))
        .map_err(|_| "not root, and sudo asks for a password")?;
    let mut command = Command::new(sudo);
    command.args(["-n", program]);
    Ok(command)
}

/// The installed version of a Debian package, for the record of what was run on.
pub(crate) fn version(package: &str) -> Option<String> {
    let mut command = Command::new("dpkg-query");
    let finished =
        process::run(command.args(["-W", "-f", "${Version}", package]), Duration::from_secs(20)).ok()?;
    Some(finished.stdout().trim().to_owned())
}
