//! Waiting for a task. Processes that share a data folder watch a file, and a process that queues
//! tasks closes it.

use std::fs::File;
use std::io::Read;
use std::os::fd::OwnedFd;
use std::path::Path;
use std::time::Duration;

use nix::sys::inotify::{AddWatchFlags, InitFlags, Inotify};
use tokio::io::unix::AsyncFd;

use super::Database;

/// Pause between two looks if the system watches no more files. By default a user may watch 128.
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
    // The file must exist to be watched.
    ring(path)?;
    let inotify = Inotify::init(InitFlags::IN_NONBLOCK | InitFlags::IN_CLOEXEC)?;
    inotify.add_watch(path, AddWatchFlags::IN_CLOSE_WRITE)?;
    // SAFETY: a file has the same descriptor from its beginning to its end, and closes it then.
    let watched = unsafe { AsyncFd::register(File::from(OwnedFd::from(inotify))) };
    Ok(watched?)
}

/// Wakes the watchers by closing the file. It writes nothing.
fn ring(path: &Path) -> std::io::Result<()> {
    File::options().append(true).create(true).open(path).map(|_| ())
}

/// Rings after a commit. A worker that does not hear it looks soon anyway.
pub(super) fn ring_after_commit(path: &Path) {
    if let Err(error) = ring(path) {
        tracing::debug!(%error, "cannot tell workers that tasks were queued");
    }
}

impl Bell {
    /// Waits until tasks were queued, or for `longest`. Returns which of the two happened.
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
