//! Verifies one shard of a simulation by making it again.

use std::panic::{AssertUnwindSafe, catch_unwind};

use arrow_array::RecordBatch;
use dynamics::Trajectories;
use store::{FileContent, ObjectWriter, ShardContents, ShardReader, StoredObject, TableReader};

use super::difference::{Difference, Tolerance, first_difference};
use super::place::FileLocation;
use crate::error::TaskError;
use crate::simulate::{ProgressCallback, SimulatedShard, VERSION, VERSION_KEY};

/// How a stored shard agrees with the one made again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Agreement {
    /// Every byte is equal.
    Bytes,
    /// Every value is equal within the tolerance for another version.
    Values {
        /// The version of torqued that wrote the file.
        version: String,
        tolerance: String,
    },
}

/// How much values of another version may differ. It may round differently, and a motion of
/// hundreds of samples multiplies the difference. Parameters are drawn and not integrated, so their
/// tolerance is smaller.
const fn tolerance_between_versions(content: FileContent) -> Tolerance {
    match content {
        FileContent::Trajectories => Tolerance { absolute: 1e-4, relative: 1e-5 },
        FileContent::Robots => Tolerance { absolute: 0.0, relative: 1e-9 },
    }
}

/// Makes a shard again. Compares both files with the files in `place`, and with their `recorded`
/// sizes and digests.
///
/// # Errors
/// [`TaskError::Differs`] names the first difference. [`TaskError::Stopped`] when `progress`
/// breaks.
pub(crate) fn verify(
    shard: &SimulatedShard<'_>,
    recorded: &ShardContents,
    place: FileLocation<'_>,
    progress: ProgressCallback<'_>,
) -> Result<Agreement, TaskError> {
    let files = recorded.files();
    // A missing or damaged file is reported before the shard is made again.
    let mut stored = Vec::new();
    for (content, recorded) in files {
        stored.push((content, recorded, measure(place, recorded)?));
    }
    let sinks = files.map(|(_, recorded)| ObjectWriter::digest_only(&recorded.path));
    let [trajectories, robots] = sinks;
    let made = shard.write(trajectories, robots, progress)?.shard;
    let mut agreement = Agreement::Bytes;
    for (content, recorded, stored) in stored {
        let made = made.file(content);
        if stored.sha256 == recorded.sha256 && stored.sha256 == made.sha256 {
            continue;
        }
        let file = File { shard, content, recorded, stored: &stored, place, progress };
        let of_file = file.explain(made)?;
        // Trajectories come first, and have the larger tolerance.
        if agreement == Agreement::Bytes {
            agreement = of_file;
        }
    }
    Ok(agreement)
}

pub(super) fn measure(
    place: FileLocation<'_>,
    recorded: &StoredObject,
) -> Result<StoredObject, TaskError> {
    place.measure(&recorded.path).map_err(|error| {
        if error.is_missing_file() {
            TaskError::Differs(format!("{} is missing", recorded.path))
        } else {
            error.into()
        }
    })
}

/// A file whose bytes differ from the expected ones.
struct File<'a> {
    shard: &'a SimulatedShard<'a>,
    content: FileContent,
    recorded: &'a StoredObject,
    stored: &'a StoredObject,
    place: FileLocation<'a>,
    progress: ProgressCallback<'a>,
}

