//! Files installed beside the program: manual, shell completions, and licence notices.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, ensure};

use super::notices;

/// A shell, and where below `share` it looks for what completes commands.
const COMPLETIONS: [(&str, &str); 3] = [
    ("bash", "bash-completion/completions/torqued"),
    ("zsh", "zsh/site-functions/_torqued"),
    ("fish", "fish/vendor_completions.d/torqued.fish"),
];

/// Writes all documents into `share`, as the program tells them; what lies there is deleted.
pub fn write(torqued: &Path, share: &Path) -> anyhow::Result<()> {
    if share.exists() {
        fs::remove_dir_all(share).with_context(|| format!("cannot delete {}", share.display()))?;
    }
    let manual = share.join("man/man1");
    told_by(Command::new(torqued).args(["man", "--dir"]).arg(&manual))?;
    for (shell, file) in COMPLETIONS {
        put(&share.join(file), &told_by(Command::new(torqued).args(["completions", shell]))?)?;
    }
    put(&share.join("doc/torqued/third-party.txt"), notices::text()?.as_bytes())
}

fn told_by(command: &mut Command) -> anyhow::Result<Vec<u8>> {
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
