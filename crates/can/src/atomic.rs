//! Files written whole or not at all: temporary file, fsync, rename

use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use crate::error::{Error, Result};

static NUMBER: AtomicU32 = AtomicU32::new(0);

/// A file that appears under its name only at [`AtomicFile::commit`]; dropped before that, nothing is left of it
///
/// Devices and pipes (`/dev/stdout`) cannot be replaced and are written directly.
#[derive(Debug)]
pub struct AtomicFile {
    file: File,
    /// The name that was asked for
    path: PathBuf,
    /// Where it goes once whole, and where it is until then
    pending: Option<(PathBuf, PathBuf)>,
}

impl AtomicFile {
    /// Begins a file
    pub fn create(path: &Path) -> Result<Self> {
        Self::begin(path).map_err(|source| Error::Write { path: path.to_owned(), source })
    }

    fn begin(path: &Path) -> io::Result<Self> {
        // A link stays a link: its target is replaced.
        let target = std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let existing = std::fs::metadata(&target).ok();
        if let Some(existing) = &existing {
            if existing.is_dir() {
                return Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a directory; name a file"));
            }
            if !existing.is_file() {
                let file = OpenOptions::new().write(true).open(&target)?;
                return Ok(Self { file, path: path.to_owned(), pending: None });
            }
        }
        let (file, temporary) =
            beside(&target, |path| OpenOptions::new().write(true).create_new(true).open(path))?;
        let this = Self { file, path: path.to_owned(), pending: Some((target, temporary)) };
        if let Some(existing) = existing {
            this.file.set_permissions(existing.permissions())?;
        }
        Ok(this)
    }

    /// The name it will have
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Makes the file appear under its name, on disk
    pub fn commit(mut self) -> Result<()> {
        self.finish().map_err(|source| Error::Write { path: self.path.clone(), source })
    }

    fn finish(&mut self) -> io::Result<()> {
        self.file.flush()?;
        let Some((target, temporary)) = self.pending.clone() else { return Ok(()) };
        self.file.sync_all()?;
        std::fs::rename(temporary, &target)?;
        let folder =
            target.parent().filter(|folder| !folder.as_os_str().is_empty()).map_or(Path::new("."), |f| f);
        self.pending = None;
        // Some file systems cannot sync a folder; the file itself is already safe.
        if let Ok(folder) = File::open(folder) {
            let _ = folder.sync_all();
        }
        Ok(())
    }
}

/// Makes something beside the target, under a name of its own
///
/// A killed process leaves its temporary behind, and one of the same number may come after it (in a container the daemon is always 1):
/// what is there already is not ours to take away, it may be somebody's recording.
fn beside<T>(target: &Path, make: impl Fn(&Path) -> io::Result<T>) -> io::Result<(T, PathBuf)> {
    let name =
        target.file_name().ok_or_else(|| io::Error::new(io::ErrorKind::InvalidInput, "no file name"))?;
    loop {
        let number = NUMBER.fetch_add(1, Ordering::Relaxed);
        let mut temporary = std::ffi::OsString::from(".");
        temporary.push(name);
        temporary.push(format!(".{}-{number}.tmp", std::process::id()));
        let temporary = target.with_file_name(temporary);
        match make(&temporary) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            made => return made.map(|made| (made, temporary)),
        }
    }
}

/// Makes a hidden folder beside `target`, to be renamed to it when all its files are whole
pub fn folder_beside(target: &Path) -> io::Result<PathBuf> {
    beside(target, |path| std::fs::create_dir(path)).map(|((), path)| path)
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        if let Some((_, temporary)) = &self.pending {
            let _ = std::fs::remove_file(temporary);
        }
    }
}

/// Writes a whole file or nothing
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes).map_err(|source| Error::Write { path: path.to_owned(), source })?;
    file.commit()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = std::fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn appears_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write(&path, b"old").unwrap();
        let mut file = AtomicFile::create(&path).unwrap();
        file.write_all(b"half").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        drop(file);
        assert_eq!(names(folder.path()), ["a.txt"]);
        write(&path, b"new").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(names(folder.path()), ["a.txt"]);
    }

    #[test]
    fn what_a_killed_process_left_is_passed_by() {
        let folder = tempfile::tempdir().unwrap();
        // Other tests count on beside this one.
        let number = NUMBER.load(Ordering::Relaxed);
        let left = |number: u32| format!(".a.txt.{}-{number}.tmp", std::process::id());
        let mut expected: Vec<String> = (number..number + 100).map(left).collect();
        for name in &expected {
            std::fs::write(folder.path().join(name), b"another's").unwrap();
        }
        write(&folder.path().join("a.txt"), b"ours").unwrap();
        std::fs::remove_dir(folder_beside(&folder.path().join("a.txt")).unwrap()).unwrap();
        assert_eq!(std::fs::read(folder.path().join("a.txt")).unwrap(), b"ours");
        expected.push("a.txt".into());
        expected.sort();
        assert_eq!(names(folder.path()), expected);
    }

    #[test]
    fn missing_folder_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("none/a.txt");
        let message = write(&path, b"x").unwrap_err().to_string();
        assert!(message.contains("none/a.txt"), "{message}");
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn a_full_disk_is_an_error_and_a_link_stays_one() {
        assert!(write(Path::new("/dev/full"), b"x").unwrap_err().to_string().contains("/dev/full"));
        let folder = tempfile::tempdir().unwrap();
        let (real, link) = (folder.path().join("real"), folder.path().join("link"));
        write(&real, b"1").unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        write(&link, b"2").unwrap();
        assert!(link.is_symlink());
        assert_eq!(std::fs::read(&real).unwrap(), b"2");
    }
}
