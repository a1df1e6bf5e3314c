//! Checks of a store: its folder, its database, and the files that rows name.

use std::os::unix::fs::MetadataExt as _;
use std::path::Path;
use std::time::SystemTime;

use nix::errno::Errno;
use nix::unistd::{AccessFlags, access};
use store::{Access, Location, ObjectPlace, Store, StoreError, StoredObject};

use super::Findings;
use crate::exit::message;
use crate::progress::measure;

/// Number of files that are listed by name. The others are counted.
const NAMED: usize = 20;

/// The allowed difference between a store's clock and this machine's.
const CLOCKS_MS: u64 = 5_000;

/// Checks the folder, then the database, then every file that rows name.
pub async fn look(location: &Location, bytes: bool, report: &mut Findings) -> anyhow::Result<()> {
    let is_there = folder(&location.folder, report)?;
    if !is_there && location.database.is_none() {
        return Ok(());
    }
    let store = match Store::open_at(location, Access::Worker).await {
        Ok(store) => store,
        Err(error @ (StoreError::FilesLost { .. } | StoreError::ForeignObjects { .. })) => {
            let found = message(&error.into());
            return report.wrong("files", found, "no server and no worker starts until then");
        }
        Err(error) => {
            let found = message(&error.into());
            return report.wrong("database", found, "see docs/queue.md and docs/scale.md");
        }
    };
    space(&store, report)?;
    database(&store, location, report).await?;
    objects(&store, bytes, report).await?;
    store.close().await;
    Ok(())
}

/// Whether the folder exists.
fn folder(folder: &Path, report: &mut Findings) -> anyhow::Result<bool> {
    let name = folder.display();
    let metadata = match std::fs::metadata(folder) {
        Ok(metadata) => metadata,
        Err(error) => {
            let remedy = "torqued serve creates it; --data names another";
            report.note("data folder", format!("{name}: {error}"), remedy)?;
            return Ok(false);
        }
    };
    let needed = AccessFlags::R_OK | AccessFlags::W_OK | AccessFlags::X_OK;
    if access(folder, AccessFlags::W_OK) == Err(Errno::EROFS) {
        let found = format!("{name} lies on a file system that is mounted read-only");
        let remedy =
            "torqued backup can read it; for a server, remount it with mount -o remount,rw";
        report.note("data folder", found, remedy)?;
        return Ok(true);
    }
    if access(folder, needed).is_err() {
        let found = format!("{name} belongs to user {} and may not be written", metadata.uid());
        let remedy = "run this as that user, or give it to this one with chown -R";
        report.wrong("data folder", found, remedy)?;
        return Ok(true);
    }
    let mode = metadata.mode() & 0o777;
    if mode & 0o007 == 0 {
        report.good("data folder", format!("{name}, mode {mode:o}"))?;
    } else {
        let found =
            format!("{name} has mode {mode:o}: every user of this machine may look into it");
        report.note("data folder", found, "chmod o= closes it")?;
    }
    Ok(true)
}

fn space(store: &Store, report: &mut Findings) -> anyhow::Result<()> {
    let space = store.disk_space()?;
    let [free, kept] = [space.free_bytes, space.reserved_bytes].map(measure::size);
    if space.is_low() {
        let found = format!("{free} free, but tasks only begin with {kept} or more");
        return report.wrong("disk", found, "delete something else on it, or move the data folder");
    }
    report.good("disk", format!("{free} free"))
}

async fn database(store: &Store, location: &Location, report: &mut Findings) -> anyhow::Result<()> {
    let version = store.schema_version();
    match store.database_damage().await {
        Ok(None) => report.good("database", format!("{location}, schema {version}, sound"))?,
        Ok(Some(damage)) => {
            let remedy = "stop the server and restore the newest backup";
            report.wrong("database", format!("damaged: {damage}"), remedy)?;
        }
        Err(error) => {
            report.wrong("database", message(&error.into()), "its log has the details")?
        }
    }
    let own = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH)?.as_millis();
    let there = store.now().await?.milliseconds();
    let apart = u64::try_from(own)?.abs_diff(there.unsigned_abs());
    if apart > CLOCKS_MS {
        let found = format!("the database's clock is {} s away from this one", apart / 1000);
        report.note("clock", found, "set both with NTP; leases go by the database's")?;
    }
    Ok(())
}

async fn objects(store: &Store, bytes: bool, report: &mut Findings) -> anyhow::Result<()> {
    let mut place = ObjectPlace::default();
    let (mut count, mut size, mut bad) = (0_u64, 0_u64, 0_usize);
    loop {
        let page = store.next_objects(&mut place).await?;
        if page.is_empty() {
            break;
        }
        for object in page {
            count += 1;
            size += object.size;
            let Some(problem) = problem(store, &object, bytes).await else { continue };
            bad += 1;
            if bad <= NAMED {
                let remedy =
                    "make it again with torqued submit --force, or restore it from a backup";
                report.wrong("file", problem, remedy)?;
            }
        }
    }
    if bad > NAMED {
        let found = format!("and {} more are missing or damaged", bad - NAMED);
        report.wrong("file", found, "restore the newest backup")?;
    }
    let looked = if bytes { "every digest compared" } else { "--bytes compares their digests" };
    let [count, size] = [measure::count(count), measure::size(size)];
    if bad == 0 {
        report.good("files", format!("{count} of {size} are there; {looked}"))?;
    }
    Ok(())
}

async fn problem(store: &Store, object: &StoredObject, bytes: bool) -> Option<String> {
    let looked =
        if bytes { store.check_object(object).await } else { store.look_up_object(object).await };
    let error = looked.err()?;
    let is_missing = error.is_missing_file();
    Some(if is_missing { format!("{} is missing", object.path) } else { message(&error.into()) })
}
