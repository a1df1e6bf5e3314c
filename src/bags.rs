//! Bags of ROS 2: folders with `metadata.yaml` and files of messages, as `ros2 bag record` writes them.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

/// The most names of files in an error.
const SHOWN_FILES: usize = 20;

/// The file to read: the only MCAP file of a folder, and otherwise `path` itself.
pub fn recorded_file(path: &Path) -> anyhow::Result<PathBuf> {
    if !path.is_dir() {
        if has_extension(path, "db3") {
            bail!("{} {IN_SQLITE}", path.display());
        }
        return Ok(path.to_owned());
    }
    let cannot_read = || format!("cannot read {}", path.display());
    let mut files = Vec::new();
    for entry in path.read_dir().with_context(cannot_read)? {
        files.push(entry.with_context(cannot_read)?.path());
    }
    files.sort();
    let of_messages: Vec<&PathBuf> =
        files.iter().filter(|file| has_extension(file, "mcap")).collect();
    if let [only] = of_messages.as_slice() {
        return Ok((*only).clone());
    }
    if of_messages.is_empty() && files.iter().any(|file| has_extension(file, "db3")) {
        bail!("{} {IN_SQLITE}", path.display());
    }
    let names = files.iter().filter_map(|file| file.file_name()).map(OsStr::to_string_lossy);
    let mut names: Vec<_> = names.collect();
    let more = names.len().saturating_sub(SHOWN_FILES);
    names.truncate(SHOWN_FILES);
    let has = if names.is_empty() { "nothing".to_owned() } else { names.join(", ") };
    let more = if more == 0 { String::new() } else { format!(" and {more} more") };
    bail!(
        "{} is a folder with {has}{more}, allowed: a file, or a bag's folder with one .mcap file",
        path.display()
    )
}

const IN_SQLITE: &str =
    "is a ROS 2 bag in SQLite; convert it with ros2 bag convert (output storage mcap)";

fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|other| other.eq_ignore_ascii_case(extension))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bag_is_read_as_its_only_file_of_messages() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str| std::fs::write(folder.path().join(name), "").unwrap();
        let refusal = || recorded_file(folder.path()).unwrap_err().to_string();
        assert!(refusal().contains("is a folder with nothing, allowed: a file"), "{}", refusal());
        write("metadata.yaml");
        write("bag_0.db3");
        assert!(refusal().ends_with("(output storage mcap)"), "{}", refusal());
        let bag = recorded_file(&folder.path().join("bag_0.db3")).unwrap_err().to_string();
        assert!(bag.contains("is a ROS 2 bag in SQLite"), "{bag}");
        write("bag_0.mcap");
        let file = folder.path().join("bag_0.mcap");
        assert_eq!(recorded_file(folder.path()).unwrap(), file);
        assert_eq!(recorded_file(&file).unwrap(), file);
        write("bag_1.mcap");
        let two = "a folder with bag_0.db3, bag_0.mcap, bag_1.mcap, metadata.yaml, allowed";
        assert!(refusal().contains(two), "{}", refusal());
        // Errors of reading name a file that is not there.
        let missing = folder.path().join("missing.csv");
        assert_eq!(recorded_file(&missing).unwrap(), missing);
    }
}
