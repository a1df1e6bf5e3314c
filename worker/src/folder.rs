//! Datasets in folders, which are made and verified without a server.
//!
//! The folder has `dataset.json` and two files for each shard. They have the same bytes as a
//! server's dataset of the same spec. `dataset.json` is replaced after each shard. It names the
//! shards that are there; files that it does not name do not count.

use std::fs::{File, TryLockError};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use spec::{DataSpec, Digest, JobSpec, SimulateSpec};
use store::{
    DatasetDescription, FileContent, FileDescription, ObjectWriter, ShardContents,
    ShardDescription, StoreError, StoredObject,
};
use thiserror::Error;

use crate::error::TaskError;
use crate::simulate::{ProgressCallback, SimulatedShard};
use crate::verify::{Agreement, FileLocation, verify};

/// Why a folder cannot be made or verified.
#[derive(Debug, Error)]
#[expect(missing_docs, reason = "messages say what variants and their fields mean")]
pub enum FolderError {
    #[error("{} cannot be used while {operation}", dir.display())]
    Folder { dir: PathBuf, operation: &'static str, source: io::Error },
    #[error("{} is in use by another torqued", dir.display())]
    InUse { dir: PathBuf },
    #[error("{} has files but no dataset.json: choose an empty folder", dir.display())]
    NotEmpty { dir: PathBuf },
    #[error("{} is not the folder of a dataset: it has no dataset.json", dir.display())]
    NoDataset { dir: PathBuf },
    #[error("{} has a dataset.json that this version cannot read: {detail}", dir.display())]
    Unreadable { dir: PathBuf, detail: String },
    #[error(
        "{} has a dataset with digest {}, but the spec has digest {}: choose another folder",
        dir.display(), found.short(), asked.short()
    )]
    AnotherDataset { dir: PathBuf, found: Digest, asked: Digest },
    #[error(
        "{} is not complete: it has {found} of {all} shards; simulate into it again to complete it",
        dir.display()
    )]
    Incomplete { dir: PathBuf, found: usize, all: u64 },
    #[error("stopped; finished shards are kept, and the same command continues")]
    Stopped,
    #[error("shard {shard:05}: {reason}")]
    Shard { shard: u32, reason: String },
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// A folder with a dataset, or a part of one. Only one process uses it at a time.
#[derive(Debug)]
pub struct DatasetFolder {
    dir: PathBuf,
    spec: SimulateSpec,
    description: DatasetDescription,
    /// The lock, held as long as this lives.
    _lock: File,
}

/// The result of verifying a dataset in a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Verified {
    /// Number of shards, all of which were made again.
    pub shards: usize,
    /// Number of trajectories in them.
    pub trajectories: u64,
    /// Files written by another version, with different bytes but equal values. Each entry is a
    /// description.
    pub by_other_versions: Vec<String>,
}

impl DatasetFolder {
    /// Opens or begins the folder for the dataset of `spec`. The folder is new, empty, or has a
    /// part of that dataset.
    ///
    /// # Errors
    /// When it holds something else, cannot be written, or is in use.
    pub fn begin(dir: &Path, spec: &SimulateSpec) -> Result<Self, FolderError> {
        std::fs::create_dir_all(dir).map_err(failed(dir, "creating it"))?;
        let lock = lock(dir)?;
        let data = DataSpec::Simulation(spec.clone());
        let digest = data.job().digest();
        let description = match read_description(dir)? {
            Some(found) if found.digest != digest => {
                let (dir, found) = (dir.to_owned(), found.digest);
                return Err(FolderError::AnotherDataset { dir, found, asked: digest });
            }
            Some(found) => found,
            None => {
                refuse_other_files(dir)?;
                jobs::describe_dataset(&data, digest, Vec::new())
            }
        };
        let spec = spec.clone();
        let mut folder = Self { dir: dir.to_owned(), spec, description, _lock: lock };
        folder.write_description()?;
        Ok(folder)
    }

