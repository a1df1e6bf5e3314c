//! Workers as child processes, so that a job that crashes or is killed never takes the server
//! along.

use std::process::Stdio;
use std::time::{Duration, Instant};

use store::{Location, Store, WorkerEnd};
use tokio::process::{Child, Command};
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;
use worker::DeviceKind;

use crate::process::{self, GAVE_UP, own_program};

/// How a server runs its workers.
#[derive(Clone, Debug)]
pub struct WorkerProcesses {
    pub store: Store,
    pub location: Location,
    pub count: usize,
    pub threads: usize,
    /// Flags that say what each offers.
    pub offers: Vec<String>,
    pub device: DeviceKind,
    pub lease_seconds: u64,
    pub log: String,
}

/// A worker that lived this long was healthy: if it dies, the next one starts at once.
const HEALTHY_AFTER: Duration = Duration::from_secs(30);

const FIRST_PAUSE: Duration = Duration::from_millis(200);
const LONGEST_PAUSE: Duration = Duration::from_secs(30);

/// How long workers may take to put down their task: longer than they give it themselves (`worker/src/stop.rs`), since
/// one that has to be killed here says nothing of why.
const STOP_WITHIN: Duration = Duration::from_secs(25);

impl WorkerProcesses {
    /// Keeps `count` workers running until `shutdown`, then until they have ended.
    pub fn spawn(
        self,
        tracker: &TaskTracker,
        shutdown: &CancellationToken,
        kill: &CancellationToken,
    ) {
        for index in 1..=self.count {
            tracker.spawn(self.clone().keep_running(index, shutdown.clone(), kill.clone()));
        }
    }

    async fn keep_running(
        self,
        index: usize,
        shutdown: CancellationToken,
        kill: CancellationToken,
    ) {
        let mut pause = FIRST_PAUSE;
        while !shutdown.is_cancelled() {
            let started = Instant::now();
            match self.start(index) {
                Ok(child) => {
                    tracing::info!(worker = index, pid = child.id(), "worker started");
                    let end = run_to_end(index, child, &shutdown, &kill).await;
                    self.take_back(index, &end).await;
                    match end {
                        End::Died(_) => {}
                        End::GaveUp => continue,
                        End::Stopped | End::Killed => return,
                    }
                }
                Err(error) => tracing::error!(worker = index, %error, "cannot start a worker"),
            }
            if started.elapsed() > HEALTHY_AFTER {
                pause = FIRST_PAUSE;
            }
            tokio::select! {
                () = tokio::time::sleep(pause) => pause = (pause * 2).min(LONGEST_PAUSE),
                () = shutdown.cancelled() => {}
            }
        }
    }

    /// Gives the task of a worker that has ended to another, without waiting for its lease to run out.
    async fn take_back(&self, index: usize, end: &End) {
        let name = self.name(index);
        let taken = match end {
            End::Died(how) => {
                let how = format!("died: {how}");
                self.store.take_back(&name, WorkerEnd::Died(&how)).await
            }
            // It may have been killed before it could put its task down, for which the task is not to blame. One that
            // gave up has ended its attempt, unless the database did not answer.
            End::GaveUp | End::Stopped | End::Killed => {
                self.store.take_back(&name, WorkerEnd::Stopped).await
            }
        };
        if let Err(error) = taken {
            let error = anyhow::Error::new(error);
            tracing::error!(worker = index, "cannot take back its task: {error:#}");
        }
    }

    /// As it is shown beside tasks. Servers that share a database have workers of the same index.
    fn name(&self, index: usize) -> String {
        if self.location.database.is_none() {
            return format!("worker-{index}");
        }
        format!("{}-{}-worker-{index}", process::host(), std::process::id())
    }

    fn start(&self, index: usize) -> std::io::Result<Child> {
        Command::new(own_program()?)
            .arg0("torqued")
            .arg("worker")
            .arg("--data")
            .arg(&self.location.folder)
            .args(["--name", &self.name(index)])
            .args(["--threads", &self.threads.to_string()])
            .args(&self.offers)
            .args(["--device", self.device.name()])
            .args(["--lease-seconds", &self.lease_seconds.to_string()])
            .args(["--log", &self.log])
            .arg("--stop-with-stdin")
            // Training reuses the same large tensors at every step. Holding on to their pages instead
            // of giving them back after 10 ms made 150 steps of the quickstart take 4.5 s, not 5.6.
            .env("MIMALLOC_PURGE_DELAY", "-1")
            // Passwords are no arguments: other users see those.
            .envs(self.location.database.iter().map(|url| ("TORQUED_DATABASE", url.expose())))
            .envs(self.location.objects.iter().map(|url| ("TORQUED_OBJECTS", url.to_string())))
            // Nothing is ever written: the pipe's closing, with or without a farewell of the
            // server, is what tells the worker to stop.
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            // Ctrl-C in the terminal reaches the server alone, which then stops its workers.
            .process_group(0)
            .kill_on_drop(true)
            .spawn()
    }
}

/// How a worker process came to its end.
enum End {
    /// By itself, and how.
    Died(String),
    /// By itself, because its task did not end when it was told to.
    GaveUp,
    Stopped,
    Killed,
}

/// Waits for a worker; asks it to stop on `shutdown`.
async fn run_to_end(
    index: usize,
    mut child: Child,
    shutdown: &CancellationToken,
    kill: &CancellationToken,
) -> End {
    // Taken out, because waiting for a child closes its standard input.
    let stdin = child.stdin.take();
    tokio::select! {
        status = child.wait() => {
            if status.as_ref().is_ok_and(|status| status.code() == Some(GAVE_UP.into())) {
                tracing::warn!(worker = index, "worker ended to end its task, starting another");
                return End::GaveUp;
            }
            let how = status.map_or_else(|error| error.to_string(), |status| status.to_string());
            tracing::warn!(worker = index, how, "worker died, starting another");
            return End::Died(how);
        }
        () = shutdown.cancelled() => {}
    }
    drop(stdin);
    let ended = tokio::select! {
        ended = tokio::time::timeout(STOP_WITHIN, child.wait()) => ended.is_ok(),
        () = kill.cancelled() => false,
    };
    if ended {
        tracing::info!(worker = index, "worker stopped");
        return End::Stopped;
    }
    tracing::warn!(worker = index, "worker killed");
    if let Err(error) = child.kill().await {
        tracing::error!(worker = index, %error, "cannot kill the worker");
    }
    End::Killed
}
