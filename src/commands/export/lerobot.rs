//! Exports a dataset in LeRobot's format v3.0. Each trajectory is an episode, with the positions of
//! all joints in `observation.state` and their torques in `action`. The folder `meta` describes
//! features, episodes and tasks.
//! <https://huggingface.co/docs/lerobot/lerobot-dataset-v3>

use std::collections::HashMap;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, ensure};
use arrow_array::builder::{ListBuilder, StringBuilder};
use arrow_array::{ArrayRef, Int64Array, RecordBatch, StringArray};
use arrow_schema::{DataType, Field, Schema};
use parquet::arrow::ArrowWriter;
use serde_json::{Value, json};
use store::DatasetDescription;
use wire::{Dataset, DatasetFile, DatasetState, FileKind, StoredFile};

use super::Done;
use super::lerobot_shard::{Feature, Features, Timing, convert};
use crate::client::Client;

/// Largest number of files in a folder, as in LeRobot.
const FILES_PER_CHUNK: u32 = 1000;

/// The folder for shards until they are converted.
const DOWNLOADS: &str = "downloads";

/// Returns `meta/info.json`.
pub async fn export(client: &Client, id: i64, out: &Path, done: &Done) -> anyhow::Result<Value> {
    let dataset: Dataset = client.get(&format!("/v1/datasets/{id}")).await?;
    ensure!(
        dataset.state == DatasetState::Complete,
        "dataset {id} is {}; it can be exported when it is complete",
        dataset.state
    );
    let downloads = out.join(DOWNLOADS);
    std::fs::create_dir_all(&downloads)
        .with_context(|| format!("cannot create {}", downloads.display()))?;
    let description = description(client, &dataset, &downloads).await?;
    let mut features = Features::of(&description.columns.trajectories)?;
    let shards: Vec<&DatasetFile> =
        dataset.files.iter().filter(|file| file.content == FileKind::Trajectories).collect();
    done.begin(shards.iter().map(|shard| shard.size).sum());
    for shard in shards {
        let ordinal = shard.shard.context("a table of trajectories belongs to no shard")?;
        let file = stored(shard);
        client.fetch(&file, &downloads, |_| {}).await?;
        let from = downloads.join(&file.name);
        let to = data_file(out, ordinal);
        let timing = Timing { samples: description.samples, rate_hz: description.rate_hz };
        features =
            tokio::task::spawn_blocking(move || convert(&from, &to, timing, features)).await??;
        done.add(shard.size);
    }
    let info = write_meta(out, &dataset.name, &description, &features)?;
    std::fs::remove_dir_all(&downloads)
        .with_context(|| format!("cannot delete {}", downloads.display()))?;
    Ok(info)
}

async fn description(
    client: &Client,
    dataset: &Dataset,
    downloads: &Path,
) -> anyhow::Result<DatasetDescription> {
    let file = dataset.files.iter().find(|file| file.content == FileKind::Description);
    let file =
        file.context("the dataset has no dataset.json; another version of torqued made it")?;
    client.fetch(&stored(file), downloads, |_| {}).await?;
    let text = std::fs::read(downloads.join(&file.name))?;
    serde_json::from_slice(&text).context("dataset.json is of another version of torqued")
}

fn stored(file: &DatasetFile) -> StoredFile {
    StoredFile {
        name: file.name.clone(),
        size: file.size,
        sha256: file.sha256,
        url: file.url.clone(),
    }
}

/// The version of the format.
const VERSION: &str = "v3.0";

/// Number of episodes that are written at once.
const EPISODES_AT_ONCE: u64 = 50_000;

/// The data file of a shard.
fn data_file(out: &Path, shard: u32) -> PathBuf {
    let (chunk, file) = place(shard);
    out.join(format!("data/chunk-{chunk:03}/file-{file:03}.parquet"))
}

fn place(shard: u32) -> (u32, u32) {
    (shard / FILES_PER_CHUNK, shard % FILES_PER_CHUNK)
}

/// Writes the folder, and returns `info.json`.
fn write_meta(
    out: &Path,
    name: &str,
    description: &DatasetDescription,
    features: &Features,
) -> anyhow::Result<Value> {
    let folder = out.join("meta/episodes/chunk-000");
    std::fs::create_dir_all(&folder)
        .with_context(|| format!("cannot create {}", folder.display()))?;
    let info = info(description, features);
    write_json(&out.join("meta/info.json"), &info)?;
    let statistics = [&features.state, &features.action];
    let statistics = statistics.map(|feature| (feature.key.to_owned(), feature.statistics()));
    write_json(&out.join("meta/stats.json"), &Value::from_iter(statistics))?;
    write_tasks(&out.join("meta/tasks.parquet"), name)?;
    write_episodes(&folder.join("file-000.parquet"), name, description)?;
    Ok(info)
}