    /// Opens a folder with a complete dataset.
    ///
    /// # Errors
    /// When it has no dataset, has only a part of one, or is in use.
    pub fn open(dir: &Path) -> Result<Self, FolderError> {
        let missing = || FolderError::NoDataset { dir: dir.to_owned() };
        if !dir.join(DatasetDescription::FILE_NAME).is_file() {
            return Err(missing());
        }
        let lock = lock(dir)?;
        let description = read_description(dir)?.ok_or_else(missing)?;
        let unreadable = |detail: String| FolderError::Unreadable { dir: dir.to_owned(), detail };
        // The spec is read like any other, because anybody may have written it.
        let text = description.spec.to_string();
        let spec =
            match spec::parse(text.as_bytes()).map_err(|error| unreadable(error.to_string()))? {
                JobSpec::Simulate(spec) => spec,
                other => {
                    let detail = format!(
                        "it is made by a job of kind {}, which cannot be repeated",
                        other.kind()
                    );
                    return Err(unreadable(detail));
                }
            };
        let digest = DataSpec::Simulation(spec.clone()).job().digest();
        if digest != description.digest {
            let (dir, found) = (dir.to_owned(), description.digest);
            return Err(FolderError::AnotherDataset { dir, found, asked: digest });
        }
        let (found, all) = (description.shards.len(), spec.shard_count());
        if found as u64 != all {
            return Err(FolderError::Incomplete { dir: dir.to_owned(), found, all });
        }
        Ok(Self { dir: dir.to_owned(), spec, description, _lock: lock })
    }

    /// The simulation that makes the dataset.
    pub fn spec(&self) -> &SimulateSpec {
        &self.spec
    }

    /// The content of `dataset.json`: the finished shards and their files.
    pub fn description(&self) -> &DatasetDescription {
        &self.description
    }

    /// Makes the shards that are missing, or whose bytes differ from `dataset.json`. It uses the
    /// threads of the current rayon pool, and reports the number of finished trajectories to
    /// `progress`.
    ///
    /// # Errors
    /// [`FolderError::Stopped`] when `progress` breaks. Finished shards stay.
    pub fn complete(&mut self, progress: ProgressCallback<'_>) -> Result<(), FolderError> {
        let mut kept: u64 = 0;
        let found = std::mem::take(&mut self.description.shards);
        for shard in found {
            if progress(kept).is_break() {
                return Err(FolderError::Stopped);
            }
            if self.is_intact(&shard) {
                kept += shard.trajectories;
                self.description.shards.push(shard);
            }
        }
        let shards = u32::try_from(self.spec.shard_count()).unwrap_or(u32::MAX);
        for ordinal in 0..shards {
            if self.description.shards.iter().any(|shard| shard.shard == ordinal) {
                continue;
            }
            let made = self.make(ordinal, &|done| progress(kept + done))?;
            kept += made.count;
            let description = ShardDescription::new(ordinal, &made, self.spec.samples);
            self.description.shards.push(description);
            self.write_description()?;
        }
        self.write_description()
    }

    fn make(
        &self,
        ordinal: u32,
        progress: ProgressCallback<'_>,
    ) -> Result<ShardContents, FolderError> {
        let begin =
            |content: FileContent| ObjectWriter::in_folder(&self.dir, &content.file_name(ordinal));
        let (trajectories, robots) =
            (begin(FileContent::Trajectories)?, begin(FileContent::Robots)?);
        let shard = SimulatedShard::new(&self.spec, self.description.digest, ordinal);
        let written = shard.write(trajectories, robots, progress).map_err(of_shard(ordinal))?;
        Ok(written.shard)
    }

    /// Whether a shard belongs to this dataset and its files have their original bytes.
    fn is_intact(&self, shard: &ShardDescription) -> bool {
        let expected = self.spec.shard(u64::from(shard.shard));
        let same = expected == (shard.first..shard.first + shard.trajectories);
        same && FileContent::ALL.into_iter().all(|content| {
            shard.file(content).is_some_and(|file| {
                file.name == content.file_name(shard.shard)
                    && store::measure_file(&self.dir, &file.name)
                        .is_ok_and(|found| found == object(file))
            })
        })
    }

    /// Makes every shard again and compares it with its files.
    ///
    /// # Errors
    /// The first difference found. [`FolderError::Stopped`] when `progress` breaks.
    pub fn verify(&self, progress: ProgressCallback<'_>) -> Result<Verified, FolderError> {
        let mut verified = Verified {
            shards: self.description.shards.len(),
            trajectories: self.description.trajectories,
            by_other_versions: Vec::new(),
        };
        let mut done_before = 0;
        for (ordinal, shard) in (0u32..).zip(&self.description.shards) {
            let recorded = self.recorded(ordinal, shard)?;
            let simulated = SimulatedShard::new(&self.spec, self.description.digest, ordinal);
            let progress = |done: u64| progress(done_before + done);
            let agreement =
                verify(&simulated, &recorded, FileLocation::Folder(&self.dir), &progress)
                    .map_err(of_shard(ordinal))?;
            if let Agreement::Values { version, tolerance } = agreement {
                verified.by_other_versions.push(format!(
                    "shard {ordinal:05} was written by version {version}: other bytes, the same \
                     values within {tolerance}"
                ));
            }
            done_before += shard.trajectories;
        }
        Ok(verified)
    }

