//! A small disk of its own, for tests that fill it or mount it read-only.

use std::path::Path;
use std::process::Command;

use crate::product::skip;

/// A small file system in memory, which lives as long as this value.
pub struct SmallDisk(tempfile::TempDir);

impl SmallDisk {
    /// Mounts it. Gives `None`, and reports `test` as skipped, where mounting is not permitted.
    pub fn mount(size: &str, test: &str) -> Option<Self> {
        let folder = tempfile::tempdir().unwrap();
        let mounted = Command::new("mount")
            .args(["-t", "tmpfs", "-o", &format!("size={size}"), "tmpfs"])
            .arg(folder.path())
            .output();
        if mounted.is_ok_and(|output| output.status.success()) {
            return Some(Self(folder));
        }
        skip(test, "mounting a file system is not permitted here");
        None
    }

    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// Makes it take no more writes, like a snapshot.
    pub fn make_read_only(&self) {
        let mut command = Command::new("mount");
        let remounted = command.args(["-o", "remount,ro"]).arg(self.path()).status();
        assert!(remounted.is_ok_and(|status| status.success()));
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        let _ = Command::new("umount").arg("--lazy").arg(self.path()).status();
    }
}
