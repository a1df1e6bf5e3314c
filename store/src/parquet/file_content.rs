//! The contents of a shard's files, with their names and sizes.

use std::fmt;

use serde::{Deserialize, Serialize};

/// The two files of a shard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum FileContent {
    /// One row per time step.
    Trajectories,
    /// One row per trajectory: its robot and its excitation.
    Robots,
}

impl FileContent {
    /// Both contents.
    pub const ALL: [Self; 2] = [Self::Trajectories, Self::Robots];

    /// The word in paths and rows.
    pub const fn as_str(self) -> &'static str {
        match self {
            Self::Trajectories => "trajectories",
            Self::Robots => "robots",
        }
    }

    /// The name under which the file of a shard is downloaded, e.g. `trajectories-00003.parquet`.
    pub fn file_name(self, shard: u32) -> String {
        format!("{self}-{shard:05}.parquet")
    }

    /// The number of rows of a shard's file with this many trajectories of this many samples.
    pub fn rows(self, trajectories: u64, samples: u32) -> u64 {
        match self {
            Self::Trajectories => trajectories * u64::from(samples),
            Self::Robots => trajectories,
        }
    }
}

crate::database::column::column! {
    FileContent: String, Text, |content| content.as_str().to_owned(), |found| {
        let known = FileContent::ALL.into_iter().find(|content| content.as_str() == found);
        known.ok_or_else(|| format!("there is no content {found:?}"))?
    };
}

impl fmt::Display for FileContent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}
