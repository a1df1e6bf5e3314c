//! Datasets and their files.

use std::collections::{BTreeMap, BTreeSet};

use serde::Deserialize as _;
use serde_json::Value;
use spec::{DataSource, DataSources, DataSpec, Digest, JobSpec};
use store::{
    DatasetDescription, DatasetId, FileContent, JobId, Listed, Listing, Shard, ShardDescription,
    Store, StoreError,
};
use wire::{Dataset, DatasetFile, FileKind};

use crate::app::App;
use crate::app::archive::{Content, Member};
use crate::app::files::Download;
use crate::app::resources::{Downloaded, Resource};
use crate::error::ApiError;

const PARQUET: &str = "application/vnd.apache.parquet";

/// How a dataset is made, from its job's spec; `None` for a spec of another version.
pub fn data_of(spec: &Value) -> Option<DataSpec> {
    let spec: JobSpec = serde_json::from_value(spec.clone()).ok()?;
    DataSpec::of(&spec)
}

impl Resource for Dataset {
    type Row = store::Dataset;

    async fn rows(store: &Store, listing: &Listing) -> Result<Listed<Self::Row>, StoreError> {
        store.list_datasets(listing).await
    }

    fn spec(row: &Self::Row) -> Option<&Value> {
        Some(&row.spec)
    }

    async fn complete(_: &App, rows: Vec<Self::Row>) -> Result<Vec<Self>, ApiError> {
        Ok(rows.into_iter().map(without_files).collect())
    }

    async fn find(app: &App, id: i64) -> Result<Self, ApiError> {
        app.dataset(id).await
    }
}

impl Downloaded for Dataset {
    async fn file(app: &App, id: i64, name: &str) -> Result<Download, ApiError> {
        let dataset = app.store.dataset(DatasetId(id)).await?;
        let shards = app.store.shards(dataset.id).await?;
        let saved_as = format!("dataset-{id}-{name}");
        if name == DatasetDescription::FILE_NAME
            && let Some(json) = description(&dataset, &shards)
        {
            return Ok(Download::made(saved_as, "application/json", json));
        }
        let file = shards.iter().find_map(|shard| {
            let mut files = shard.contents.files().into_iter();
            let (_, file) = files.find(|(content, _)| content.file_name(shard.ordinal) == name)?;
            Some(file)
        });
        let file =
            file.ok_or_else(|| ApiError::not_found("file", format!("{name:?} in dataset {id}")))?;
        Ok(Download::new(saved_as, PARQUET, file, format!("{name} of dataset {id}")))
    }

    async fn tar(app: &App, id: i64) -> Result<Download, ApiError> {
        let dataset = app.store.dataset(DatasetId(id)).await?;
        let shards = app.store.shards(dataset.id).await?;
        let description = description(&dataset, &shards).map(|json| Member {
            name: DatasetDescription::FILE_NAME.to_owned(),
            content: Content::Made(json.into()),
        });
        let files = shards.iter().flat_map(|shard| {
            shard.contents.files().map(|(content, object)| {
                let name = content.file_name(shard.ordinal);
                let file = format!("{name} of dataset {id}");
                Member { name, content: Content::Stored { object: object.clone(), file } }
            })
        });
        Download::tar(&format!("dataset-{id}"), description.into_iter().chain(files).collect())
    }
}

/// The names of the data of jobs, which their specs name by digest.
pub(crate) struct DataNames(BTreeMap<Digest, String>);

impl DataNames {
    /// The names of the data that a spec refers to, separated by commas. A dataset that is gone has
    /// its short digest.
    pub fn of(&self, spec: &Value) -> Option<String> {
        let name = |source: &DataSource| match source {
            DataSource::Digest(digest) => self.0.get(digest).cloned().unwrap_or(digest.short()),
            DataSource::Stream(_) => "stream".to_owned(),
            DataSource::Dataset(id) => format!("dataset {id}"),
            DataSource::Job(job) => job.clone(),
        };
        let names: Vec<String> = sources(spec).iter().map(name).collect();
        (!names.is_empty()).then(|| names.join(", "))
    }
}

/// The data that a spec refers to.
fn sources(spec: &Value) -> Vec<DataSource> {
    match spec.get("data").map(DataSources::deserialize) {
        Some(Ok(DataSources::Each(sources))) => sources,
        Some(Ok(DataSources::One(source))) => vec![source],
        Some(Err(_)) | None => Vec::new(),
    }
}