impl File<'_> {
    /// Compares the values of a file that another version wrote. Everything else is an error that
    /// says what is wrong.
    fn explain(&self, made: &StoredObject) -> Result<Agreement, TaskError> {
        let path = &self.recorded.path;
        if self.stored.sha256 != self.recorded.sha256 {
            let what = match self.first_difference(Tolerance::NONE)? {
                Ok(None) => "its values are those of the simulation".to_owned(),
                Ok(Some(difference)) => difference,
                Err(unreadable) => unreadable,
            };
            return Err(TaskError::Differs(format!(
                "checksum mismatch of {path}: {} bytes with SHA-256 {} instead of {} bytes with \
                 {}: {what}",
                self.stored.size,
                self.stored.sha256.short(),
                self.recorded.size,
                self.recorded.sha256.short(),
            )));
        }
        let version = self.version();
        if version.as_deref() == Some(VERSION) {
            let what = match self.first_difference(Tolerance::NONE)? {
                Ok(None) => format!("all values agree, but not the bytes: SHA-256 {}", made.sha256),
                Ok(Some(difference)) => difference,
                Err(unreadable) => unreadable,
            };
            return Err(TaskError::Differs(format!(
                "{path} differs when it is made again: {what}"
            )));
        }
        let version = version.unwrap_or_else(|| "unknown".to_owned());
        let tolerance = tolerance_between_versions(self.content);
        match self.first_difference(tolerance)? {
            Ok(None) => Ok(Agreement::Values { version, tolerance: tolerance.to_string() }),
            Ok(Some(what)) | Err(what) => Err(TaskError::Differs(format!(
                "{path}, written by version {version}, differs by more than {tolerance}: {what}"
            ))),
        }
    }

    fn version(&self) -> Option<String> {
        let table = self.decode(|| Ok(self.place.open(self.stored)?)).ok()?;
        table.footer(VERSION_KEY).map(str::to_owned)
    }

    /// Describes the first difference. The inner error says why the file cannot be read.
    fn first_difference(
        &self,
        tolerance: Tolerance,
    ) -> Result<Result<Option<String>, String>, TaskError> {
        let reader = match self.decode(|| self.open()) {
            Ok(reader) => reader,
            Err(unreadable) => return Ok(Err(unreadable)),
        };
        let columns: Vec<&str> =
            self.schema().fields().iter().map(|field| field.name().as_str()).collect();
        let mut simulated = Trajectories::default();
        for part in self.shard.parts() {
            self.shard.simulate(part.clone(), self.progress, &mut simulated)?;
            let made = match self.content {
                FileContent::Trajectories => self.shard.trajectory_rows(&simulated)?,
                FileContent::Robots => self.shard.robot_rows(&simulated)?,
            };
            let read = self.decode(|| Ok(reader.read_trajectories(part.clone(), &columns)?));
            let stored = match read.and_then(|stored| self.same_shape(stored, &made)) {
                Ok(stored) => stored,
                Err(unreadable) => return Ok(Err(unreadable)),
            };
            if let Some(difference) = first_difference(&stored, &made, tolerance) {
                return Ok(Ok(Some(self.in_words(&difference, part.start))));
            }
        }
        Ok(Ok(None))
    }

    fn open(&self) -> Result<ShardReader, TaskError> {
        let table = self.place.open(self.stored)?;
        self.check_claims(&table)?;
        Ok(ShardReader::new(table, self.shard.trajectories())?)
    }

    /// Checks the sizes that the footer claims, because memory is reserved for them.
    fn check_claims(&self, table: &TableReader) -> Result<(), TaskError> {
        let trajectories = self.shard.trajectories();
        let expected =
            self.content.rows(trajectories.end - trajectories.start, self.shard.samples());
        if table.rows() != expected || table.row_groups().any(|rows| rows > expected) {
            let rows = table.rows();
            return Err(TaskError::Differs(format!("it has {rows} rows instead of {expected}")));
        }
        let names: Vec<&str> =
            self.schema().fields().iter().map(|field| field.name().as_str()).collect();
        let differing = |name: &&&str| !table.columns().contains(name);
        if let Some(missing) = names.iter().find(differing) {
            return Err(TaskError::Differs(format!("it has no column {missing}")));
        }
        Ok(())
    }

    fn same_shape(&self, stored: RecordBatch, made: &RecordBatch) -> Result<RecordBatch, String> {
        if stored.num_rows() != made.num_rows() {
            return Err("its row groups do not hold whole trajectories".to_owned());
        }
        for (stored, made) in stored.schema_ref().fields().iter().zip(made.schema_ref().fields()) {
            if stored.data_type() != made.data_type() {
                let (name, found) = (stored.name(), stored.data_type());
                return Err(format!("its column {name} is {found}, not {}", made.data_type()));
            }
        }
        Ok(stored)
    }

    fn schema(&self) -> &arrow_schema::SchemaRef {
        match self.content {
            FileContent::Trajectories => self.shard.trajectory_schema(),
            FileContent::Robots => self.shard.robot_schema(),
        }
    }

    /// Runs code that may panic on damaged pages, and turns a panic into an error.
    fn decode<T>(&self, read: impl FnOnce() -> Result<T, TaskError>) -> Result<T, String> {
        match catch_unwind(AssertUnwindSafe(read)) {
            Ok(Ok(read)) => Ok(read),
            Ok(Err(TaskError::Differs(what))) => Err(what),
            Ok(Err(error)) => Err(format!("it cannot be read: {}", spec::causes(&error))),
            Err(_) => Err("it cannot be read: a page is damaged".to_owned()),
        }
    }

    fn in_words(&self, difference: &Difference, first: u64) -> String {
        let Difference { row, column, stored, made } = difference;
        let rows = match self.content {
            FileContent::Trajectories => self.shard.samples() as usize,
            FileContent::Robots => 1,
        };
        let trajectory = first + (row / rows) as u64;
        let step = match self.content {
            FileContent::Trajectories => format!(", step {}", row % rows),
            FileContent::Robots => String::new(),
        };
        format!("trajectory {trajectory}, column {column}{step}: {stored} instead of {made}")
    }
}
