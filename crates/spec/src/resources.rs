//! The resources that tasks need and workers offer.

use std::collections::BTreeSet;
use std::fmt;

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use crate::check::{Check, Violations};

/// Resources that the tasks of a job need, or that a worker offers. A worker takes a task if it
/// offers at least as much of every resource, and all tags.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Resources {
    /// Number of processors, 1 to 1024. A worker offers its threads.
    pub cpus: Option<u32>,
    /// Number of GPUs, 0 to 64.
    pub gpus: u32,
    /// Memory in units of 10^9 bytes, 0.1 to 100 000, with a precision of 10^6 bytes.
    pub memory_gb: Option<f64>,
    /// At most 16 names of 1 to 60 lower-case letters, digits and dashes.
    pub tags: BTreeSet<String>,
}

const MAX_TAGS: usize = 16;

const MEGABYTES_PER_GB: f64 = 1000.0;

impl Resources {
    /// Allowed numbers of processors.
    pub const CPUS: std::ops::RangeInclusive<u32> = 1..=1024;
    /// Allowed numbers of GPUs.
    pub const GPUS: std::ops::RangeInclusive<u32> = 0..=64;
    /// Allowed memory, 10^9 bytes.
    pub const MEMORY_GB: std::ops::RangeInclusive<f64> = 0.1..=100_000.0;

    /// Whether a worker with this offer can take a task that asks for `asked`.
    pub fn cover(&self, asked: &Self) -> bool {
        self.cpus.unwrap_or(0) >= asked.cpus.unwrap_or(0)
            && self.gpus >= asked.gpus
            && self.megabytes() >= asked.megabytes()
            && self.tags.is_superset(&asked.tags)
    }

    /// The smallest resources that cover these and `others`.
    #[must_use]
    pub fn and(&self, others: &Self) -> Self {
        let memory = self.megabytes().max(others.megabytes());
        Self {
            cpus: self.cpus.max(others.cpus),
            gpus: self.gpus.max(others.gpus),
            memory_gb: Self::gigabytes(memory),
            tags: self.tags.union(&others.tags).cloned().collect(),
        }
    }

    /// The memory in units of 10^6 bytes; 0 if it is not specified.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a cast of a float saturates, and memory is checked to be far below the largest integer"
    )]
    pub fn megabytes(&self) -> u32 {
        self.memory_gb.map_or(0, |gigabytes| (gigabytes * MEGABYTES_PER_GB).round() as u32)
    }

    /// A number of units of 10^6 bytes as `memory_gb`; `None` for 0.
    pub fn gigabytes(megabytes: u32) -> Option<f64> {
        (megabytes > 0).then(|| f64::from(megabytes) / MEGABYTES_PER_GB)
    }

    /// Whether `name` may be a tag.
    pub fn is_tag(name: &str) -> bool {
        (1..=60).contains(&name.len())
            && name.bytes().all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'-')
    }
}

/// For example `cpus >= 4, gpus >= 1 and tag a100`.
impl fmt::Display for Resources {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut parts = Vec::new();
        parts.extend(self.cpus.map(|cpus| format!("cpus >= {cpus}")));
        parts.extend((self.gpus > 0).then(|| format!("gpus >= {}", self.gpus)));
        parts.extend(self.memory_gb.map(|memory| format!("memory_gb >= {memory}")));
        parts.extend(self.tags.iter().map(|tag| format!("tag {tag}")));
        match parts.split_last() {
            None => f.write_str("anything"),
            Some((last, [])) => f.write_str(last),
            Some((last, others)) => write!(f, "{} and {last}", others.join(", ")),
        }
    }
}

impl Check for Resources {
    fn check(&self, violations: &mut Violations) {
        if let Some(cpus) = self.cpus {
            violations.within("cpus", cpus, Self::CPUS);
        }
        violations.within("gpus", self.gpus, Self::GPUS);
        if let Some(memory) = self.memory_gb {
            violations.within("memory_gb", memory, Self::MEMORY_GB);
        }
        if self.tags.len() > MAX_TAGS {
            violations.add("tags", format!("{} tags", self.tags.len()), "at most 16 tags");
        }
        for tag in self.tags.iter().filter(|tag| !Self::is_tag(tag)) {
            let allowed = "names of 1 to 60 lower-case letters, digits and dashes";
            violations.add("tags", format!("{tag:?}"), allowed);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn resources(cpus: u32, gpus: u32, memory_gb: f64, tags: &[&str]) -> Resources {
        let tags = tags.iter().map(|tag| (*tag).to_owned()).collect();
        Resources { cpus: Some(cpus), gpus, memory_gb: Some(memory_gb), tags }
    }

    #[test]
    fn an_offer_covers_what_asks_for_no_more_of_anything() {
        let offer = resources(8, 1, 16.0, &["a100", "lab-3"]);
        for asked in [
            Resources::default(),
            offer.clone(),
            resources(1, 0, 0.1, &[]),
            resources(8, 1, 16.0, &["lab-3"]),
        ] {
            assert!(offer.cover(&asked), "{asked}");
        }
        for asked in [
            resources(9, 1, 16.0, &[]),
            resources(8, 2, 16.0, &[]),
            resources(8, 1, 16.001, &[]),
            resources(8, 1, 16.0, &["h100"]),
        ] {
            assert!(!offer.cover(&asked), "{asked}");
            assert!(!Resources::default().cover(&asked), "{asked}");
            let both = offer.and(&asked);
            assert!(both.cover(&offer) && both.cover(&asked), "{both}");
        }
        assert_eq!(offer.and(&Resources::default()), offer);
        assert_eq!(
            resources(1, 0, 2.0, &["x"]).and(&resources(2, 1, 1.0, &["y"])),
            resources(2, 1, 2.0, &["x", "y"])
        );
    }

    #[test]
    fn memory_is_counted_in_whole_megabytes() {
        for (gigabytes, megabytes) in [(0.1, 100), (4.1, 4100), (16.1, 16_100), (1e5, 100_000_000)]
        {
            let asked = Resources { memory_gb: Some(gigabytes), ..Resources::default() };
            assert_eq!(asked.megabytes(), megabytes);
            assert_eq!(Resources::gigabytes(megabytes), Some(gigabytes));
        }
        assert_eq!((Resources::default().megabytes(), Resources::gigabytes(0)), (0, None));
    }

    #[test]
    fn what_is_asked_for_is_told_in_words() {
        assert_eq!(Resources::default().to_string(), "anything");
        assert_eq!(Resources { gpus: 1, ..Resources::default() }.to_string(), "gpus >= 1");
        let all = resources(4, 1, 0.5, &["a100"]).to_string();
        assert_eq!(all, "cpus >= 4, gpus >= 1, memory_gb >= 0.5 and tag a100");
    }
}
