//! Processor time of running processes, from the kernel's scheduler.

use std::fs;
use std::time::Duration;

/// The processor time of a process's threads so far; 0 after its end.
pub fn of(process: u32) -> Duration {
    let threads = fs::read_dir(format!("/proc/{process}/task")).into_iter().flatten().flatten();
    let spent = threads.filter_map(|thread| {
        let text = fs::read_to_string(thread.path().join("schedstat")).ok()?;
        let nanoseconds = text.split_whitespace().next()?.parse().ok()?;
        Some(Duration::from_nanos(nanoseconds))
    });
    spent.sum()
}

/// The processor time of a process and its children so far.
pub fn with_children(process: u32) -> Duration {
    let entries = fs::read_dir("/proc").into_iter().flatten().flatten();
    let processes = entries.filter_map(|entry| entry.file_name().to_str()?.parse().ok());
    let children = processes.filter(|&candidate| parent(candidate) == Some(process));
    of(process) + children.map(of).sum::<Duration>()
}

/// Field 4 of `/proc/PID/stat`. The second field is a name that may contain anything.
fn parent(process: u32) -> Option<u32> {
    let stat = fs::read_to_string(format!("/proc/{process}/stat")).ok()?;
    let (_, after_name) = stat.rsplit_once(')')?;
    after_name.split_whitespace().nth(1)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn children_are_known_by_their_parent() {
        let mut child = std::process::Command::new("sleep").arg("60").spawn().unwrap();
        assert_eq!(parent(child.id()), Some(std::process::id()));
        child.kill().unwrap();
        child.wait().unwrap();
    }

    #[test]
    fn a_process_that_ended_has_spent_nothing() {
        assert_eq!(of(u32::MAX), Duration::ZERO);
        assert!(with_children(std::process::id()) >= of(u32::MAX));
    }
}
