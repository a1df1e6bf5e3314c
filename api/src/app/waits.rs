//! Sentences about why queued tasks wait.

use std::fmt::Write;

use spec::Resources;
use store::Wait;

/// The part of a sentence after "queued, ". `engine` is the engine that provides missing workers,
/// if there is one.
pub(super) fn sentence(wait: &Wait, engine: Option<&str>) -> String {
    match (wait, engine) {
        (Wait::Until(moment), _) => format!("from {moment} on"),
        (Wait::Unoffered(resources) | Wait::Drained { resources, .. }, Some(engine)) => {
            format!("no worker offers {resources}; {engine} is asked for one")
        }
        (Wait::Unoffered(resources), None) => format!(
            "no worker offers {resources}; start one with `torqued worker{}`",
            flags(resources)
        ),
        (Wait::Drained { resources, workers }, None) => format!(
            "only drained workers offer {resources}; undrain one with `torqued undrain {}`",
            workers.join("` or `torqued undrain ")
        ),
    }
}

/// The flags with which a worker must be started to offer `resources`.
fn flags(Resources { cpus, gpus, memory_gb, tags }: &Resources) -> String {
    let mut flags = String::new();
    let mut flag = |name: &str, value: &dyn std::fmt::Display| {
        // Writing to a string cannot fail.
        let _ = write!(flags, " --{name} {value}");
    };
    if let Some(cpus) = cpus {
        flag("cpus", cpus);
    }
    if *gpus > 0 {
        flag("gpus", gpus);
    }
    if let Some(memory) = memory_gb {
        flag("memory-gb", memory);
    }
    tags.iter().for_each(|tag| flag("tag", tag));
    flags
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn who_waits_is_told_for_what_and_how_to_get_it() {
        let tags = ["a100".to_owned(), "lab-3".to_owned()].into();
        let resources = Resources { cpus: Some(4), gpus: 1, memory_gb: Some(7.5), tags };
        assert_eq!(
            sentence(&Wait::Unoffered(resources.clone()), None),
            "no worker offers cpus >= 4, gpus >= 1, memory_gb >= 7.5, tag a100 and tag lab-3; start one \
             with `torqued worker --cpus 4 --gpus 1 --memory-gb 7.5 --tag a100 --tag lab-3`"
        );
        assert_eq!(
            sentence(&Wait::Unoffered(resources), Some("Slurm")),
            "no worker offers cpus >= 4, gpus >= 1, memory_gb >= 7.5, tag a100 and tag lab-3; Slurm is asked \
             for one"
        );
        let resources = Resources { gpus: 2, ..Resources::default() };
        let workers = vec!["w1".to_owned(), "w2".to_owned()];
        assert_eq!(
            sentence(&Wait::Drained { resources, workers }, None),
            "only drained workers offer gpus >= 2; undrain one with `torqued undrain w1` or `torqued undrain w2`"
        );
        let moment = "2026-12-01T09:00:00+01:00".parse().unwrap();
        assert_eq!(sentence(&Wait::Until(moment), None), "from 2026-12-01T08:00:00Z on");
    }
}
