//! Waiting for a task: processes that share a data folder watch a file, which whoever queues tasks closes.

use std::fs::File;
use std::io::Read;
use std::os::fd::OwnedFd;
use std::path::Path;
use std::time::Duration;

use nix::sys::inotify::{AddWatchFlags, InitFlags, Inotify};
use tokio::io::unix::AsyncFd;

use super::Database;

/// Between two looks where the system watches no more files: by default a user may have 128 watched.
const LOOK_EVERY: Duration = Duration::from_millis(100);

#[derive(Debug)]
pub(crate) struct Bell(Option<AsyncFd<File>>);

impl Database {
    pub fn bell(&self) -> Bell {
        Bell(
            watch(&self.bell)
                .inspect_err(|error| tracing::debug!(%error, "no file is watched"))
                .ok(),
        )
    }
}

fn watch(path: &Path) -> std::io::Result<AsyncFd<File>> {
    // It must be there to be watched.
    ring(path)?;
    let inotify = Inotify::init(InitFlags::IN_NONBLOCK | InitFlags::IN_CLOEXEC)?;
    inotify.add_watch(path, AddWatchFlags::IN_CLOSE_WRITE)?;
    // SAFETY: a file has the same descriptor from its beginning to its end, and closes it then.
    let watched = unsafe { AsyncFd::register(File::from(OwnedFd::from(inotify))) };
    Ok(watched?)
}

/// Wakes who watches. Nothing is written: that the file is closed is enough.
fn ring(path: &Path) -> std::io::Result<()> {
    File::options().append(true).create(true).open(path).map(|_| ())
}

/// Rings after a commit. Who does not hear it looks soon by itself.
pub(super) fn ring_after_commit(path: &Path) {
    if let Err(error) = ring(path) {
        tracing::debug!(%error, "cannot tell workers that tasks were queued");
    }
}

impl Bell {
    /// Returns when tasks were queued, or after `longest`, and which of both it is.
    pub async fn wait(&mut self, longest: Duration) -> bool {
        let Some(watched) = &self.0 else {
            tokio::time::sleep(longest.min(LOOK_EVERY)).await;
            return false;
        };
        let Ok(Ok(mut ready)) = tokio::time::timeout(longest, watched.readable()).await else {
            return false;
        };
        let mut events = [0; 1024];
        while (&mut watched.get_ref()).read(&mut events).is_ok_and(|count| count > 0) {}
        ready.clear_ready();
        true
    }
}
