//! Rebuilds datasets. The footers of shards name their spec and their trajectories.

use std::collections::BTreeMap;
use std::ops::Range;

use spec::{Digest, JobSpec};
use store::{FileContent, FoundTable, JobId, ShardContents, Store};

use super::work::{FoundJob, FoundObjects, FoundWork, Written, checked_spec};

type Files = BTreeMap<FileContent, String>;

pub(super) async fn read(
    store: &Store,
    shards: BTreeMap<JobId, BTreeMap<Written, Files>>,
    found: &mut FoundObjects,
) {
    for (job, written) in shards {
        let mut spec: Option<JobSpec> = None;
        let mut contents = BTreeMap::new();
        // If a shard was written several times, the last one counts.
        for (Written { number, .. }, files) in written.into_iter().rev() {
            let paths: Vec<String> = files.values().cloned().collect();
            let read = match u32::try_from(number) {
                Ok(number) if contents.contains_key(&number) => {
                    Err("another attempt wrote it again".to_owned())
                }
                Ok(number) => read_shard(store, &files).await.map(|shard| (number, shard)),
                Err(_) => Err("its number is too large".to_owned()),
            };
            match read {
                Ok((_, (other, _))) if spec.as_ref().is_some_and(|spec| *spec != other) => {
                    paths.into_iter().for_each(|path| {
                        found.leave_out(path, "it is of another spec than other shards of its job");
                    });
                }
                Ok((number, (of_shard, shard))) => {
                    spec = Some(of_shard);
                    contents.insert(number, shard);
                }
                Err(reason) => {
                    paths.into_iter().for_each(|path| found.leave_out(path, reason.clone()));
                }
            }
        }
        if let Some(spec) = spec {
            found.jobs.insert(job, FoundJob { spec, work: FoundWork::Shards(contents) });
        }
    }
}

async fn read_shard(store: &Store, files: &Files) -> Result<(JobSpec, ShardContents), String> {
    let table = async |content: FileContent| {
        let path = files.get(&content).ok_or_else(|| format!("its {content} are missing"))?;
        store.find_table(path).await.map_err(|error| error.to_string())
    };
    let trajectories = table(FileContent::Trajectories).await?;
    let robots = table(FileContent::Robots).await?;
    let spec = said_spec(&robots)?;
    if said_spec(&trajectories)? != spec {
        return Err("its two files are of different specs".to_owned());
    }
    let count = robots.reader.rows();
    let Range { start: first, end } = match robots.reader.footer("torqued.trajectories") {
        Some(range) => said_range(range)?,
        // An import has one shard.
        None => 0..count,
    };
    if end.checked_sub(first) != Some(count) {
        return Err(format!("it has {count} robots, and says trajectories {first} to {end}"));
    }
    // A robot was drawn again until its motion kept away from the limits.
    let drawn = match &spec {
        JobSpec::Simulate(_) => robots.sum("draws").await.map_err(|error| error.to_string())?,
        _ => count,
    };
    let contents = ShardContents {
        first,
        count,
        rejected: drawn.saturating_sub(count),
        trajectories: trajectories.object,
        robots: robots.object,
    };
    Ok((spec, contents))
}

fn said_spec(table: &FoundTable) -> Result<JobSpec, String> {
    let said = |key: &str| {
        table.reader.footer(key).ok_or_else(|| format!("its footer does not say {key}"))
    };
    let digest: Digest = said("torqued.digest")?
        .parse()
        .map_err(|_| "torqued.digest of its footer is not a digest".to_owned())?;
    checked_spec(said("torqued.spec")?.as_bytes(), digest)
}

fn said_range(text: &str) -> Result<Range<u64>, String> {
    let range = text.split_once("..");
    let range = range.and_then(|(start, end)| Some(start.parse().ok()?..end.parse().ok()?));
    range.ok_or_else(|| format!("torqued.trajectories of its footer is {text:?}"))
}
