use spec::{DataSpec, Digest};
use store::{DatasetDescription, ShardDescription, TableColumns};

/// Describes the dataset that `data` makes, with its digest and the shards that exist, in order.
pub fn describe_dataset(
    data: &DataSpec,
    digest: Digest,
    shards: Vec<ShardDescription>,
) -> DatasetDescription {
    let job = data.job();
    DatasetDescription {
        name: format!("{}-{}", job.kind(), digest.short()),
        digest,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        complete: shards.len() as u64 == data.shard_count(),
        trajectories: shards.iter().map(|shard| shard.trajectories).sum(),
        samples: data.samples(),
        rate_hz: data.rate_hz(),
        rejected: shards.iter().map(|shard| shard.rejected).sum(),
        columns: TableColumns {
            trajectories: data.trajectory_columns(),
            robots: data.table_columns(),
        },
        shards,
        spec: job.to_json(),
    }
}
