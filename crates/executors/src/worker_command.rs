//! The command that starts a worker, wherever it runs.

use std::ffi::OsString;
use std::fmt;
use std::path::PathBuf;
use std::time::Duration;

use spec::Resources;

use crate::Ask;

/// The variable with the server's token. Workers speak to the database and not to the server, so no
/// worker gets it.
pub const SERVERS_TOKEN: &str = "TORQUED_TOKEN";

/// The command line and the environment of a worker.
#[derive(Clone)]
pub struct WorkerCommand {
    /// The path of the program where the worker runs.
    pub program: PathBuf,
    /// The flags that name the data folder. The environment says where database and objects are.
    pub store: Vec<OsString>,
    /// The device that computes models if there is no GPU.
    pub device: String,
    /// The device that computes models in a worker to which an engine gives GPUs.
    pub gpu_device: String,
    /// The length of its leases, s.
    pub lease_seconds: u64,
    /// The filter of its log.
    pub log: String,
    /// A worker ends when it finds no task for this long.
    pub idle_exit: Duration,
    /// Variables for the worker. Secrets are only here, because anybody can read a list of
    /// processes.
    pub environment: Vec<(String, String)>,
}

/// Leaves out the values of variables.
impl fmt::Debug for WorkerCommand {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let variables: Vec<&str> = self.environment.iter().map(|(name, _)| name.as_str()).collect();
        f.debug_struct("WorkerCommand")
            .field("program", &self.program)
            .field("store", &self.store)
            .field("variables", &variables)
            .finish_non_exhaustive()
    }
}

impl WorkerCommand {
    /// The flags of a worker, without those of its folder and its offer.
    pub(crate) fn flags(&self, name: &str, threads: u32, device: &str) -> Vec<String> {
        let flags = [
            ("--name", name.to_owned()),
            ("--threads", threads.to_string()),
            ("--device", device.to_owned()),
            ("--lease-seconds", self.lease_seconds.to_string()),
            ("--log", self.log.clone()),
        ];
        flags.into_iter().flat_map(|(flag, value)| [flag.to_owned(), value]).collect()
    }

    /// The flags of a requested worker.
    pub(crate) fn flags_of(&self, ask: &Ask) -> Vec<String> {
        let Resources { cpus, gpus, memory_gb, tags } = &ask.resources;
        let device = if *gpus > 0 { &self.gpu_device } else { &self.device };
        let mut flags = self.flags(&ask.name, cpus.unwrap_or(1), device);
        flags.extend(["--gpus".to_owned(), gpus.to_string()]);
        if let Some(memory) = memory_gb {
            flags.extend(["--memory-gb".to_owned(), memory.to_string()]);
        }
        flags.extend(tags.iter().flat_map(|tag| ["--tag".to_owned(), tag.clone()]));
        if !ask.stays {
            flags.extend(["--idle-exit".to_owned(), self.idle_exit.as_secs().max(1).to_string()]);
        }
        flags
    }
}

/// The prefix of the names of all workers that are requested for a store.
pub fn prefix(store: &str) -> String {
    format!("torqued-{store}-")
}

/// A unique name for a worker of a store. It has letters, digits and hyphens, fewer than 63.
pub fn new_name(store: &str) -> String {
    use std::hash::{BuildHasher, RandomState};
    use std::sync::atomic::{AtomicU64, Ordering};
    static COUNT: AtomicU64 = AtomicU64::new(0);
    // The keys of a hash map come from the system's randomness.
    let random = RandomState::new().hash_one(COUNT.fetch_add(1, Ordering::Relaxed));
    format!("{}{:010x}", prefix(store), random & 0xff_ffff_ffff)
}

#[cfg(test)]
mod tests {
    use std::collections::HashSet;

    use super::*;

    #[test]
    fn names_say_whose_a_worker_is_and_differ() {
        let names: HashSet<String> = (0..1000).map(|_| new_name("0f3a")).collect();
        assert_eq!(names.len(), 1000);
        assert!(names.iter().all(|name| name.starts_with("torqued-0f3a-") && name.len() == 23));
    }
}
