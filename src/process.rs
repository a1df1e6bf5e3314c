//! This process: its program, its files, its children, its memory, and the signals that end it.

use std::io;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, ensure};
use nix::sys::resource::{Resource, getrlimit, setrlimit};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use tokio::signal::unix::{self, SignalKind, signal};

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

/// Files that a server opens beside its connections and workers: the database, sent files and those
/// that are read for figures, models, streams of predictions, a bucket. A server without any of
/// these has about 40 open.
const RESERVED_FILES: u64 = 128;

/// Files of a worker that the server started.
const FILES_OF_A_WORKER: u64 = 4;

/// Files of a connection: its socket, and a file that is sent.
const FILES_OF_A_CONNECTION: u64 = 2;

/// The smallest number of connections with which a server starts.
const FEWEST_CONNECTIONS: u64 = 16;

/// The number of connections for which this process may open files, at most `connections`.
///
/// # Errors
/// When that number is so small that the server would refuse nearly everything.
pub fn files_allow(connections: usize, workers: u16) -> anyhow::Result<usize> {
    let files = getrlimit(Resource::RLIMIT_NOFILE).map_or(u64::MAX, |(now, _)| now);
    let allowed = connections_for(files, workers)?;
    if allowed < connections {
        tracing::warn!(
            files,
            "this process may open few files: {allowed} connections at once, not {connections}; raise ulimit -n"
        );
    }
    Ok(allowed.min(connections))
}

fn connections_for(files: u64, workers: u16) -> anyhow::Result<usize> {
    let beside = RESERVED_FILES + FILES_OF_A_WORKER * u64::from(workers);
    let needed = beside + FILES_OF_A_CONNECTION * FEWEST_CONNECTIONS;
    ensure!(
        files >= needed,
        "this process may open {files} files at once, allowed: at least {needed} ({RESERVED_FILES} for \
         the database and stored files, {FILES_OF_A_WORKER} for each of {workers} workers, \
         {FILES_OF_A_CONNECTION} for each of {FEWEST_CONNECTIONS} connections); raise the limit with \
         `ulimit -n 4096`, LimitNOFILE= of systemd or --ulimit nofile= of a container"
    );
    let connections = (files - beside) / FILES_OF_A_CONNECTION;
    Ok(usize::try_from(connections).unwrap_or(usize::MAX))
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

/// The machine's memory, or the smallest limit of the process's control groups. `None` where the
/// system does not provide it, e.g. on systems other than Linux.
pub fn memory_bytes() -> Option<u64> {
    let machine =
        std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| total_memory(&text))?;
    let groups = std::fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    Some(
        group_limit(&groups, Path::new("/sys/fs/cgroup"))
            .map_or(machine, |limit| limit.min(machine)),
    )
}

fn total_memory(meminfo: &str) -> Option<u64> {
    let line = meminfo.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(1024 * kib)
}

/// The smallest limit of the groups in `groups`, which is the text of `/proc/self/cgroup`, and of
/// their parents. Version 2 has `memory.max`, and version 1 has a separate hierarchy for memory.
fn group_limit(groups: &str, root: &Path) -> Option<u64> {
    let limits = groups.lines().filter_map(|line| {
        let (controllers, path) = line.split_once(':')?.1.split_once(':')?;
        let (root, file) = match controllers {
            "" => (root.to_owned(), "memory.max"),
            "memory" => (root.join("memory"), "memory.limit_in_bytes"),
            _ => return None,
        };
        let group = root.join(path.trim_start_matches('/'));
        // Inside a container the path may not exist, and the root is the container's own group.
        group
            .ancestors()
            .take_while(|folder| folder.starts_with(&root))
            .filter_map(|folder| {
                std::fs::read_to_string(folder.join(file)).ok()?.trim().parse().ok()
            })
            .min()
    });
    limits.min()
}

/// Listens for Ctrl-C and SIGTERM.
pub struct Interrupts {
    interrupt: unix::Signal,
    terminate: unix::Signal,
}

impl Interrupts {
    pub fn new() -> anyhow::Result<Self> {
        let interrupt = signal(SignalKind::interrupt()).context("cannot listen for Ctrl-C")?;
        let terminate = signal(SignalKind::terminate()).context("cannot listen for SIGTERM")?;
        Ok(Self { interrupt, terminate })
    }

    /// Waits for the next Ctrl-C.
    pub async fn next_from_terminal(&mut self) {
        self.interrupt.recv().await;
    }

    /// Waits for the next Ctrl-C or SIGTERM.
    pub async fn next(&mut self) {
        tokio::select! {
            _ = self.interrupt.recv() => {}
            _ = self.terminate.recv() => {}
        }
    }
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
    fn connections_get_the_files_that_the_rest_leaves() {
        assert_eq!(connections_for(256, 0).unwrap(), 64);
        assert_eq!(connections_for(1024, 1).unwrap(), 446);
        assert_eq!(connections_for(160, 0).unwrap(), 16);
        let error = connections_for(24, 1).unwrap_err().to_string();
        assert!(error.starts_with("this process may open 24 files at once, allowed: at least 164"));
        assert!(error.contains("ulimit -n 4096"), "{error}");
    }

    #[test]
    fn as_many_files_as_are_allowed_may_be_open() {
        open_many_files();
        let (now, most) = getrlimit(Resource::RLIMIT_NOFILE).unwrap();
        assert_eq!(now, most);
    }

    #[test]
    fn the_machine_says_how_much_it_has() {
        assert_eq!(total_memory("MemTotal:       2048 kB\nMemFree: 1 kB\n"), Some(2 << 20));
        assert_eq!(total_memory("nothing of the kind"), None);
    }

    #[test]
    fn the_tightest_control_group_counts() {
        let root = tempfile::tempdir().unwrap();
        let inner = root.path().join("lab/job");
        std::fs::create_dir_all(&inner).unwrap();
        std::fs::write(root.path().join("lab/memory.max"), "4096\n").unwrap();
        std::fs::write(inner.join("memory.max"), "max\n").unwrap();
        assert_eq!(group_limit("0::/lab/job\n", root.path()), Some(4096));
        std::fs::write(inner.join("memory.max"), "1024\n").unwrap();
        assert_eq!(group_limit("0::/lab/job\n", root.path()), Some(1024));
        assert_eq!(group_limit("0::/elsewhere\n", root.path()), None);
    }

    #[test]
    fn groups_of_the_first_version_count_too() {
        let root = tempfile::tempdir().unwrap();
        std::fs::create_dir_all(root.path().join("memory/lab")).unwrap();
        std::fs::write(root.path().join("memory/lab/memory.limit_in_bytes"), "2048\n").unwrap();
        let groups = "5:cpu:/lab\n4:memory:/lab\n0::/lab\n";
        assert_eq!(group_limit(groups, root.path()), Some(2048));
    }
}
