//! Prints how fast a shard's trajectories are read and written, as one line of JSON.
//!
//! `cargo run --release -p store --example parquet_rates -- trajectories-00000.parquet`
//!
//! It uses one thread, and reports the best of three times. The time of writing includes the digest
//! and the sync to disk.

use std::path::Path;
use std::time::Instant;

use arrow_array::cast::AsArray;
use arrow_array::types::Int32Type;
use arrow_array::{Array, RecordBatch};
use mimalloc::MiMalloc;
use serde_json::json;
use store::{ObjectWriter, STEP, StoreError, TableReader, TableWriter};

/// The allocator that the product uses.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

const REPETITIONS: u32 = 3;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let file = std::env::args().nth(1).ok_or("which file?")?;
    let file = Path::new(&file);
    let batches = read(file)?;
    let samples = samples(&batches)?;
    let folder = tempfile::tempdir_in(file.parent().ok_or("the file lies in no folder")?)?;
    let written = folder.path().join("trajectories.parquet");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;

    let write_s = best(|| pool.install(|| write(&batches, samples, &written)))?;
    let read_s = best(|| read(&written))?;
    if read(&written)? != batches {
        return Err("the rows that were read differ from those that were written".into());
    }
    let mut raw_bytes = 0;
    for column in batches.iter().flat_map(RecordBatch::columns) {
        raw_bytes += column.to_data().get_slice_memory_size()?;
    }
    let file_bytes = written.metadata()?.len();
    let rates = json!({
        "raw_bytes": raw_bytes, "file_bytes": file_bytes, "write_s": write_s, "read_s": read_s,
    });
    println!("{rates}");
    Ok(())
}

/// The shortest duration of three runs of `action`, in seconds. Dropping the result is not timed.
fn best<T>(mut action: impl FnMut() -> Result<T, StoreError>) -> Result<f64, StoreError> {
    let mut best = f64::INFINITY;
    for _ in 0..REPETITIONS {
        let start = Instant::now();
        let _result = action()?;
        best = best.min(start.elapsed().as_secs_f64());
    }
    Ok(best)
}

fn read(file: &Path) -> Result<Vec<RecordBatch>, StoreError> {
    let reader = TableReader::open(file)?;
    let columns = reader.columns();
    (0..reader.row_groups().count()).map(|group| reader.read_row_group(group, &columns)).collect()
}

fn write(batches: &[RecordBatch], samples: u32, file: &Path) -> Result<(), StoreError> {
    let (Some(folder), Some(name)) = (file.parent(), file.file_name()) else {
        unreachable!("the file lies in a folder");
    };
    let object = ObjectWriter::in_folder(folder, &name.to_string_lossy())?;
    let footer = std::collections::BTreeMap::new();
    let mut writer = TableWriter::trajectories(object, batches[0].schema(), samples, &footer)?;
    for batch in batches {
        writer.write(batch.clone())?;
    }
    writer.finish()?;
    Ok(())
}

/// The number of samples of each trajectory.
fn samples(batches: &[RecordBatch]) -> Result<u32, Box<dyn std::error::Error>> {
    let first = batches.first().ok_or("the file has no rows")?;
    let steps = first.column_by_name(STEP).ok_or("the file has no column step")?;
    let steps = steps.as_primitive_opt::<Int32Type>().ok_or("step is not an int32")?;
    let last = steps.values().iter().max().ok_or("the file has no rows")?;
    Ok(u32::try_from(last + 1)?)
}
