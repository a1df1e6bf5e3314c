//! Measures bytes per second into and out of a store, for `cargo xtask bench objects`: with objects
//! in a folder, and in a bucket of an S3 server in this process.
//!
//! `object_rates FOLDER OBJECTS MEGABYTES` writes OBJECTS objects of this size to each, and reads
//! them again. It prints a JSON object with the megabytes per second of each.

#[expect(dead_code, clippy::unwrap_used, reason = "it fails and dies for tests")]
#[path = "../../tests/s3_server/mod.rs"]
mod s3_server;

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use bytes::Bytes;
use futures::TryStreamExt;
use s3_server::S3Server;
use serde_json::{Value, json};
use store::{Access, Location, Store, StoredObject};

type Outcome<T> = Result<T, Box<dyn std::error::Error + Send + Sync>>;

/// Bytes of one write.
const PIECE: usize = 1 << 20;

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, objects, megabytes] = &arguments[..] else {
        return Err("usage: object_rates FOLDER OBJECTS MEGABYTES".into());
    };
    let folder = PathBuf::from(folder);
    let (objects, megabytes) = (objects.parse()?, megabytes.parse()?);
    let server = S3Server::start();
    let rates = tokio::runtime::Runtime::new()?.block_on(async {
        Outcome::Ok(json!({
            "folder": rates(&folder.join("folder"), None, objects, megabytes).await?,
            "bucket": rates(&folder.join("bucket"), Some(&server), objects, megabytes).await?,
        }))
    })?;
    println!("{rates}");
    Ok(())
}

async fn rates(
    folder: &Path,
    server: Option<&S3Server>,
    objects: usize,
    megabytes: usize,
) -> Outcome<Value> {
    fs::create_dir_all(folder)?;
    let location = Location::in_folder(folder);
    let store = match server {
        None => Store::open_at(&location, Access::Server).await?,
        Some(server) => {
            let bucket = server.objects("arm").await;
            Store::open_with_objects(&location, Access::Server, bucket).await?
        }
    };
    let total = objects * megabytes;
    let began = Instant::now();
    let mut written = Vec::new();
    for number in 0..objects {
        written.push(write(&store, number, megabytes).await?);
    }
    let write = rate(total, began);

    forget_copies(folder)?;
    let began = Instant::now();
    for object in &written {
        let mut stream = store.open_object(object, None).await?.stream;
        while stream.try_next().await?.is_some() {}
    }
    let download = rate(total, began);

    let mut open = Vec::new();
    for _ in ["first", "again"] {
        let began = Instant::now();
        for object in &written {
            store.read_object(object).await?;
        }
        open.push(rate(total, began));
    }
    store.close().await;
    Ok(json!({"write": write, "download": download, "read": open[0], "read_again": open[1]}))
}

/// Writes an object like a task: into a file, which is then published.
async fn write(store: &Store, number: usize, megabytes: usize) -> Outcome<StoredObject> {
    let mut writer = store.write_object(&format!("objects/{number}.parquet")).await?;
    let written = tokio::task::spawn_blocking(move || {
        let piece = piece(number);
        for _ in 0..megabytes {
            writer.write_all(&piece)?;
        }
        Outcome::Ok(writer.finish()?)
    });
    written.await?
}

/// Bytes that differ for every object.
fn piece(number: usize) -> Bytes {
    (0..PIECE).map(|index| u8::try_from((index ^ number) % 251).unwrap_or_default()).collect()
}

/// Deletes the local copies, so that the next reader fetches the objects again.
fn forget_copies(folder: &Path) -> Outcome<()> {
    let copies = folder.join("cache");
    if copies.exists() {
        for copy in fs::read_dir(copies)? {
            fs::remove_file(copy?.path())?;
        }
    }
    Ok(())
}

/// Megabytes (2^20 bytes) per second.
#[expect(clippy::cast_precision_loss, reason = "far fewer megabytes than 2^52")]
fn rate(megabytes: usize, began: Instant) -> f64 {
    megabytes as f64 / began.elapsed().as_secs_f64()
}
