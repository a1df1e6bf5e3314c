//! The offer of a worker to tasks, from flags or detected.

use clap::Args;
use spec::Resources;

use crate::process::memory_bytes;

/// Flags for a worker's offer.
#[derive(Debug, Args)]
pub struct OfferArguments {
    /// Processors to offer to tasks [default: its threads]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    cpus: Option<u32>,

    /// GPUs to offer to tasks [default: 1 if its device is a GPU, otherwise 0]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(0..=64))]
    gpus: Option<u32>,

    /// Memory to offer to tasks, in GB [default: the memory of the machine or of its control group]
    #[arg(long, value_name = "GB", value_parser = gigabytes)]
    memory_gb: Option<f64>,

    /// Also take tasks that ask for this tag; may be given several times
    #[arg(long = "tag", value_name = "NAME", value_parser = tag)]
    tags: Vec<String>,
}

impl OfferArguments {
    /// The offer, with defaults for missing flags: `threads`, the `gpus` of its device, and the
    /// machine's memory.
    pub fn complete(self, threads: usize, gpus: u32) -> Resources {
        let threads = u32::try_from(threads).unwrap_or(u32::MAX);
        Resources {
            cpus: Some(self.cpus.unwrap_or(threads)),
            gpus: self.gpus.unwrap_or(gpus),
            memory_gb: self.memory_gb.or_else(|| memory_bytes().map(in_gigabytes)),
            tags: self.tags.into_iter().collect(),
        }
    }
}

/// Flags for the offer of each of a server's own workers.
#[derive(Clone, Debug, Args)]
pub struct WorkerOfferArguments {
    /// Processors that each worker offers to tasks [default: its threads]
    #[arg(long, env = "TORQUED_WORKER_CPUS", value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    worker_cpus: Option<u32>,

    /// GPUs that each worker offers to tasks [default: 1 if its device is a GPU, otherwise 0; 0 on
    /// a cluster]
    #[arg(long, env = "TORQUED_WORKER_GPUS", value_name = "N", value_parser = clap::value_parser!(u32).range(0..=64))]
    worker_gpus: Option<u32>,

    /// Memory that each worker offers to tasks, in GB [default: its share of the machine's memory;
    /// 8 on a cluster]
    #[arg(long, env = "TORQUED_WORKER_MEMORY_GB", value_name = "GB", value_parser = gigabytes)]
    worker_memory_gb: Option<f64>,

    /// Workers also take tasks that ask for this tag; may be given several times
    #[arg(long = "worker-tag", env = "TORQUED_WORKER_TAGS", value_name = "NAME", value_delimiter = ',', value_parser = tag)]
    worker_tags: Vec<String>,
}

impl WorkerOfferArguments {
    /// The offer of each worker on a cluster.
    pub fn of_a_clusters_worker(&self, threads: u32) -> Resources {
        const MEMORY_GB: f64 = 8.0;
        Resources {
            cpus: Some(self.worker_cpus.unwrap_or(threads)),
            gpus: self.worker_gpus.unwrap_or(0),
            memory_gb: Some(self.worker_memory_gb.unwrap_or(MEMORY_GB)),
            tags: self.worker_tags.iter().cloned().collect(),
        }
    }

    /// The flags for each of `count` workers, which share the machine's memory.
    pub fn flags(&self, count: usize) -> Vec<String> {
        let mut flags = Vec::new();
        let mut flag = |name: &str, value: String| flags.extend([format!("--{name}"), value]);
        if let Some(cpus) = self.worker_cpus {
            flag("cpus", cpus.to_string());
        }
        if let Some(gpus) = self.worker_gpus {
            flag("gpus", gpus.to_string());
        }
        let share = || Some(in_gigabytes(memory_bytes()? / count.max(1) as u64));
        if let Some(memory) = self.worker_memory_gb.or_else(share) {
            flag("memory-gb", memory.to_string());
        }
        for tag in &self.worker_tags {
            flag("tag", tag.clone());
        }
        flags
    }
}

/// Bytes in units of 10^9 bytes, rounded down to 10^6 bytes.
fn in_gigabytes(bytes: u64) -> f64 {
    let megabytes = u32::try_from(bytes / 1_000_000).unwrap_or(u32::MAX);
    Resources::gigabytes(megabytes).unwrap_or(0.0)
}

fn gigabytes(text: &str) -> Result<f64, String> {
    let memory: f64 = text.parse().map_err(|_| "not a number".to_owned())?;
    let most = *Resources::MEMORY_GB.end();
    if (0.0..=most).contains(&memory) { Ok(memory) } else { Err(format!("allowed: 0 to {most}")) }
}

fn tag(name: &str) -> Result<String, String> {
    if Resources::is_tag(name) {
        Ok(name.to_owned())
    } else {
        Err("allowed: 1 to 60 lower-case letters, digits and dashes".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Worker {
        #[command(flatten)]
        offers: OfferArguments,
    }

    #[derive(Parser)]
    struct Serve {
        #[command(flatten)]
        offers: WorkerOfferArguments,
    }

    #[test]
    fn a_worker_offers_what_it_has_unless_it_is_told() {
        let offers = Worker::parse_from(["worker"]).offers.complete(6, 1);
        assert_eq!((offers.cpus, offers.gpus, offers.tags.len()), (Some(6), 1, 0));
        assert_eq!(offers.memory_gb, memory_bytes().map(in_gigabytes));
        let told = ["worker", "--cpus", "2", "--gpus", "0", "--memory-gb", "1.5", "--tag", "a100"];
        let offers = Worker::parse_from(told).offers.complete(6, 1);
        let tags = ["a100".to_owned()].into();
        let expected = Resources { cpus: Some(2), gpus: 0, memory_gb: Some(1.5), tags };
        assert_eq!(offers, expected);
        for wrong in [["--tag", "A100"], ["--gpus", "65"], ["--cpus", "0"], ["--memory-gb", "nan"]]
        {
            assert!(Worker::try_parse_from(["worker", wrong[0], wrong[1]]).is_err(), "{wrong:?}");
        }
    }

    #[test]
    fn a_server_tells_its_workers_what_to_offer() {
        let told =
            ["serve", "--worker-gpus", "2", "--worker-memory-gb", "3", "--worker-tag", "lab-3"];
        let flags = Serve::parse_from(told).offers.flags(4);
        assert_eq!(flags, ["--gpus", "2", "--memory-gb", "3", "--tag", "lab-3"]);
        let tags = ["lab-3".to_owned()].into();
        let expected = Resources { cpus: Some(4), gpus: 2, memory_gb: Some(3.0), tags };
        assert_eq!(Serve::parse_from(told).offers.of_a_clusters_worker(4), expected);
        let flags = Serve::parse_from(["serve"]).offers.flags(2);
        let half = memory_bytes().map(|bytes| in_gigabytes(bytes / 2).to_string());
        assert_eq!(flags.last(), half.as_ref());
    }
}