impl App {
    /// The names of the data of these specs, by one statement.
    pub(crate) async fn data_names<'a>(
        &self,
        specs: impl IntoIterator<Item = &'a Value>,
    ) -> Result<DataNames, ApiError> {
        let digest = |source: DataSource| match source {
            DataSource::Digest(digest) => Some(digest),
            DataSource::Stream(_) | DataSource::Dataset(_) | DataSource::Job(_) => None,
        };
        let digests: BTreeSet<Digest> =
            specs.into_iter().flat_map(sources).filter_map(digest).collect();
        let digests: Vec<Digest> = digests.into_iter().collect();
        Ok(DataNames(self.store.names_of_digests(&digests).await?.into_iter().collect()))
    }

    /// The data that each of these jobs reads.
    pub(crate) async fn data_of_jobs(
        &self,
        jobs: &[i64],
    ) -> Result<Vec<Vec<DataSource>>, ApiError> {
        let jobs: Vec<JobId> = jobs.iter().copied().map(JobId).collect();
        let specs = self.store.specs(&jobs).await?;
        Ok(specs.iter().map(|(_, spec)| sources(spec)).collect())
    }

    /// The dataset of a spec's digest, if it is there.
    pub(crate) async fn dataset_of_digest(&self, digest: Digest) -> Result<Option<i64>, ApiError> {
        Ok(self.store.dataset_by_digest(digest).await?.map(|dataset| dataset.id.0))
    }

    pub(crate) async fn dataset(&self, id: i64) -> Result<Dataset, ApiError> {
        let row = self.store.dataset(DatasetId(id)).await?;
        let shards = self.store.shards(row.id).await?;
        let samples = row.samples;
        let description = description(&row, &shards);
        let mut dataset = without_files(row);
        dataset.files.extend(description.map(|json| described(id, &json)));
        dataset.files.extend(shards.iter().flat_map(|shard| files(shard, samples)));
        dataset.verification = self.verification(id).await?;
        Ok(dataset)
    }

    /// Those of the datasets with these ids that exist, by id and without their files.
    pub(crate) async fn datasets_by_id(
        &self,
        ids: &[i64],
    ) -> Result<BTreeMap<i64, Dataset>, ApiError> {
        let ids: Vec<DatasetId> = ids.iter().copied().map(DatasetId).collect();
        let rows = self.store.datasets_by_id(&ids).await?;
        Ok(rows.into_iter().map(|row| (row.id.0, without_files(row))).collect())
    }
}

/// The present `dataset.json`; `None` if another version wrote the spec.
fn description(dataset: &store::Dataset, shards: &[Shard]) -> Option<Vec<u8>> {
    let data = data_of(&dataset.spec)?;
    let described =
        |shard: &Shard| ShardDescription::new(shard.ordinal, &shard.contents, dataset.samples);
    let shards = shards.iter().map(described).collect();
    Some(jobs::describe_dataset(&data, dataset.digest, shards).to_json())
}

fn described(dataset: i64, json: &[u8]) -> DatasetFile {
    let name = DatasetDescription::FILE_NAME.to_owned();
    DatasetFile {
        url: format!("/v1/datasets/{dataset}/files/{name}"),
        name,
        content: FileKind::Description,
        shard: None,
        rows: None,
        size: json.len() as u64,
        sha256: Digest::of(json),
    }
}

fn files(shard: &Shard, samples: u32) -> [DatasetFile; 2] {
    shard.contents.files().map(|(content, object)| {
        let name = content.file_name(shard.ordinal);
        DatasetFile {
            url: format!("/v1/datasets/{}/files/{name}", shard.dataset),
            name,
            content: match content {
                FileContent::Trajectories => FileKind::Trajectories,
                FileContent::Robots => FileKind::Robots,
            },
            shard: Some(shard.ordinal),
            rows: Some(content.rows(shard.contents.count, samples)),
            size: object.size,
            sha256: object.sha256,
        }
    })
}

fn without_files(row: store::Dataset) -> Dataset {
    Dataset {
        id: row.id.0,
        job: row.job.0,
        name: row.name,
        note: row.note,
        tags: row.tags,
        job_tags: row.job_tags,
        digest: row.digest,
        state: row.state,
        spec: row.spec,
        trajectories: row.trajectories,
        samples: row.samples,
        rejected: row.rejected,
        bytes: row.bytes,
        files: Vec::new(),
        verification: None,
        created_at: row.created_at.to_string(),
        completed_at: row.completed_at.map(|time| time.to_string()),
    }
}
