//! Warnings about simulations that are larger than the disk.

use spec::{JobSpec, SimulateSpec};
use store::{DiskSpace, JobProgress};

/// A warning about a job whose files do not fit on a disk with this space. A pipeline has it until one
/// of its jobs is done; the jobs have warnings of their own.
pub(super) fn doubt(spec: &JobSpec, progress: &JobProgress, space: DiskSpace) -> Option<String> {
    let (field, trajectories, bytes) = match spec {
        JobSpec::Simulate(spec) => {
            ("trajectories", spec.trajectories, left(spec.estimated_bytes(), progress))
        }
        JobSpec::Pipeline(_) if progress.done == 0 => {
            let jobs = spec.single_jobs();
            let simulations = || jobs.iter().filter_map(|(_, job)| simulation(job));
            let trajectories = simulations().map(|spec| spec.trajectories).sum();
            (
                "the sum of all trajectories",
                trajectories,
                simulations().map(SimulateSpec::estimated_bytes).sum(),
            )
        }
        _ => return None,
    };
    let room = space.free_bytes.saturating_sub(space.reserved_bytes);
    (bytes > room).then(|| {
        let [bytes, free, reserved] =
            [bytes, space.free_bytes, space.reserved_bytes].map(|bytes| bytes / 1_000_000);
        format!(
            "{field} is {trajectories}: about {bytes} MB are still to be written, and the disk of the data folder has {free} MB \
             free, of which {reserved} MB stay free. Tasks without room wait: delete results with `torqued delete` and \
             `torqued gc`, or simulate fewer trajectories"
        )
    })
}

const fn simulation(job: &JobSpec) -> Option<&SimulateSpec> {
    match job {
        JobSpec::Simulate(spec) => Some(spec),
        _ => None,
    }
}

/// The part of `bytes` that is not written yet.
fn left(bytes: u64, progress: &JobProgress) -> u64 {
    let JobProgress { done, total, .. } = *progress;
    if total == 0 {
        return bytes;
    }
    let part = u128::from(bytes) * u128::from(total.saturating_sub(done)) / u128::from(total);
    u64::try_from(part).unwrap_or(bytes)
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    fn said(spec: &Value, done: u64, free_bytes: u64) -> String {
        let spec = spec::parse(spec.to_string().as_bytes()).unwrap();
        let space = DiskSpace { free_bytes, reserved_bytes: 256_000_000 };
        let (unit, rate_per_second, message) = ("trajectories".to_owned(), None, None);
        let progress = JobProgress { done, total: 1_000_000, unit, rate_per_second, message };
        doubt(&spec, &progress, space).unwrap_or_default()
    }

    #[test]
    fn a_simulation_larger_than_the_disk_is_doubted_with_both_numbers() {
        let spec = json!({"preset": "D1-chirp", "trajectories": 1_000_000, "samples": 400});
        let doubt = said(&spec, 0, 3_000_000_000);
        assert!(doubt.starts_with("trajectories is 1000000: about 17200 MB are still"), "{doubt}");
        assert!(doubt.contains("has 3000 MB free, of which 256 MB stay free"), "{doubt}");
        assert_eq!(said(&spec, 0, 17_500_000_000), "");
        assert_ne!(said(&spec, 0, 17_400_000_000), "", "the reserve is no room");
        assert!(said(&spec, 500_000, 3_000_000_000).contains("about 8600 MB are still"));
        assert_eq!(said(&spec, 900_000, 3_000_000_000), "");
        assert_eq!(said(&spec, 1_000_000, 0), "");
    }

    #[test]
    fn a_pipeline_is_doubted_before_it_begins() {
        let simulation = json!({"preset": "D1-chirp", "trajectories": 100_000, "samples": 400});
        let mut other = simulation.clone();
        other["seed"] = json!(7);
        let spec = json!({
            "kind": "pipeline", "name": "two", "jobs": {"one": simulation, "other": other},
        });
        let doubt = said(&spec, 0, 3_000_000_000);
        assert!(
            doubt.starts_with("the sum of all trajectories is 200000: about 3440 MB"),
            "{doubt}"
        );
        assert_eq!(said(&spec, 1, 3_000_000_000), "");
        assert_eq!(said(&spec, 0, 4_000_000_000), "");
    }
}
