//! The folder that a command writes its results to.

use std::fs;
use std::path::Path;

use anyhow::{Context, ensure};

/// An empty folder for results. It goes again if nothing is written to it, unless it was there before.
pub struct ResultFolder<'a> {
    path: &'a Path,
    is_new: bool,
}

impl<'a> ResultFolder<'a> {
    /// Makes the folder before the work, so that the results have a place.
    pub fn prepare(path: &'a Path) -> anyhow::Result<Self> {
        let place = || path.display().to_string();
        if !path.exists() {
            fs::create_dir_all(path).with_context(place)?;
            return Ok(Self { path, is_new: true });
        }
        let is_empty = fs::read_dir(path).with_context(place)?.next().is_none();
        ensure!(
            is_empty,
            "{} has files, allowed: a folder that is empty or does not exist",
            place()
        );
        Ok(Self { path, is_new: false })
    }
}

impl Drop for ResultFolder<'_> {
    fn drop(&mut self) {
        if self.is_new {
            // A folder with files stays.
            let _ = fs::remove_dir(self.path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_folder_goes_if_nothing_is_written_and_an_old_one_stays() {
        let parent = tempfile::tempdir().unwrap();
        let [new, old, full] = ["new", "old", "full"].map(|name| parent.path().join(name));
        fs::create_dir(&old).unwrap();
        for path in [&new, &old] {
            drop(ResultFolder::prepare(path).unwrap());
        }
        assert!(!new.exists() && old.exists());
        let folder = ResultFolder::prepare(&full).unwrap();
        fs::write(full.join("report.json"), "{}").unwrap();
        drop(folder);
        assert!(full.join("report.json").exists());
        let refused = ResultFolder::prepare(&full).err().unwrap().to_string();
        assert!(
            refused.ends_with("allowed: a folder that is empty or does not exist"),
            "{refused}"
        );
    }
}
