//! Files that appear whole or not at all.

use std::fs::{self, File, OpenOptions};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use crate::error::{Error, Result};

/// An I/O error with the file it is about.
pub(crate) fn io_error(doing: &str, path: &Path, source: io::Error) -> Error {
    Error::Io { what: format!("{doing} {}", path.display()), source }
}

/// Write a file under a temporary name in the same folder, flush it to disk, then rename it to `path`.
/// A killed run leaves at most the temporary file `.NAME.PID.N.tmp`; a failed one removes it. An existing file is replaced.
pub fn write_atomically(path: &Path, fill: impl FnOnce(&mut File) -> Result<()>) -> Result<()> {
    let temporary = temporary_name(path)?;
    let done = fill_and_rename(path, &temporary, fill);
    if done.is_err() {
        // The first error is the one to report.
        let _ = fs::remove_file(&temporary);
    }
    done
}

fn fill_and_rename(path: &Path, temporary: &Path, fill: impl FnOnce(&mut File) -> Result<()>) -> Result<()> {
    let fail = |e| io_error("cannot write", path, e);
    let mut file = OpenOptions::new().read(true).write(true).create_new(true).open(temporary).map_err(fail)?;
    fill(&mut file)?;
    file.sync_all().map_err(fail)?;
    drop(file);
    fs::rename(temporary, path).map_err(fail)?;
    // Make the new name durable too; some file systems cannot sync a folder, and the data are safe already.
    if let Some(folder) = path.parent() {
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
        let _ = File::open(folder).and_then(|f| f.sync_all());
    }
    Ok(())
}

/// [`write_atomically`] for bytes at hand.
pub fn write_bytes(path: &Path, bytes: &[u8]) -> Result<()> {
    write_atomically(path, |file| io::Write::write_all(file, bytes).map_err(|e| io_error("cannot write", path, e)))
}

fn temporary_name(path: &Path) -> Result<PathBuf> {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let name = path.file_name().ok_or_else(|| {
        Error::usage(format!("`{}` does not name a file", path.display()), "give a file name, not a folder")
    })?;
    let n = NEXT.fetch_add(1, Ordering::Relaxed);
    Ok(path.with_file_name(format!(".{}.{}.{n}.tmp", name.to_string_lossy(), std::process::id())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_no_temporary() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        write_bytes(&path, b"old").unwrap();
        let failed = write_atomically(&path, |file| {
            io::Write::write_all(file, b"half").unwrap();
            Err(Error::Runtime("stop".into()))
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(&path).unwrap(), b"old");
        write_bytes(&path, b"new").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 1);
        assert!(write_bytes(&dir.path().join("missing/a"), b"").is_err());
    }
}