    /// The entry of a shard in `dataset.json`, if it is plausible.
    fn recorded(
        &self,
        ordinal: u32,
        shard: &ShardDescription,
    ) -> Result<ShardContents, FolderError> {
        let unreadable = |detail: String| FolderError::Unreadable { dir: self.dir.clone(), detail };
        let expected = self.spec.shard(u64::from(ordinal));
        let count = expected.end - expected.start;
        if (shard.shard, shard.first, shard.trajectories) != (ordinal, expected.start, count) {
            let detail = format!("its shard {ordinal} does not hold the trajectories of the spec");
            return Err(unreadable(detail));
        }
        let file = |content: FileContent| {
            let named = shard.file(content).filter(|file| file.name == content.file_name(ordinal));
            named.map(object).ok_or_else(|| {
                unreadable(format!("its shard {ordinal} has no {}", content.file_name(ordinal)))
            })
        };
        Ok(ShardContents {
            first: shard.first,
            count,
            rejected: shard.rejected,
            trajectories: file(FileContent::Trajectories)?,
            robots: file(FileContent::Robots)?,
        })
    }

    /// Writes `dataset.json` for the shards that are there now.
    fn write_description(&mut self) -> Result<(), FolderError> {
        let data = DataSpec::Simulation(self.spec.clone());
        let mut shards = std::mem::take(&mut self.description.shards);
        shards.sort_by_key(|shard| shard.shard);
        self.description = jobs::describe_dataset(&data, self.description.digest, shards);
        let mut file = ObjectWriter::in_folder(&self.dir, DatasetDescription::FILE_NAME)?;
        file.write_all(&self.description.to_json())
            .map_err(failed(&self.dir, "writing dataset.json"))?;
        file.finish()?;
        Ok(())
    }
}

fn object(file: &FileDescription) -> StoredObject {
    StoredObject { path: file.name.clone(), size: file.size, sha256: file.sha256 }
}

fn of_shard(shard: u32) -> impl FnOnce(TaskError) -> FolderError {
    move |error| match error {
        TaskError::Stopped => FolderError::Stopped,
        other => FolderError::Shard { shard, reason: spec::causes(&other) },
    }
}

fn failed(dir: &Path, operation: &'static str) -> impl FnOnce(io::Error) -> FolderError {
    let dir = dir.to_owned();
    move |source| FolderError::Folder { dir, operation, source }
}

/// Locks the folder itself, so that no lock file is left behind.
fn lock(dir: &Path) -> Result<File, FolderError> {
    let handle = File::open(dir).map_err(failed(dir, "opening it"))?;
    match handle.try_lock() {
        Ok(()) => Ok(handle),
        Err(TryLockError::WouldBlock) => Err(FolderError::InUse { dir: dir.to_owned() }),
        Err(TryLockError::Error(source)) => Err(failed(dir, "locking it")(source)),
    }
}

fn read_description(dir: &Path) -> Result<Option<DatasetDescription>, FolderError> {
    let text = match std::fs::read(dir.join(DatasetDescription::FILE_NAME)) {
        Ok(text) => text,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(failed(dir, "reading dataset.json")(error)),
    };
    let unreadable = |error: serde_json::Error| {
        let detail = error.to_string();
        FolderError::Unreadable { dir: dir.to_owned(), detail }
    };
    serde_json::from_slice(&text).map(Some).map_err(unreadable)
}

/// Refuses a folder with other files. Hidden files are ignored: a killed attempt left them, or they
/// are not ours.
fn refuse_other_files(dir: &Path) -> Result<(), FolderError> {
    for entry in std::fs::read_dir(dir).map_err(failed(dir, "listing it"))? {
        let entry = entry.map_err(failed(dir, "listing it"))?;
        if !entry.file_name().to_string_lossy().starts_with('.') {
            return Err(FolderError::NotEmpty { dir: dir.to_owned() });
        }
    }
    Ok(())
}
