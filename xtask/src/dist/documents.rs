//! Files installed beside the program: manual, shell completions, and licence notices.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, ensure};

use super::notices;

/// A shell, and the file below `share` with its completions.
const COMPLETIONS: [(&str, &str); 3] = [
    ("bash", "bash-completion/completions/torqued"),
    ("zsh", "zsh/site-functions/_torqued"),
    ("fish", "fish/vendor_completions.d/torqued.fish"),
];

/// Writes all documents into `share`, with the texts that the program prints. It first deletes the
/// folder.
pub fn write(torqued: &Path, share: &Path) -> anyhow::Result<()> {
    if share.exists() {
        fs::remove_dir_all(share).with_context(|| format!("cannot delete {}", share.display()))?;
    }
    let manual = share.join("man/man1");
    stdout_of(Command::new(torqued).args(["man", "--dir"]).arg(&manual))?;
    for (shell, file) in COMPLETIONS {
        put(&share.join(file), &stdout_of(Command::new(torqued).args(["completions", shell]))?)?;
    }
    put(&share.join("doc/torqued/third-party.txt"), notices::text()?.as_bytes())
}

fn stdout_of(command: &mut Command) -> anyhow::Result<Vec<u8>> {
    let output = command.output().context("cannot run torqued")?;
    let error = String::from_utf8_lossy(&output.stderr);
    ensure!(output.status.success(), "{command:?}: {error}");
    Ok(output.stdout)
}

fn put(file: &Path, bytes: &[u8]) -> anyhow::Result<()> {
    if let Some(folder) = file.parent() {
        fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    }
    fs::write(file, bytes).with_context(|| format!("cannot write {}", file.display()))
}
