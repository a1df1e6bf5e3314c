//! This process: its program, its files, its children, and its priority when memory runs out.

use std::io;
use std::path::PathBuf;

use nix::sys::resource::{Resource, getrlimit, setrlimit};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;

/// The program of this process, so that it can start itself again. It is the same program even if
/// another version has replaced the file since.
///
/// # Errors
/// When the operating system does not provide it.
pub fn own_program() -> io::Result<PathBuf> {
    // Linux resolves this to the program itself, and not to a name that it once had.
    let own = PathBuf::from("/proc/self/exe");
    if own.exists() { Ok(own) } else { std::env::current_exe() }
}

/// Raises this process's limit of open files to the allowed maximum. Shells and systemd start
/// programs with 1024, which is not enough for a server with many downloads, streams and shards.
pub fn open_many_files() {
    let raised = getrlimit(Resource::RLIMIT_NOFILE)
        .and_then(|(_, most)| setrlimit(Resource::RLIMIT_NOFILE, most, most));
    if let Err(error) = raised {
        tracing::warn!(%error, "cannot open more files than usual");
    }
}

/// The number of connections that leaves three of four files for everything else; at most
/// `connections`.
pub fn files_allow(connections: usize) -> usize {
    let files = getrlimit(Resource::RLIMIT_NOFILE).map_or(u64::MAX, |(now, _)| now);
    let allowed = usize::try_from(files / 4).unwrap_or(usize::MAX).max(1);
    if allowed < connections {
        tracing::warn!(
            files,
            "this process may open few files: {allowed} connections at once, not {connections}; raise ulimit -n"
        );
    }
    allowed.min(connections)
}

/// Makes the system kill this process before others when memory runs out, where that is possible. A
/// worker's task is retried, but without its server everything stops.
pub fn prefer_as_oom_victim() {
    /// In thousandths, added to the process's share of memory.
    const SCORE: &str = "500";
    // Only Linux has the file.
    let _ = std::fs::write("/proc/self/oom_score_adj", SCORE);
}

/// The machine's name, where the system provides it.
pub fn host() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    match name.trim() {
        "" => "unknown".to_owned(),
        name => name.to_owned(),
    }
}

/// Kills the processes that this one started, those that they started, and the rest of its process
/// group if it leads one. Only Linux tells which these are.
pub fn kill_children() {
    let processes = processes();
    let mut found = vec![std::process::id()];
    let mut looked_at = 0;
    while let Some(&parent) = found.get(looked_at) {
        looked_at += 1;
        // While a process lives, only the group that it leads has its number.
        let is_child =
            |process: &&Process| process.parent == parent || process.group == std::process::id();
        let children = processes.iter().filter(is_child).map(|process| process.pid);
        let new: Vec<u32> = children.filter(|pid| !found.contains(pid)).collect();
        found.extend(new);
    }
    for pid in found.into_iter().skip(1).filter_map(|pid| i32::try_from(pid).ok()) {
        // The process may have ended by itself.
        let _ = kill(Pid::from_raw(pid), Signal::SIGKILL);
    }
}

/// A process of this machine.
#[derive(Debug)]
struct Process {
    pid: u32,
    parent: u32,
    group: u32,
}

/// All processes that this one may see.
fn processes() -> Vec<Process> {
    let entries = std::fs::read_dir("/proc").into_iter().flatten().flatten();
    let read = |entry: std::fs::DirEntry| {
        let pid = entry.file_name().to_str()?.parse().ok()?;
        let stat = std::fs::read_to_string(entry.path().join("stat")).ok()?;
        // The line is `PID (NAME) STATE PARENT GROUP ...`, and a name may contain parentheses.
        let mut fields = stat.rsplit_once(')')?.1.split_whitespace().skip(1);
        let (parent, group) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
        Some(Process { pid, parent, group })
    };
    entries.filter_map(read).collect()
}

#[cfg(test)]
mod tests {
    use std::os::unix::process::ExitStatusExt as _;

    use super::*;

    #[test]
    fn the_own_program_is_this_one() {
        let own = std::fs::read(own_program().unwrap()).unwrap();
        assert_eq!(own, std::fs::read(std::env::current_exe().unwrap()).unwrap());
    }

    /// One child is stopped and takes no other signal, and the other was started by it.
    #[test]
    #[cfg(target_os = "linux")]
    fn children_are_killed_with_their_children() {
        let mut child = std::process::Command::new("sh")
            .args(["-c", "sleep 1000 & echo $!; kill -STOP $$"])
            .stdout(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        let output = child.stdout.take().unwrap();
        io::BufRead::read_line(&mut io::BufReader::new(output), &mut line).unwrap();
        let grandchild: u32 = line.trim().parse().unwrap();
        assert!(
            processes()
                .iter()
                .any(|process| process.pid == grandchild && process.parent == child.id())
        );
        kill_children();
        assert_eq!(child.wait().unwrap().signal(), Some(9));
        // Nobody may have waited for it.
        let has_ended = || {
            let stat = std::fs::read_to_string(format!("/proc/{grandchild}/stat"));
            stat.is_err() || stat.is_ok_and(|stat| stat.contains(") Z "))
        };
        while !has_ended() {
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
    }

    #[test]
    fn as_many_files_as_are_allowed_may_be_open() {
        open_many_files();
        let (now, most) = getrlimit(Resource::RLIMIT_NOFILE).unwrap();
        assert_eq!(now, most);
    }
}
