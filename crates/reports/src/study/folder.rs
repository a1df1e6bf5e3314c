use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

/// The file that marks a folder as a study's report, which a newer one may replace.
const MARK: &str = "study.json";

/// Files that appear all at once or not at all.
#[derive(Debug, Default)]
pub struct Folder {
    files: Vec<(PathBuf, Vec<u8>)>,
}

impl Folder {
    pub fn new() -> Self {
        Self::default()
    }

    pub fn add(&mut self, path: impl Into<PathBuf>, bytes: impl Into<Vec<u8>>) {
        self.files.push((path.into(), bytes.into()));
    }

    /// Writes the folder beside `out`, and then replaces `out`.
    pub fn write(&self, out: &Path) -> anyhow::Result<()> {
        check_replaceable(out)?;
        let staged = beside(out, "partial")?;
        remove(&staged)?;
        for (path, bytes) in &self.files {
            let path = staged.join(path);
            let parent = path.parent().context("a file without a folder")?;
            fs::create_dir_all(parent)?;
            fs::write(&path, bytes)?;
        }
        let previous = beside(out, "previous")?;
        remove(&previous)?;
        if out.exists() {
            fs::rename(out, &previous)?;
        }
        fs::rename(&staged, out)?;
        remove(&previous)
    }
}

/// # Errors
/// When `out` has other contents than a study's report.
pub fn check_replaceable(out: &Path) -> anyhow::Result<()> {
    let is_empty = match fs::read_dir(out) {
        Ok(mut entries) => entries.next().is_none(),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => true,
        Err(error) => return Err(error.into()),
    };
    if !is_empty && !out.join(MARK).is_file() {
        bail!("{} holds something else than the report of a study", out.display());
    }
    Ok(())
}

fn beside(out: &Path, suffix: &str) -> anyhow::Result<PathBuf> {
    let name = out.file_name().context("the folder needs a name")?.to_string_lossy();
    Ok(out.with_file_name(format!(".{name}.{suffix}")))
}

fn remove(folder: &Path) -> anyhow::Result<()> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != std::io::ErrorKind::NotFound => Err(error.into()),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(text: &str) -> Folder {
        let mut folder = Folder::new();
        folder.add("study.json", "{}");
        folder.add("tables/rmse.csv", text);
        folder
    }

    #[test]
    fn a_report_replaces_the_one_before_whole() {
        let place = tempfile::tempdir().unwrap();
        let out = place.path().join("report");
        let mut first = folder("1");
        first.add("figures/old.svg", "x");
        first.write(&out).unwrap();
        folder("2").write(&out).unwrap();
        assert_eq!(fs::read_to_string(out.join("tables/rmse.csv")).unwrap(), "2");
        assert!(!out.join("figures").exists());
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_folder_with_anything_else_is_left_alone() {
        let place = tempfile::tempdir().unwrap();
        fs::write(place.path().join("thesis.tex"), "years of work").unwrap();
        let error = folder("1").write(place.path()).unwrap_err().to_string();
        assert!(error.contains("something else"), "{error}");
        assert!(place.path().join("thesis.tex").exists());
    }
}