fn info(description: &DatasetDescription, features: &Features) -> Value {
    let episodes = description.trajectories;
    let robot = description.spec.pointer("/robot/model").and_then(Value::as_str);
    // LeRobot writes an integer if the rate is one.
    let whole = format!("{}", description.rate_hz).parse::<u64>().ok();
    let rate = whole.map_or(json!(description.rate_hz), |whole| json!(whole));
    let own = |feature: &Feature| {
        json!({
            "dtype": "float32",
            "shape": [feature.names.len()],
            "names": feature.names,
            "info": {"unit": feature.unit},
        })
    };
    let scalar = |dtype: &str| json!({"dtype": dtype, "shape": [1], "names": null});
    json!({
        "codebase_version": VERSION,
        "robot_type": robot.unwrap_or("arm"),
        "total_episodes": episodes,
        "total_frames": episodes * u64::from(description.samples),
        "total_tasks": 1,
        "chunks_size": FILES_PER_CHUNK,
        "data_files_size_in_mb": 100,
        "video_files_size_in_mb": 200,
        "fps": rate,
        "splits": {"train": format!("0:{episodes}")},
        "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
        "video_path": null,
        "features": {
            features.state.key: own(&features.state),
            features.action.key: own(&features.action),
            "timestamp": scalar("float32"),
            "frame_index": scalar("int64"),
            "episode_index": scalar("int64"),
            "index": scalar("int64"),
            "task_index": scalar("int64"),
        },
    })
}

fn write_json(path: &Path, document: &Value) -> anyhow::Result<()> {
    let text = serde_json::to_string_pretty(document)?;
    std::fs::write(path, text).with_context(|| format!("cannot write {}", path.display()))
}

/// Writes the tasks. They are the index of a pandas table, with pandas' own marks.
fn write_tasks(path: &Path, name: &str) -> anyhow::Result<()> {
    const INDEX: &str = "__index_level_0__";
    let pandas = json!({
        "index_columns": [INDEX],
        "column_indexes": [],
        "columns": [
            {
                "name": "task_index", "field_name": "task_index",
                "pandas_type": "int64", "numpy_type": "int64", "metadata": null,
            },
            {
                "name": null, "field_name": INDEX,
                "pandas_type": "unicode", "numpy_type": "object", "metadata": null,
            },
        ],
        "creator": {"library": "torqued", "version": env!("CARGO_PKG_VERSION")},
        "pandas_version": "2.0.0",
    });
    let fields = vec![
        Field::new("task_index", DataType::Int64, false),
        Field::new(INDEX, DataType::Utf8, false),
    ];
    let metadata = HashMap::from([("pandas".to_owned(), pandas.to_string())]);
    let schema = Arc::new(Schema::new_with_metadata(fields, metadata));
    let columns: Vec<ArrayRef> =
        vec![Arc::new(Int64Array::from(vec![0])), Arc::new(StringArray::from(vec![name]))];
    let mut writer = writer(path, &schema)?;
    writer.write(&RecordBatch::try_new(schema, columns)?)?;
    writer.close()?;
    Ok(())
}

fn write_episodes(path: &Path, task: &str, description: &DatasetDescription) -> anyhow::Result<()> {
    const NUMBERS: [&str; 8] = [
        "episode_index",
        "length",
        "dataset_from_index",
        "dataset_to_index",
        "data/chunk_index",
        "data/file_index",
        "meta/episodes/chunk_index",
        "meta/episodes/file_index",
    ];
    let mut fields: Vec<Field> =
        NUMBERS.map(|name| Field::new(name, DataType::Int64, false)).into();
    let element = Arc::new(Field::new_list_field(DataType::Utf8, true));
    fields.push(Field::new("tasks", DataType::List(element), false));
    let schema = Arc::new(Schema::new(fields));
    let mut writer = writer(path, &schema)?;
    let samples = i64::from(description.samples);
    for shard in &description.shards {
        let (chunk, file) = place(shard.shard);
        let mut first = shard.first;
        let end = shard.first + shard.trajectories;
        while first < end {
            let last = end.min(first + EPISODES_AT_ONCE);
            let episodes: Vec<i64> = (first..last).map(u64::cast_signed).collect();
            let constant = |value: i64| vec![value; episodes.len()];
            let times = |by: i64| episodes.iter().map(|episode| (episode + by) * samples).collect();
            let numbers: [Vec<i64>; 8] = [
                episodes.clone(),
                constant(samples),
                times(0),
                times(1),
                constant(chunk.into()),
                constant(file.into()),
                constant(0),
                constant(0),
            ];
            let mut columns: Vec<ArrayRef> =
                numbers.map(|numbers| Arc::new(Int64Array::from(numbers)) as ArrayRef).into();
            let mut tasks = ListBuilder::new(StringBuilder::new());
            for _ in &episodes {
                tasks.values().append_value(task);
                tasks.append(true);
            }
            columns.push(Arc::new(tasks.finish()));
            writer.write(&RecordBatch::try_new(Arc::clone(&schema), columns)?)?;
            first = last;
        }
    }
    writer.close()?;
    Ok(())
}

fn writer(path: &Path, schema: &Arc<Schema>) -> anyhow::Result<ArrowWriter<File>> {
    let file = File::create(path).with_context(|| format!("cannot write {}", path.display()))?;
    Ok(ArrowWriter::try_new(file, Arc::clone(schema), None)?)
}
