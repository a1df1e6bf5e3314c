//! This process among others: which program it runs, its files, and who goes first when memory runs out.

use std::io;
use std::path::PathBuf;

use nix::sys::resource::{Resource, getrlimit, setrlimit};

/// The program that this process runs, for it to run once more: the very same, also when another version has taken
/// its place since.
///
/// # Errors
/// When the system does not tell.
pub fn own_program() -> io::Result<PathBuf> {
    // Linux resolves this to the program itself and not to a name that it once had.
    let own = PathBuf::from("/proc/self/exe");
    if own.exists() { Ok(own) } else { std::env::current_exe() }
}

/// Lets this process open as many files as it is allowed to. Shells and systemd start programs with 1024, which a
/// server with many downloads, streams and shards gets through.
pub fn open_many_files() {
    let raised = getrlimit(Resource::RLIMIT_NOFILE)
        .and_then(|(_, most)| setrlimit(Resource::RLIMIT_NOFILE, most, most));
    if let Err(error) = raised {
        tracing::warn!(%error, "cannot open more files than usual");
    }
}

/// Has the system end this process before others when memory runs out, where it lets us say so: a worker's task is
/// tried again, while without its server everything stands still.
pub fn go_first_when_memory_is_short() {
    /// In thousandths, added to the share of memory that the process uses.
    const SCORE: &str = "500";
    // Only Linux has the file.
    let _ = std::fs::write("/proc/self/oom_score_adj", SCORE);
}

/// The machine's name, where the system tells.
pub fn host() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    match name.trim() {
        "" => "unknown".to_owned(),
        name => name.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_own_program_is_this_one() {
        let own = std::fs::read(own_program().unwrap()).unwrap();
        assert_eq!(own, std::fs::read(std::env::current_exe().unwrap()).unwrap());
    }

    #[test]
    fn as_many_files_as_are_allowed_may_be_open() {
        open_many_files();
        let (now, most) = getrlimit(Resource::RLIMIT_NOFILE).unwrap();
        assert_eq!(now, most);
    }
}
