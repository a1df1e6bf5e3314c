//! The memory that this machine allows a process.

use std::path::Path;

/// The machine's memory, or the smallest limit of the process's control groups. `None` where the
/// system does not provide it, e.g. on systems other than Linux.
pub fn bytes() -> Option<u64> {
    let machine = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| total(&text))?;
    let groups = std::fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    Some(
        group_limit(&groups, Path::new("/sys/fs/cgroup"))
            .map_or(machine, |limit| limit.min(machine)),
    )
}

fn total(meminfo: &str) -> Option<u64> {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_machine_says_how_much_it_has() {
        assert_eq!(total("MemTotal:       2048 kB\nMemFree: 1 kB\n"), Some(2 << 20));
        assert_eq!(total("nothing of the kind"), None);
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
